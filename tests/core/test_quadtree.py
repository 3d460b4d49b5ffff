# SPDX-License-Identifier: GPL-3.0-or-later
"""The quadtree against one in plain Python, which knows no edges and no parameters, only where points lie.

There a point is its weights on the control mesh's vertices, as exact fractions: the middle of a side is the mean of its
ends, the centre of a node that of its corners. Points of the same weights on an edge are the same, whatever face they
are seen from; so sides are the same if their ends are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccdepth_addon.core.adaptive.quadtree import NONE, Quadtree
from ccdepth_addon.core.arrays.types import IndexArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.surface_points import SurfacePoints
from tests import meshes

Weights = frozenset[tuple[int, Fraction]]
Place = tuple[int, Weights]
Side = frozenset[Place]

MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "single quad": lambda: meshes.grid(1, 1),
    "grid": lambda: meshes.grid(2, 2),
    "cube": meshes.cube,
    "tetrahedron": meshes.tetrahedron,
    "n-gons": lambda: meshes.cylinder(5),
    "triangles and quads": meshes.triangles_and_quads,
    "valence 2": meshes.valence_two,
    "three faces on an edge": meshes.three_faces_on_an_edge,
    "fin through": meshes.fin_through,
    "face soup": lambda: meshes.face_soup(share=0.2),
    "flipped face": meshes.flipped_face,
    "Möbius strip": lambda: meshes.mobius_strip(3),
    "bow tie": meshes.bow_tie,
    "ring of quads on opposite corners": meshes.ring_of_quads_on_opposite_corners,
    "pillow of triangles": lambda: meshes.pillow(3),
    "pillow of quads": lambda: meshes.pillow(4),
    "pillow of pentagons": lambda: meshes.pillow(5),
    "doubled face": meshes.doubled_face,
    "loose vertices": meshes.loose_edge_at_a_face_vertex,
}

MOST_NODES = 150


@cache
def build(name: str) -> PolygonMesh:
    return meshes.to_polygon_mesh(MESHES[name]())


# The tree in plain Python


def mean(points: Iterable[Weights]) -> Weights:
    given, sums = list(points), dict[int, Fraction]()
    for point in given:
        for vertex, weight in point:
            sums[vertex] = sums.get(vertex, Fraction()) + weight / len(given)
    return frozenset(sums.items())


@dataclass
class Node:
    face: int
    level: int
    corners: list[Weights]
    children: list[Node] = field(default_factory=list)

    def middle(self, slot: int) -> Weights:
        """Of the side from a corner to the next."""
        return mean([self.corners[slot], self.corners[(slot + 1) % len(self.corners)]])

    def place(self, point: Weights) -> Place:
        """What tells a point from all others: those inside faces belong to the face."""
        return (NONE if len(point) <= 2 else self.face), point

    def side(self, slot: int) -> Side:
        """The side from a corner to the next, whichever way round."""
        ends = self.corners[slot], self.corners[(slot + 1) % len(self.corners)]
        return frozenset(self.place(end) for end in ends)

    def halves(self, slot: int) -> list[Side]:
        """The half at the corner, and the other."""
        ends = self.corners[slot], self.corners[(slot + 1) % len(self.corners)]
        middle = self.place(self.middle(slot))
        return [frozenset([self.place(end), middle]) for end in ends]

    def split(self) -> None:
        centre = mean(self.corners)
        self.children = [
            Node(self.face, self.level + 1, [corner, self.middle(slot), centre, self.middle(slot - 1)])
            for slot, corner in enumerate(self.corners)
        ]


def roots_of(mesh: PolygonMesh) -> list[Node]:
    """One for each face."""
    faces = np.split(mesh.corner_vertices, mesh.face_starts[1:-1])
    return [
        Node(number, 0, [frozenset([(vertex, Fraction(1))]) for vertex in face.tolist()])
        for number, face in enumerate(faces)
    ]


def numbered(tree: Quadtree, roots: list[Node]) -> dict[int, Node]:
    """The nodes by the number they have in the tree: the children of a node follow its slots."""
    waiting = list(enumerate(roots))
    found = {}
    while waiting:
        number, node = waiting.pop()
        found[number] = node
        first = int(tree.first_child[number])
        assert (first == NONE) == (not node.children)
        assert np.all(tree.parents[first + np.arange(len(node.children))] == number)
        waiting += [(first + slot, child) for slot, child in enumerate(node.children)]
    assert sorted(found) == list(range(len(tree.first_child)))
    return found


def split_both(tree: Quadtree, roots: list[Node], chosen: IndexArray) -> None:
    nodes = numbered(tree, roots)
    for number in chosen.tolist():
        nodes[number].split()
    tree.split(chosen)


# The two next to each other


def weights_of(mesh: PolygonMesh, points: SurfacePoints) -> Iterator[Weights]:
    """The points by bilinear interpolation in their quarters: corner, middle after it, centroid, middle before it."""
    roots = roots_of(mesh)
    centroids = [mean(root.corners) for root in roots]
    for corner, (u, v) in zip(points.corners.tolist(), points.parameters.tolist(), strict=True):
        root = roots[int(mesh.corner_faces[corner])]
        slot = corner - int(mesh.face_starts[root.face])
        assert 0 <= u <= 1
        assert 0 <= v <= 1
        x, y = Fraction(u), Fraction(v)
        quarter = [root.corners[slot], root.middle(slot), centroids[root.face], root.middle(slot - 1)]
        sums: dict[int, Fraction] = {}
        for part, share in zip(quarter, ((1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y), strict=True):
            for vertex, weight in part:
                sums[vertex] = sums.get(vertex, Fraction()) + share * weight
        yield frozenset((vertex, weight) for vertex, weight in sums.items() if weight)


def assert_same(tree: Quadtree, roots: list[Node]) -> None:
    """The whole tree is the one in plain Python."""
    nodes = numbered(tree, roots)
    assert_nodes(tree, nodes)
    vertices = assert_vertices(tree, nodes)
    assert_edges(tree, nodes, vertices)
    assert_slot_points(tree, nodes)


def slots_of(tree: Quadtree, nodes: dict[int, Node]) -> Iterator[tuple[int, Node, int]]:
    """(slot of the tree, its node, place in the node), each once."""
    numbers = np.array(sorted(nodes))
    for first, number in zip(tree.first_slots(numbers).tolist(), numbers.tolist(), strict=True):
        for place in range(len(nodes[number].corners)):
            yield first + place, nodes[number], place


def assert_nodes(tree: Quadtree, nodes: dict[int, Node]) -> None:
    numbers = np.array(sorted(nodes))
    in_order = [nodes[number] for number in numbers.tolist()]
    assert tree.levels.tolist() == [node.level for node in in_order]
    assert tree.base_faces.tolist() == [node.face for node in in_order]
    assert tree.leaves().tolist() == [number for number in numbers.tolist() if not nodes[number].children]
    assert tree.leaf_count == len(tree.leaves())
    assert np.all(tree.parents[: tree.mesh.face_count] == NONE)
    assert tree.slot_counts(numbers).tolist() == [len(node.corners) for node in in_order]
    assert tree.is_quad(numbers).tolist() == [len(node.corners) == 4 for node in in_order]
    # Every slot belongs to one node, and a node's slots follow each other, whichever nodes are asked for.
    assert sorted(slot for slot, _, _ in slots_of(tree, nodes)) == list(range(len(tree.slot_vertices)))
    some = np.random.default_rng(len(numbers)).permutation(numbers)[: len(numbers) // 2 + 1]
    starts = tree.first_slots(some).tolist()
    expected = [
        start + place
        for start, number in zip(starts, some.tolist(), strict=True)
        for place in range(len(nodes[number].corners))
    ]
    assert tree.slots(some).tolist() == expected


def assert_vertices(tree: Quadtree, nodes: dict[int, Node]) -> dict[Place, int]:
    """One vertex for each point, and none besides but the mesh's without faces; the vertices by point."""
    mesh = tree.mesh
    found: dict[Place, int] = {}
    for slot, node, place in slots_of(tree, nodes):
        vertex = int(tree.slot_vertices[slot])
        assert found.setdefault(node.place(node.corners[place]), vertex) == vertex
    numbers = sorted(found.values())
    assert numbers == sorted(set(numbers))
    loose = np.flatnonzero(tree.vertex_points(np.arange(len(tree.vertex_edges))).corners == NONE).tolist()
    assert sorted(numbers + loose) == list(range(len(tree.vertex_edges)))
    assert loose == np.flatnonzero(mesh.vertex_face_counts == 0).tolist()

    points = tree.vertex_points(np.array(numbers))
    weights = dict(zip(numbers, weights_of(mesh, points), strict=True))
    faces = dict(zip(numbers, mesh.corner_faces[points.corners].tolist(), strict=True))
    edges = edges_by_ends(mesh)
    for (face, point), vertex in found.items():
        assert weights[vertex] == point
        assert face in (NONE, faces[vertex])
        # Points with weights on two vertices lie on the edge between them.
        on_edge = edges[frozenset(corner for corner, _ in point)] if len(point) == 2 else NONE
        assert tree.vertex_edges[vertex] == on_edge
    return found


def edges_by_ends(mesh: PolygonMesh) -> dict[frozenset[int], int]:
    return {frozenset(ends): edge for edge, ends in enumerate(mesh.edge_vertices.tolist())}


def assert_edges(tree: Quadtree, nodes: dict[int, Node], vertices: dict[Place, int]) -> None:
    """One edge for each side that there is, and its halves where some node along it is split."""
    edges: dict[Side, int] = {}
    split = {node.side(slot) for node in nodes.values() if node.children for slot in range(len(node.corners))}
    base = edges_by_ends(tree.mesh)
    counts, deeper = tree.sides(np.arange(len(tree.first_child)))
    numbers = np.array(sorted(nodes))
    all_slots = tree.slots(numbers)
    hanging = dict(zip(all_slots.tolist(), tree.hanging(all_slots).tolist(), strict=True))
    starts = dict(zip(numbers.tolist(), tree.first_slots(numbers).tolist(), strict=True))
    halves_of_split: set[Side] = set()
    for number, node in nodes.items():
        sides = [node.side(slot) for slot in range(len(node.corners))]
        halves = [node.halves(slot) for slot in range(len(node.corners))]
        assert counts[number] == sum(side in split for side in sides)
        assert deeper[number] == any(half in split for both in halves for half in both)
        for slot, side in enumerate(sides):
            edge = int(tree.slot_edges[starts[number] + slot])
            assert edges.setdefault(side, edge) == edge
            assert hanging[starts[number] + slot] == (side in split)
            assert {*tree.edge_vertices[edge].tolist()} == {vertices[end] for end in side}
            touched = frozenset(vertex for _, point in side for vertex, _ in point)
            assert tree.base_edges[edge] == (base[touched] if len(touched) == 2 else NONE)
            assert_halves(tree, edge, vertices[node.place(node.middle(slot))] if side in split else None)
            halves_of_split.update(halves[slot] if side in split else [])
    # Every edge is some node's side or half of one that is split.
    assert len(set(edges.values())) == len(edges)
    assert len(tree.edge_vertices) == len(set(edges) | halves_of_split)


def assert_halves(tree: Quadtree, edge: int, middle: int | None) -> None:
    """The half at the edge's first vertex, then the other; nothing where there is no middle."""
    if middle is None:
        assert tree.edge_children[edge] == tree.midpoints[edge] == NONE
        return
    first, second = tree.edge_vertices[edge].tolist()
    halves = tree.edge_vertices[tree.edge_children[edge] + np.arange(2)].tolist()
    assert halves == [[first, middle], [middle, second]]
    assert tree.midpoints[edge] == middle


def assert_slot_points(tree: Quadtree, nodes: dict[int, Node]) -> None:
    """Corners and middles of sides are where they should be, seen from their own face, asked for in any order."""
    numbers = np.random.default_rng(len(nodes)).permutation(sorted(nodes))
    sizes = tree.slot_counts(numbers)
    for size in np.unique(sizes).tolist():
        of_size = numbers[sizes == size]
        wanted = [(place, middle) for place in range(size) for middle in (False, True)]
        for (place, middle), points in zip(wanted, tree.points_at(of_size, wanted), strict=True):
            found = weights_of(tree.mesh, points)
            faces = tree.mesh.corner_faces[points.corners].tolist()
            for number, weights, face in zip(of_size.tolist(), found, faces, strict=True):
                node = nodes[number]
                assert face == node.face
                assert weights == (node.middle(place) if middle else node.corners[place])


# Tests


def picked(tree: Quadtree, seed: int, share: float) -> IndexArray:
    """A share of the leaves of a tree that stays small, in some order, but at least one."""
    leaves = np.random.default_rng(seed).permutation(tree.leaves())
    room = max(1, (MOST_NODES - len(tree.first_child)) // 4)
    return leaves[: min(room, max(1, round(share * len(leaves))))]


@pytest.mark.parametrize("name", MESHES)
def test_faces_split_all_at_once_or_one_by_one(name: str) -> None:
    """In whatever order, from all faces of an edge in one call or not, what there is in the end is the same."""
    mesh = build(name)
    tree, roots = Quadtree(mesh), roots_of(mesh)
    assert_same(tree, roots)
    split_both(tree, roots, tree.leaves())
    assert_same(tree, roots)
    tree, roots = Quadtree(mesh), roots_of(mesh)
    for face in np.random.default_rng(2).permutation(mesh.face_count).tolist():
        split_both(tree, roots, np.array([face]))
    assert_same(tree, roots)
    assert np.all(tree.hanging(tree.slots(np.arange(mesh.face_count))))


names, seeds = st.sampled_from(list(MESHES)), st.integers(0, 2**32 - 1)
sequences = st.lists(st.tuples(seeds, st.sampled_from([0.05, 0.2, 0.5, 1.0])), min_size=1, max_size=5)


@given(name=names, sequence=sequences)
def test_random_splits(name: str, sequence: list[tuple[int, float]]) -> None:
    """Some of the leaves again and again, balanced or not, in any order."""
    mesh = build(name)
    tree, roots = Quadtree(mesh), roots_of(mesh)
    for seed, share in sequence:
        split_both(tree, roots, picked(tree, seed, share))
    assert_same(tree, roots)


@pytest.mark.parametrize("name", ["single quad", "tetrahedron", "n-gons", "three faces on an edge", "Möbius strip"])
def test_deep_at_a_corner_and_beside_the_centre(name: str) -> None:
    """Points stay exact however deep; each face along the edges there knows what is split across."""
    mesh = build(name)
    for path in ([0] * 24, [0] + [2] * 24, [1, 3] * 12):
        tree, roots = Quadtree(mesh), roots_of(mesh)
        node = 0
        for slot in path:
            split_both(tree, roots, np.array([node]))
            node = int(tree.first_child[node]) + slot
        assert tree.levels.max() == len(path)
        assert_same(tree, roots)
        # Of a whole face and a far smaller one beside it, only the whole one's split side knows the vertex they share.
        for level in (0, 1, 3):
            others = tree.leaves()[tree.levels[tree.leaves()] == level]
            assert_share_vertices(tree, tree.leaves(), others)
            assert_share_vertices(tree, others, tree.leaves()[tree.levels[tree.leaves()] > level + 1])


@given(name=names, sequence=sequences, seed=seeds, share=st.sampled_from([0.0, 0.1, 0.5, 1.0]))
def test_leaves_share_a_vertex_as_their_sets_of_vertices_do(
    name: str, sequence: list[tuple[int, float]], seed: int, share: float
) -> None:
    tree = Quadtree(build(name))
    for each in sequence:
        tree.split(picked(tree, *each))
    generator = np.random.default_rng(seed)
    leaves = generator.permutation(tree.leaves())
    assert_share_vertices(tree, leaves, leaves[generator.random(len(leaves)) < share])


def assert_share_vertices(tree: Quadtree, leaves: IndexArray, others: IndexArray) -> None:
    marked: set[int] = set().union(*(vertices_of(tree, node) for node in others.tolist()))
    expected = [bool(vertices_of(tree, node) & marked) for node in leaves.tolist()]
    assert tree.share_a_vertex(leaves, others).tolist() == expected


def vertices_of(tree: Quadtree, node: int) -> set[int]:
    """Those of a node, with the middles of its split sides."""
    slots = tree.slots(np.array([node]))
    return {*tree.slot_vertices[slots].tolist(), *tree.midpoints[tree.slot_edges[slots]].tolist()} - {NONE}


@given(
    name=names,
    sequence=sequences,
    default=st.sampled_from([np.int8(-1), np.int32(7), np.float64(np.inf), np.bool_(True)]),
    reserved=st.integers(0, 2000),
)
def test_columns_grow_with_the_tree(
    name: str, sequence: list[tuple[int, float]], default: np.generic, reserved: int
) -> None:
    """Values that were written stay, and new nodes and vertices have the default, with memory reserved or without."""
    tree = Quadtree(build(name))
    of_nodes, of_vertices = tree.add_column(default), tree.add_vertex_column(default)
    expected_nodes, expected_vertices = of_nodes.values.copy(), of_vertices.values.copy()
    for seed, share in sequence:
        generator = np.random.default_rng(seed)
        for column, expected in ((of_nodes, expected_nodes), (of_vertices, expected_vertices)):
            chosen = generator.random(len(expected)) < 0.5
            values = generator.integers(0, 2, len(expected)).astype(default.dtype)
            column.values[chosen] = expected[chosen] = values[chosen]
        tree.reserve(reserved)
        tree.split(picked(tree, seed, share))
        late = tree.add_column(default)
        expected_nodes = np.append(expected_nodes, np.full(len(tree.first_child) - len(expected_nodes), default))
        more = len(tree.vertex_edges) - len(expected_vertices)
        expected_vertices = np.append(expected_vertices, np.full(more, default))
        assert of_nodes.values.dtype == of_vertices.values.dtype == default.dtype
        np.testing.assert_array_equal(of_nodes.values, expected_nodes)
        np.testing.assert_array_equal(of_vertices.values, expected_vertices)
        np.testing.assert_array_equal(late.values, np.full(len(expected_nodes), default))


ROUNDS = 8


@pytest.mark.parametrize("name", MESHES)
def test_only_leaves_beside_change_their_sides(name: str) -> None:
    """Random splits, one after another, now many leaves and now few, without any balance."""
    tree = Quadtree(build(name))
    generator = np.random.default_rng(7)
    for turn in range(ROUNDS):
        leaves = tree.leaves()
        chosen = np.sort(generator.choice(leaves, 1 + len(leaves) // (2 + 3 * (turn % 3)), replace=False))
        kept = np.setdiff1d(leaves, chosen)
        before = np.stack(tree.sides(kept))
        tree.split(chosen)
        beside = tree.leaves_beside(chosen)
        after = np.stack(tree.sides(kept))
        np.testing.assert_array_equal(after, np.stack(tree.sides(np.arange(len(tree.first_child))))[:, kept])
        # Splits are never undone.
        assert np.all(after >= before)
        assert np.all(np.isin(kept[np.any(after > before, axis=0)], beside))
        assert beside.tolist() == beside_by_brute_force(tree, chosen, leaves)


def beside_by_brute_force(tree: Quadtree, nodes: IndexArray, leaves_before: IndexArray) -> list[int]:
    """New leaves, and those with a side that is a side of the nodes or has one for a half."""
    edges = tree.slot_edges[tree.slots(nodes)]
    halves = tree.edge_children
    wholes = np.flatnonzero(np.isin(halves, edges) | np.isin(np.where(halves == NONE, NONE, halves + 1), edges))
    concerned = np.concatenate([edges, wholes])
    return [
        leaf
        for leaf in tree.leaves().tolist()
        if leaf not in leaves_before or np.any(np.isin(tree.slot_edges[tree.slots(np.array([leaf]))], concerned))
    ]
