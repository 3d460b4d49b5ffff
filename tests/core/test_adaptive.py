# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: sound on meshes of every kind, as near as proved, of few faces, refused before it is huge."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

from ccdepth_addon.core.adaptive import planner
from ccdepth_addon.core.adaptive.cells.cell_store import some
from ccdepth_addon.core.adaptive.cells.control_faces import cells_of_faces
from ccdepth_addon.core.adaptive.cells.patch_cells import BicubicCells
from ccdepth_addon.core.adaptive.leaf_approximation import LeafApproximation
from ccdepth_addon.core.adaptive.leaf_bounds.star_bounds import star_bounds
from ccdepth_addon.core.adaptive.neighbour_bounds import MORE_RINGS
from ccdepth_addon.core.adaptive.plan import TooManyFacesError
from ccdepth_addon.core.adaptive.planner import AdaptiveMesh, count_faces, subdivide_adaptively
from ccdepth_addon.core.adaptive.quadtree import NONE, Quadtree
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import Transitions
from ccdepth_addon.core.adaptive.tessellation import TessellationPlan, plan_tessellation, triangles_around
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.evaluation import limit_values
from ccdepth_addon.core.surface.limit_normals import limit_normals
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from ccdepth_addon.core.surface.surface_points import SurfacePoints
from tests import meshes, soundness

MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "single quad": lambda: meshes.grid(1, 1),
    "cube": meshes.cube,
    "landscape": lambda: meshes.landscape(4, 3),
    "torus": lambda: meshes.torus(7, 5),
    "n-gons": lambda: meshes.bumpy(meshes.cylinder(7), 0.1),
    "triangles and quads": meshes.triangles_and_quads,
    "triangles": lambda: meshes.bipyramid(5),
    "tetrahedron": meshes.tetrahedron,
    "concave faces": meshes.concave_faces,
    "collapsed faces": lambda: meshes.with_collapsed_faces(meshes.landscape(5, 4)),
    "collapsed n-gons": lambda: meshes.with_collapsed_faces(meshes.bumpy(meshes.cylinder(7), 0.1)),
    "valences 3 and 7": lambda: meshes.trapezohedron(7),
    "valences 2 and 12": meshes.valences_two_and_twelve,
    "valence 64": lambda: meshes.fan(64, 1),
    "valence 360": lambda: meshes.fan(360, 1),
    "three faces on an edge": meshes.three_faces_on_an_edge,
    "fin through": meshes.fin_through,
    "face soup": meshes.face_soup,
    "flipped face": meshes.flipped_face,
    "bow tie": meshes.bow_tie,
    "bow tie inside": meshes.bow_tie_inside,
    "boundary touching inside": meshes.boundary_touching_inside,
    "two cubes sharing an edge": meshes.two_cubes_sharing_an_edge,
    "two cubes sharing a vertex": meshes.two_cubes_sharing_a_vertex,
    "Möbius strip": meshes.mobius_strip,
    "two quads on opposite corners": meshes.two_quads_on_opposite_corners,
    "ring of quads on opposite corners": meshes.ring_of_quads_on_opposite_corners,
    "pillow of triangles": lambda: meshes.pillow(3),
    "pillow of quads": lambda: meshes.pillow(4),
    "pillow of pentagons": lambda: meshes.pillow(5),
    "doubled face": meshes.doubled_face,
    "loose edges": meshes.loose_edge_at_a_face_vertex,
    "creased cube": meshes.creased_cube,
    "sharp vertices": meshes.corner_creased_cube,
    "random creases": lambda: meshes.with_random_creases(meshes.landscape(3, 2), share=0.4),
    "n-gons with creases": lambda: meshes.creased(
        meshes.cylinder(5), {(0, 1): 0.4, (5, 6): 1.0, (1, 6): 0.5}, {3: 0.3}
    ),
}

every_mesh = pytest.mark.parametrize("name", MESHES)

# Both faces of these are the same surface, all of whose points are there twice.
COINCIDENT = {"pillow of triangles", "pillow of quads", "pillow of pentagons", "doubled face"}

# Which take longer than others: at the first tolerance alone.
SLOW = {"valence 360", "valence 64", "random creases", "n-gons with creases", "face soup", "creased cube"}

# In parts of the diagonal: some levels, most faces whole, and as graded as takes little time.
TOLERANCES = {Mode.ADAPTIVE: (0.05, 0.3, 0.015), Mode.PER_FACE: (0.1, 0.3, 0.05)}

MOST_FACES = 1_000_000


@cache
def build(name: str) -> PolygonMesh:
    return apply_boundary_rule(meshes.to_polygon_mesh(MESHES[name]()), smooth_corners=True)


def diagonal(mesh: PolygonMesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))


def request_of(
    mesh: PolygonMesh,
    tolerance: float,
    mode: Mode = Mode.ADAPTIVE,
    transitions: Transitions = Transitions.TRIANGLES,
    most_faces: int = MOST_FACES,
) -> AdaptiveRequest:
    """tolerance: in parts of the diagonal."""
    return AdaptiveRequest(tolerance * diagonal(mesh), mode, transitions, most_faces)


def subdivided(mesh: PolygonMesh, request: AdaptiveRequest) -> AdaptiveMesh:
    return subdivide_adaptively(mesh, request, mesh.positions)


# Sound


@pytest.mark.parametrize("transitions", Transitions)
@pytest.mark.parametrize("mode", Mode)
@every_mesh
def test_sound(name: str, mode: Mode, transitions: Transitions) -> None:
    mesh = build(name)
    for tolerance in TOLERANCES[mode][: 1 if name in SLOW else 3]:
        request = request_of(mesh, tolerance, mode, transitions)
        found = subdivided(mesh, request)
        soundness.assert_sound(mesh, found.mesh)
        if name not in COINCIDENT:
            soundness.assert_nothing_degenerate(found.mesh)
        if transitions is Transitions.TRIANGLES:
            soundness.assert_no_thin_triangles(mesh, found.mesh)
        assert_corners_meet(mesh, found)
        assert np.all(found.bounds <= request.limit)
    assert count_faces(mesh, request) == len(found.bounds)


def assert_corners_meet(mesh: PolygonMesh, found: AdaptiveMesh) -> None:
    """Every vertex is where each of its faces says it is, and vertices of the base mesh are their limits."""
    made = found.mesh
    # A point seen from another face is another sum of the same products, some dozens for each of its levels.
    rounding = 1e3 * np.finfo(np.float64).eps * np.abs(mesh.positions).max()
    points = limit_values(mesh, mesh.positions, made.corner_points)
    np.testing.assert_allclose(points, made.positions[made.corner_vertices], rtol=0, atol=rounding)


@pytest.mark.parametrize("name", ["n-gons", "valences 3 and 7", "landscape", "sharp vertices", "valence 64"])
def test_sound_at_a_fine_tolerance(name: str) -> None:
    mesh = build(name)
    found = subdivided(mesh, request_of(mesh, 1e-3))
    soundness.assert_sound(mesh, found.mesh)
    soundness.assert_nothing_degenerate(found.mesh)
    soundness.assert_no_thin_triangles(mesh, found.mesh)


def test_sound_where_leaves_are_split_as_soon_as_they_are_made() -> None:
    """Beside a pole that is much deeper, by balance, before their first approximation."""
    mesh = build("valence 360")
    found = subdivided(mesh, request_of(mesh, 0.02))
    soundness.assert_sound(mesh, found.mesh)
    assert np.all(found.bounds <= 0.02 * diagonal(mesh))


@pytest.mark.parametrize("name", ["cube", "torus", "n-gons", "valences 3 and 7", "random creases", "landscape"])
def test_faces_look_the_way_of_the_surface(name: str) -> None:
    mesh = build(name)
    found = subdivided(mesh, request_of(mesh, 1e-3))
    normals, _ = soundness.newell_normals(found.mesh)
    of_surface = limit_normals(mesh, found.mesh.corner_points)
    towards = np.einsum("ij,ij->i", of_surface, normals[soundness.corner_faces(found.mesh)])
    sums = np.add.reduceat(towards, found.mesh.face_starts[:-1])
    assert np.all(sums > 0)


# Near


def triangles_of(mesh: PolygonMesh, found: AdaptiveMesh) -> tuple[IndexArray, IndexArray]:
    """(T, 3) corners of the triangles that faces with three or four corners are drawn as, quads along their first
    diagonal, and (T,) the face of each; without the faces of base faces that are no quads."""
    made = found.mesh
    of_quad = mesh.face_sizes[made.base_faces] == 4
    sizes = soundness.sizes(made)
    blocks, faces = [], []
    for size, places in ((3, [[0, 1, 2]]), (4, [[0, 1, 2], [0, 2, 3]])):
        chosen = np.flatnonzero((sizes == size) & of_quad)
        for corners in places:
            blocks.append(made.face_starts[chosen][:, None] + corners)
            faces.append(chosen)
    return np.concatenate(blocks), np.concatenate(faces)


def from_square(mesh: PolygonMesh, faces: IndexArray, places: FloatArray) -> SurfacePoints:
    """Points (N, 2) in the unit squares of quads as points of the surface; those on two quarters are in either."""
    right, upper = places[:, 0] > 0.5, places[:, 1] > 0.5
    corner = np.where(upper, np.where(right, 2, 3), np.where(right, 1, 0))
    square = soundness.SQUARE
    offsets = 2 * (places - square[corner])
    along, across = square[(corner + 1) % 4] - square[corner], square[corner - 1] - square[corner]
    parameters = np.stack([np.einsum("ij,ij->i", offsets, side) for side in (along, across)], axis=1)
    return SurfacePoints(mesh.face_starts[faces] + corner, parameters)


STEPS = 8


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize(
    "name",
    [
        "cube",
        "n-gons",
        "valences 3 and 7",
        "valences 2 and 12",
        "landscape",
        "flipped face",
        "fin through",
        "bow tie inside",
        "two cubes sharing a vertex",
        "sharp vertices",
        "Möbius strip",
        "creased cube",
    ],
)
def test_triangles_are_as_near_as_proved(name: str, mode: Mode) -> None:
    """Distances from the surface of the same base face, at equal parameters or elsewhere, on quads."""
    mesh = build(name)
    for tolerance in TOLERANCES[mode][:1]:
        found = subdivided(mesh, request_of(mesh, tolerance, mode))
        corners, faces = triangles_of(mesh, found)
        i, j = np.divmod(np.arange((STEPS + 1) ** 2), STEPS + 1)
        inside = i + j <= STEPS
        weights = np.stack([i, j, STEPS - i - j], axis=1)[inside] / STEPS
        places = weights @ soundness.in_square(mesh, found.mesh.corner_points)[corners]
        drawn = weights @ found.mesh.positions[found.mesh.corner_vertices[corners]]
        of_points = np.repeat(found.mesh.base_faces[faces], len(weights))
        surface = limit_values(mesh, mesh.positions, from_square(mesh, of_points, places.reshape(-1, 2)))
        distances = np.linalg.norm(drawn - surface.reshape(drawn.shape), axis=2)
        # Rounding, of some dozens of products of coordinates.
        bounds = found.bounds[faces] + 1e-13 * diagonal(mesh)
        farther = np.nonzero(distances > bounds[:, None])
        of_farther = found.mesh.base_faces[faces[farther[0]]]
        distances[farther] = nearest(mesh, of_farther, places[farther], drawn[farther], bounds[farther[0]])
        assert np.all(distances.max(axis=1) <= bounds)
        assert np.all(found.bounds <= tolerance * diagonal(mesh))


SAMPLES = 32
STARTS = 16


def nearest(
    mesh: PolygonMesh, faces: IndexArray, places: FloatArray, points: FloatArray, bounds: FloatArray
) -> FloatArray:
    """(N,) distances of points from the surface of their faces at most: found by looking around places (N, 2), and
    where that is farther than bounds (N,), around the nearest samples of all of the face, which may be folded."""
    distances = refined(mesh, faces, places, points)
    left = np.flatnonzero(distances > bounds)
    along = np.linspace(0, 1, SAMPLES + 1)
    grid = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)
    for face in np.unique(faces[left]).tolist():
        own = left[faces[left] == face]
        surface = limit_values(mesh, mesh.positions, from_square(mesh, np.full(len(grid), face), grid))
        starts = np.linalg.norm(surface - points[own, None], axis=2).argsort(axis=1)[:, :STARTS]
        again = np.repeat(own, STARTS)
        found = refined(mesh, faces[again], grid[starts.ravel()], points[again])
        distances[own] = np.minimum(distances[own], found.reshape(-1, STARTS).min(axis=1))
    return distances


def refined(mesh: PolygonMesh, faces: IndexArray, places: FloatArray, points: FloatArray) -> FloatArray:
    """(N,) distances of points from the surface near places (N, 2) of their faces."""
    distances = np.full(len(points), np.inf)
    beside = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]])
    for step in range(4, 20):
        tried = np.clip(places[:, None] + np.ldexp(beside, -step), 0, 1)
        on = from_square(mesh, np.repeat(faces, len(beside)), tried.reshape(-1, 2))
        surface = limit_values(mesh, mesh.positions, on).reshape(*tried.shape[:2], 3)
        away = np.linalg.norm(surface - points[:, None], axis=2)
        best = away.argmin(axis=1)
        places, distances = tried[np.arange(len(best)), best], away[np.arange(len(best)), best]
    return distances


# Finished

# Rounding, of bounds that are worked out twice, among others then.
SAME = 1e-9


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize(
    "name", ["cube", "torus", "n-gons", "triangles and quads", "valences 3 and 7", "landscape", "fin through"]
)
def test_finished_tree(name: str, mode: Mode, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tessellated tree is balanced; its approximations and bounds belong to its sides and neighbours as they are.

    While a tree grows only what may have changed is evaluated; here the whole tree is, from the start.
    """
    mesh = build(name)
    for tolerance in (0.02, 2e-3) if mode is Mode.ADAPTIVE else (0.05,):
        drawn: list[tuple[Quadtree, IndexArray, LeafApproximation]] = []

        def recorded(
            tree: Quadtree,
            leaves: IndexArray,
            approximation: LeafApproximation,
            transitions: Transitions,
            drawn: Any = drawn,
        ) -> TessellationPlan:
            drawn.append((tree, leaves, approximation))
            return plan_tessellation(tree, leaves, approximation, transitions)

        monkeypatch.setattr(planner, "plan_tessellation", recorded)
        request = request_of(mesh, tolerance, mode)
        subdivided(mesh, request)
        for tree, leaves, approximation in drawn:
            np.testing.assert_array_equal(np.sort(leaves), tree.leaves())
            assert_approximated_as_it_is(tree, leaves, approximation)
            assert_bounded_as_it_is(tree, leaves, approximation, request)


def assert_approximated_as_it_is(tree: Quadtree, leaves: IndexArray, approximation: LeafApproximation) -> None:
    counts, deeper = tree.sides(leaves)
    assert not np.any(deeper)
    assert np.all(counts < tree.slot_counts(leaves))
    quads = np.flatnonzero(tree.is_quad(leaves))
    hanging = tree.hanging(
        tree.first_slots(leaves[quads])[:, None] + (np.arange(4) + approximation.turns[quads, None]) % 4
    )
    np.testing.assert_array_equal(hanging @ [1, 2, 4, 8], approximation.patterns[quads])


def assert_bounded_as_it_is(
    tree: Quadtree, leaves: IndexArray, approximation: LeafApproximation, request: AdaptiveRequest
) -> None:
    """Every bound is what is found for the leaf as it is drawn, or else for its neighbours as they are drawn."""
    anew = approximated_anew(tree, request).at(leaves)
    # Those that neighbours were expected to bound, and that had to do without them.
    chosen = np.flatnonzero(approximation.alone & ~anew.alone)
    anew.put(chosen, approximated_anew(tree, request, alone=True).at(leaves[chosen]))
    assert np.all(np.isfinite(anew.bounds[chosen]))
    for name in ("patterns", "alternatives", "turns", "folded"):
        np.testing.assert_array_equal(getattr(approximation, name), getattr(anew, name))
    drawn = triangles_around(tree, leaves, anew, Transitions.TRIANGLES)
    points = limit_values(tree.mesh, tree.mesh.positions, tree.vertex_points(drawn.used))
    along, of_leaves = np.full(len(leaves), np.inf), drawn.leaves
    normal, tangential = anew.normal[of_leaves], anew.tangential[of_leaves]
    for rings in (1, *MORE_RINGS):
        found = star_bounds(points, drawn.corners, normal, tangential, drawn.closed, of_leaves >= 0, rings=rings)
        largest = np.zeros(len(leaves))
        np.maximum.at(largest, of_leaves, found.bounds)
        along = np.where(along > request.limit, largest, along)
    np.testing.assert_allclose(
        approximation.bounds, np.where(np.isinf(anew.bounds), along, anew.bounds), rtol=SAME, atol=0
    )
    assert np.all(approximation.bounds <= request.limit)


def approximated_anew(tree: Quadtree, request: AdaptiveRequest, *, alone: bool = False) -> LeafApproximation:
    """(nodes,) approximations of a tree's leaves with their sides as they are, and error bounds along their normals and
    across: from the faces of the control mesh down. Whole leaves by their bicubic parents first."""
    found, waiting = LeafApproximation.none(len(tree.first_child)), [*cells_of_faces(tree.mesh)]
    from_parents = LeafApproximation.none(len(found.accepted))
    while waiting:
        cells = waiting.pop()
        is_leaf = tree.first_child[cells.nodes] == NONE
        for parents in some(cells, ~is_leaf & ~np.isin(cells.nodes, tree.covered)):
            waiting += parents.children(tree)
            if isinstance(parents, BicubicCells):
                waiting += halves_of(tree, parents)
                children = parents.approximate_children(request.limit, request.axes)
                from_parents.put(tree.children_of_quads(parents.nodes).ravel(), children.approximation)
        for leaves in some(cells, is_leaf):
            known = LeafApproximation.none(len(leaves.nodes)) if alone else None
            approximation = leaves.approximate(tree.hanging(tree.slots(leaves.nodes)), request, known=known)
            by_parents = from_parents.accepted[leaves.nodes] & (tree.sides(leaves.nodes)[0] == 0)
            at_parents = np.flatnonzero(by_parents & (not alone))
            approximation.put(at_parents, from_parents.at(leaves.nodes[at_parents]))
            error_bounds = leaves.error_bounds(approximation, request.limit)
            unknown = np.flatnonzero(np.isinf(approximation.normal))
            approximation.normal[unknown] = np.minimum(error_bounds.normal, approximation.bounds)[unknown]
            approximation.tangential[unknown] = np.minimum(error_bounds.tangential, approximation.bounds)[unknown]
            found.put(leaves.nodes, approximation)
    return found


def halves_of(tree: Quadtree, parents: BicubicCells) -> Iterator[BicubicCells]:
    """The cells of the halves of quads, where these are halved: halves that were not drawn in the end are no leaves."""
    halves = tree.first_half + np.arange(len(tree.covered))
    for half in halves[tree.first_child[halves] == NONE].tolist():
        chosen = np.flatnonzero(parents.nodes == tree.parents[half])
        if len(chosen):
            side = tree.covered[half - tree.first_half, 0] - tree.first_child[parents.nodes[chosen[0]]]
            yield parents.at(chosen).halves(int(side), np.array([half]))


@pytest.mark.parametrize("exponent", [-40, 40])
@pytest.mark.parametrize("name", ["cube", "landscape", "n-gons", "valences 3 and 7"])
def test_a_mesh_of_another_size_is_divided_alike(name: str, exponent: int) -> None:
    """Powers of two take part in no rounding; a library may still sum in another order."""
    mesh = build(name)
    scaled = mesh.changed(positions=np.ldexp(mesh.positions, exponent))
    found, other = subdivided(mesh, request_of(mesh, 0.007)), subdivided(scaled, request_of(scaled, 0.007))
    np.testing.assert_array_equal(other.mesh.corner_vertices, found.mesh.corner_vertices)
    np.testing.assert_allclose(np.ldexp(other.mesh.positions, -exponent), found.mesh.positions, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.ldexp(other.bounds, -exponent), found.bounds, rtol=1e-9)


@pytest.mark.parametrize("stretch", [1.0, 2.0])
@pytest.mark.parametrize("name", ["cube", "torus", "n-gons", "valences 3 and 7", "landscape", "fin through"])
def test_vertices_lie_on_the_limit_surface(name: str, stretch: float) -> None:
    """Those whose positions were found on the way, and the others; in the space of the mesh, and in a wider one."""
    mesh = build(name)
    wanted = mesh.positions * [stretch, 1.0, 1.0]
    made = subdivide_adaptively(mesh, request_of(mesh, 2e-3), wanted).mesh
    has_faces = made.vertex_points.corners != NONE
    points = made.vertex_points.at(np.flatnonzero(has_faces))
    # Some dozens of roundings of coordinates, for each of a few levels.
    rounding = 1e-14 * np.abs(wanted).max()
    np.testing.assert_allclose(made.positions[has_faces], limit_values(mesh, wanted, points), rtol=0, atol=rounding)


@pytest.mark.parametrize("stretch", [1.0, 2.0])
@pytest.mark.parametrize("place", [3.0, np.inf, np.nan])
def test_vertices_without_faces_stay_where_they_are(place: float, stretch: float) -> None:
    """Wherever that is, in the space of the mesh and in a wider one."""
    mesh = meshes.to_polygon_mesh(meshes.loose_edge_at_a_face_vertex())
    loose = np.flatnonzero(mesh.vertex_face_counts == 0)
    positions = mesh.positions.copy()
    positions[loose[-1]] = place
    mesh = apply_boundary_rule(mesh.changed(positions=positions), smooth_corners=True)
    wanted = positions * [stretch, 1.0, 1.0]
    request = AdaptiveRequest(0.05, Mode.ADAPTIVE, Transitions.TRIANGLES, MOST_FACES)
    made = subdivide_adaptively(mesh, request, wanted).mesh
    of_loose = np.flatnonzero(np.isin(made.base_vertices, loose))
    assert len(of_loose) == len(loose) > 0
    np.testing.assert_array_equal(made.positions[of_loose], wanted[made.base_vertices[of_loose]])
    assert np.all(np.isfinite(made.positions[made.corner_vertices]))


# One depth for each face


@pytest.mark.parametrize("name", ["cube", "landscape", "n-gons", "valences 3 and 7"])
def test_a_face_with_one_depth_is_divided_evenly(name: str) -> None:
    """A face all of whose neighbours are less deep consists of as many equal quads as its depth says.

    So do all faces, where all are equally deep; beside a deeper face there may be no other way than to split some.
    """
    mesh = build(name)
    found = subdivided(mesh, request_of(mesh, 0.007, Mode.PER_FACE))
    depths = np.zeros(mesh.face_count, dtype=np.int64)
    depths[found.mesh.base_faces] = found.depths
    even = np.flatnonzero((deepest_neighbours(mesh, depths) < depths) | (depths.min() == depths.max()))
    assert len(even)
    quarters = 4.0 ** (1 - depths)
    for face in even.tolist():
        own = np.flatnonzero(found.mesh.base_faces == face)
        areas = soundness.plane_areas(found.mesh, found.mesh.corner_points.parameters)[own]
        if mesh.face_sizes[face] == 4 and depths[face] == 0:
            areas = soundness.plane_areas(found.mesh, soundness.in_square(mesh, found.mesh.corner_points))[own]
        # Those that are folded are drawn as two triangles.
        assert set(np.unique(areas / quarters[face]).tolist()) <= {0.5, 1.0}
        assert areas.sum() == mesh.face_sizes[face]


def deepest_neighbours(mesh: PolygonMesh, depths: IndexArray) -> IndexArray:
    """(F,) the largest depth across the sides of each face, -1 where there is nothing across."""
    deepest = np.full(mesh.face_count, -1)
    for corner, edge in enumerate(mesh.corner_edges.tolist()):
        face = mesh.corner_faces[corner]
        across = np.setdiff1d(mesh.corner_faces[mesh.corner_edges == edge], [face])
        deepest[face] = max([deepest[face], *depths[across]])
    return deepest


def test_one_depth_for_each_face_takes_no_fewer_faces() -> None:
    for name, transitions in product(("cube", "n-gons", "landscape"), Transitions):
        mesh = build(name)
        adaptive, per_face = (len(subdivided(mesh, request_of(mesh, 0.01, mode, transitions)).bounds) for mode in Mode)
        assert adaptive <= per_face


# Few


# At twice this, 13 levels are enough: leaves on their own are nearer than at equal parameters.
DEPTH_15 = 7e-5

# By then the parts around the corner are smooth enough for their size.
SETTLED = 11


@pytest.mark.parametrize("transitions", Transitions)
def test_a_corner_that_needs_depth_15_costs_some_faces_a_level(transitions: Transitions) -> None:
    """At a sharp vertex of valence 8 the surface is a cone, which facets miss by a part of their size, however small.

    A level there is a ring of three leaves in each of the eight faces. Two of these have a finer neighbour on the
    inside, and are drawn as three triangles, the third is the quad between them: seven faces.
    """
    mesh = cone(valence=8)
    found = subdivided(mesh, request_of(mesh, DEPTH_15, transitions=transitions))
    assert found.depths.max() >= 15
    soundness.assert_sound(mesh, found.mesh)
    rings = faces_by_ring(mesh, found)
    assert len(rings) >= 15
    assert np.all(rings[SETTLED:] <= 8 * (7 if transitions is Transitions.TRIANGLES else 3))


def cone(valence: int) -> PolygonMesh:
    """Flat but for its sharp tip, vertex 0, at which every fourth face begins."""
    data = meshes.fan(valence, 2)
    flat = data.positions * [1.0, 1.0, 0.0]
    flat[0, 2] = 3.0
    data = meshes.creased(meshes.MeshData(flat, data.face_sizes, data.corner_vertices), {}, {0: 1.0})
    return apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True)


def faces_by_ring(mesh: PolygonMesh, found: AdaptiveMesh) -> IndexArray:
    """How many faces reach from vertex 0 beyond half the side of a base face, a quarter, and so on."""
    made = found.mesh
    far = np.maximum.reduceat(soundness.in_square(mesh, made.corner_points).max(axis=1), made.face_starts[:-1])
    at_tip = mesh.corner_vertices[mesh.face_starts[made.base_faces]] == 0
    return np.bincount(np.floor(-np.log2(far[at_tip])).astype(np.intp))


# Not too many


@pytest.mark.parametrize("name", ["cube", "landscape", "torus", "valences 3 and 7"])
def test_refused_with_about_the_tolerance_that_fits(name: str) -> None:
    mesh = build(name)
    most_faces = 3000
    request = request_of(mesh, 1e-5, most_faces=most_faces)
    with pytest.raises(TooManyFacesError) as refused:
        count_faces(mesh, request)
    assert refused.value.faces > most_faces
    assert refused.value.tolerance > request.limit
    # A level more or less is a factor of four in the tolerance.
    fitting = AdaptiveRequest(4 * refused.value.tolerance, request.mode, request.transitions, most_faces)
    assert count_faces(mesh, fitting) <= most_faces


@pytest.mark.parametrize(
    "name",
    [
        "cube",
        "torus",
        "n-gons",
        "valences 3 and 7",
    ],
)
def test_the_number_of_faces_refused_is_about_the_real_one(name: str) -> None:
    mesh = build(name)
    request = request_of(mesh, 3e-5)
    count = count_faces(mesh, request)
    assert count > 20_000
    with pytest.raises(TooManyFacesError) as refused:
        count_faces(mesh, request_of(mesh, 3e-5, most_faces=count // 5))
    assert count / 2 <= refused.value.faces <= 2 * count


def test_refused_before_it_takes_much() -> None:
    """A result of 4 million faces and more, where a thousandth is allowed."""
    mesh = build("torus")
    tracemalloc.start()
    with pytest.raises(TooManyFacesError):
        count_faces(mesh, request_of(mesh, 1e-7, most_faces=4000))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # What a mesh of as many faces as allowed may take, and the matrices of the bounds.
    assert peak < 4000 * 1200 + 20e6
