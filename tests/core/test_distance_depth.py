# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances of whole meshes at a level, both ways, against dense samples: every kind of face, and odd meshes."""

import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from itertools import cycle, pairwise, product

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import BoolArray, FloatArray
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from ccdepth_addon.core.depth import distance_depth
from ccdepth_addon.core.depth.certified_depth import certified_level_bounds
from ccdepth_addon.core.depth.common_level import common_level
from ccdepth_addon.core.depth.disproved_levels import MOST_FACES
from ccdepth_addon.core.depth.distance_depth import Effort
from ccdepth_addon.core.depth.face_depths import face_depths, uniform_level
from ccdepth_addon.core.depth.lone_polygons import lone_polygon_bounds
from ccdepth_addon.core.depth.pose_depths import Pose, deepest_pose, pose_depths, raised_depths
from ccdepth_addon.core.depth.tolerance import ToleranceTest
from ccdepth_addon.core.deviation.leaf_deviations import DrawnLeaves
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from tests import meshes
from tests.drawn_levels import OFF, largest_around, points_of, sampled, surface
from tests.proved_bounds import level_bounds
from tests.thorough import cases, combinations, each
from tests.triangle_distances import point_to_triangles

# Relative: single precision plays no part, and double precision is exact to far more.
ROUNDING = 1e-9


def bevelled_prism(sides: int, bevel: float) -> meshes.MeshData:
    """A prism with two narrow strips around each cap, an n-gon."""
    profile = [(1 - bevel, -1.0), (1 - bevel / 4, -1 + bevel / 4), (1.0, -1 + bevel)]
    return meshes.cylinder(sides, profile + [(radius, -height) for radius, height in profile[::-1]])


def wavy(data: meshes.MeshData, size: float) -> meshes.MeshData:
    """Grid lines that wind to and fro in the plane."""
    return meshes.bent(data, lambda x, y, z: (x + size * np.sin(4 * y), y + size * np.sin(3 * x), z))


MESHES: dict[str, Callable[[int], meshes.MeshData]] = {
    "cube": lambda seed: meshes.bumpy(meshes.cube(), 0.2, seed),
    "sphere": lambda seed: meshes.bumpy(meshes.sphere(4 + seed % 20, 6), 0.03 * (seed % 3), seed),
    "pole of 16": lambda seed: meshes.sphere(16, 4),
    "bevelled prism": lambda seed: bevelled_prism(3 + seed % 12, 0.02 + 0.05 * (seed % 4)),
    "torus": lambda seed: meshes.bumpy(meshes.torus(9, 6), 0.1, seed),
    "landscape": lambda seed: meshes.landscape(5, 4, seed),
    "landscape with creases": lambda seed: meshes.with_random_creases(meshes.landscape(4, 4, seed), seed),
    "hexagons": lambda seed: meshes.hexagons(3, 3, 0.2, seed),
    "fan": lambda seed: meshes.fan(3 + seed % 9, 2, seed),
    "cylinder with creases": lambda seed: meshes.with_random_creases(meshes.cylinder(6), seed),
    # Sides that are far from perpendicular.
    "sheared": lambda seed: meshes.bent(meshes.landscape(4, 4, seed), lambda x, y, z: (x + 2.5 * y, y, z)),
    "wavy": lambda seed: wavy(meshes.landscape(4, 4, seed), 0.2),
    "wavy and flat": lambda seed: wavy(meshes.grid(4, 4), 0.1 + 0.05 * (seed % 4)),
    # Turned over on itself along a line.
    "folded": lambda seed: meshes.bent(
        meshes.landscape(6, 3, seed), lambda x, y, z: (np.abs(x - x.mean()), y, z + 0.05 * (x > x.mean()))
    ),
    "face soup": lambda seed: meshes.face_soup(seed),
    "collapsed faces": lambda seed: meshes.with_collapsed_faces(meshes.landscape(4, 4, seed)),
    "Möbius strip": lambda seed: meshes.mobius_strip(7 + seed % 5),
    "tetrahedron": lambda seed: meshes.bumpy(meshes.tetrahedron(), 0.1, seed),
    "three faces on an edge": lambda seed: meshes.three_faces_on_an_edge(),
    "boundary touching inside": lambda seed: meshes.boundary_touching_inside(),
    "flipped face": lambda seed: meshes.flipped_face(),
    "concave faces": lambda seed: meshes.concave_faces(),
    "bow tie": lambda seed: meshes.bow_tie(),
    "valence two": lambda seed: meshes.valence_two(),
    "creased cube": lambda seed: meshes.creased_cube(),
    "two cubes sharing an edge": lambda seed: meshes.two_cubes_sharing_an_edge(),
    "pole of 48": lambda seed: meshes.sphere(48, 4),
}


def case(name: str, seed: int) -> tuple[PolygonMesh, float]:
    mesh = meshes.build(MESHES[name](seed))
    return mesh, meshes.diagonal(mesh)


SEEDS = range(*map(int, os.environ.get("CCDEPTH_SEEDS", "0:4").split(":")))


def cases_of(names: Iterable[str], seed: int) -> list[object]:
    """Each mesh at level 1 with one kind of vertices; in the thorough run with both, at level 2, with more seeds."""
    short = [(name, vertices, seed, 1) for name, vertices in zip(names, cycle(Vertices), strict=False)]
    return cases([*short, *product(MESHES, Vertices, SEEDS, [2])], short)


TRIANGLES: dict[str, Callable[[int], meshes.MeshData]] = {
    "house": lambda seed: meshes.bumpy(meshes.triangles_and_quads(), 0.2, seed),
    "tetrahedron": MESHES["tetrahedron"],
    "poles": lambda seed: meshes.bumpy(meshes.sphere(5 + seed, 3), 0.1, seed),
    "creased tetrahedron": lambda seed: meshes.with_random_creases(MESHES["tetrahedron"](seed), seed),
    "sliver": lambda seed: meshes.from_faces([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 1]], [[0, 1, 2], [0, 2, 3]]),
}


@pytest.mark.parametrize(
    ("name", "vertices", "seed"),
    cases(product(TRIANGLES, Vertices, SEEDS), [(*pair, 1) for pair in zip(TRIANGLES, cycle(Vertices), strict=False)]),
)
def test_control_triangles_are_as_near_as_proved(name: str, vertices: Vertices, seed: int) -> None:
    """Each one to the surface over itself, both ways, and within what is proved at equal parameters."""
    mesh = meshes.build(TRIANGLES[name](seed))
    fine, fine_triangles, owners, step = surface(mesh, 4)
    chosen, found = np.flatnonzero(mesh.face_sizes == 3), []
    for face in chosen:
        triangle = mesh.positions[mesh.corner_vertices[mesh.face_starts[face] :][:3]]
        own = fine[fine_triangles[owners == face]]
        points, drawn = own.reshape(-1, 3), points_of(triangle[None]).reshape(-1, 3)
        back = point_to_triangles(points, np.tile(triangle, (len(points), 1, 1))).max()
        there = point_to_triangles(np.repeat(drawn, len(own), axis=0), np.tile(own, (len(drawn), 1, 1)))
        found.append((there.reshape(len(drawn), -1).min(axis=1).max() - OFF * step, back))
    # Bounds are no nearer than asked.
    for tolerance in (meshes.diagonal(mesh), *(factor * max(pair) for pair in found for factor in (1.5, 0.9))):
        if tolerance > 0:
            bounds = level_bounds(mesh, tolerance, "DISTANCE", vertices, 0)[chosen]
            assert np.all(np.max(found, axis=1) <= bounds * (1 + ROUNDING) + ROUNDING)


POLYGONS: dict[str, Callable[[int], meshes.MeshData]] = {
    "hexagons": lambda seed: meshes.hexagons(3, 3, 0.2 * seed, seed),
    "prism": lambda seed: meshes.bumpy(meshes.cylinder(5 + seed), 0.1 * seed, seed),
    "one polygon": lambda seed: meshes.from_faces(
        [[np.cos(turn), np.sin(turn), 0.05 * seed * turn % 0.1] for turn in np.linspace(0, 6, 6 + seed)],
        [list(range(6 + seed))],
    ),
}


@pytest.mark.parametrize(("name", "seed"), cases(product(POLYGONS, range(8)), product(POLYGONS, range(2))))
def test_control_polygons_are_as_near_as_proved_however_they_are_cut(name: str, seed: int) -> None:
    """Each one to the surface over itself, both ways, cut into the triangles at each of its corners."""
    mesh = meshes.build(POLYGONS[name](seed))
    fine, fine_triangles, owners, step = surface(mesh, 4)
    polygons = np.flatnonzero(mesh.face_sizes > 4)
    bounds = level_bounds(mesh, meshes.diagonal(mesh), "DISTANCE", Vertices.LIMIT, 0)
    # With higher seeds all polygons may be so crumpled that no bound of them is proved.
    assert seed >= 3 or np.any(np.isfinite(bounds[polygons]))
    for face in polygons:
        loop = mesh.positions[mesh.corner_vertices[mesh.face_starts[face] :][: mesh.face_sizes[face]]]
        own = fine[fine_triangles[owners == face]]
        for first in range(len(loop)):
            turned = np.roll(loop, first, axis=0)
            drawn = np.stack([np.broadcast_to(turned[0], turned[1:-1].shape), turned[1:-1], turned[2:]], axis=1)
            for points, triangles, allowed in (
                (own.reshape(-1, 3)[::7], drawn, 0.0),
                (points_of(drawn).reshape(-1, 3), own, OFF * step),
            ):
                off = point_to_triangles(
                    np.repeat(points, len(triangles), axis=0), np.tile(triangles, (len(points), 1, 1))
                )
                off = off.reshape(len(points), -1).min(axis=1).max()
                assert off <= bounds[face] * (1 + ROUNDING) + ROUNDING + allowed


def test_flat_polygons_are_depth_0_where_they_are_near_enough_and_convex() -> None:
    mesh = meshes.build(meshes.cylinder(12))
    found = face_depths(mesh, 10.0, "DISTANCE", "LIMIT")
    assert np.all(found.depths == 0)
    notched = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [1, 0.2, 0], [0, 2, 0]]
    found = face_depths(meshes.build(meshes.from_faces(notched, [[0, 1, 2, 3, 4]])), 10.0, "DISTANCE", "LIMIT")
    assert found.depths[0] == 1


@pytest.mark.parametrize(("name", "vertices", "seed", "levels"), cases_of([*MESHES][:-1], 1))
def test_certified_bounds_hold_of_what_is_drawn(name: str, vertices: Vertices, seed: int, levels: int) -> None:
    """Each face by itself, both ways, and no depth by distance is larger."""
    mesh, diagonal = case(name, seed)
    every = np.arange(mesh.face_count)
    for level in range(1, levels + 1):
        there, back, step = sampled(mesh, level, vertices)
        largest = max(there.max(), back.max())
        for tolerance in (0.1 * diagonal, 1.2 * largest + 1e-6 * diagonal, 0.5 * largest):
            test, found = ToleranceTest(tolerance, 0.0), np.full(mesh.face_count, np.inf)
            for block in certified_level_bounds(
                mesh, every, test, vertices, level, lambda: None, nearly=False, as_drawn=True
            ):
                found[block.faces] = block.bounds
            assert np.all(back <= found * (1 + ROUNDING) + ROUNDING * diagonal)
            assert np.all(there <= found * (1 + ROUNDING) + ROUNDING * diagonal + OFF * step)
            if np.any(np.isfinite(found)) and tolerance > 0.2 * largest > 0:
                depths = face_depths(mesh, tolerance, "DISTANCE", vertices, effort="QUICK").depths
                assert np.all(depths[np.isfinite(found)] <= level)


@pytest.mark.parametrize(("bend", "vertices"), [(0.03, Vertices.LIMIT), (-0.03, Vertices.CONTROL)])
def test_twists_add_to_the_distance_of_facets(bend: float, vertices: Vertices) -> None:
    """Facets and twists by themselves are within tolerances here that what is drawn is not."""
    mesh = meshes.build(meshes.bent(meshes.grid(6, 6), lambda x, y, _: (x, y, 0.1 * x * y + bend * (x * x + y * y))))
    there, back, step = sampled(mesh, 1, vertices)
    every, found = np.arange(mesh.face_count), {}
    for as_drawn in (True, False):
        found[as_drawn] = np.full(mesh.face_count, np.inf)
        test = ToleranceTest(0.9 * np.median(back), 0.0)
        for block in certified_level_bounds(
            mesh, every, test, vertices, 1, lambda: None, nearly=False, as_drawn=as_drawn
        ):
            found[as_drawn][block.faces] = block.bounds
    assert np.all(np.maximum(back, there - OFF * step) <= found[True])
    assert np.any(found[False] < back)


def test_polygons_may_be_cut_along_their_highest_corners() -> None:
    around = np.arange(6)
    loop = np.stack([np.cos(around * np.pi / 3), np.sin(around * np.pi / 3), 0.3 * (-1.0) ** around], axis=1)
    sharp = {(min(pair), max(pair)): 1.0 for pair in zip(range(6), [1, 2, 3, 4, 5, 0], strict=True)}
    data = replace(
        meshes.from_faces(loop, [list(range(6))]), edge_creases=sharp, vertex_creases=dict.fromkeys(range(6), 1.0)
    )
    mesh = meshes.build(data)
    fine, fine_triangles, *_ = surface(mesh, 4)
    points = fine[fine_triangles].reshape(-1, 3)
    cut = loop[[[0, 2, 4], [0, 1, 2], [2, 3, 4], [4, 5, 0]]]
    off = point_to_triangles(np.repeat(points, 4, axis=0), np.tile(cut, (len(points), 1, 1))).reshape(-1, 4)
    farthest = off.min(axis=1).max()
    assert np.isinf(level_bounds(mesh, 0.95 * farthest, "DISTANCE", Vertices.LIMIT, 0)[0])
    assert np.isfinite(level_bounds(mesh, 3 * farthest, "DISTANCE", Vertices.LIMIT, 0)[0])


@pytest.mark.parametrize("name", ["house", "tetrahedron", "poles"])
def test_at_level_0_control_points_are_shown_whatever_the_vertices(name: str) -> None:
    mesh = meshes.build(TRIANGLES[name](1))
    control, limit = (level_bounds(mesh, 10.0, "DISTANCE", vertices, 0) for vertices in Vertices)
    np.testing.assert_array_equal(control, limit)
    depths = [face_depths(mesh, 0.2, "DISTANCE", vertices).depths == 0 for vertices in Vertices]
    np.testing.assert_array_equal(*depths)


@pytest.mark.parametrize("smooth_corners", [True, False])
@pytest.mark.parametrize("sides", [5, 40])
def test_flat_polygons_alone_are_bounded_at_all_levels(sides: int, smooth_corners: bool) -> None:
    turns = np.linspace(0, 2 * np.pi, sides, endpoint=False) + 0.05 * np.sin(np.arange(sides))
    loop = np.stack([np.cos(turns), 2 * np.sin(turns), 0.01 * np.cos(3 * turns)], axis=1)
    mesh = meshes.build(meshes.from_faces(loop, [list(range(sides))]), smooth_corners=smooth_corners)
    bound = lone_polygon_bounds(mesh, np.arange(1))[0]
    assert bound < 0.9 * 4 * (2 * np.pi / sides) ** 2
    for vertices in Vertices:
        assert face_depths(mesh, bound + 1e-3, "DISTANCE", vertices).depths[0] == 0
        assert uniform_level(mesh, bound + 1e-3, "DISTANCE", vertices) <= 1
        for level in (1, 2):
            there, back, step = sampled(mesh, level, vertices)
            assert max(back.max(), there.max() - OFF * step) <= bound
    fine = surface(mesh, 4)[0]
    assert np.linalg.norm(loop[:, None] - fine, axis=2).min(axis=1).max() <= bound
    beside = meshes.from_faces([*loop, [3, 0, 0]], [list(range(sides)), [0, 1, sides]])
    assert np.isinf(lone_polygon_bounds(meshes.build(beside), np.arange(1))[0])
    star = meshes.from_faces(loop[np.arange(5) * (2 * sides // 5) % sides], [list(range(5))])
    assert np.isinf(lone_polygon_bounds(meshes.build(star), np.arange(1))[0])


def test_triangles_near_enough_have_depth_0() -> None:
    """A sphere of triangles: where certified bounds suffice, no level is asked for."""
    data = meshes.sphere(24, 12)
    triangles = [[face[0], *pair] for face in data.faces for pair in pairwise(face[1:])]
    mesh = meshes.build(meshes.from_faces(data.positions, triangles))
    diagonal = meshes.diagonal(mesh)
    certified = face_depths(mesh, 0.02 * diagonal, "CERTIFIED", "CONTROL").depths
    assert np.all(certified == 0)
    assert np.all(face_depths(mesh, 0.02 * diagonal, "DISTANCE", "LIMIT").depths == 0)
    assert np.all(face_depths(mesh, 0.002 * diagonal, "DISTANCE", "LIMIT").depths == 1)


# The last one takes the longest.
@pytest.mark.parametrize(("name", "vertices", "seed", "levels"), cases_of([*MESHES][:-1], 0))
def test_levels_are_as_near_as_proved(name: str, vertices: Vertices, seed: int, levels: int) -> None:
    """At several tolerances, each face both ways."""
    mesh, diagonal = case(name, seed)
    for level in range(1, levels + 1):
        there, back, step = sampled(mesh, level, vertices)
        largest = max(there.max(), back.max())
        for tolerance in (0.1 * diagonal, 1.05 * largest + 1e-6 * diagonal, 0.95 * largest):
            bounds = level_bounds(mesh, tolerance, "DISTANCE", vertices, level)
            # Strips at its border a face may leave to those that touch it.
            around = largest_around(mesh, bounds) * (1 + ROUNDING) + ROUNDING * diagonal
            assert np.all(back <= around)
            assert np.all(there <= around + OFF * step)


def test_the_surface_beside_measured_leaves_has_to_be_near(monkeypatch: pytest.MonkeyPatch) -> None:
    """Feet of leaves that touch a measured one do not cover it. Here nothing else is far from anything. What a depth
    proves by leaves is not measured again, but what is beside it is."""
    mesh, _ = case("bevelled prism", 1)
    there, back, _ = sampled(mesh, 2, Vertices.LIMIT)
    tolerance = 1.1 * max(there.max(), back.max())

    drawn_leaves = []

    def deviations(leaves: DrawnLeaves, on_surface: BoolArray, drawn: BoolArray, *_: float) -> FloatArray:
        drawn_leaves.append(np.count_nonzero(drawn))
        return np.where(on_surface & ~drawn, np.inf, 0.0)

    monkeypatch.setattr(DrawnLeaves, "deviations", deviations)
    monkeypatch.setattr(DrawnLeaves, "mapped", lambda leaves, *_: np.full(len(leaves.points), np.inf))
    bounds = level_bounds(mesh, tolerance, "DISTANCE", Vertices.LIMIT, 2)
    assert 0 < np.count_nonzero(bounds == np.inf) < mesh.face_count
    found = face_depths(mesh, tolerance, "DISTANCE", "LIMIT")
    assert found.depths.max() == 2
    assert np.any(found.alone & (found.depths == 2))
    counts = []
    for depth in (1, 2):
        drawn_leaves.clear()
        at_depth = replace(found, depths=np.full_like(found.depths, depth))
        assert uniform_level(mesh, tolerance, "DISTANCE", "LIMIT", at_depth, 2) > 2
        counts.append(drawn_leaves[0])
    assert counts[1] < counts[0]


@pytest.mark.parametrize(
    ("name", "vertices"),
    combinations(["cube", "bevelled prism", "torus", "hexagons", "creased cube", "tetrahedron"], Vertices),
)
def test_a_level_is_proved_where_it_is_a_tenth_nearer_than_asked(name: str, vertices: Vertices) -> None:
    mesh, _ = case(name, 1)
    there, back, _ = sampled(mesh, 1, vertices)
    bounds = level_bounds(mesh, 1.1 * max(there.max(), back.max()), "DISTANCE", vertices, 1)
    assert np.all(np.isfinite(bounds))


@pytest.mark.parametrize(
    ("name", "vertices"),
    combinations(["cube", "sphere", "bevelled prism", "landscape with creases", "wavy and flat"], Vertices),
)
def test_all_faces_are_within_the_tolerance_at_the_uniform_level(name: str, vertices: Vertices) -> None:
    mesh, diagonal = case(name, 3)
    for tolerance in (0.02 * diagonal, 0.005 * diagonal):
        found = face_depths(mesh, tolerance, "DISTANCE", vertices)
        assert np.all((found.depths >= 0) & (found.bounds <= tolerance))
        level = uniform_level(mesh, tolerance, "DISTANCE", vertices, found, 1)
        assert level >= found.depths.max()
        if level <= 3:
            there, back, step = sampled(mesh, level, vertices)
            assert back.max() <= tolerance
            assert there.max() <= tolerance + OFF * step


@pytest.mark.parametrize(("name", "tolerance", "level"), [("bevelled prism", 1e-3, 2), ("sphere", 2e-3, 2)])
def test_uneven_parameters_do_not_count(name: str, tolerance: float, level: int) -> None:
    """The least level: samples at the one before are farther off. At equal parameters it is many levels more."""
    mesh, diagonal = case(name, 9)
    assert uniform_level(mesh, tolerance * diagonal, "DISTANCE", "LIMIT") == level
    there, back, _ = sampled(mesh, level - 1, Vertices.LIMIT)
    assert max(there.max(), back.max()) > tolerance * diagonal
    assert uniform_level(mesh, tolerance * diagonal, "CERTIFIED", "LIMIT") > level + 1


def test_what_is_flat_has_no_distance() -> None:
    """Whatever way its grid lines wind: all of it, at the first level at which vertices are on the surface."""
    mesh, diagonal = case("wavy and flat", 2)
    border = mesh.edge_vertices[mesh.edge_face_counts == 1]
    touching = mesh.corner_faces[np.isin(mesh.corner_vertices, border)]
    inside = np.setdiff1d(np.arange(mesh.face_count), touching)
    found = face_depths(mesh, 1e-4 * diagonal, "DISTANCE", "LIMIT")
    assert len(inside)
    assert np.all(found.depths[inside] <= 1)


def test_faces_of_depth_0_have_the_least_possible_depth() -> None:
    """However many faces there are."""
    mesh = meshes.build(meshes.landscape(40, 40))
    found = face_depths(mesh, 10.0, "DISTANCE", "LIMIT")
    assert np.count_nonzero(found.depths == 0) > MOST_FACES
    assert np.all(found.exact[found.depths == 0])


@pytest.mark.parametrize("name", ["bevelled prism", "folded"])
@pytest.mark.parametrize("tolerance", [0.0057, 0.0165])
def test_deepest_depths_of_large_meshes_are_proved(
    name: str, tolerance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where estimates find a level to be enough that is not."""
    mesh, size = case(name, 1)
    plain = face_depths(mesh, tolerance * size, "DISTANCE", "CONTROL", effort="FULL")
    for name in ("MOST_MEASURED", "MOST_REGULAR", "MOST_MAPPED"):
        monkeypatch.setattr(distance_depth, name, 0)
    # Groups of faces with too many leaves are examined in parts, and measured in smaller ones.
    monkeypatch.setattr(distance_depth, "MOST_LEAVES", 1 << 6)
    monkeypatch.setattr(distance_depth, "MEASURED_AT_ONCE", 1 << 3)
    found = face_depths(mesh, tolerance * size, "DISTANCE", "CONTROL")
    assert np.all(found.bounds <= tolerance * size)
    assert np.all(found.depths >= plain.depths)
    assert found.depths.max() == plain.depths.max()
    assert not np.any(plain.might_need_less)
    assert np.all(found.might_need_less[found.depths > plain.depths])


@pytest.mark.parametrize("name", ["bevelled prism", "sphere", "landscape with creases", "wavy"])
def test_every_effort_proves_its_depths_and_quick_measures_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, size = case(name, 1)
    found = {effort: face_depths(mesh, 2e-3 * size, "DISTANCE", "LIMIT", effort=effort) for effort in Effort}
    measured = []

    def deviations(leaves: DrawnLeaves, *_: object) -> FloatArray:
        measured.append(len(leaves.points))
        return np.zeros(len(leaves.points))

    monkeypatch.setattr(DrawnLeaves, "deviations", deviations)
    quick = face_depths(mesh, 2e-3 * size, "DISTANCE", "LIMIT", effort="QUICK")
    poses = [Pose(lambda: mesh, 2e-3 * size)] * 2
    in_poses = pose_depths(poses, "DISTANCE", "LIMIT", effort="QUICK")
    raised = raised_depths(poses, "DISTANCE", "LIMIT", in_poses, in_poses.depths + 1, effort="QUICK")
    quick_level = common_level([(poses, "DISTANCE", "LIMIT", in_poses)], effort="QUICK")
    assert not measured
    monkeypatch.undo()
    assert np.all((raised.depths > in_poses.depths) & (raised.bounds <= 2e-3 * size))
    np.testing.assert_array_equal(quick.depths, found[Effort.QUICK].depths)
    assert np.all(quick.might_need_less[found[Effort.FULL].depths < quick.depths])
    assert np.all(found[Effort.NORMAL].depths <= quick.depths)
    assert np.all(found[Effort.FULL].depths <= found[Effort.NORMAL].depths)
    levels = [uniform_level(mesh, 2e-3 * size, "DISTANCE", "LIMIT", each_one) for each_one in found.values()]
    assert quick_level >= min(levels)
    for each_one in found.values():
        assert np.all((each_one.depths >= 0) & (each_one.bounds <= 2e-3 * size))
    for level in {quick_level, *levels}:
        there, back, step = sampled(mesh, level, Vertices.LIMIT)
        assert max(back.max(), there.max() - OFF * step) <= 2e-3 * size


def terraces(size: int) -> PolygonMesh:
    """Steps with two lines of the grid close together at each."""

    def along(places: FloatArray) -> FloatArray:
        return places // 3 + np.array([0, 0.1, 0.9])[(places % 3).astype(int)]

    return meshes.build(
        meshes.bent(meshes.grid(size, size), lambda x, y, _: (along(x), along(y), 0.3 * (x // 3 % 2) * (y // 3 % 2)))
    )


def test_a_mesh_of_many_faces_needs_no_deeper_level_than_a_part_of_it() -> None:
    part, whole = (face_depths(terraces(size), 0.01, "DISTANCE", "LIMIT") for size in (12, 42))
    assert len(whole.depths) > distance_depth.MOST_REGULAR
    assert part.depths.max() == whole.depths.max() == 2
    assert np.all(whole.bounds <= 0.01)
    assert uniform_level(terraces(42), 0.01, "DISTANCE", "LIMIT", whole) == 2
    assert pose_depths([Pose(partial(terraces, 42), 0.01)] * 2, "DISTANCE", "LIMIT").depths.max() == 2


@pytest.mark.parametrize("tolerance", each([0.003, 0.01], short=[0.01]))
def test_a_depth_over_poses_holds_in_all_of_them(tolerance: float) -> None:
    mesh, diagonal = case("bevelled prism", 5)
    generator = np.random.default_rng(1)
    positions = mesh.positions + [[[0.0]], [[0.1]], [[0.1]]] * generator.normal(size=(3, *mesh.positions.shape))
    poses = [Pose(partial(mesh.changed, positions=own), tolerance * diagonal) for own in positions]
    found = pose_depths(poses, "DISTANCE", "LIMIT")
    single = [face_depths(pose.make(), pose.tolerance, "DISTANCE", "LIMIT") for pose in poses]
    depths = [each.depths for each in single]
    assert np.all(found.depths >= np.max(depths, axis=0))
    assert np.all(found.bounds <= tolerance * diagonal)
    is_raised = found.depths > depths[0]
    assert np.any(is_raised)
    np.testing.assert_array_equal(found.exact, single[0].exact & ~is_raised)
    alike = np.all(depths == found.depths, axis=0)
    lasting = np.all([each.lasting for each in single], axis=0)
    np.testing.assert_array_equal(found.lasting[alike], lasting[alike])
    level = common_level([(poses, "DISTANCE", "LIMIT", found)])
    for pose in poses:
        there, back, step = sampled(pose.make(), level, Vertices.LIMIT)
        assert back.max() <= pose.tolerance
        assert there.max() <= pose.tolerance + OFF * step
    first = deepest_pose(poses, "DISTANCE", "LIMIT", found, lambda: None)
    assert [each.max() == found.depths.max() for each in depths].index(True) == first


@pytest.mark.parametrize("vertices", Vertices)
def test_quads_that_are_folded_where_the_object_is_flat_are_drawn_along_their_other_diagonal(
    vertices: Vertices,
) -> None:
    """In the object's space heights are a hundred times as large, so that many quads are folded there."""
    mesh, diagonal = case("landscape", 2)
    turned = mesh.changed(axes=np.diag([1.0, 1.0, 0.01]))
    there, back, step = sampled(turned, 1, vertices)
    plain, _, _ = sampled(mesh, 1, vertices)
    assert np.any(there != plain)
    around = largest_around(mesh, level_bounds(turned, 0.2 * diagonal, "DISTANCE", vertices, 1)) * (1 + ROUNDING)
    assert np.all(back <= around)
    assert np.all(there <= around + OFF * step)
