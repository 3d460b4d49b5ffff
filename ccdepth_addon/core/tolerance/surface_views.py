# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances in pixels for parts of a surface: the distance that keeps the image of every point within the pixels.

A point s of the surface with depth z_s, and a drawn point t = s + d with |d| ≤ ε and tangents τ_t = (x, y) / z off the
axis, have images that are f·(d_xy − τ_t·d_z) / z_s apart: z_t·τ_t = z_s·τ_s + d_xy. The linear map in the brackets has
the norm √(1 + |τ_t|²), so ε = pixels · z / (f·√(1 + r²)) keeps them within the pixels, with the least depth z of the
part and the largest |τ_t|, r. A box in the camera's space around the part has a depth no larger than any in the part,
and the ratio of its farthest place off the axis to this depth is no less than any |τ_s|. A drawn point is off the part
by ε, at most ``LARGEST_PART`` of the depth; and if it is in the image, its tangent is no farther off the axis than the
farthest corner of the image with its margin.

If only s is in the image, |τ_t| ≤ r as well, for at most a tenth of the image's shorter side in pixels. The way from s
to t would leave the circle through that corner at a point that is within the pixels of s in the image. But the circle
is a tenth of that side, at least, from the image: where the farthest corner is (a, b) off the axis, and the margins are
m and n, |(a + m, b + n)| − |(a, b)| ≥ (a·m + b·n) / |(a, b)| ≥ min(m, n), as the norm is convex and a, b ≥ 0.

What is nearer than the image begins is in no image: s and t are both beyond that.

For an orthographic camera images are f·d_xy apart, and ε = pixels / f.

Between two frames a part is taken to be anywhere in the box around its boxes on both, the image to be within those of
both, and the focal length to be no more than the longer one. Positions that a camera's matrix makes ``stretch`` times
as long have 1 / stretch of the distance.

A smaller box, or fewer frames, have no smaller ε: the depth is no less, r no more, and off screen ε is no less than in
the image, as a distance is no less than its depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf

import numpy as np

from ..arrays.chunks import AT_ONCE, chunks
from ..arrays.types import BoolArray, FloatArray

# The part of its size by which an image is extended on every side; what is outside is off screen.
MARGIN = 0.1

# The largest part of the focal length that a number of pixels may be, and of the depth that the distance is then.
LARGEST_PART = 0.01

# The rounding of a transformed coordinate, in parts of the largest product: far more than that of double precision, as
# matrices may be computed from others.
ROUNDING = 1e-9


@dataclass(frozen=True)
class View:
    """One camera at one frame.

    to_camera: (3, 4) float64, from the space of the positions to the camera's, to nine digits: x and y along the
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

    def seen(self, low: FloatArray, high: FloatArray) -> _Seen:
        """Boxes (3, N) as seen by the camera."""
        linear, offset = self.to_camera[:, :3], self.to_camera[:, 3:]
        middle, reach = (low + high) / 2, np.abs(linear) @ (high - low) / 2
        points = linear @ middle + offset
        reach += ROUNDING * (np.abs(linear) @ np.abs(middle) + reach + np.abs(offset))
        center, size = np.array(self.center), np.array(self.size)
        return _Seen(
            is_perspective=self.is_perspective,
            focal=self.focal,
            near=self.near,
            stretch=float(np.linalg.norm(linear, 2)) * (1 + ROUNDING),
            window=np.stack([-MARGIN * size - center, (1 + MARGIN) * size - center]) / self.focal,
            low=points - reach,
            high=points + reach,
        )


def most_pixels(view: View) -> float:
    """The largest tolerance in pixels."""
    return LARGEST_PART * view.focal if view.is_perspective else inf


def pixel_lengths(views: Sequence[View], low: FloatArray, high: FloatArray, off_screen: float) -> FloatArray:
    """(N,): the lengths of a pixel on parts of a surface: the largest distances with which all images are at most a
    pixel apart; n pixels have n times the length.

    views: on successive frames, and between each two, at least one. low, high: (3, N), boxes around the parts in the
    space of the positions. off_screen: the factor, 1 or more, for parts off screen, on the length at the nearest point
    of the box.
    """
    found = np.full(low.shape[1], inf)
    for some in chunks(len(found), AT_ONCE):
        seen = (view.seen(low[:, some], high[:, some]) for view in views)
        for one, other in pairwise(seen) if len(views) > 1 else ((each, each) for each in seen):
            np.minimum(found[some], one.joined(other).lengths(off_screen), out=found[some])
            # A camera may change between perspective and orthographic.
            if one.is_perspective != other.is_perspective:
                np.minimum(found[some], other.joined(one).lengths(off_screen), out=found[some])
    return found


@dataclass(frozen=True)
class _Seen:
    """N parts of a surface as a camera sees them. low, high: (3, N), boxes in the camera's space. window: (2, 2), the
    tangents of the least and greatest places in the image with its margin, x first; of an orthographic camera, lengths.
    stretch: how many times as long lengths are in the camera's space, at most."""

    is_perspective: bool
    focal: float
    near: float
    stretch: float
    window: FloatArray
    low: FloatArray
    high: FloatArray

    def joined(self, other: _Seen) -> _Seen:
        """The parts anywhere in the boxes of both, seen by a camera between both of its states."""
        is_alike = self.is_perspective == other.is_perspective
        ends = np.stack([self.window, other.window if is_alike else self.window])
        return replace(
            self,
            focal=max(self.focal, other.focal) if is_alike else self.focal,
            near=min(self.near, other.near),
            stretch=max(self.stretch, other.stretch),
            window=np.stack([np.minimum(*ends[:, 0]), np.maximum(*ends[:, 1])]),
            low=np.minimum(self.low, other.low),
            high=np.maximum(self.high, other.high),
        )

    def lengths(self, off_screen: float) -> FloatArray:
        """(N,): the lengths of a pixel; as of ``pixel_lengths``."""
        is_outside = self._are_outside()
        if not self.is_perspective:
            return np.where(is_outside, off_screen, 1.0) / (self.focal * self.stretch)
        radii = np.hypot(*np.maximum(-self.low, self.high)[:2])
        depths = np.maximum(self.low[2], self.near)
        tangents = (radii / depths + LARGEST_PART) / (1 - LARGEST_PART)
        tangents[~(self.low[2] >= self.near)] = inf
        tangents = np.minimum(tangents, np.hypot(*np.maximum(-self.window[0], self.window[1])))
        distances = np.maximum(np.sqrt((np.maximum(np.maximum(self.low, -self.high), 0) ** 2).sum(axis=0)), self.near)
        lengths = np.where(is_outside, off_screen * distances, depths / np.hypot(1, tangents))
        found: FloatArray = lengths / (self.focal * self.stretch)
        return found

    def _are_outside(self) -> BoolArray:
        """(N,) bool: whether all of a part is beyond the same edge of the image, or nearer than the image begins."""
        found: BoolArray = self.high[2] < self.near
        scales = (self.low[2], self.high[2]) if self.is_perspective else (1.0, 1.0)
        for axis in range(2):
            least, greatest = self.window[:, axis]
            found |= self.high[axis] < np.minimum(*(least * each for each in scales))
            found |= self.low[axis] > np.maximum(*(greatest * each for each in scales))
        return found
