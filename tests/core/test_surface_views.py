# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances in pixels, against images of random points and displacements by a pinhole camera written out here."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core import View, limit_values, pixel_lengths, surface_boxes
from tests import meshes
from tests.core.test_variation import dense

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
    return float(pixels * pixel_lengths(views, low, high, OFF_SCREEN)[0])


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
    lengths = PIXELS * pixel_lengths(views, low, high, OFF_SCREEN)
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
