# SPDX-License-Identifier: GPL-3.0-or-later
"""One tolerance in pixels for a whole surface: the distance that keeps the image of every point within the pixels.

A point s of the surface with depth z_s, and a drawn point t = s + d with |d| ≤ ε and tangents τ_t = (x, y) / z off the
axis, have images that are f·(d_xy − τ_t·d_z) / z_s apart: z_t·τ_t = z_s·τ_s + d_xy. The linear map in the brackets has
the norm √(1 + |τ_t|²), so ε = pixels · z / (f·√(1 + r²)) keeps them within the pixels, with the least depth z of the
surface and the largest |τ_t|, r. The control points have the surface in their hull, and a depth and a tangent have
their extremes on a hull at its corners. A drawn point is off the hull by ε, at most ``LARGEST_PART`` of the depth; and
if it is in the image, its tangent is no farther off the axis than the farthest corner of the image with its margin.

If only s is in the image, |τ_t| ≤ r as well, for at most a tenth of the image's shorter side in pixels. The way from s
to t would leave the circle through that corner at a point that is within the pixels of s in the image. But the circle
is a tenth of that side, at least, from the image: where the farthest corner is (a, b) off the axis, and the margins are
m and n, |(a + m, b + n)| − |(a, b)| ≥ (a·m + b·n) / |(a, b)| ≥ min(m, n), as the norm is convex and a, b ≥ 0.

What is nearer than the image begins is in no image: s and t are both beyond that.

For an orthographic camera images are f·d_xy apart, and ε = pixels / f.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf, sqrt

import numpy as np

from ..arrays.types import BoolArray, FloatArray

# The part of its size by which an image is extended on every side; what is outside is off screen.
MARGIN = 0.1

# The largest part of the focal length that a number of pixels may be, and of the depth that the distance is then.
LARGEST_PART = 0.01

# Roundings of a transformed coordinate, in parts of the largest product.
ROUNDINGS = 8 * np.finfo(np.float64).eps


@dataclass(frozen=True)
class View:
    """One camera at one frame.

    to_camera: (3, 4) float64, from the space of the positions to the camera's, with lengths kept: x and y along the
    image's width and height, and the depth in front of the camera. focal: in pixels; of an orthographic camera in
    pixels per unit of length. center: the pixel on the camera's axis; size: the width and height of the image, in
    pixels. near: the depth from which the camera sees.
    """

    to_camera: FloatArray
    focal: float
    center: tuple[float, float]
    size: tuple[float, float]
    near: float
    is_perspective: bool


def most_pixels(view: View) -> float:
    """The largest tolerance in pixels."""
    return LARGEST_PART * view.focal if view.is_perspective else inf


def seen_by(view: View, positions: FloatArray) -> Seen:
    """How the camera sees a surface with these control points: (P, 3) float64, at least one."""
    linear, offset = view.to_camera[:, :3], view.to_camera[:, 3]
    points = positions @ linear.T + offset
    rounding = ROUNDINGS * float((np.abs(linear) @ np.abs(positions).max(axis=0) + np.abs(offset)).max())
    depths, radii = points[:, 2] - rounding, np.hypot(points[:, 0], points[:, 1]) + rounding
    scale = points[:, 2:] if view.is_perspective else np.ones((len(points), 1))
    images = view.focal * points[:, :2]
    size, center = np.array(view.size), np.array(view.center)
    low, high = -MARGIN * size - center, (1 + MARGIN) * size - center
    tangent = float(np.linalg.norm(np.maximum(-low, high))) / view.focal
    if depths.min() >= view.near:
        tangent = min(tangent, (float((radii / depths).max()) + LARGEST_PART) / (1 - LARGEST_PART))
    return Seen(
        focal=view.focal,
        slope=sqrt(1 + tangent**2) if view.is_perspective else 1.0,
        depth=max(float(depths.min()), view.near) if view.is_perspective else 1.0,
        distance=max(float(np.linalg.norm(points, axis=1).min()), view.near) if view.is_perspective else 1.0,
        outside=np.array(
            [
                *(images < low * scale).all(axis=0),
                *(images > high * scale).all(axis=0),
                bool((points[:, 2] < view.near).all()),
            ]
        ),
    )


@dataclass(frozen=True)
class Seen:
    """How a camera sees a surface: the focal length in pixels; the largest √(1 + r²); the least depth in the image, and
    the least distance of a control point, as lengths, both 1 for an orthographic camera.

    outside: (5,) bool, whether all of the surface is beyond the left, lower, right and upper edge with its margin, or
    nearer than the image begins.
    """

    focal: float
    slope: float
    depth: float
    distance: float
    outside: BoolArray

    def joined(self, other: Seen) -> Seen:
        """How a camera on its way from one view to the other sees it, as of the box of both."""
        return Seen(
            max(self.focal, other.focal),
            max(self.slope, other.slope),
            min(self.depth, other.depth),
            min(self.distance, other.distance),
            self.outside & other.outside,
        )

    def length(self, pixels: float, off_screen: float) -> float:
        """The largest distance, a length, with which images are at most pixels apart. off_screen: the factor for a
        surface off screen, of the distance at its nearest control point."""
        if self.outside.any():
            return off_screen * pixels * self.distance / self.focal
        return pixels * self.depth / (self.focal * self.slope)


def length_in_views(views: Sequence[Seen], pixels: float, off_screen: float) -> float:
    """The least length of views on successive frames, and between each two; as of ``Seen.length``."""
    if len(views) > 1:
        views = [one.joined(other) for one, other in pairwise(views)]
    return min(each.length(pixels, off_screen) for each in views)
