# SPDX-License-Identifier: GPL-3.0-or-later
"""Pairs of points of the surface over a leaf with points of its drawn triangles, and the angles of their normals.

Two pairings are at hand. *At equal parameters*, each triangle has its own normal as axis. *Along an axis* that all
triangles of a leaf have in common, a point of the surface is paired with the point of the triangles over the same place
of the plane across the axis. There only these shifts count: the curves over the leaf's sides bow away from these, and
the surface over one triangle may reach over the next one. docs/normals.md has the proofs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays.ranges import ranges
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import angles_between, cross_products, dot_products, lengths, squared_norms, units
from ..distance.piece_hulls import SIDES, Pieces, off_at_equal
from ..distance.pieces import Form
from ..surface.normal_coefficients import grid_of, is_triangle, largest_angles, linear_grid, normal_grid
from .leaf_triangles import LeafTriangles
from .request import AdaptiveRequest

# The number of times pieces are quartered while no angle beyond the limit is reached.
SPLITS = 3

# Stored normals are off by this angle at most, in radians: they are numbers of 16 bits.
STORED = 2.0**-13

# The least cosine between a leaf's axis and the normals of its triangles, and between stored normals and their mean.
LEAST_COSINE = 0.1

# Weights of corners are known up to rounding: 0 is below this.
NOTHING = 1e-9


@dataclass(frozen=True)
class PairedTriangles:
    """M drawn triangles of n leaves. corners, normals: (M, 3, 3), positions and stored normals; firsts: (n + 1,) the
    first triangle of each leaf; axes: (M, 3), unit vectors; planes: (M, 3), unit normals; slopes: (M, 3, 3), the
    gradients of the weights of the corners across the axis; areas: (M,), twice the areas seen along the axis.
    is_outer: (M, 3) bool, whether the side opposite to a corner is a side of the leaf. is_polygon: (M,) bool, of a
    polygon drawn whole, whose plane stands for its triangles. allowances: (2, M), what is added to angles of shading
    and facets.
    """

    corners: FloatArray
    normals: FloatArray
    firsts: IndexArray
    axes: FloatArray
    planes: FloatArray
    slopes: FloatArray
    areas: FloatArray
    is_outer: BoolArray
    is_polygon: BoolArray
    allowances: FloatArray

    @staticmethod
    def of(
        triangles: LeafTriangles,
        corners: FloatArray,
        normals: FloatArray,
        is_polygon: BoolArray,
        request: AdaptiveRequest,
    ) -> PairedTriangles:
        """Triangles with corners and stored normals (M, 3, 3), paired at equal parameters. is_polygon: (M,) bool."""
        areas = cross_products(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        own, firsts = units(areas), triangles.firsts
        of_polygons = np.repeat(units(np.add.reduceat(areas, firsts[:-1])), np.diff(firsts), axis=0)
        planes = np.where(is_polygon[:, None], of_polygons, own)
        # A polygon is drawn by triangles between any of its corners.
        turns = np.where(is_polygon, angles_between(normals[:, 1:], planes[:, None]).max(axis=1), 0.0)
        normals = np.where(is_polygon[:, None, None], planes[:, None], normals)
        allowances = np.stack(
            [
                np.repeat(np.maximum.reduceat(turns, firsts[:-1]), np.diff(firsts))
                + uneven_turns(normals, request.axes),
                _tilts(corners, planes, is_polygon, firsts, request.stored),
            ]
        )
        is_outer = _outer_sides(triangles)
        nothing = np.zeros((len(corners), 3, 3))
        found = PairedTriangles(
            corners, normals, firsts, own, planes, nothing, areas[:, 0], is_outer, is_polygon, allowances + STORED
        )
        return found.along(own)

    def along(self, axes: FloatArray) -> PairedTriangles:
        """The triangles with other axes (M, 3)."""
        sides = self.corners[:, 1:] - self.corners[:, :1]
        areas = dot_products(cross_products(sides[:, 0], sides[:, 1]), axes)
        opposite = np.roll(self.corners, 1, axis=1) - np.roll(self.corners, -1, axis=1)
        slopes = cross_products(axes[:, None], opposite) / np.where(areas > 0, areas, np.inf)[:, None, None]
        return replace(self, axes=axes, slopes=slopes, areas=areas)

    def along_common_axes(self) -> PairedTriangles:
        """The triangles with the mean normal of their leaf as axis; a polygon's own."""
        sums = np.add.reduceat(self.planes, self.firsts[:-1])
        return self.along(np.repeat(units(sums), np.diff(self.firsts), axis=0))

    def at_leaves(self, chosen: BoolArray) -> BoolArray:
        """(M,) bool: whether triangles belong to chosen leaves (n,)."""
        return np.repeat(chosen, np.diff(self.firsts))

    @property
    def cosines(self) -> FloatArray:
        """(M,): of the angles between the axes and the planes' normals."""
        return dot_products(self.planes, self.axes)

    def weights(self, triangles: IndexArray, points: FloatArray) -> FloatArray:
        """(3, R, P): the weights of the corners of triangles (P,) at points (R, 3, P), seen along the axis."""
        slopes = self.slopes[triangles, 1:].transpose(1, 2, 0)
        away = points - self.corners[triangles, 0].T
        second, third = (each[0] * away[:, 0] + each[1] * away[:, 1] + each[2] * away[:, 2] for each in slopes)
        return np.stack([1 - second - third, second, third])

    def heights(self, triangles: IndexArray, points: FloatArray) -> FloatArray:
        """(P,): the largest heights of points (R, 3, P) over the planes of triangles (P,), along the axis."""
        planes, away = self.planes[triangles].T, points - self.corners[triangles, 0].T
        off = np.abs(planes[0] * away[:, 0] + planes[1] * away[:, 1] + planes[2] * away[:, 2]).max(axis=0)
        found: FloatArray = off / np.maximum(self.cosines[triangles], LEAST_COSINE)
        return found


@dataclass
class MeasuredAngles:
    """The largest angles, (2, M), of shading and facets, over each of M triangles. limits: (2, M), below which no piece
    is quartered; an infinite one is not looked at. is_along_axis: whether pairs are along the axis, instead of at equal
    parameters."""

    triangles: PairedTriangles
    limits: FloatArray
    is_along_axis: bool
    angles: FloatArray

    @staticmethod
    def none(triangles: PairedTriangles, limits: FloatArray, *, is_along_axis: bool) -> MeasuredAngles:
        """Nothing measured yet."""
        return MeasuredAngles(triangles, limits, is_along_axis, np.zeros(limits.shape))

    def include(self, pieces: Pieces, form: Form) -> None:
        """Include pieces, quartered where that may bring them within the limits."""
        for split in range(SPLITS + 1):
            own, triangle = pieces.triangles, is_triangle(pieces.hulls)
            normals, wanted = normal_grid(pieces.hulls.swapaxes(1, 2)), self.limits[:, own]
            angles, reached = np.zeros((2, 2, len(own)))
            for number, compared in enumerate((self._interpolated, self._planes)):
                if np.isfinite(wanted[number]).any():
                    found = largest_angles(normals, compared(pieces), triangle=triangle)
                    angles[number], reached[number] = np.where(np.isfinite(wanted[number]), found, 0.0)
            is_lost = ((reached > wanted) | (self.angles[:, own] > wanted)).any(axis=0)
            is_open = (angles > wanted).any(axis=0) & ~is_lost & (split < SPLITS)
            for each, values in zip(self.angles, angles, strict=True):
                np.maximum.at(each, own[~is_open], values[~is_open])
            if not is_open.any():
                return
            pieces = pieces.at(is_open).divided(form.quarters)

    def _interpolated(self, pieces: Pieces) -> FloatArray:
        """(I, J, 3, P): the grid of interpolated normals."""
        own, points = pieces.triangles, pieces.hulls
        if not self.is_along_axis:
            points = pieces.flats[[0, 21, 27] if is_triangle(pieces.hulls) else [0, 12, 15, 3]]
        weights, stored = self.triangles.weights(own, points.swapaxes(1, 2)), self.triangles.normals[own]
        found = sum(weights[corner][:, None] * stored[:, corner].T for corner in range(3))
        return grid_of(found) if self.is_along_axis else linear_grid(found)

    def _planes(self, pieces: Pieces) -> FloatArray:
        return self.triangles.planes[pieces.triangles].T[None, None]


@dataclass
class MeasuredPieces:
    """Where the pieces over each of M triangles lie at most. off: (M,), at equal parameters; and along the axis
    heights: (M,), over the plane; over: (M, 3), how far weights of corners are below 0; bows: (2, M, 3), how far curves
    over outer sides go away from these sides, and beyond their ends; rests: (M,), the sizes of rests; faces: (M,) bool,
    whether the surface faces along the axis.
    """

    triangles: PairedTriangles
    off: FloatArray
    heights: FloatArray
    over: FloatArray
    bows: FloatArray
    rests: FloatArray
    faces: BoolArray

    @staticmethod
    def none(triangles: PairedTriangles) -> MeasuredPieces:
        """Nothing measured yet."""
        count = len(triangles.corners)
        over, bows, faces = np.zeros((count, 3)), np.zeros((2, count, 3)), np.ones(count, dtype=bool)
        return MeasuredPieces(triangles, np.zeros(count), np.zeros(count), over, bows, np.zeros(count), faces)

    def include_at_equal(self, pieces: Pieces) -> None:
        """Include the distances of pieces at equal parameters."""
        np.maximum.at(self.off, pieces.triangles, off_at_equal(pieces))

    def include_along_axis(self, pieces: Pieces, form: Form) -> None:
        """Include where pieces lie, seen along the axis."""
        parts = pieces.divided(form.quarters) if form.quarters else pieces
        own, points = parts.triangles, parts.hulls.swapaxes(1, 2)
        np.maximum.at(self.heights, own, self.triangles.heights(own, points))
        np.maximum.at(self.over, own, np.maximum(-self.triangles.weights(own, points).min(axis=1), 0.0).T)
        if not form.quarters:
            spread = points - points.mean(axis=0)
            np.maximum.at(self.rests, own, 2 * np.sqrt((spread**2).sum(axis=1).max(axis=0)))
            return
        self._include_bows(parts)
        self._include_facing(pieces)

    def _include_facing(self, pieces: Pieces) -> None:
        """Note the triangles over which pieces do not face along the axis."""
        own, normals = pieces.triangles, normal_grid(pieces.hulls.swapaxes(1, 2))
        axes = self.triangles.axes[own].T
        along = normals[:, :, 0] * axes[0] + normals[:, :, 1] * axes[1] + normals[:, :, 2] * axes[2]
        largest = np.abs(normals).max(axis=(0, 1, 2))
        self.faces[own[along.min(axis=(0, 1)) < -NOTHING * largest]] = False

    def _include_bows(self, pieces: Pieces) -> None:
        """Raise the bows to those of the curves of pieces over outer sides."""
        drawn, own = self.triangles, pieces.triangles
        flats, hulls = pieces.flats.swapaxes(1, 2), pieces.hulls.swapaxes(1, 2)
        starts = [start for start, _, _ in SIDES[len(flats)]]
        are_on = np.abs(drawn.weights(own, flats[starts])) < NOTHING
        for start, end, rows in SIDES[len(flats)]:
            on_both = are_on[:, starts.index(start)] & are_on[:, starts.index(end)] & drawn.is_outer[own].T
            for corner in np.flatnonzero(on_both.any(axis=1)).tolist():
                on = np.flatnonzero(on_both[corner])
                first, along, size = _side_across_axis(drawn, own[on], corner)
                axes = drawn.axes[own[on]]
                away = hulls[:, :, on][rows].swapaxes(1, 2) - first
                away = away - dot_products(away, axes)[..., None] * axes
                part = dot_products(away, along)
                off = np.sqrt(np.maximum(squared_norms(away) - part**2, 0.0)).max(axis=0)
                np.maximum.at(self.bows[0, :, corner], own[on], off)
                np.maximum.at(self.bows[1, :, corner], own[on], np.maximum(-part, part - size).max(axis=0))

    def distances_at_equal(self) -> FloatArray:
        """(n,): the distances of pairs at equal parameters; infinite where a triangle has no area."""
        usable = np.logical_and.reduceat(self.triangles.areas > 0, self.triangles.firsts[:-1])
        return np.where(usable, np.maximum.reduceat(self.off, self.triangles.firsts[:-1]), np.inf)

    def pairs_along_axis(self) -> tuple[FloatArray, FloatArray]:
        """(2, M), what pairs along the axis add to the angles of triangles with the surface over them; and (n,), the
        distances of pairs, infinite where there is no pairing."""
        drawn, firsts = self.triangles, self.triangles.firsts
        counts = np.diff(firsts)
        bows = np.where(drawn.is_outer, np.hypot(*self.bows), 0.0).max(axis=1)
        rests = np.maximum.reduceat(self.rests, firsts[:-1])
        reaches = np.maximum.reduceat(bows, firsts[:-1]) + rests
        reach = np.repeat(reaches, counts)
        shaded, raised, kinks = self._jumps(reach)
        cosines = dot_products(drawn.normals, units(drawn.normals.sum(axis=1))[:, None]).min(axis=1)
        turned = (self._slides(np.repeat(rests, counts)) + shaded) / np.maximum(cosines, LEAST_COSINE)
        added = np.stack([np.arcsin(np.minimum(turned, 1.0)), kinks])
        tilts = np.sqrt(np.maximum(1 / np.maximum(drawn.cosines, LEAST_COSINE) ** 2 - 1, 0.0))
        flat = np.abs(dot_products(drawn.corners - drawn.corners[:, :1], drawn.planes[:, None])).max(axis=1)
        flat = np.repeat(np.maximum.reduceat(flat, firsts[:-1]), counts)
        heights = self.heights + np.where(drawn.is_polygon, flat, tilts * reach + raised)
        off = np.hypot(reaches, np.maximum.reduceat(heights, firsts[:-1]))
        usable = self.faces & (drawn.areas > 0) & (drawn.cosines > LEAST_COSINE) & (cosines > LEAST_COSINE)
        return added, np.where(np.logical_and.reduceat(usable, firsts[:-1]), off, np.inf)

    def _slides(self, rests: FloatArray) -> FloatArray:
        """(M,): how far interpolated normals, continued, change between the leaf's sides and the curves over them."""
        drawn = self.triangles
        changes = np.einsum("mki,mkj->mij", drawn.slopes, drawn.normals)
        one, other = _pairs(drawn)
        largest = np.zeros(len(one))
        for corner in range(3):
            _, along, _ = _side_across_axis(drawn, other, corner)
            away = cross_products(along, drawn.axes[other])
            moved = sum(
                lengths(np.einsum("mij,mi->mj", changes[one], way)) * bows[other, corner]
                for way, bows in zip((away, along), self.bows, strict=True)
            )
            largest = np.maximum(largest, np.where(drawn.is_outer[other, corner], moved, 0.0))
        found = np.zeros(len(rests))
        np.maximum.at(found, one, largest)
        return found + np.sqrt(np.einsum("mij,mij->m", changes, changes)) * rests

    def _jumps(self, reach: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(M,) each: how far the interpolated normals, and the heights, of the leaf's other triangles are off those of
        a triangle, continued as far as the surface over it reaches beyond its inner sides; and the largest angle
        between their planes."""
        drawn = self.triangles
        one, other = _pairs(drawn)
        one, other = one[one != other], other[one != other]
        result = np.zeros((3, len(drawn.corners)))
        if not len(one):
            return result[0], result[1], result[2]
        points = drawn.corners[other].transpose(1, 2, 0)
        weights = drawn.weights(one, points)
        continued = np.einsum("krp,pkc->rpc", weights, drawn.normals[one])
        differences = lengths(continued - drawn.normals[other].swapaxes(0, 1))
        heights = np.abs(dot_products(points.swapaxes(1, 2) - drawn.corners[one, 0], drawn.planes[one]))
        heights /= np.maximum(drawn.cosines[one], LEAST_COSINE)
        shaded, raised = np.full((2, len(one)), np.inf)
        size = lengths(drawn.corners[one, 1] - drawn.corners[one, 0])
        for corner in range(3):
            _, _, across = _side_across_axis(drawn, one, corner)
            high = drawn.areas[one] / np.maximum(across, 1e-300)
            beyond = self.over[one, corner] * high + reach[one]
            # The other triangle lies beyond this side, a corner of it perhaps on the side.
            usable = ~drawn.is_outer[one, corner] & (weights[corner] <= NOTHING).all(axis=0)
            is_at, away = weights[corner] > -NOTHING, np.maximum(-weights[corner] * high, 1e-300)
            for best, values, least in ((shaded, differences, NOTHING), (raised, heights, NOTHING * size)):
                ratios = np.where(is_at, np.where(values <= least, 0.0, np.inf), values / away).max(axis=0)
                moved = np.where(beyond > 0, ratios * np.maximum(beyond, 1e-300), 0.0)
                np.minimum(best, np.where(usable, moved, np.inf), out=best)
        kinks = angles_between(drawn.planes[one], drawn.planes[other])
        for each, values in zip(result, (shaded, raised, kinks), strict=True):
            np.maximum.at(each, one, values)
        return result[0], result[1], result[2]


def _side_across_axis(
    drawn: PairedTriangles, triangles: IndexArray, corner: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The side opposite to a corner of triangles (P,): its first end (P, 3), and seen along the axis its unit vector
    (P, 3) and its length (P,)."""
    first, second = (drawn.corners[triangles, (corner + k) % 3] for k in (1, 2))
    side, axes = second - first, drawn.axes[triangles]
    side = side - dot_products(side, axes)[:, None] * axes
    return first, units(side), lengths(side)


def _pairs(drawn: PairedTriangles) -> tuple[IndexArray, IndexArray]:
    """(K,) twice: all ordered pairs of triangles of a leaf, each with itself too; none of polygons."""
    firsts = drawn.firsts
    counts = np.where(drawn.is_polygon[firsts[:-1]], 0, np.diff(firsts))
    of_triangles = np.repeat(counts, np.diff(firsts))
    one = np.repeat(np.arange(len(drawn.corners)), of_triangles)
    return one, ranges(np.repeat(firsts[:-1], np.diff(firsts)), of_triangles)


def _outer_sides(triangles: LeafTriangles) -> BoolArray:
    """(M, 3) bool: whether the side opposite to a corner belongs to one triangle of the leaf alone."""
    count = int(triangles.vertices.max(initial=0)) + 1
    ends = np.stack([np.roll(triangles.vertices, shift, axis=1) for shift in (-1, 1)])
    keys = (triangles.leaves[:, None] * count + ends.min(axis=0)) * count + ends.max(axis=0)
    _, places, times = np.unique(keys, return_inverse=True, return_counts=True)
    found: BoolArray = times[places.reshape(-1, 3)] == 1
    return found


def _tilts(
    corners: FloatArray, planes: FloatArray, is_polygon: BoolArray, firsts: IndexArray, stored: float
) -> FloatArray:
    """(M,): how far the drawn triangles' normals may be off the planes' by rounding of positions, and for polygons off
    the polygon's by the way it is cut: a convex polygon's triangles are at least as high as its lowest ear."""
    sides = np.roll(corners, -1, axis=1) - corners
    low = lengths(cross_products(sides[:, 0], sides[:, 1])) / np.maximum(lengths(sides).max(axis=1), 1e-300)
    off = np.full(len(corners), stored)
    for first in np.unique(np.searchsorted(firsts, np.flatnonzero(is_polygon), side="right") - 1).tolist():
        own = slice(firsts[first], firsts[first + 1])
        around, normal = corners[own, 1], planes[firsts[first]]
        before, after = np.roll(around, 1, axis=0) - around, np.roll(around, -1, axis=0) - around
        ears = cross_products(after, before) @ normal / np.maximum(lengths(after - before), 1e-300)
        low[own] = ears.min()
        off[own] += np.abs((around - around.mean(axis=0)) @ normal).max()
    found: FloatArray = np.where(low > 0, np.arcsin(np.minimum(2 * off / np.maximum(low, 1e-300), 1.0)), np.pi)
    return found


def uneven_turns(normals: FloatArray, axes: FloatArray) -> FloatArray:
    """(M,): how far interpolated normals turn where Blender interpolates in the object's space, whose axes are the
    columns of (3, 3): there the corners' normals (M, 3, 3) have other lengths."""
    stored = lengths(normals @ axes)
    ratio = np.sqrt(stored.max(axis=1) / np.maximum(stored.min(axis=1), 1e-300))
    spread = lengths(normals - np.roll(normals, 1, axis=1)).max(axis=1)
    cosines = np.maximum(dot_products(normals, units(normals.sum(axis=1))[:, None]).min(axis=1), LEAST_COSINE)
    found: FloatArray = np.arcsin(np.minimum((ratio - 1) / (ratio + 1) * spread / cosines, 1.0))
    return found
