# SPDX-License-Identifier: GPL-3.0-or-later
"""Depths over several poses of a mesh, against single poses and against brute force."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.depth import pose_depths as depth_search
from ccdepth_addon.core.depth.common_level import common_level
from ccdepth_addon.core.depth.face_depths import (
    METHODS,
    DepthResult,
    ToleranceError,
    check_pose,
    face_depths,
    level_bounds,
    uniform_level,
)
from ccdepth_addon.core.depth.key_poses import POSES_BY_A_KEY
from ccdepth_addon.core.depth.pose_depths import pose_depths, raised_depths
from ccdepth_addon.core.depth.poses import Pose
from ccdepth_addon.core.depth.worst_pose import worst_pose
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.mesh.validation import InvalidMeshError
from tests import meshes
from tests.brute_force import Levels
from tests.core.test_face_depths import LEVELS, both_vertices, build, every_method
from tests.core.test_uniform_level import EPSILON, NAMES, ROUNDING, grid_counter_example

every_name = pytest.mark.parametrize("name", NAMES)

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


def posed_landscape(side: int, count: int, tolerance: float) -> list[Pose]:
    return posed(build(meshes.landscape(side, side)), count, tolerance)


def pose_of(mesh: PolygonMesh, positions: FloatArray, tolerance: float) -> Pose:
    return Pose(lambda: mesh.changed(positions=positions), tolerance)


def singles(poses: list[Pose], method: str, vertices: str) -> list[DepthResult]:
    return [face_depths(pose.make(), pose.tolerance, method, vertices) for pose in poses]


@pytest.mark.parametrize(
    ("vertices", "jumps"),
    [
        ("CONTROL", True),
        ("LIMIT", False),
        pytest.param("CONTROL", False, marks=pytest.mark.thorough),
        pytest.param("LIMIT", True, marks=pytest.mark.thorough),
    ],
)
@every_name
@every_method
def test_the_depths_are_the_deepest_of_single_poses(name: str, method: str, vertices: str, jumps: bool) -> None:
    """And the common level holds in every pose."""
    mesh = build(meshes.AWKWARD[name](), smooth_corners=False)
    poses = posed(mesh, 11, 0.5, jumps=jumps)
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
    level = common_level(poses, method, vertices, found)
    least = max(uniform_level(pose.make(), pose.tolerance, method, vertices) for pose in poses)
    # No face needs a level that none of the poses needs, but where one is not enough after another.
    assert max(least - 1, found.depths.max()) <= level <= max(least, found.depths.max()) + 1
    if method == "CERTIFIED" and level < LEVELS:
        for pose in poses:
            assert np.all(Levels(pose.make()).distances(level, vertices, 2) <= pose.tolerance + ROUNDING)


@every_name
@both_vertices
def test_no_face_is_farther_in_any_pose_than_proved(name: str, vertices: str) -> None:
    poses = posed(build(meshes.AWKWARD[name](), smooth_corners=False), 11, 1.0)
    levels = [Levels(pose.make()) for pose in poses]
    sampled = [np.max([each.distances(level, vertices, 2) for each in levels], axis=0) for level in range(LEVELS)]
    for method in METHODS:
        found = pose_depths(poses, method, vertices)
        for level in range(LEVELS):
            at = found.depths == level
            assert np.all(sampled[level][at] <= found.bounds[at] + ROUNDING)


def test_poses_between_key_poses_are_tested_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Heights grow evenly, so only the last pose, a key pose, makes faces deeper."""
    mesh = build(meshes.landscape(6, 6))
    growth = mesh.positions * [0.0, 0.0, 1.0]
    poses = [pose_of(mesh, mesh.positions + number / 4 * growth, 0.05) for number in range(POSES_BY_A_KEY)]
    first, last = (each.depths for each in singles([poses[0], poses[-1]], "CERTIFIED", "CONTROL"))
    monkeypatch.delattr(depth_search._PoseSearch, "_test")
    np.testing.assert_array_equal(pose_depths(poses, "CERTIFIED", "CONTROL").depths, last)
    assert np.any(first < last)


@both_vertices
def test_bounds_are_those_of_single_poses_where_a_pose_is_alone(vertices: str) -> None:
    [pose] = poses = posed_landscape(8, 1, 0.05)
    found, [alone] = pose_depths(poses, "CERTIFIED", vertices), singles(poses, "CERTIFIED", vertices)
    for name in ("depths", "bounds", "exact"):
        np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))
    assert common_level(poses, "CERTIFIED", vertices, found) == uniform_level(pose.make(), 0.05, "CERTIFIED", vertices)


@every_name
@both_vertices
def test_the_worst_pose_alone_has_the_deepest_depth(name: str, vertices: str) -> None:
    poses = posed(build(meshes.AWKWARD[name](), smooth_corners=False), 12, 0.5, jumps=True)
    found = pose_depths(poses, "CERTIFIED", vertices)
    worst = worst_pose(poses, "CERTIFIED", vertices, found)
    assert worst.depth == found.depths.max()
    shares = []
    for pose, alone in zip(poses, singles(poses, "CERTIFIED", vertices), strict=True):
        deepest = (alone.depths == worst.depth) & (found.depths == worst.depth)
        shares.append(np.max(alone.bounds[deepest] / pose.tolerance, initial=-np.inf))
    assert [shares[worst.pose], worst.share] == pytest.approx([max(shares)] * 2, rel=SCALING)


def test_of_poses_alike_the_first_is_the_worst() -> None:
    poses = posed_landscape(4, 1, 0.05) * 5
    assert worst_pose(poses, "CERTIFIED", "CONTROL", pose_depths(poses, "CERTIFIED", "CONTROL")).pose == 0


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
        assert common_level(poses, "CERTIFIED", "CONTROL", found) >= 3


@every_method
def test_no_lesser_depths_than_the_floors(method: str) -> None:
    poses = posed_landscape(6, 5, 0.1)
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
    poses = posed_landscape(12, 40, 0.05)
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
    for value in (np.nan, np.inf):
        positions = mesh.positions.copy()
        positions[0, 0] = value
        with pytest.raises(InvalidMeshError, match="finite"):
            check_pose(mesh.changed(positions=positions), 0.1)
    with pytest.raises(InvalidMeshError, match="one point"):
        check_pose(mesh.changed(positions=np.zeros_like(mesh.positions)), 0.1)
    with pytest.raises(ToleranceError, match="finer"):
        check_pose(mesh, 1e-12)
