# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: sound on meshes of every kind, as near as proved, of few faces, refused before it is huge.

Trees, leaves and their bounds are judged by the meshes that are made of them.
"""

import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.leaf_approximation import LeafApproximation
from ccdepth_addon.core.adaptive.leaf_bounds import unbounded
from ccdepth_addon.core.adaptive.plan import TooManyFacesError
from ccdepth_addon.core.adaptive.planner import AdaptiveMesh, count_faces, plan_within, subdivide_adaptively
from ccdepth_addon.core.adaptive.rectangle_tree import NONE, RectangleTree
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.tessellation import plan_tessellation
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.deviation import measure_deviation
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh, polygon_mesh
from ccdepth_addon.core.surface.evaluation import limit_values
from ccdepth_addon.core.surface.limit_normals import limit_normals
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes, soundness
from tests.meshes import bent
from tests.thorough import combinations, each

MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    # With random creases they take long.
    **{name: data for name, data in meshes.AWKWARD.items() if "random" not in name},
    "single quad": lambda: meshes.grid(1, 1),
    "landscape": lambda: meshes.landscape(4, 3),
    "torus": lambda: meshes.torus(7, 5),
    "n-gons": lambda: meshes.bumpy(meshes.cylinder(7), 0.1),
    "hexagons with a bump": meshes.hexagons_with_a_bump,
    "triangles": lambda: meshes.sphere(5, 2),
    "triangles of any valences": lambda: cut(meshes.torus(5, 4), np.random.default_rng(1).integers(0, 2, 20)),
    "tetrahedron": meshes.tetrahedron,
    "concave faces": meshes.concave_faces,
    "collapsed n-gons": lambda: meshes.with_collapsed_faces(meshes.bumpy(meshes.cylinder(7), 0.1)),
    "valences 3 and 7": lambda: meshes.trapezohedron(7),
    "neighbours of 6, 3, 5 and 7": lambda: meshes.around_quad((6, 3, 5, 7)),
    "valence 64": lambda: meshes.fan(64, 1),
    "valence 360": lambda: meshes.fan(360, 1),
    "Möbius strip": meshes.mobius_strip,
    "two quads on opposite corners": meshes.two_quads_on_opposite_corners,
    "ring of quads on opposite corners": meshes.ring_of_quads_on_opposite_corners,
    "pillow of triangles": lambda: meshes.pillow(3),
    "pillow of quads": lambda: meshes.pillow(4),
    "pillow of pentagons": lambda: meshes.pillow(5),
    "doubled face": lambda: meshes.from_faces([[0, 0, 0], [1, 0, 0], [1, 1, 0.3], [0, 1, 0]], 2 * [[0, 1, 2, 3]]),
    "loose edges": meshes.loose_edge_at_a_face_vertex,
    "random creases": lambda: meshes.with_random_creases(meshes.landscape(3, 2), share=0.4),
    "n-gons with creases": lambda: meshes.creased(
        meshes.cylinder(5), {(0, 1): 0.4, (5, 6): 1.0, (1, 6): 0.5}, {3: 0.3}
    ),
}

# Both faces of these are the same surface, all of whose points are there twice.
COINCIDENT = {"pillow of triangles", "pillow of quads", "pillow of pentagons", "doubled face"}

# Which take longer than others: with the last two requests alone.
SLOW = {"valence 360", "valence 64", "random creases", "n-gons with creases", "soup", "creased cube"}

# In parts of the diagonal: most faces whole, as graded as takes little time, and some levels.
REQUESTS = [(Mode.PER_FACE, 0.3), (Mode.ADAPTIVE, 0.015), (Mode.PER_FACE, 0.1), (Mode.ADAPTIVE, 0.05)]

MOST_FACES = 1_000_000


@cache
def build(name: str) -> PolygonMesh:
    return meshes.build(MESHES[name]())


def request_of(
    mesh: PolygonMesh,
    tolerance: float,
    mode: Mode = Mode.ADAPTIVE,
    most_faces: int = MOST_FACES,
) -> AdaptiveRequest:
    """tolerance: in parts of the diagonal."""
    return AdaptiveRequest(tolerance * meshes.diagonal(mesh), mode, most_faces)


def subdivided(mesh: PolygonMesh, request: AdaptiveRequest) -> AdaptiveMesh:
    return subdivide_adaptively(mesh, request, mesh.positions)


@pytest.mark.parametrize("name", each(MESHES, [*MESHES][::2]))
def test_sound(name: str) -> None:
    mesh = build(name)
    for mode, tolerance in REQUESTS[2 if name in SLOW else 0 :]:
        request = request_of(mesh, tolerance, mode)
        found = subdivided(mesh, request)
        soundness.assert_sound(mesh, found.mesh)
        if name not in COINCIDENT:
            soundness.assert_nothing_degenerate(found.mesh)
        # Every vertex is where each of its faces says it is, and vertices of the base mesh are their limits. A point
        # seen from another face is another sum of the same products, some dozens for each of its levels.
        rounding = 1e3 * np.finfo(np.float64).eps * np.abs(mesh.positions).max()
        points = limit_values(mesh, mesh.positions, found.mesh.corner_points)
        at_vertices = found.mesh.positions[found.mesh.corner_vertices]
        np.testing.assert_allclose(points, at_vertices, rtol=0, atol=rounding)
        assert np.all(found.bounds <= request.limit)
    assert count_faces(mesh, request) == len(found.bounds)


# How many faces are enough at a 50th and a 500th of the diagonal, and at a 20th with one depth for each face.
ENOUGH = {
    "cube": (96, 1032, 24),
    "landscape": (24, 158, 12),
    "torus": (70, 840, 35),
    "n-gons": (140, 732, 42),
    "triangles and quads": (74, 614, 36),
    "tetrahedron": (48, 276, 12),
    "concave faces": (13, 121, 13),
    "collapsed faces": (31, 206, 20),
    "valences 3 and 7": (56, 798, 14),
    "valences 2 and 12": (66, 289, 66),
    "fin through": (24, 239, 24),
    "Möbius strip": (38, 122, 14),
    "creased cube": (98, 1003, 24),
    "corner creased cube": (138, 785, 52),
    "random creases": (25, 131, 6),
}


@pytest.mark.parametrize("name", each(ENOUGH, [*ENOUGH][::2]))
def test_few_faces_are_as_near_as_proved(name: str) -> None:
    """And sound, and look the way of the surface."""
    mesh = build(name)
    requests = request_of(mesh, 0.02), request_of(mesh, 2e-3), request_of(mesh, 0.05, Mode.PER_FACE)
    for request, enough in zip(requests, ENOUGH[name], strict=True):
        found = subdivided(mesh, request)
        assert len(found.bounds) <= enough
        assert_as_near_as_proved(mesh, found, request.limit)
        soundness.assert_nothing_degenerate(found.mesh)
        normals, _ = soundness.newell_normals(found.mesh)
        of_surface = limit_normals(mesh, found.mesh.corner_points)
        towards = np.einsum("ij,ij->i", of_surface, normals[soundness.corner_faces(found.mesh)])
        assert np.all(np.add.reduceat(towards, found.mesh.face_starts[:-1]) > 0)


def assert_as_near_as_proved(mesh: PolygonMesh, found: AdaptiveMesh, limit: float) -> None:
    """And sound. As measured by ``measure_deviation``, which knows nothing of leaves: what it reaches is the distance
    of points that it has found. Larger polygons are measured as Blender draws them in ``tests/blender``."""
    soundness.assert_sound(mesh, found.mesh)
    assert np.all(found.bounds <= limit)
    if np.diff(found.mesh.face_starts).max() > 4:
        return
    # At poles of hundreds of faces measuring takes minutes to decide; what it has reached by then counts.
    measured = measure_deviation(
        mesh, found.mesh.positions, soundness.drawn(found.mesh), accuracy=0.05, time_limit=30.0, enough=limit
    )
    # Positions and distances are rounded a few times, to sixteen digits.
    assert measured.reached <= found.bounds.max() * (1 + 1e-9)


@pytest.mark.parametrize(
    "name", ["random creases", "valences 3 and 7", "triangles and quads", "uneven torus", "wavy torus"]
)
def test_bounds_are_those_of_leaves_as_they_are_in_the_end(name: str) -> None:
    """Found again for all leaves at once, however many were split since."""
    mesh = build("torus" if name.endswith("torus") else name)
    if name == "uneven torus":
        mesh = mesh.changed(positions=np.sign(mesh.positions) * np.abs(mesh.positions) ** 3)
    if name == "wavy torus":
        mesh = mesh.changed(positions=mesh.positions + np.sin(5 * mesh.positions[:, [1, 2, 0]]) / 2)
    plan, _ = plan_within(mesh, request_of(mesh, 5e-4 if name == "wavy torus" else 2e-3), lambda _: None)
    leaves = plan.tree.leaves()
    before = plan.bounds(leaves)
    assert np.any(plan.at_equal.values[leaves] > plan.request.limit)
    plan.along_surface.values[leaves] = np.inf
    plan.is_stale.values[leaves] = True
    assert not len(unbounded(plan))
    # Pieces are looked at in other company: a matrix product may be rounded otherwise.
    np.testing.assert_allclose(plan.bounds(leaves), before, rtol=1e-9)


def test_bounds_count_how_thick_polygons_are() -> None:
    mesh = build("hexagons with a bump")
    plan, _ = plan_within(mesh, request_of(mesh, 0.01), lambda _: None)
    leaves = plan.tree.leaves()
    thickness, along = plan.approximation(leaves).thickness, plan.along_surface.values[leaves]
    assert np.any((thickness > 0) & np.isfinite(along))
    assert np.all(plan.bounds(leaves) >= thickness)
    assert np.all(along >= thickness)


def sheet(size: int, *, as_triangles: bool, noise: float, seed: int = 1) -> meshes.MeshData:
    """A grid in one plane, its points moved about within it; every other quad cut along the other diagonal."""
    data = meshes.grid(size, size)
    moved = np.random.default_rng(seed).uniform(-noise, noise, (len(data.positions), 2))
    data = replace(data, positions=data.positions + np.column_stack([moved, np.zeros(len(moved))]))
    return cut(data, 3 * (np.arange(size * size) % 2)) if as_triangles else data


def cut(data: meshes.MeshData, turns: IndexArray) -> meshes.MeshData:
    """Each quad cut along the diagonal from its first corner, or from one so many corners after that."""
    quads = np.take_along_axis(data.corner_vertices.reshape(-1, 4), (np.arange(4) + turns[:, None]) % 4, axis=1)
    return meshes.MeshData(data.positions, np.full(2 * len(quads), 3), quads[:, [0, 1, 2, 0, 2, 3]].ravel())


def turned(data: meshes.MeshData) -> meshes.MeshData:
    """By some angle in space, in single precision."""
    axes, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    return meshes.single_precision(replace(data, positions=data.positions @ axes.T))


def needles(each_side: int) -> meshes.MeshData:
    """A square, cut into triangles from its centre to as many parts of each side."""
    along = np.arange(each_side) / each_side
    sides = [np.column_stack([along, np.zeros((each_side, 2))])]
    for _ in range(3):
        sides.append([1, 0, 0] + sides[-1] @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    around = np.arange(4 * each_side)
    faces = [[0, 1 + i, 1 + (i + 1) % len(around)] for i in around.tolist()]
    return meshes.from_faces(np.concatenate([[[0.5, 0.5, 0.0]], *sides]), faces)


# Flat control meshes, whatever way their lines run, are split at their borders alone; nearly flat ones, and those that
# bend one way, take few faces: so many at a thousandth of the diagonal.
FLAT: dict[str, tuple[Callable[[], meshes.MeshData], int]] = {
    "quads": (lambda: sheet(8, as_triangles=False, noise=0.2), 179),
    "uneven": (lambda: bent(meshes.grid(8, 8), lambda x, y, z: (x**2, y**2, z)), 124),
    "triangles": (lambda: sheet(8, as_triangles=True, noise=0.2), 430),
    "turned": (lambda: turned(sheet(7, as_triangles=True, noise=0.2)), 406),
    "turned over": (lambda: sheet(5, as_triangles=True, noise=0.45, seed=3), 637),
    "thin": (lambda: bent(sheet(6, as_triangles=True, noise=0.2), lambda x, y, z: (x, 0.02 * y, z)), 633),
    "needles": (lambda: needles(8), 152),
    "hexagons": (lambda: turned(meshes.hexagons(7, 14, 0.1)), 538),
    "dented hexagons": (lambda: turned(meshes.hexagons(4, 6, 0.3)), 278),
    "bent plate": (meshes.bent_plate, 194),
    "nearly flat pole": (lambda: bent(meshes.fan(16, 1), lambda x, y, _: [x, y, -0.05 * (x * x + y * y)]), 436),
    # Nothing of what is missed there is across the plane of a leaf, and chords of lines that wind miss nothing at their
    # middles: how to split says nothing then of parameters that lie elsewhere.
    "folded in the plane": (
        lambda: bent(
            meshes.grid(4, 4), lambda x, y, _: [x + 0.9 * np.sin(3 * y), np.abs(y - 1.7) + 0.2 * np.cos(4 * x), 0 * x]
        ),
        338,
    ),
    "winding within the plane": (lambda: bent(meshes.grid(1, 3), lambda x, y, _: [x + winding(y), y, 0 * x]), 100),
    "winding out of the plane": (lambda: bent(meshes.grid(3, 1), lambda x, y, _: [x, y, winding(x)]), 100),
    # Half of a circle: half of the triangles that whole leaves would take, but for its ends.
    "tube": (
        lambda: bent(meshes.grid(6, 4), lambda x, y, _: [np.cos(np.pi / 6 * x), np.sin(np.pi / 6 * x), 0.75 * y]),
        188,
    ),
}


def winding(along: FloatArray) -> FloatArray:
    return np.array([0.0, 0.3, -0.3, 0.0])[np.rint(along).astype(int)]


SHORT_FLAT = ["uneven", "needles", "hexagons", "bent plate", *[*FLAT][-4:]]


@pytest.mark.parametrize("name", each(FLAT, SHORT_FLAT))
def test_flat_meshes_and_those_bent_one_way_take_few_faces(name: str) -> None:
    make, enough = FLAT[name]
    mesh = meshes.build(make())
    found = subdivided(mesh, request_of(mesh, 1e-3, most_faces=2_000))
    assert len(found.bounds) <= enough
    assert_as_near_as_proved(mesh, found, 1e-3 * meshes.diagonal(mesh))


def test_thousands_of_needles_at_a_vertex_are_looked_at_together() -> None:
    mesh = meshes.build(needles(500))
    began = time.process_time()
    found = subdivided(mesh, request_of(mesh, 1e-3))
    assert len(found.bounds) == mesh.face_count
    # About one second; were each compared with all others it would be a thousand.
    assert time.process_time() - began < 20


@pytest.mark.parametrize(("mode", "enough"), [(Mode.ADAPTIVE, 1_300), (Mode.PER_FACE, 3_300)])
def test_borders_of_flat_triangles_take_few_faces_at_fine_tolerances(mode: Mode, enough: int) -> None:
    """At vertices of the border lines that are straight in the control mesh are not on the surface."""
    mesh = meshes.build(sheet(8, as_triangles=True, noise=0.2))
    found = subdivided(mesh, request_of(mesh, 8e-5, mode, most_faces=10_000))
    assert len(found.bounds) <= enough
    assert_as_near_as_proved(mesh, found, 8e-5 * meshes.diagonal(mesh))


@pytest.mark.parametrize(
    ("name", "exponent"), combinations(["cube", "landscape", "n-gons", "valences 3 and 7"], [-40, 40])
)
def test_a_mesh_of_another_size_is_divided_alike(name: str, exponent: int) -> None:
    """Powers of two take part in no rounding; a library may still sum in another order."""
    mesh = build(name)
    scaled = mesh.changed(positions=np.ldexp(mesh.positions, exponent))
    found, other = subdivided(mesh, request_of(mesh, 0.007)), subdivided(scaled, request_of(scaled, 0.007))
    np.testing.assert_array_equal(other.mesh.corner_vertices, found.mesh.corner_vertices)
    np.testing.assert_allclose(np.ldexp(other.mesh.positions, -exponent), found.mesh.positions, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.ldexp(other.bounds, -exponent), found.bounds, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "stretch"),
    combinations(["cube", "torus", "n-gons", "valences 3 and 7", "landscape", "fin through"], [2.0, 1.0]),
)
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


@pytest.mark.parametrize(("place", "stretch"), combinations([3.0, np.inf, np.nan], [1.0, 2.0]))
def test_vertices_without_faces_stay_where_they_are(place: float, stretch: float) -> None:
    """Wherever that is, in the space of the mesh and in a wider one."""
    mesh = meshes.to_polygon_mesh(meshes.loose_edge_at_a_face_vertex())
    loose = np.flatnonzero(mesh.vertex_face_counts == 0)
    positions = mesh.positions.copy()
    positions[loose[-1]] = place
    mesh = apply_boundary_rule(mesh.changed(positions=positions), smooth_corners=True)
    wanted = positions * [stretch, 1.0, 1.0]
    request = AdaptiveRequest(0.05, Mode.ADAPTIVE, MOST_FACES)
    made = subdivide_adaptively(mesh, request, wanted).mesh
    of_loose = np.flatnonzero(np.isin(made.base_vertices, loose))
    assert len(of_loose) == len(loose) > 0
    np.testing.assert_array_equal(made.positions[of_loose], wanted[made.base_vertices[of_loose]])
    assert np.all(np.isfinite(made.positions[made.corner_vertices]))


@pytest.mark.parametrize("name", ["cube", "landscape", "n-gons", "valences 3 and 7"])
def test_a_face_with_one_depth_is_divided_evenly(name: str) -> None:
    """A face all of whose neighbours are less deep consists of as many equal quads as its depth says.

    So do all faces, where all are equally deep; beside a deeper face there may be no other way than to split some.
    """
    mesh = build(name)
    request = request_of(mesh, 0.007, Mode.PER_FACE)
    found = subdivided(mesh, request)
    assert count_faces(mesh, request) == len(found.bounds)
    depths = np.zeros(mesh.face_count, dtype=np.int64)
    depths[found.mesh.base_faces] = found.depths
    # At each face those that share an edge with it.
    around = [np.isin(mesh.corner_edges, mesh.corner_edges[mesh.corner_faces == face]) for face in range(len(depths))]
    across = [np.setdiff1d(mesh.corner_faces[there], [face]) for face, there in enumerate(around)]
    deepest = np.array([depths[faces].max(initial=-1) for faces in across])
    even = np.flatnonzero((deepest < depths) | (depths.min() == depths.max()))
    assert len(even)
    quarters = 4.0 ** (1 - depths)
    for face in even.tolist():
        own = np.flatnonzero(found.mesh.base_faces == face)
        areas = soundness.plane_areas(found.mesh, found.mesh.corner_points.parameters)[own]
        if mesh.face_sizes[face] == 4:
            # In the unit square, a quarter of which is that of quarters.
            areas = 4 * soundness.plane_areas(found.mesh, soundness.in_square(mesh, found.mesh.corner_points))[own]
        # Those that are folded are drawn as two triangles.
        assert set(np.unique(areas / quarters[face]).tolist()) <= {0.5, 1.0}
        assert areas.sum() == mesh.face_sizes[face]


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [("cube", 3e-5), ("torus", 3e-5), ("landscape", 1e-5), ("n-gons", 1e-4), ("valences 3 and 7", 1e-4)],
)
def test_refused_with_about_the_number_of_faces_and_the_tolerance_that_fits(name: str, tolerance: float) -> None:
    mesh = build(name)
    request = request_of(mesh, tolerance)
    count = count_faces(mesh, request)
    assert count > 9_000
    with pytest.raises(TooManyFacesError) as refused:
        count_faces(mesh, replace(request, most_faces=count // 5))
    assert count / 2 <= refused.value.faces <= 2 * count
    assert refused.value.tolerance > request.limit
    # A level more or less is a factor of four in the tolerance.
    fitting = AdaptiveRequest(4 * refused.value.tolerance, request.mode, count // 5)
    assert count_faces(mesh, fitting) <= count // 5


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


SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
LOOSE_DIAGONAL = [[0, 2]]


@pytest.mark.parametrize(
    ("faces", "loose", "alternatives", "clashing"),
    [
        ([0, 1, 2, 3, 3, 2, 1, 0], [], [0, 0], []),
        ([0, 1, 2, 3, 3, 2, 1, 0], [], [0, 1], [0, 1]),
        ([0, 1, 2, 3, 3, 2, 1, 0], [], [1, 0], [0, 1]),
        ([0, 1, 2, 3, 2, 1, 0, 3], [], [0, 0], [0, 1]),
        ([0, 1, 2, 3, 2, 1, 0, 3], [], [0, 1], []),
        # Of two edges with the same ends Blender would take one away.
        ([0, 1, 2, 3], LOOSE_DIAGONAL, [0], [0]),
        ([0, 1, 2, 3], LOOSE_DIAGONAL, [1], []),
    ],
)
def test_diagonals_are_edges_of_nothing_else(
    faces: list[int], loose: list[list[int]], alternatives: list[int], clashing: list[int]
) -> None:
    """Quads over the same four vertices, each drawn as two triangles along the diagonal of its alternative."""
    mesh = polygon_mesh(np.array(SQUARE), np.full(len(faces) // 4, 4), np.array(faces))
    mesh = mesh.changed(
        edge_vertices=np.concatenate([mesh.edge_vertices, np.array(loose, dtype=np.intp).reshape(-1, 2)]),
        edge_sharpness=np.append(mesh.edge_sharpness, [0.0] * len(loose)),
    )
    tree = RectangleTree(apply_boundary_rule(mesh, smooth_corners=True))
    approximation = LeafApproximation.none(mesh.face_count)
    approximation.folded[:] = True
    approximation.alternatives[:] = alternatives
    plan = plan_tessellation(tree, tree.leaves(), approximation)
    assert plan.clashes.tolist() == clashing
    assert loose or len(plan.drawn) == 4
    # Edges without faces are kept, and known.
    assert np.isin(np.flatnonzero(mesh.edge_face_counts == 0), plan.edges.base_edges).all()


@pytest.mark.parametrize("seed", each(range(500), (3, 7, 13, 40, 90)))
def test_random_results_are_sound_and_within_the_tolerance_both_ways(seed: int) -> None:
    """Distorted, flattened, with uneven parameters; at random tolerances."""
    generator = np.random.default_rng(seed)
    mesh = build(list(MESHES)[generator.integers(len(MESHES))])
    positions, size = mesh.positions, meshes.diagonal(mesh)
    match generator.integers(5):
        case 1:
            positions = positions + generator.normal(0, 10 ** generator.uniform(-3, -1), positions.shape) * size
        case 2:
            positions = positions * [1, 1, 10 ** generator.uniform(-3, 0)]
        case 3:
            turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
            positions = positions * [1, 10 ** generator.uniform(-2, 0), 1] @ turn
        case 4:
            uneven = np.sign(positions[:, 0]) * np.abs(positions[:, 0] / size) ** 3 * size
            positions = np.column_stack([uneven, positions[:, 1:]])
    mesh = mesh.changed(positions=positions)
    request = request_of(mesh, 10 ** generator.uniform(-3, -1), most_faces=100_000)
    found = subdivided(mesh, request)
    assert_as_near_as_proved(mesh, found, request.limit)


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("name", ["n-gons", "torus", "random creases", "tetrahedron"])
def test_no_edge_is_longer_than_allowed(name: str, mode: Mode) -> None:
    """And the mesh is sound, and still as near; a length that no edge exceeds changes nothing."""
    mesh = build(name)
    request = request_of(mesh, 0.05, mode)
    free = subdivided(mesh, request)
    largest = edge_lengths(free).max()
    for share in (0.9, 0.3):
        found = subdivided(mesh, replace(request, longest_edge=share * largest))
        assert edge_lengths(found).max() <= share * largest
        soundness.assert_sound(mesh, found.mesh)
        assert np.all(found.bounds <= request.limit)
    same = subdivided(mesh, replace(request, longest_edge=largest))
    np.testing.assert_array_equal(same.mesh.positions, free.mesh.positions)


def test_long_strips_are_cut_across() -> None:
    """A flat strip of one face, ten times as long as wide, needs no cut along it."""
    data = meshes.bent(meshes.grid(1, 1), lambda x, y, z: (10 * x, y, z))
    mesh = meshes.build(data, smooth_corners=False)
    found = subdivided(mesh, replace(request_of(mesh, 0.05), longest_edge=1.01))
    assert len(found.bounds) == 16


def edge_lengths(found: AdaptiveMesh) -> FloatArray:
    ends = found.mesh.positions[found.mesh.edge_vertices]
    lengths: FloatArray = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return lengths
