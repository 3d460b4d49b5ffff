# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles of a measured mesh, and exact distances to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import AT_ONCE, chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import columns, cross_products, crosses, products, squared_norms, units
from .box_tree import BoxTree
from .spread import NONE

# A triangle is a needle when its height is below this part of its longest side.
NEEDLE = 1e-5


@dataclass(frozen=True)
class Triangles:
    """T triangles. points: (3, T, 3) float64, the corners. beyond: (3, T) intp, the one other triangle at the edge from
    each corner to the next, NONE without one or with more than one. normals: (T, 3), unit vectors, or zero for a
    triangle without area. thickness: (T,), a bound of the thickness of needles, so thin that rounding decides their
    direction; 0 for other triangles. slack: (T,), ``distance_slack``. tree: of their boxes."""

    points: FloatArray
    beyond: IndexArray
    normals: FloatArray
    thickness: FloatArray
    slack: FloatArray
    tree: BoxTree

    @staticmethod
    def of(positions: FloatArray, triangles: IndexArray, tick: Callable[[], None] = lambda: None) -> Triangles:
        """The triangles of a mesh. positions: (V, 3); triangles: (T, 3) intp; tick: called again and again; it may
        raise to stop."""
        corners = np.ascontiguousarray(triangles.T)
        points = positions[corners]
        tick()
        beyond = _partners(corners, len(positions))
        tick()
        tree = BoxTree.around(points.min(axis=0), points.max(axis=0))
        tick()
        normals = cross_products(points[1] - points[0], points[2] - points[0])
        return Triangles(points, beyond, units(normals), needle_thickness(points), distance_slack(points), tree)

    @property
    def rows(self) -> FloatArray:
        """(T, 9): the corners of each triangle in a row."""
        return self.points.swapaxes(0, 1).reshape(-1, 9)

    @property
    def count(self) -> int:
        return self.points.shape[1]

    def corners(self, which: IndexArray) -> FloatArray:
        """(3, 3, K): the corners of some triangles (K,), with their coordinates."""
        return np.ascontiguousarray(self.points[:, which].swapaxes(1, 2))

    def distances(self, places: FloatArray, which: IndexArray) -> tuple[FloatArray, FloatArray]:
        """The distances (N,) from places (N, 3) to a triangle each, and the nearest points (N, 3) of these
        triangles."""
        found, nearest = np.empty(len(places)), np.empty((len(places), 3))
        for some in chunks(len(places), AT_ONCE):
            found[some], points = to_triangles(columns(places[some]), self.corners(which[some]))
            nearest[some] = points.T
        return found, nearest


def needle_thickness(points: FloatArray) -> FloatArray:
    """(T,): a bound of the thickness of needles among triangles with corners (3, T, 3); 0 for other triangles."""
    longest, heights = _longest_and_heights(points)
    return np.where(heights > NEEDLE * longest, 0.0, 2 * heights + NEEDLE**2 * longest)


def distance_slack(points: FloatArray) -> FloatArray:
    """(T,): the largest error by which ``to_triangles`` finds distances to triangles with corners (3, T, 3) too long:
    the thickness of needles, for others 4·2⁻⁵²·longest²/height (docs/deviation.md, Rounding)."""
    longest, heights = _longest_and_heights(points)
    is_plain = heights > NEEDLE * longest
    of_plain = np.divide(4 * np.finfo(float).eps * longest**2, heights, out=np.zeros_like(heights), where=is_plain)
    return np.where(is_plain, of_plain, needle_thickness(points))


def _longest_and_heights(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The longest sides (T,) of triangles with corners (3, T, 3), and the heights (T,) over these sides."""
    normals = cross_products(points[1] - points[0], points[2] - points[0])
    longest = np.sqrt(squared_norms(points[[1, 2, 0]] - points).max(axis=0))
    return longest, np.divide(np.sqrt(squared_norms(normals)), longest, out=np.zeros_like(longest), where=longest > 0)


def _partners(corners: IndexArray, vertex_count: int) -> IndexArray:
    """(3, T) ``beyond`` for the vertices of triangles (3, T)."""
    following = corners[[1, 2, 0]]
    keys = (np.minimum(corners, following) * vertex_count + np.maximum(corners, following)).ravel()
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    is_next_same = np.concatenate([[False], keys[1:] == keys[:-1], [False]])
    is_last_of_two = is_next_same[1:-1] & ~is_next_same[:-2] & ~is_next_same[2:]
    second = np.flatnonzero(is_last_of_two) + 1
    one, other = order[second - 1], order[second]
    beyond = np.full(len(keys), NONE)
    beyond[one], beyond[other] = other % corners.shape[1], one % corners.shape[1]
    return beyond.reshape(corners.shape)


def barycentric(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """(P, 3): the weights of points (P, 3) of triangles (3, P, 3)."""
    a, b, c = triangles
    normals = cross_products(b - a, c - a)
    squares = squared_norms(normals)
    parts = [cross_products(c - b, points - b), cross_products(a - c, points - c), cross_products(b - a, points - a)]
    weights = np.stack([(part * normals).sum(axis=1) for part in parts], axis=1)
    even = np.full_like(weights, 1 / 3)
    weights = np.divide(weights, squares[:, None], out=even, where=squares[:, None] > 0)
    return np.clip(weights, 0.0, 1.0)


def to_triangles(places: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The distances (N,) from places (3, N) to triangles with corners (3, 3, N), and the nearest points (3, N).

    The nearest points are points of the triangles whatever the rounding, so distances are not too short. Distances are
    too long by ``distance_slack`` at most, and 2⁻³⁷ of themselves: the foot of the perpendicular comes from cross
    products, with a relative error of the rounding over the sine of the angle at the first corner. If the sine is too
    small, the triangle is a needle, and its sides replace it.
    """
    first = corners[0]
    ab, ac, ap = corners[1] - first, corners[2] - first, places - first
    normal = crosses(ab, ac)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        squared = products(normal, normal)
        scaled = normal / squared
        v = products(crosses(ap, ac), scaled)
        w = products(crosses(ab, ap), scaled)
        inside = (v >= 0) & (w >= 0) & (v + w <= 1)
        longest = np.maximum(products(ab, ab), products(ac, ac))
        # Half of NEEDLE: each triangle taken for its sides is a needle to ``needle_thickness``, however both round.
        inside &= squared > (NEEDLE / 2) ** 2 * longest * longest
    nearest = first + np.where(inside, v, 0.0) * ab + np.where(inside, w, 0.0) * ac
    outside = np.flatnonzero(~inside)
    if len(outside):
        nearest[:, outside] = _on_sides(places.take(outside, axis=1), corners.take(outside, axis=2))
    between = places - nearest
    return np.sqrt(products(between, between)), nearest


def to_quads(places: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """As of ``to_triangles``, for quads with corners (4, 3, N) as two triangles, the diagonal from corner 0 to 2; and
    (N,) bool, whether the first triangle is no farther than the second."""
    (one, at_one), (other, at_other) = (to_triangles(places, corners[some]) for some in ([0, 1, 2], [0, 2, 3]))
    is_first = one <= other
    return np.minimum(one, other), np.where(is_first, at_one, at_other), is_first


def _on_sides(places: FloatArray, corners: FloatArray) -> FloatArray:
    """(3, N): the nearest points on the sides of triangles."""
    best, least = corners[0].copy(), np.full(places.shape[1], np.inf)
    for start, end in zip(corners, corners[[1, 2, 0]], strict=True):
        along, towards = end - start, places - start
        length = products(along, along)
        share = np.divide(products(along, towards), length, out=np.zeros_like(length), where=length > 0)
        points = start + np.clip(share, 0.0, 1.0, out=share) * along
        between = places - points
        distances = products(between, between)
        nearer = distances < least
        np.copyto(best, points, where=nearer)
        np.copyto(least, distances, where=nearer)
    return best


def places_among(rows: FloatArray, others: FloatArray) -> IndexArray:
    """(N,) intp: the place of each of the rows (N, d) among others (M, d), exactly; ``NONE`` if it is not there."""
    if not len(others):
        return np.full(len(rows), NONE)
    found, known = (np.ascontiguousarray(each + 0.0).view(f"V{8 * each.shape[1]}").ravel() for each in (rows, others))
    order = np.argsort(known, kind="stable")
    places = order[np.minimum(np.searchsorted(known, found, sorter=order), len(known) - 1)]
    return np.where(known[places] == found, places, NONE)
