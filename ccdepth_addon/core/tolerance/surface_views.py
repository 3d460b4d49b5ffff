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

A smaller box has no smaller ε: the depth is no less, r no more, and off screen ε is no less than in the image, as a
distance is no less than its depth. Nor has one frame of two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from ..arrays.chunks import AT_ONCE, FEW_AT_ONCE, chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray

# The part of its size by which an image is extended on every side; what is outside is off screen.
MARGIN = 0.1

# The largest part of the focal length that a number of pixels may be, and of the depth that the distance is then.
LARGEST_PART = 0.01

# The rounding of a transformed coordinate, in parts of the largest product: far more than that of double precision, as
# matrices may be computed from others.
ROUNDING = 1e-8

# The number of frames looked at together, at least; each number of frames begins with the last one before.
FEWEST_FRAMES = 8


@dataclass(frozen=True)
class View:
    """One camera at one frame.

    to_camera: (3, 4) float64, from the space of the positions to the camera's, to eight digits: x and y along the
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

    def moved(self, matrix: FloatArray) -> View:
        """The view of positions that the matrix (3, 3) moves to those of this view."""
        return replace(self, to_camera=np.column_stack([self.to_camera[:, :3] @ matrix, self.to_camera[:, 3]]))


def most_pixels(view: View) -> float:
    """The largest tolerance in pixels, for any part."""
    return min(LARGEST_PART * view.focal, MARGIN * min(view.size)) if view.is_perspective else inf


@dataclass(frozen=True)
class Pixels:
    """The lengths of a pixel over a surface, in parts of a unit: the largest distances with which all images of it are
    at most a pixel apart; n pixels have n times the length.

    views: for each user of the surface its views on successive frames, and between each two, at least one. off_screen:
    the factor, 1 or more, for what is off screen, on the length at its nearest point.
    """

    unit: float
    views: tuple[tuple[View, ...], ...]
    off_screen: float

    def extremes(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N,) twice: no more, and no less, than the lengths at all points in boxes (3, N)."""
        least, greatest = np.full((2, low.shape[1]), inf)
        for some in chunks(len(least), FEW_AT_ONCE):
            for views in self.views:
                frames = max(AT_ONCE // len(least[some]), FEWEST_FRAMES)
                for first in range(0, max(len(views) - 1, 1), frames):
                    seen = _Seen.of(views[first : first + frames + 1], low[:, some], high[:, some])
                    found = seen.over_frames(self.off_screen)
                    is_less = found[0] < least[some]
                    least[some][is_less], greatest[some][is_less] = (each[is_less] for each in found)
        return least / self.unit, greatest / self.unit

    def moved(self, matrix: FloatArray) -> Pixels:
        """The lengths over a surface that the matrix (3, 3) moves to this one."""
        return replace(self, views=tuple(tuple(each.moved(matrix) for each in own) for own in self.views))


@dataclass(frozen=True)
class _Seen:
    """N parts of a surface as a camera sees them on K frames. low, high: (3, K, N), boxes in the camera's space.
    window: (2, 2, K, 1), the tangents of the least and greatest places in the image with its margin, x first; of an
    orthographic camera, lengths. (K, 1) each: is_perspective, focal and near, as of ``View``; stretch: how many times
    as long lengths are in the camera's space, at most."""

    is_perspective: BoolArray
    focal: FloatArray
    near: FloatArray
    stretch: FloatArray
    window: FloatArray
    low: FloatArray
    high: FloatArray

    @staticmethod
    def of(views: Sequence[View], low: FloatArray, high: FloatArray) -> _Seen:
        """Boxes (3, N) as seen on frames."""
        cameras, focal, centers, sizes = (
            np.array([getattr(each, name) for each in views]) for name in ("to_camera", "focal", "center", "size")
        )
        linear, offsets = cameras[:, :, :3], cameras[:, :, 3:]
        middle, sides = (low + high) / 2, (high - low) / 2
        points, reach = linear @ middle + offsets, np.abs(linear) @ sides
        reach += ROUNDING * (np.abs(linear) @ np.abs(middle) + reach + np.abs(offsets))
        low, high = ((points + sign * reach).swapaxes(0, 1) for sign in (-1, 1))
        ends = np.stack([-MARGIN * sizes - centers, (1 + MARGIN) * sizes - centers]) / focal[:, None]
        return _Seen(
            is_perspective=np.array([[each.is_perspective] for each in views]),
            focal=focal[:, None],
            near=np.array([[each.near] for each in views]),
            stretch=np.linalg.norm(linear, 2, axis=(1, 2))[:, None] * (1 + ROUNDING),
            window=ends.swapaxes(1, 2)[..., None],
            low=low,
            high=high,
        )

    def over_frames(self, off_screen: float) -> tuple[FloatArray, FloatArray]:
        """(N,) twice: as of ``Pixels.extremes``, as lengths; the greatest ones on the frames with the least ones."""
        if len(self.focal) == 1:
            lengths = self._least(off_screen)
        else:
            one, other = self._frames(slice(None, -1)), self._frames(slice(1, None))
            lengths = one._joined(other)._least(off_screen)
            # A camera may change between perspective and orthographic.
            if np.any(one.is_perspective != other.is_perspective):
                lengths = np.minimum(lengths, other._joined(one)._least(off_screen))
        return lengths.min(axis=0), self._frames(lengths.argmin(axis=0))._greatest(off_screen)[0]

    def _frames(self, chosen: slice | IndexArray) -> _Seen:
        """The parts on some frames; or each part on a frame of its own, (N,)."""
        if isinstance(chosen, slice):
            return _Seen(**{name: each[..., chosen, :] for name, each in vars(self).items()})
        parts = np.arange(len(chosen))
        return _Seen(
            **{
                name: each[..., chosen, parts if each.shape[-1] > 1 else 0][..., None, :]
                for name, each in vars(self).items()
            }
        )

    def _joined(self, other: _Seen) -> _Seen:
        """The parts anywhere in the boxes of both, seen by a camera between both of its states."""
        is_alike = self.is_perspective == other.is_perspective
        windows = self.window, np.where(is_alike, other.window, self.window)
        return _Seen(
            is_perspective=self.is_perspective,
            focal=np.where(is_alike, np.maximum(self.focal, other.focal), self.focal),
            near=np.minimum(self.near, other.near),
            stretch=np.maximum(self.stretch, other.stretch),
            window=np.stack([np.minimum(*windows)[0], np.maximum(*windows)[1]]),
            low=np.minimum(self.low, other.low),
            high=np.maximum(self.high, other.high),
        )

    def _least(self, off_screen: float) -> FloatArray:
        """(K, N): no more than the lengths at all points of the parts."""
        are_outside = self._are_outside(self.high, self.low, np.minimum, np.maximum)
        nearest, farthest = np.maximum(np.maximum(self.low, -self.high), 0), np.maximum(-self.low, self.high)
        return self._lengths(self.low[2], farthest, nearest, are_outside, off_screen)

    def _greatest(self, off_screen: float) -> FloatArray:
        """(K, N): no less than the lengths at all points of the parts."""
        may_be_outside = self._are_outside(self.low, self.high, np.maximum, np.minimum)
        nearest, farthest = np.maximum(np.maximum(self.low, -self.high), 0), np.maximum(-self.low, self.high)
        return self._lengths(self.high[2], nearest, farthest, may_be_outside, off_screen)

    def _lengths(
        self, depths: FloatArray, asides: FloatArray, ways: FloatArray, are_outside: BoolArray, off_screen: float
    ) -> FloatArray:
        """(K, N): the lengths for depths (K, N), for places beside the axis, and for ways from the camera to what is
        off screen, (3, K, N) each."""
        depths, is_before = np.maximum(depths, self.near), depths >= self.near
        tangents = (np.hypot(*asides[:2]) / depths + LARGEST_PART) / (1 - LARGEST_PART)
        corners = np.hypot(*np.maximum(-self.window[0], self.window[1]))
        tangents = np.where(is_before, np.minimum(tangents, corners), corners)
        distances = np.maximum(np.sqrt((ways**2).sum(axis=0)), self.near)
        if not np.all(self.is_perspective):
            depths, distances = (np.where(self.is_perspective, each, 1.0) for each in (depths, distances))
            tangents = np.where(self.is_perspective, tangents, 0.0)
        lengths = np.where(are_outside, off_screen * distances, depths / np.hypot(1, tangents))
        found: FloatArray = lengths / (self.focal * self.stretch)
        return found

    def _are_outside(self, high: FloatArray, low: FloatArray, lesser: np.ufunc, greater: np.ufunc) -> BoolArray:
        """(K, N) bool: whether all of a part is beyond the same edge of the image, or nearer than the image begins.
        With the other ends and functions, whether some of it may be."""
        found: BoolArray = high[2] < self.near
        scales = [np.where(self.is_perspective, ends[2], 1.0) for ends in (self.low, self.high)]
        for axis in range(2):
            least, greatest = self.window[:, axis]
            found |= high[axis] < lesser(*(least * each for each in scales))
            found |= low[axis] > greater(*(greatest * each for each in scales))
        return found
