# SPDX-License-Identifier: GPL-3.0-or-later
"""From the leaves of a quadtree to polygons: templates where sides are split, whole faces elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from .fits import Fit
from .limit_surface import limit_values
from .mesh import FloatArray, IndexArray, PolygonMesh
from .quadtree import NONE, Quadtree
from .subdivided_mesh import SubdividedMesh
from .templates import ALL_SPLIT, WHOLE, Transitions, templates, triangle_template

BoolArray = NDArray[np.bool_]

# Quads looked at together, so that what belongs to them stays in the processor's cache.
QUADS_AT_ONCE = 1 << 13


@dataclass(frozen=True)
class Polygons:
    """P polygons of one size k: (P,) the leaf each draws, as a place among the leaves; (P, k) slots; (k,) whether a
    point is the middle of the side at its slot, or else the corner."""

    leaves: IndexArray
    slots: IndexArray
    middles: list[bool]


@dataclass(frozen=True)
class Drawing:
    """A mesh, and the proved distance of each of its faces, (F,) float64.

    clashes: (…,) nodes whose triangles would share an edge with too many others: they have to be split first.
    """

    mesh: SubdividedMesh
    bounds: FloatArray
    clashes: IndexArray


def draw(tree: Quadtree, leaves: IndexArray, fit: Fit, transitions: Transitions, positions: FloatArray) -> Drawing:
    """Draw the leaves (L,) of a tree as they were fitted.

    positions: (V, 3) float64, those of the control mesh in the space that is wanted; the tree's own may be in another.
    """
    polygons = [*_polygons_of_quads(tree, leaves, fit, transitions), *_polygons_of_faces(tree, leaves, transitions)]
    mesh, faces_along, drawn = _assembled(tree, polygons, leaves, positions)
    clashing = drawn[_clashing(tree.mesh, mesh, faces_along)]
    return Drawing(mesh, fit.bounds[drawn], leaves[np.unique(clashing)])


def face_counts(tree: Quadtree, leaves: IndexArray, fit: Fit, transitions: Transitions) -> IndexArray:
    """(L,) how many polygons draw each leaf."""
    quads = tree.is_quad(leaves)
    if transitions is Transitions.NGONS:
        return 1 + (quads & fit.folded)
    sizes = np.array([1, *(len(templates(pattern)[0]) for pattern in range(1, ALL_SPLIT))])
    counts = np.where(quads, sizes[fit.patterns] + fit.folded, 1)
    triangles = np.flatnonzero(tree.slot_counts(leaves) == 3)
    slots = tree.slots(leaves[triangles]).reshape(-1, 3)
    counts[triangles] += tree.hanging(slots).sum(axis=1)
    return counts


def triangles_around(
    tree: Quadtree, leaves: IndexArray, fit: Fit, transitions: Transitions, wanted: BoolArray
) -> tuple[IndexArray, IndexArray, BoolArray]:
    """The triangles that are drawn at the vertices of the wanted ones, (L,) bool, among leaves (L,).

    leaves: all that have a vertex of the wanted ones, and maybe others.

    Returns (T, 3) vertices of the tree, (T,) the leaf of each as a place, and (V,) whether a vertex has no other faces
    than triangles and quads around it, which close up to a disc: not so on boundaries and infinitely sharp creases.
    """
    closed = _is_inside(tree)
    nearby = np.flatnonzero(share_a_vertex(tree, leaves, wanted))
    near, fit_near = leaves[nearby], fit.at(nearby)
    triangles, drawn = [np.zeros((0, 3), dtype=np.intp)], [np.zeros(0, dtype=np.intp)]
    others = _polygons_of_faces(tree, near, transitions)
    of_faces = ((_vertices(tree, block.slots, block.middles), block.leaves) for block in others)
    of_quads = (_as_triangles(tree, block) for block in _polygons_of_quads(tree, near, fit_near, transitions))
    for vertices, of_leaves in chain(of_faces, of_quads):
        if vertices.shape[1] == 3:
            triangles.append(vertices)
            drawn.append(nearby[of_leaves])
        else:
            closed[vertices] = False
    return np.concatenate(triangles), np.concatenate(drawn), closed


def share_a_vertex(tree: Quadtree, leaves: IndexArray, wanted: BoolArray) -> BoolArray:
    """(L,) the leaves that have a vertex of the wanted ones, (L,) bool."""
    marked = np.zeros(len(tree.vertex_edges), dtype=bool)
    slots = tree.slots(leaves[wanted])
    middles = tree.midpoints[tree.slot_edges[slots]]
    marked[tree.slot_vertices[slots]] = True
    marked[middles[tree.hanging(slots)]] = True
    slots = tree.slots(leaves)
    counts = tree.slot_counts(leaves)
    middles = tree.midpoints[tree.slot_edges[slots]]
    touched = marked[tree.slot_vertices[slots]] | (marked[middles] & (middles != NONE))
    return np.logical_or.reduceat(touched, np.cumsum(counts) - counts)


def _is_inside(tree: Quadtree) -> BoolArray:
    """(V,) whether a vertex lies inside a smooth or semi-sharp part of the surface."""
    inside = np.ones(len(tree.vertex_edges), dtype=bool)
    sharp_edges = np.isinf(tree.mesh.edge_sharpness)
    inside[: tree.mesh.vertex_count] = ~np.isinf(tree.mesh.vertex_sharpness)
    inside[tree.mesh.edge_vertices[sharp_edges]] = False
    on_edges = np.flatnonzero(tree.vertex_edges != NONE)
    inside[on_edges] = ~sharp_edges[tree.vertex_edges[on_edges]]
    return inside


def _as_triangles(tree: Quadtree, block: Polygons) -> tuple[IndexArray, IndexArray]:
    """The vertices of polygons, quads as two triangles along their first diagonal, and their leaves."""
    vertices = _vertices(tree, block.slots, block.middles)
    if vertices.shape[1] != 4:
        return vertices, block.leaves
    return vertices[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3), np.repeat(block.leaves, 2)


def _vertices(tree: Quadtree, slots: IndexArray, middles: BoolArray | list[bool]) -> IndexArray:
    return np.where(middles, tree.midpoints[tree.slot_edges[slots]], tree.slot_vertices[slots])


def _polygons_of_quads(tree: Quadtree, leaves: IndexArray, fit: Fit, transitions: Transitions) -> Iterator[Polygons]:
    quads = np.flatnonzero(tree.is_quad(leaves))
    # Patterns and turns are below 16 and 4, so every template in use has a number of its own.
    numbers = (fit.alternatives[quads].astype(np.intp) * 16 + fit.patterns[quads]) * 4 + fit.turns[quads]
    for number in np.flatnonzero(np.bincount(numbers)).tolist():
        chosen = quads[numbers == number]
        pattern, turns = number // 4 % 16, number % 4
        template = templates(pattern)[number // 64]
        if pattern == WHOLE:
            # A quad is drawn along its first diagonal.
            flat = chosen[~fit.folded[chosen]]
            yield _polygons(tree, leaves, flat, [*template[0], template[1][2]], turns)
            chosen = chosen[fit.folded[chosen]]
        elif transitions is Transitions.NGONS:
            yield _polygons(tree, leaves, chosen, _around([bool(pattern >> side & 1) for side in range(4)]), turns)
            continue
        for triangle in template:
            yield _polygons(tree, leaves, chosen, triangle, turns)


def _polygons(
    tree: Quadtree, leaves: IndexArray, chosen: IndexArray, points: Sequence[int], turns: int = 0, size: int = 4
) -> Polygons:
    """Polygons over points of the chosen leaves: corners 0 to size - 1, and from size on the middles of the sides."""
    places = [(point + turns) % size for point in points]
    slots = tree.first_slots(leaves[chosen])[:, None] + np.array(places)
    return Polygons(chosen, slots, [point >= size for point in points])


def _around(split_sides: list[bool]) -> list[int]:
    """The corners 0 to k - 1 of a polygon, each followed by the middle k + corner of its side if that is split."""
    size = len(split_sides)
    return [point for side in range(size) for point in (side, size + side) if point < size or split_sides[side]]


def _polygons_of_faces(tree: Quadtree, leaves: IndexArray, transitions: Transitions) -> Iterator[Polygons]:
    """Faces of the control mesh that are no quads: with a vertex at the middle of every split side."""
    others = np.flatnonzero(~tree.is_quad(leaves))
    sizes = tree.slot_counts(leaves[others])
    for size in np.unique(sizes).tolist():
        of_size = others[sizes == size]
        found, group = np.unique(
            tree.hanging(tree.slots(leaves[of_size])).reshape(-1, size), axis=0, return_inverse=True
        )
        for number, sides in enumerate(found.tolist()):
            chosen = of_size[group.reshape(-1) == number]
            for points in _points_of_face(sides, transitions):
                yield _polygons(tree, leaves, chosen, points, size=size)


def _points_of_face(split_sides: list[bool], transitions: Transitions) -> list[Sequence[int]]:
    """The polygons that draw a face, by which of its sides are split."""
    if len(split_sides) == 3 and any(split_sides) and transitions is Transitions.TRIANGLES:
        return [*triangle_template(sum(1 << side for side in range(3) if split_sides[side]))]
    order = _around(split_sides)
    # A triangle with a fourth point on a side is drawn as a quad, which has to be split from there.
    first = next((place for place, point in enumerate(order) if point >= 3), 0) if len(split_sides) == 3 else 0
    return [order[first:] + order[:first]]


def _assembled(
    tree: Quadtree, polygons: list[Polygons], leaves: IndexArray, positions: FloatArray
) -> tuple[SubdividedMesh, IndexArray, IndexArray]:
    """One mesh of all polygons, in the order of their leaves; (E,) the faces along its edges; (F,) each face's leaf.

    Vertices and edges of the control mesh that have no faces are kept as they are.
    """
    starts, drawn, slots, middles = _in_order(polygons)
    vertices = _vertices(tree, slots, middles)
    loose = np.flatnonzero(tree.mesh.vertex_face_counts == 0)
    used, corner_vertices = _compact(vertices, loose, len(tree.vertex_edges))
    following = np.arange(1, len(vertices) + 1)
    following[starts[1:] - 1] = starts[:-1]
    edge_keys, corner_edges, faces_along = _edges(corner_vertices, corner_vertices[following], len(used))
    base_edges = _base_edges(tree, used, edge_keys)
    loose_edges = np.flatnonzero(tree.mesh.edge_face_counts == 0)
    mesh = SubdividedMesh(
        vertex_points=tree.vertex_points.at(used),
        positions=_positions(tree, used, positions),
        face_starts=starts,
        corner_vertices=corner_vertices,
        corner_edges=corner_edges,
        edge_vertices=np.concatenate(
            [np.stack(np.divmod(edge_keys, len(used)), axis=1), np.searchsorted(used, tree.edge_vertices[loose_edges])]
        ),
        corner_points=tree.slot_points(slots, middles),
        base_faces=tree.base_faces[leaves[drawn]],
        base_edges=np.concatenate([base_edges, loose_edges]),
        base_vertices=np.where(used < tree.mesh.vertex_count, used, NONE),
        vertex_edges=tree.vertex_edges[used],
    )
    return mesh, np.concatenate([faces_along, np.zeros_like(loose_edges)]), drawn


def _in_order(polygons: list[Polygons]) -> tuple[IndexArray, IndexArray, IndexArray, BoolArray]:
    """All polygons in the order of their leaves: (F + 1,) first corners, (F,) leaves, (C,) slots and (C,) middles."""
    sizes = np.concatenate([np.full(len(block.leaves), len(block.middles)) for block in polygons])
    of_leaves = np.concatenate([block.leaves for block in polygons])
    order = np.argsort(of_leaves, kind="stable")
    starts = np.concatenate([[0], np.cumsum(sizes[order])])
    # Where each polygon's corners go, polygon by polygon as they were made.
    target = np.empty(len(order), dtype=np.intp)
    target[order] = starts[:-1]
    places = np.arange(starts[-1]) + np.repeat(target - (np.cumsum(sizes) - sizes), sizes)
    slots = np.empty(starts[-1], dtype=np.intp)
    slots[places] = np.concatenate([block.slots.ravel() for block in polygons])
    middles = np.empty(starts[-1], dtype=bool)
    middles[places] = np.concatenate([np.tile(block.middles, len(block.leaves)) for block in polygons])
    return starts, of_leaves[order], slots, middles


def _positions(tree: Quadtree, used: IndexArray, positions: FloatArray) -> FloatArray:
    """(V, 3) where the used vertices lie; those without faces stay where they are."""
    points = tree.vertex_points.at(used)
    on_surface = np.flatnonzero(points.corners != NONE)
    found = np.empty((len(used), 3))
    found[on_surface] = limit_values(tree.mesh, positions, points.at(on_surface))
    loose = np.flatnonzero(points.corners == NONE)
    found[loose] = positions[used[loose]]
    return found


def _compact(vertices: IndexArray, loose: IndexArray, count: int) -> tuple[IndexArray, IndexArray]:
    """The vertices that are used, and the loose ones, in ascending order; the used ones numbered by them."""
    is_used = np.zeros(count, dtype=bool)
    is_used[vertices] = True
    is_used[loose] = True
    return np.flatnonzero(is_used), (np.cumsum(is_used) - 1)[vertices]


def _edges(first: IndexArray, second: IndexArray, count: int) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Edges as keys low · count + high, ascending; the edge of each half-edge; how many half-edges each has."""
    keys = np.minimum(first, second) * count + np.maximum(first, second)
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    new = np.ones(len(keys), dtype=bool)
    new[1:] = ordered[1:] != ordered[:-1]
    edge_of = np.empty(len(keys), dtype=np.intp)
    edge_of[order] = np.cumsum(new) - 1
    return ordered[new], edge_of, np.diff(np.flatnonzero(new), append=len(keys))


def _base_edges(tree: Quadtree, used: IndexArray, edge_keys: IndexArray) -> IndexArray:
    """(E,) the edge of the control mesh each edge lies on, or NONE."""
    new = np.full(len(tree.vertex_edges), NONE, dtype=np.intp)
    new[used] = np.arange(len(used))
    along = np.flatnonzero((tree.base_edges != NONE) & (tree.edge_children == NONE))
    ends = np.sort(new[tree.edge_vertices[along]], axis=1)
    there = ends[:, 0] != NONE
    found = np.full(len(edge_keys), NONE, dtype=np.intp)
    places = np.searchsorted(edge_keys, ends[there, 0] * len(used) + ends[there, 1])
    found[places] = tree.base_edges[along[there]]
    return found


def _clashing(mesh: PolygonMesh, drawn: SubdividedMesh, faces_along: IndexArray) -> BoolArray:
    """(F,) the faces with an edge that has other faces than it should: two inside a face, as many as before elsewhere.

    Two quads over the same two opposite corners, split along the diagonal between these, would do that.
    """
    expected = np.where(drawn.base_edges == NONE, 2, mesh.edge_face_counts[drawn.base_edges])
    bad = (faces_along != expected)[drawn.corner_edges]
    return np.logical_or.reduceat(bad, drawn.face_starts[:-1])
