# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances in pixels, against the images of random points and of the points that a tolerance lets them move to."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core import View

PIXELS = 0.5

# Images are compared in double precision, at coordinates of some thousand pixels.
ROUNDED = 1 + 1e-9


def random_view(rng: np.random.Generator, *, is_perspective: bool) -> View:
    """A view of the origin from a few units away, with any shift, focal length and size."""
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    to_camera = np.column_stack([rotation, [*rng.normal(size=2), rng.uniform(-1, 6)]])
    size = rng.uniform(50, 2000, size=2)
    center = size * rng.uniform(-0.5, 1.5, size=2)
    near = rng.uniform(0.01, 1.0)
    return View(to_camera, rng.uniform(20, 3000), tuple(center), tuple(size), near, is_perspective)


def images(view: View, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pixels (n, 2) of points (n, 3), and their depths."""
    placed = points @ view.to_camera[:, :3].T + view.to_camera[:, 3]
    divisor = placed[:, 2:] if view.is_perspective else 1.0
    return view.focal * placed[:, :2] / divisor + view.center, placed[:, 2]


@pytest.mark.parametrize("is_perspective", [True, False])
def test_no_image_in_the_picture_moves_farther_than_the_pixels(is_perspective: bool) -> None:
    rng = np.random.default_rng(60)
    moved_most, seen_count = 0.0, 0
    for _ in range(1000):
        view = random_view(rng, is_perspective=is_perspective)
        hull = rng.normal(size=3) + rng.normal(size=(6, 3)) * rng.choice([0.01, 0.3, 2.0])
        limit = view.distances(np.full(1, PIXELS), view.measures(hull).min(axis=1)[:, None], 4.0)[0]
        assert limit > 0
        points = rng.dirichlet(np.full(6, 0.3), size=200) @ hull
        way = rng.normal(size=(200, 3))
        others = points + limit * way / np.linalg.norm(way, axis=1, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            (before, depth), (after, other_depth) = images(view, points), images(view, others)
        inside = ((before >= 0) & (before <= view.size)).all(axis=1)
        seen = inside & (depth >= view.near) & (other_depth >= view.near)
        moved = np.linalg.norm(after - before, axis=1)[seen]
        assert np.all(moved <= PIXELS * ROUNDED)
        moved_most, seen_count = max(moved_most, moved.max(initial=0.0)), seen_count + len(moved)
    assert seen_count > 1000
    # A small hull on the axis leaves next to no room.
    assert moved_most > 0.9 * PIXELS


def test_a_part_of_a_hull_has_no_smaller_tolerance() -> None:
    """The pixel tolerance of a leaf holds for its children. A hull outside the image may have parts as near."""
    rng = np.random.default_rng(61)
    for _ in range(1000):
        view = random_view(rng, is_perspective=True)
        hull = rng.normal(size=3) + rng.normal(size=(6, 3))
        part = rng.dirichlet(np.ones(6), size=4) @ hull
        whole, smaller = (
            view.distances(np.full(1, PIXELS), view.measures(each).min(axis=1)[:, None], 4.0)[0]
            for each in (hull, part)
        )
        assert smaller >= whole * (1 - 1e-12)


def test_a_hull_outside_the_image_has_the_off_screen_factor() -> None:
    view = View(np.eye(3, 4), 1000.0, (500.0, 500.0), (1000.0, 1000.0), 0.1, is_perspective=True)
    beside = np.array([[10.0, 0, 5], [12, 1, 5], [11, 0, 7]])
    behind = np.array([[0.0, 0, -5], [1, 1, -5], [0, 1, -6]])
    for hull, away in ((beside, np.hypot(10, 5)), (behind, 5.0)):
        limit = view.distances(np.full(1, PIXELS), view.measures(hull).min(axis=1)[:, None], 4.0)[0]
        assert limit == pytest.approx(4 * PIXELS * away / 1000)
