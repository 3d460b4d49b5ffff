# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances in pixels, against images of random points and displacements by a pinhole camera written out here."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core import View, length_in_views, seen_by

PIXELS, OFF_SCREEN = 0.5, 4.0


def view(rng: np.random.Generator, *, is_perspective: bool = True) -> View:
    """A view with any axis, shift and focal length, from a turned camera."""
    turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    size = rng.integers(50, 2000, 2).astype(float)
    return View(
        to_camera=np.column_stack([turned, rng.normal(size=3)]),
        focal=float(rng.uniform(60, 4000)),
        center=tuple(size * rng.uniform(-0.5, 1.5, 2)),
        size=tuple(size),
        near=0.1,
        is_perspective=is_perspective,
    )


def image(seen: View, points: NDArray) -> NDArray:
    """(P, 2): the places of points in the image, in pixels."""
    x, y, z = (points @ seen.to_camera[:, :3].T + seen.to_camera[:, 3]).T
    depth = z if seen.is_perspective else 1.0
    return np.stack([seen.center[0] + seen.focal * x / depth, seen.center[1] + seen.focal * y / depth], axis=1)


def on_screen(seen: View, points: NDArray) -> NDArray:
    depths = points @ seen.to_camera[2, :3] + seen.to_camera[2, 3]
    places = image(seen, points)
    return (depths >= seen.near) & (places >= 0).all(axis=1) & (places <= seen.size).all(axis=1)


def control_points(rng: np.random.Generator, seen: View) -> NDArray:
    """A cloud somewhere in front of the camera, near or far, partly in the image, and sometimes around the camera."""
    in_camera = rng.normal(size=(20, 3)) * 10 ** rng.uniform(-2, 0.5) + [0, 0, 10 ** rng.uniform(-1, 1.5)]
    in_camera[:, :2] += in_camera[:, 2:] * (np.array(seen.size) * rng.uniform(0, 1, 2) - seen.center) / seen.focal
    return (in_camera - seen.to_camera[:, 3]) @ seen.to_camera[:, :3]


@pytest.mark.parametrize("is_perspective", [True, False])
def test_no_image_of_a_drawn_point_is_farther_off_than_the_pixels(is_perspective: bool) -> None:
    largest, told = 0.0, 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        seen = view(rng, is_perspective=is_perspective)
        points = control_points(rng, seen)
        found = seen_by(seen, points)
        if found.outside.any():
            continue
        # Points of the hull, and drawn points at the distance.
        weights = rng.dirichlet(np.full(len(points), 0.2), 2000)
        surface = np.concatenate([points, weights @ points])
        away = rng.normal(size=surface.shape)
        drawn = surface + away / np.linalg.norm(away, axis=1)[:, None] * found.length(PIXELS, OFF_SCREEN)
        # Either is in the image. What is nearer than the image begins is in none.
        shown = on_screen(seen, drawn) | on_screen(seen, surface)
        for each in (surface, drawn):
            shown &= each @ seen.to_camera[2, :3] + seen.to_camera[2, 3] >= seen.near
        off = np.linalg.norm(image(seen, drawn) - image(seen, surface), axis=1)[shown]
        # Places of thousands of pixels round by 1e-10.
        assert off.max(initial=0.0) <= PIXELS + 1e-8
        largest, told = max(largest, off.max(initial=0.0)), told + len(off)
    # It is no better than needed by more than a few hundredths.
    assert largest > 0.95 * PIXELS
    assert told > 10_000


def test_what_is_off_screen_may_be_farther_off() -> None:
    seen = View(np.eye(3, 4), 100.0, (50.0, 50.0), (100.0, 100.0), 0.1, True)
    square = np.array([(x, y, 5.0) for x in (-1, 1) for y in (-1, 1)])
    inside = seen_by(seen, square).length(PIXELS, OFF_SCREEN)
    for shift in ([10, 0, 0], [-10, 0, 0], [0, 10, 0], [0, -10, 0]):
        away = square + shift
        nearest = np.linalg.norm(away, axis=1).min()
        # By the definition: a pixel at the nearest control point, times the factor.
        assert seen_by(seen, away).length(PIXELS, OFF_SCREEN) == pytest.approx(OFF_SCREEN * PIXELS * nearest / 100)
    # Behind the camera.
    assert seen_by(seen, square - np.array([0, 0, 10])).outside[4]
    assert not seen_by(seen, square).outside.any()
    # Within the margin of a tenth it still counts as seen.
    assert not seen_by(seen, square + np.array([3.6, 0, 0])).outside.any()
    assert inside < PIXELS * 5 / 100


def test_between_two_frames_the_nearest_of_both_counts() -> None:
    seen = View(np.eye(3, 4), 100.0, (50.0, 50.0), (100.0, 100.0), 0.1, True)
    square = np.array([(x, y, 5.0) for x in (-1, 1) for y in (-1, 1)])
    views = [seen_by(seen, square + shift) for shift in ([20, 0, 0], [-20, 0, 0], [-20, 0, 10])]
    assert all(each.outside.any() for each in views)
    # On its way from the right to the left it crosses the image.
    crossing = length_in_views(views[:2], PIXELS, OFF_SCREEN)
    assert crossing <= seen_by(seen, square).length(PIXELS, OFF_SCREEN)
    assert crossing == length_in_views(views, PIXELS, OFF_SCREEN)
    assert length_in_views(views[1:], PIXELS, OFF_SCREEN) == views[1].length(PIXELS, OFF_SCREEN)


def test_the_camera_inside_counts_the_nearest_depth() -> None:
    seen = View(np.eye(3, 4), 100.0, (50.0, 50.0), (100.0, 100.0), 0.1, True)
    around = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1.0, 1)])
    assert seen_by(seen, around).depth == 0.1
    assert seen_by(replace(seen, near=0.2), around).depth == 0.2
