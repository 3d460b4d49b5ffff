# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances in pixels, against images of random points and displacements by a pinhole camera written out here."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core import (
    AdaptiveRequest,
    Mode,
    Pixels,
    PolygonMesh,
    Variation,
    View,
    count_faces,
    limit_values,
    subdivide_adaptively,
    surface_boxes,
)
from ccdepth_addon.core.adaptive.planner import plan_within
from tests import meshes, soundness
from tests.core.test_variation import ROUNDED, SEEDS, SIDE, SPACED, build, dense, nearest

PIXELS, OFF_SCREEN = 0.5, 4.0

AHEAD = View(np.eye(3, 4), 100.0, (50.0, 50.0), (100.0, 100.0), 0.1, True)

# The corners of a square.
SQUARE = np.array([(x, y, 5.0) for x in (-1, 1) for y in (-1, 1)])


def view(rng: np.random.Generator, *, is_perspective: bool = True) -> View:
    """A view with any axis, shift and focal length, from a turned, stretched space."""
    turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    size = rng.integers(50, 2000, 2).astype(float)
    return View(
        to_camera=np.column_stack([turned * 10 ** rng.uniform(-1, 1, 3), rng.normal(size=3)]),
        focal=float(rng.uniform(60, 4000)),
        center=tuple(size * rng.uniform(-0.5, 1.5, 2)),
        size=tuple(size),
        near=0.1,
        is_perspective=is_perspective,
    )


def in_camera(seen: View, points: NDArray) -> NDArray:
    return points @ seen.to_camera[:, :3].T + seen.to_camera[:, 3]


def image(seen: View, points: NDArray) -> NDArray:
    """(P, 2): the places of points in the image, in pixels."""
    x, y, z = in_camera(seen, points).T
    depth = z if seen.is_perspective else 1.0
    return np.stack([seen.center[0] + seen.focal * x / depth, seen.center[1] + seen.focal * y / depth], axis=1)


def on_screen(seen: View, points: NDArray) -> NDArray:
    places = image(seen, points)
    is_before = in_camera(seen, points)[:, 2] >= seen.near
    return is_before & (places >= 0).all(axis=1) & (places <= seen.size).all(axis=1)


def control_points(rng: np.random.Generator, seen: View) -> NDArray:
    """A cloud somewhere in front of the camera, near or far, partly in the image, and sometimes around the camera."""
    points = rng.normal(size=(20, 3)) * 10 ** rng.uniform(-2, 0.5) + [0, 0, 10 ** rng.uniform(-1, 1.5)]
    points[:, :2] += points[:, 2:] * (np.array(seen.size) * rng.uniform(0, 1, 2) - seen.center) / seen.focal
    return np.linalg.solve(seen.to_camera[:, :3], (points - seen.to_camera[:, 3]).T).T


def length(views: list[View], points: NDArray, pixels: float = PIXELS) -> float:
    """The tolerance of the hull of points."""
    low, high = points.min(axis=0)[:, None], points.max(axis=0)[:, None]
    return float(pixels * over(views).extremes(low, high)[0][0])


def over(*users: list[View]) -> Pixels:
    return Pixels(1.0, tuple(tuple(views) for views in users), OFF_SCREEN)


def lengths_at(views: list[View], points: NDArray) -> NDArray:
    """(P,): the lengths of a pixel at points, by the definition: between two frames of one camera in the box of both
    places."""
    found = []
    for one, other in pairwise(views) if len(views) > 1 else [(views[0], views[0])]:
        places = np.stack([in_camera(each, points) for each in (one, other)])
        stretch = max(np.linalg.norm(each.to_camera[:, :3], 2) for each in (one, other)) * one.focal
        size, center = np.array(one.size), np.array(one.center)
        low, high = (-0.1 * size - center) / one.focal, (1.1 * size - center) / one.focal
        x, y = np.abs(places[:, :, :2]).max(axis=0).T
        depths = np.maximum(places[:, :, 2].min(axis=0), one.near)
        corner = np.hypot(*np.maximum(-low, high))
        beside = np.minimum((np.hypot(x, y) / depths + 0.01) / 0.99, corner)
        beside[places[:, :, 2].min(axis=0) < one.near] = corner
        lengths = depths / np.sqrt(1 + beside**2)
        nearest = np.where(np.ptp(np.sign(places), axis=0) > 0, 0, np.abs(places).min(axis=0))
        distances = np.maximum(np.linalg.norm(nearest, axis=1), one.near)
        if not one.is_perspective:
            lengths = distances = np.ones(len(points))
        outside = (places[:, :, 2] < one.near).all(axis=0)
        z = places[:, :, 2] if one.is_perspective else np.ones(places.shape[:2])
        for axis in range(2):
            outside |= places[:, :, axis].max(axis=0) < (low[axis] * z).min(axis=0)
            outside |= places[:, :, axis].min(axis=0) > (high[axis] * z).max(axis=0)
        found.append(np.where(outside, OFF_SCREEN * distances, lengths) / stretch)
    return np.min(found, axis=0)


def shifted(seen: View, by: NDArray | list[float]) -> View:
    """The view of what is moved in the camera's space."""
    return replace(seen, to_camera=seen.to_camera + np.column_stack([np.zeros((3, 3)), by]))


def farthest_images(seen: View, surface: NDArray, drawn: NDArray) -> NDArray:
    """The distances of images of points of a surface and of drawn points, of which one is in the image."""
    shown = on_screen(seen, drawn) | on_screen(seen, surface)
    # What is nearer than the image begins is in none.
    for each in (surface, drawn):
        shown &= in_camera(seen, each)[:, 2] >= seen.near
    return np.linalg.norm(image(seen, drawn) - image(seen, surface), axis=1)[shown]


def away(rng: np.random.Generator, points: NDArray, distances: NDArray | float) -> NDArray:
    """Points at distances from others."""
    directions = rng.normal(size=points.shape)
    return points + directions / np.linalg.norm(directions, axis=1)[:, None] * np.reshape(distances, (-1, 1))


@pytest.mark.parametrize("is_perspective", [True, False])
def test_no_image_of_a_drawn_point_is_farther_off_than_the_pixels(is_perspective: bool) -> None:
    largest, told = 0.0, 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        seen = view(rng, is_perspective=is_perspective)
        points = control_points(rng, seen)
        # Points of the hull, and drawn points at the distance.
        surface = np.concatenate([points, rng.dirichlet(np.full(len(points), 0.2), 2000) @ points])
        if not on_screen(seen, surface).any():
            continue
        off = farthest_images(seen, surface, away(rng, surface, length([seen], points)))
        # Places of thousands of pixels round by 1e-10.
        assert off.max(initial=0.0) <= PIXELS + 1e-8
        largest, told = max(largest, off.max(initial=0.0)), told + len(off)
    # It is no better than needed by more than a few hundredths.
    assert largest > 0.95 * PIXELS
    assert told > 10_000


def test_parts_of_a_part_have_no_smaller_tolerance_nor_have_fewer_frames() -> None:
    for seed in range(100):
        rng = np.random.default_rng(seed)
        seen = view(rng, is_perspective=seed % 4 > 0)
        points = control_points(rng, seen)
        views = [seen, shifted(seen, rng.normal(size=3))]
        whole = length(views, points)
        # The sums of the last digits differ.
        assert whole <= length(views[:1], points) * (1 + 1e-12)
        for few in (1, 3, 10):
            assert whole <= length(views, points[rng.choice(len(points), few)]) * (1 + 1e-12)


def test_lengths_over_boxes_are_about_those_at_points() -> None:
    tight = 0
    for seed in range(120):
        rng = np.random.default_rng(seed)
        seen = view(rng, is_perspective=seed % 4 > 0)
        points = control_points(rng, seen)
        views = [seen, shifted(seen, rng.normal(size=3) * 0.1), shifted(seen, rng.normal(size=3))][: seed % 3 + 1]
        size = 10 ** rng.uniform(-3, 0)
        points = points[0] + size * (points - points[0])
        low, high = points.min(axis=0), points.max(axis=0)
        inside = np.concatenate([points, rng.uniform(low, high, (200, 3))])
        lengths = lengths_at(views, inside)
        least, greatest = over(views).extremes(low[:, None], high[:, None])
        # Boxes are wider by 1e-8 of the largest coordinates, a thousand times the depth at most.
        assert least[0] <= lengths.min() * (1 + 1e-5)
        assert greatest[0] >= lengths.max() * (1 - 1e-5)
        tight += size < 0.01 and greatest[0] < 1.3 * least[0]
        single = over(views).extremes(inside.T, inside.T)
        np.testing.assert_allclose(single[0], lengths, rtol=1e-4)
        # Of two users the lesser one counts.
        both = over(views, [shifted(seen, [0, 0, -1.0])]).extremes(low[:, None], high[:, None])
        assert both[0][0] == min(
            least[0], over([shifted(seen, [0, 0, -1.0])]).extremes(low[:, None], high[:, None])[0][0]
        )
    assert tight > 24


def test_images_of_a_surface_from_near_to_far_are_within_the_pixels_by_face() -> None:
    """A landscape below a camera that walks and turns over it: on frames, and on the way between two of them."""
    mesh, rng = meshes.build(meshes.landscape(6, 6)), np.random.default_rng(1)
    low, high = surface_boxes(mesh)
    samples = dense(mesh, 4)
    surface, faces = limit_values(mesh, mesh.positions, samples), mesh.corner_faces[samples.corners]
    own = surface[:, None] - np.stack([low.T, high.T])[:, faces].swapaxes(0, 1)
    assert np.all(own[:, 0] >= 0)
    assert np.all(own[:, 1] <= 0)
    size = np.ptp(mesh.positions, axis=0)
    middle, largest = mesh.positions.mean(axis=0), 0.0
    # Along y, with z upwards; a camera has its y axis downwards here.
    ahead = np.array([(1.0, 0, 0), (0, 0, -1), (0, 1, 0)])

    def placed(part: float) -> NDArray:
        turn = 0.2 * part
        turned = np.array([(np.cos(turn), 0, np.sin(turn)), (0, 1, 0), (-np.sin(turn), 0, np.cos(turn))]) @ ahead
        eye = middle + np.array((0.05, -0.6 + 0.3 * part, 0.1)) * (size[0], size[1], size[0]) + (0, 0, size[2])
        return np.column_stack([turned, -turned @ eye])

    seen = View(np.zeros((3, 4)), 300.0, (200.0, 150.0), (400.0, 300.0), 0.01 * size[0], True)
    views = [replace(seen, to_camera=placed(part)) for part in np.linspace(0, 1, 7)]
    lengths = PIXELS * over(views).extremes(low, high)[0]
    assert lengths.max() > 3 * lengths.min()
    for one, other in pairwise(views):
        for part in np.linspace(0, 1, 3):
            # Positions are then in the box of both.
            between = replace(seen, to_camera=(1 - part) * one.to_camera + part * other.to_camera)
            for _ in range(10):
                off = farthest_images(between, surface, away(rng, surface, lengths[faces]))
                assert off.max(initial=0.0) <= PIXELS + 1e-8
                largest = max(largest, off.max(initial=0.0))
    # The control points of a face are three faces apart, and boxes are around those of two frames.
    assert largest > 0.5 * PIXELS


def passing(mesh: PolygonMesh) -> list[View]:
    """Views of a camera that passes close by a mesh."""
    low, size = mesh.positions.min(axis=0), np.ptp(mesh.positions, axis=0)
    # Along y, with z upwards; a camera has its y axis downwards here.
    ahead = np.array([(1.0, 0, 0), (0, 0, -1), (0, 1, 0)])
    eyes = low + size * [(0.5, -0.1, 1.1), (0.5, 0.0, 1.1), (0.6, 0.2, 1.1)]
    placed = [np.column_stack([ahead, -ahead @ eye]) for eye in eyes]
    return [View(each, 400.0, (200.0, 150.0), (400.0, 300.0), 0.01 * size[0], True) for each in placed]


@pytest.mark.parametrize("seed", [1, *SEEDS])
@pytest.mark.parametrize("name", ["landscape", "creases", "n-gons", "valence 7"])
def test_adaptive_meshes_are_within_the_pixels_at_each_point(name: str, seed: int) -> None:
    mesh, rng = build(name, seed), np.random.default_rng(seed)
    views = passing(mesh)
    pixels = over(views)
    pixels = replace(pixels, unit=pixels.extremes(*surface_boxes(mesh))[0].min())
    variation, limit = Variation(np.ones(mesh.corner_count), pixels), 0.01 * meshes.diagonal(mesh)
    request = AdaptiveRequest(limit, Mode.ADAPTIVE, 100_000, variation=variation)
    found = subdivide_adaptively(mesh, request, mesh.positions)
    assert np.all(found.ratios <= 1)
    of_faces = Variation(np.repeat(variation.of_faces(mesh, 1.0), mesh.face_sizes))
    assert len(found.bounds) <= count_faces(mesh, replace(request, variation=of_faces))
    samples = dense(mesh, SIDE)
    surface = limit_values(mesh, mesh.positions, samples)
    own = limit / pixels.unit * lengths_at(views, surface)
    plan, tessellation = plan_within(mesh, request, lambda _: None)
    low, high = plan.surfaces.boxes(tessellation.leaves)
    # Of places inside the control mesh's faces.
    quads = np.flatnonzero(plan.tree.is_quad(tessellation.leaves))
    for points in plan.tree.points_at(tessellation.leaves[quads], [(0, False), (1, True), (2, False)]):
        inside = limit_values(mesh, mesh.positions, points).T
        assert np.all(low[:, quads] - 1e-9 <= inside)
        assert np.all(inside <= high[:, quads] + 1e-9)
    if np.diff(found.mesh.face_starts).max() > 4:
        pytest.skip("Blender chooses the triangles of polygons")
    triangles = found.mesh.positions[soundness.drawn(found.mesh)]
    some = rng.choice(len(own), 200)
    assert np.all(nearest(surface[some], triangles)[1] <= own[some] * ROUNDED)
    chosen = triangles[rng.integers(len(triangles), size=200)]
    drawn = np.einsum("nk,nkd->nd", rng.dirichlet(np.full(3, 0.5), size=200), chosen)
    assert np.all((np.linalg.norm(drawn[:, None] - surface, axis=2) / own).min(axis=1) <= SPACED)


def test_what_is_off_screen_may_be_farther_off() -> None:
    inside = length([AHEAD], SQUARE)
    for shift in ([10, 0, 0], [-10, 0, 0], [0, 10, 0], [0, -10, 0]):
        # By the definition: a pixel at the nearest point, times the factor.
        assert length([AHEAD], SQUARE + shift) == pytest.approx(OFF_SCREEN * PIXELS * np.hypot(9, 5) / 100)
    # Behind the camera.
    behind = OFF_SCREEN * PIXELS * 5 / 100
    assert length([AHEAD], SQUARE - np.array([0, 0, 10])) == pytest.approx(behind)
    # Within the margin of a tenth it still counts as seen.
    assert length([AHEAD], SQUARE + np.array([3.6, 0, 0])) <= PIXELS * 5 / 100
    assert inside < PIXELS * 5 / 100


def test_between_two_frames_the_nearest_of_both_counts() -> None:
    views = [shifted(AHEAD, by) for by in ([20, 0, 0], [-20, 0, 0], [-20, 0, 10])]
    assert all(length([each], SQUARE) > PIXELS * 5 / 100 for each in views)
    # On its way from the right to the left it crosses the image.
    crossing = length(views[:2], SQUARE)
    assert crossing <= length([AHEAD], SQUARE)
    assert crossing == length(views, SQUARE)
    # Beyond the same edge on both frames it stays off screen; the nearer one counts.
    assert length(views[1:], SQUARE) == pytest.approx(length(views[1:2], SQUARE))
    # A camera that is orthographic on the next frame.
    flat = replace(AHEAD, is_perspective=False, focal=20.0)
    assert length([AHEAD, flat], SQUARE) == pytest.approx(min(length([AHEAD], SQUARE), length([flat], SQUARE)))


def test_the_camera_inside_counts_the_nearest_depth() -> None:
    around = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1.0, 1)])
    # The farthest corner of the image with its margin is 0.6 off the axis along both sides.
    for near in (0.1, 0.2):
        found = length([replace(AHEAD, near=near)], around)
        assert found == pytest.approx(PIXELS * near / 100 / np.sqrt(1 + 2 * 0.6**2))
