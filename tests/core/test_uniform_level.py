# SPDX-License-Identifier: GPL-3.0-or-later
"""The first level at which all faces are within the tolerance; and depths over several poses."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.depth.common_level import common_level
from ccdepth_addon.core.depth.face_depths import ToleranceError, check_pose, face_depths, uniform_level
from ccdepth_addon.core.depth.modifier_quality import MOST_QUALITY, needed_quality, unmet_corners
from ccdepth_addon.core.depth.pose_depths import Pose, deepest_pose, pose_depths, raised_depths
from ccdepth_addon.core.depth.tolerance import FaceDepths
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.mesh.validation import InvalidMeshError
from tests import meshes
from tests.brute_force import Levels
from tests.core.test_face_depths import EQUAL_METHODS, LEVELS, both_vertices, every_method, sampled
from tests.meshes import build
from tests.proved_bounds import level_bounds
from tests.thorough import combinations

# Sampled distances are true ones up to rounding in double precision, at coordinates of some ten.
ROUNDING = 1e-12

NAMES = ["triangles and quads", "valences 2 and 12", "landscape with random creases", "soup"]


@pytest.mark.parametrize("name", NAMES)
@every_method
@pytest.mark.parametrize("tolerance", [2.0, 0.5, 0.1, 0.02])
def test_the_uniform_level_is_the_first_with_bounds_of_all_faces(name: str, method: str, tolerance: float) -> None:
    """Whatever is not evaluated again would have been found to hold; and all faces are near enough there."""
    mesh, distances = sampled(name, "CONTROL")
    found = uniform_level(mesh, tolerance, method, "CONTROL")
    assert found >= LEVELS or np.all(distances[found] <= tolerance)
    depths = face_depths(mesh, tolerance, method, "CONTROL").depths
    for level in range(int(depths.max()), found + 1):
        assert np.isfinite(level_bounds(mesh, tolerance, method, "CONTROL", level)).all() == (level == found)


@pytest.mark.parametrize("method", [method for method in EQUAL_METHODS if method != "CERTIFIED"])
def test_most_regular_faces_are_lasting(method: str) -> None:
    found = face_depths(build(meshes.landscape(12, 12)), 1e-3, method, "CONTROL")
    assert np.count_nonzero(found.lasting) > 0.8 * len(found.lasting)


EPSILON = 1.1


@cache
def grid_counter_example() -> PolygonMesh:
    """3 × 3 faces. The middle one is near enough at levels 0 and 3, and not between."""
    mesh = build(meshes.grid_with_a_late_face(), smooth_corners=False)
    # Distances go with the heights, the grid itself being even and flat.
    share = 1.07 / Levels(mesh).distances(0, "CONTROL", 5)[4]
    return mesh.changed(positions=mesh.positions * [1.0, 1.0, share])


def test_the_deepest_depth_is_not_enough_for_all_faces() -> None:
    """On a torus a face of depth 0 is off at level 1, which is the deepest depth: level 2 it has to be."""
    mesh = build(meshes.torus_with_a_late_face())
    levels = Levels(mesh)
    distances = [levels.distances(level, "LIMIT", 4) for level in range(3)]
    assert distances[0][12] <= EPSILON < 1.1 * EPSILON < distances[1][12]
    assert np.delete(distances[1], 12).max() <= EPSILON
    depths = face_depths(mesh, EPSILON, "CERTIFIED", "LIMIT").depths
    assert (depths[12], depths.max()) == (0, 1)
    assert np.isinf(level_bounds(mesh, EPSILON, "CERTIFIED", "LIMIT", 1)[12])
    assert uniform_level(mesh, EPSILON, "CERTIFIED", "LIMIT") == 2
    assert distances[2].max() <= EPSILON
    # Of two poses it is the second that needs it.
    poses = [pose_of(mesh, share * mesh.positions, EPSILON) for share in (0.5, 1.0)]
    found = pose_depths(poses, "CERTIFIED", "LIMIT")
    assert common_level([(poses, "CERTIFIED", "LIMIT", found)]) == 2


@every_method
@both_vertices
def test_progress_rises_over_several_levels(method: str, vertices: str) -> None:
    for mesh in (build(meshes.torus_with_a_late_face()), build(meshes.AWKWARD["soup"](), smooth_corners=False)):
        found = face_depths(mesh, EPSILON, method, vertices)
        fractions: list[float] = []
        uniform_level(mesh, EPSILON, method, vertices, found, progress=fractions.append)
        assert fractions == sorted(fractions)
        assert 0 <= fractions[0] <= fractions[-1] < 1
        least = int(found.depths.max()) + 2
        assert uniform_level(mesh, EPSILON, method, vertices, found, least) == least


def test_limit_vertices_take_a_level_at_least() -> None:
    """A modifier at level 0 moves nothing to the limit surface."""
    mesh = build(meshes.grid(3, 3), smooth_corners=False)
    assert [uniform_level(mesh, 0.1, "CERTIFIED", vertices) for vertices in ("CONTROL", "LIMIT")] == [0, 1]


@pytest.mark.parametrize(("crease", "sharpness"), [(0.3, 1), (0.7, 5), (0.9, 9), (0.99, 10)])
def test_quality_reaches_the_level_and_the_end_of_the_sharpness(crease: float, sharpness: int) -> None:
    mesh = build(meshes.cube_creased_around_the_top(crease))
    assert [needed_quality(mesh, level, 0.01) for level in (1, 5, 11)] == [sharpness, max(5, sharpness), 11]


def test_corners_of_an_open_mesh_need_more() -> None:
    """A smooth corner of one face is off by a sixth of its second difference, and a quarter of that with each level."""
    smooth, kept = (build(meshes.grid(3, 3), smooth_corners=smooth) for smooth in (True, False))
    unmet = unmet_corners(smooth)
    assert set(smooth.corner_vertices[unmet.corners].tolist()) == {0, 3, 12, 15}
    # 2V - V₋₁ - V₁ is (1, 1) at the corner.
    np.testing.assert_allclose(unmet.gaps, np.sqrt(2) / 6 * 0.25 ** np.arange(MOST_QUALITY + 1), rtol=1e-9)
    assert needed_quality(smooth, 1, 0.01) == 6
    assert needed_quality(kept, 1, 0.01) == 1
    assert needed_quality(smooth, 1, 1e-7) > MOST_QUALITY


def test_faces_at_such_corners_keep_a_margin() -> None:
    """A sixty-fourth of the tolerance."""
    mesh = build(meshes.with_heights(meshes.grid(1, 1), [0.0, 0.5, 0.2, 0.0]))
    bound = level_bounds(mesh, 10.0, "SECOND_ORDER", "LIMIT", 2)[0]
    assert [uniform_level(mesh, each * bound, "SECOND_ORDER", "LIMIT") for each in (1.01, 1.03)] == [3, 2]


# Single poses are bounded without scaling them by the tolerance, which rounds otherwise.
SCALING = 1e-9


def posed(mesh: PolygonMesh, count: int, tolerance: float, *, jumps: bool = False, seed: int = 1) -> list[Pose]:
    """Poses on the way from the mesh to another shape and back, or at random, each with a tolerance of its own."""
    rng = np.random.default_rng(seed)
    size = np.ptp(mesh.positions, axis=0).max()
    way = 0.1 * size * rng.standard_normal(mesh.positions.shape)
    poses = []
    for number in range(count):
        share = rng.random() if jumps else np.sin(np.pi * number / max(count - 1, 1))
        positions = mesh.positions + share * way + 1e-3 * size * np.sin(number) * np.roll(way, 1, axis=0)
        poses.append(pose_of(mesh, positions, tolerance * (1 + 0.02 * number)))
    return poses


def pose_of(mesh: PolygonMesh, positions: FloatArray, tolerance: float) -> Pose:
    return Pose(lambda: mesh.changed(positions=positions), tolerance)


def singles(poses: list[Pose], method: str, vertices: str) -> list[FaceDepths]:
    return [face_depths(pose.make(), pose.tolerance, method, vertices) for pose in poses]


@pytest.mark.parametrize(("name", "vertices", "jumps"), combinations(NAMES, ["CONTROL", "LIMIT"], [True, False]))
@every_method
def test_the_depths_are_the_deepest_of_single_poses(name: str, method: str, vertices: str, jumps: bool) -> None:
    """And the common level holds in every pose."""
    mesh = build(meshes.AWKWARD[name](), smooth_corners=False)
    poses = posed(mesh, 7, 0.5, jumps=jumps)
    found = pose_depths(poses, method, vertices)
    alone = singles(poses, method, vertices)
    deepest = np.max([each.depths for each in alone], axis=0)
    # A level that is enough in one pose need not be in another that needs a lesser one.
    raised = np.flatnonzero(found.depths != deepest)
    assert np.all(found.depths >= deepest)
    for face in raised.tolist():
        at_deepest = [level_bounds(p.make(), p.tolerance, method, vertices, int(deepest[face]))[face] for p in poses]
        assert np.isinf(at_deepest).any()
    assert len(raised) <= 0.02 * mesh.face_count
    exact = np.any([each.exact & (each.depths == found.depths) for each in alone], axis=0)
    assert np.all(exact | ~found.exact)
    assert np.all(found.bounds <= max(pose.tolerance for pose in poses))
    level = common_level([(poses, method, vertices, found)])
    least = max(uniform_level(pose.make(), pose.tolerance, method, vertices) for pose in poses)
    # No face needs a level that none of the poses needs, but where one is not enough after another.
    assert max(least - 1, found.depths.max()) <= level <= max(least, found.depths.max()) + 1
    if method in ("CERTIFIED", "SHARP"):
        posed_levels = [Levels(pose.make()) for pose in poses]
        depths = range(min(level + 1, LEVELS))
        sampled = np.array([[each.distances(depth, vertices, 2) for depth in depths] for each in posed_levels])
        shallow = np.flatnonzero(found.depths < LEVELS)
        farthest = sampled[:, found.depths[shallow], shallow].max(axis=0)
        assert np.all(farthest <= found.bounds[shallow] + ROUNDING)
        if level < LEVELS:
            assert np.all(sampled[:, level] <= np.array([[pose.tolerance] for pose in poses]) + ROUNDING)


def test_what_lasts_in_one_pose_alone_does_not_last() -> None:
    mesh = build(meshes.bent(meshes.landscape(6, 6), lambda x, y, z: (x + y / 2, y, z)))
    poses = [pose_of(mesh, share * mesh.positions, 0.03) for share in (0.5, 1.0)]
    first, second = singles(poses, "DISTANCE", "LIMIT")
    found = pose_depths(poses, "DISTANCE", "LIMIT")
    once = (first.depths == second.depths) & first.lasting & ~second.lasting
    assert once.any()
    assert not found.lasting[once].any()


@pytest.mark.parametrize("name", NAMES)
@both_vertices
def test_the_deepest_pose_is_the_first_that_alone_has_the_deepest_depth(name: str, vertices: str) -> None:
    poses = posed(build(meshes.AWKWARD[name](), smooth_corners=False), 7, 0.5, jumps=True)
    found = pose_depths(poses, "CERTIFIED", vertices)
    deepest = found.depths.max()
    alone = [np.any(each.depths[found.depths == deepest] == deepest) for each in singles(poses, "CERTIFIED", vertices)]
    assert deepest_pose(poses, "CERTIFIED", vertices, found, lambda: None) == alone.index(True)


def test_bounds_are_lengths_in_the_pose_where_they_are_longest() -> None:
    """The same shape four times as large, with a tolerance as much larger: in units of that nothing has moved."""
    mesh = build(meshes.landscape(4, 4))
    poses = [pose_of(mesh, mesh.positions, 0.05), pose_of(mesh, 4 * mesh.positions, 0.2)]
    alone = face_depths(mesh, 0.05, "CERTIFIED", "CONTROL")
    levels = Levels(mesh.changed(positions=4 * mesh.positions))
    distances = np.array([levels.distances(level, "CONTROL", 2) for level in range(LEVELS)])
    for order in (poses, poses[::-1], [poses[0], *poses]):
        found = pose_depths(order, "CERTIFIED", "CONTROL")
        np.testing.assert_array_equal(found.depths, alone.depths)
        np.testing.assert_allclose(found.bounds, 4 * alone.bounds, rtol=SCALING)
        shallow = np.flatnonzero(found.depths < LEVELS)
        assert np.all(distances[found.depths[shallow], shallow] <= found.bounds[shallow] + ROUNDING)


def test_a_face_may_be_farther_at_the_next_two_levels() -> None:
    """The middle face of 3 × 3, whose depth is 0, is off at level 1 by several times the tolerance, and at level 2."""
    mesh = grid_counter_example()
    levels = Levels(mesh)
    distances = [levels.distances(level, "CONTROL", 4)[4] for level in range(4)]
    assert distances[0] <= EPSILON
    assert distances[1] > 4 * EPSILON
    assert distances[2] > EPSILON >= distances[3]
    assert face_depths(mesh, EPSILON, "CERTIFIED", "CONTROL").depths[4] == 0
    bounds = [level_bounds(mesh, EPSILON, "CERTIFIED", "CONTROL", level)[4] for level in range(4)]
    assert np.isfinite(bounds).tolist() == [True, False, False, True]


def test_a_level_is_not_enough_because_an_earlier_one_is() -> None:
    """In one pose the middle face of 3 × 3 is near enough at levels 0 and 3 alone, and another one needs level 1."""
    whole = grid_counter_example()
    grid = meshes.grid(3, 3).positions
    odd = pose_of(whole, whole.positions, EPSILON)
    bump = np.zeros_like(grid)
    bump[5, 2] = 1.0
    scale = 2.0 * EPSILON / Levels(whole.changed(positions=grid + bump)).distances(0, "CONTROL", 3)[4]
    plain = pose_of(whole, grid + scale * bump, EPSILON)
    assert [int(each.depths[4]) for each in singles([odd, plain], "CERTIFIED", "CONTROL")] == [0, 1]
    distances = [Levels(pose.make()).distances(3, "CONTROL", 4)[4] for pose in (odd, plain)]
    for poses in ([odd, plain], [plain, odd], [odd, odd, plain, odd]):
        found = pose_depths(poses, "CERTIFIED", "CONTROL")
        assert found.depths[4] == 3
        assert not found.exact[4]
        assert max(distances) <= found.bounds[4] + ROUNDING <= EPSILON
        assert common_level([(poses, "CERTIFIED", "CONTROL", found)]) >= 3


@every_method
def test_no_lesser_depths_than_the_floors(method: str) -> None:
    poses = posed(build(meshes.landscape(6, 6)), 5, 0.1)
    found = pose_depths(poses, method, "CONTROL")
    floors = np.zeros_like(found.depths)
    floors[::3] = found.depths[::3] + 1
    raised = raised_depths(poses, method, "CONTROL", found, floors)
    assert np.all(raised.depths >= np.maximum(found.depths, floors))
    same = raised.depths == found.depths
    assert np.count_nonzero(~same) >= len(same) // 3
    np.testing.assert_array_equal(raised.bounds[same], found.bounds[same])
    for level in np.unique(raised.depths).tolist():
        for pose in poses:
            proved = level_bounds(pose.make(), pose.tolerance, method, "CONTROL", level)
            assert np.all(np.isfinite(proved[raised.depths == level]))
    assert raised_depths(poses, method, "CONTROL", found, np.zeros_like(floors)) is found


def test_progress_rises_and_stops() -> None:
    poses = posed(build(meshes.landscape(12, 12)), 40, 0.05)
    fractions: list[float] = []
    pose_depths(poses, "CERTIFIED", "CONTROL", fractions.append)
    assert all(one <= other for one, other in pairwise([0, *fractions, 1]))
    assert len(set(fractions)) > 10

    def stop(fraction: float) -> None:
        if fraction > 0.5:
            raise LookupError

    with pytest.raises(LookupError):
        pose_depths(poses, "CERTIFIED", "CONTROL", stop)


def test_poses_are_checked() -> None:
    mesh = build(meshes.landscape(3, 3))
    check_pose(mesh, 0.1)
    first = np.arange(mesh.vertex_count)[:, None] == 0
    for positions, match in (
        (np.where(first, np.nan, mesh.positions), "finite"),
        (np.where(first, np.inf, mesh.positions), "finite"),
        (0 * mesh.positions, "one point"),
    ):
        with pytest.raises(InvalidMeshError, match=match):
            check_pose(mesh.changed(positions=positions), 0.1)
    with pytest.raises(ToleranceError, match="finer"):
        check_pose(mesh, 1e-12)
