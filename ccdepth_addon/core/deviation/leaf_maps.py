# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance of a level's leaves, both ways, by a map of the surface onto each leaf's own triangles.

Cells of the surface over a leaf are mapped bilinearly, their corners to the triangles, those on a side of the leaf to
this side. The map meets every point of the triangles, so the largest distance between a point and its image bounds the
distance both ways. docs/distance.md, Lemma 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import AT_ONCE, chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import cross_products, dot_products, squared_norms, units
from ..surface.bicubic import CORNERS
from .bezier_pieces import BezierPieces, bilinear_pieces
from .columns import NONE, columns
from .triangles import needle_thickness, to_triangles

# How many times cells are quartered, and bicubic patches halved.
QUARTERED, HALVED_TIMES = 11, 3

# Places in a leaf are counted along both of its sides in steps of this part; of its corners; the corner after each.
PLACES = 1 << (QUARTERED + 2)
CORNERS_OF_LEAF = (PLACES // 2) * np.array([0, PLACES, PLACES + 1, 1])
FOLLOWING = [1, 2, 3, 0]

# The least cosine between a triangle's normal and the direction in which it is seen.
LEANING = 0.1

# Nine points of a cell: its corners, the middles of its sides, its middle. The corners of its quarters among these, for
# quarters in the order of ``bezier_pieces.QUARTERS``, and for the children of subdivision.
HALVED = np.array([[0, 4, 8, 7], [4, 1, 5, 8], [7, 8, 6, 3], [8, 5, 2, 6]])
SUBDIVIDED = np.array([[0, 4, 8, 7], [1, 5, 8, 4], [2, 6, 8, 5], [3, 7, 8, 6]])


@dataclass(frozen=True)
class Roofs:
    """The two triangles of K leaves, as heights over a plane. first: (K, 3), the first corner of the diagonal; normals:
    (K, 3), of the planes through these corners. triangles: (3, 3, K) twice, the triangles in the plane. slopes: (K, 3),
    the height of the first triangle's plane; folds: (K, 3), the height of the second one's over the first one's;
    is_valley: (K,) bool, whether that is positive over the second triangle. is_good: (K,) bool, whether both triangles
    lie over a convex quad."""

    first: FloatArray
    normals: FloatArray
    triangles: tuple[FloatArray, FloatArray]
    slopes: FloatArray
    folds: FloatArray
    is_valley: BoolArray
    is_good: BoolArray

    @staticmethod
    def over(quads: FloatArray, is_turned: BoolArray) -> Roofs:
        """The triangles of quads (K, 4, 3), with the diagonal from corner 0 to 2, or (K,) bool from corner 1 to 3."""
        quads = np.where(is_turned[:, None, None], np.roll(quads, -1, axis=1), quads)
        first = quads[:, 0]
        off = quads - first[:, None]
        _, b, c, d = np.moveaxis(off, 1, 0)
        normals = units(cross_products(c, d - b))
        flat = quads - dot_products(off, normals[:, None])[..., None] * normals[:, None]
        sides = np.roll(flat, -1, axis=1) - flat
        turns = dot_products(cross_products(sides, np.roll(sides, -1, axis=1)), normals[:, None])
        one, other = units(cross_products(b, c)), units(cross_products(c, d))
        facing = dot_products(one, normals)
        corners = columns(flat)
        triangles = corners[[0, 1, 2]], corners[[0, 2, 3]]
        is_good = (turns > 0).all(axis=1) & (facing > LEANING) & (dot_products(other, normals) > LEANING)
        for some in triangles:
            is_good &= needle_thickness(some.swapaxes(1, 2)) == 0
        one = one / np.where(is_good, facing, 1.0)[:, None]
        rises, across = dot_products(one, d), cross_products(normals, c)
        share = np.divide(rises, dot_products(across, d), out=np.zeros_like(rises), where=is_good)
        return Roofs(first, normals, triangles, normals - one, share[:, None] * across, rises > 0, is_good)

    def images(self, places: FloatArray, leaves: IndexArray) -> FloatArray:
        """(N, 3): the points of the triangles of leaves (N,) at places (N, 3) seen along the normals, or at the nearest
        places of the convex quads."""
        points = columns(places)
        (one, at_one), (other, at_other) = (to_triangles(points, some[..., leaves]) for some in self.triangles)
        flat: FloatArray = np.where(one <= other, at_one, at_other).T
        off, folds = flat - self.first[leaves], self.folded(flat, leaves)
        folds = np.where(self.is_valley[leaves], np.maximum(folds, 0.0), np.minimum(folds, 0.0))
        heights = dot_products(off, self.slopes[leaves]) + folds
        flat += heights[:, None] * self.normals[leaves]
        return flat

    def folded(self, places: FloatArray, leaves: IndexArray) -> FloatArray:
        """(N,): the heights of the second planes over the first ones, at places (N, 3)."""
        return dot_products(places - self.first[leaves], self.folds[leaves])


@dataclass(frozen=True)
class Cells:
    """N cells of the surface, of one size. pieces, leaves: (N,) intp, the piece and the leaf of each. corners: (N, 4)
    intp, the place in the leaf of each corner; images: (N, 4, 3), of the corners; off: (N, 4), their distances from the
    triangles. halved: (N,) intp, the number of times that a bicubic patch was halved."""

    pieces: IndexArray
    leaves: IndexArray
    corners: IndexArray
    images: FloatArray
    off: FloatArray
    halved: IndexArray

    def at(self, chosen: BoolArray) -> Cells:
        """Chosen cells."""
        return Cells(*(column[chosen] for column in vars(self).values()))


def mapped_bounds(
    pieces: BezierPieces, quads: FloatArray, is_turned: BoolArray, chosen: BoolArray, limit: float
) -> FloatArray:
    """(K,): bounds of the distance, both ways, between the surface over chosen leaves (K,) bool and their triangles, by
    a map; infinite for all others, and beyond the limit. pieces: of the leaves, in their order, not split since. quads:
    (K, 4, 3), as drawn; is_turned: as of ``Roofs.over``."""
    roofs = Roofs.over(quads, is_turned)
    found = np.where(chosen & roofs.is_good, 0.0, np.inf)
    leaves = np.flatnonzero(np.isfinite(found))
    # Corners of pieces at an extraordinary vertex are counted from this vertex on.
    turns = (pieces.unit_mesh.corner_edges.reshape(-1, 4)[leaves] == pieces.sides[leaves, :1]).argmax(axis=1)
    turned = (turns[:, None] + np.arange(4)) % 4
    off, halved = np.zeros(turned.shape), np.zeros_like(leaves)
    cells = Cells(leaves, leaves, CORNERS_OF_LEAF[turned], quads[leaves[:, None], turned], off, halved)
    for times in range(QUARTERED + 1):
        bounds = _bounds(pieces, roofs, cells, limit)
        # Of numbers beyond double precision nothing is proved.
        is_far = ~(bounds <= limit)
        is_lost = ~np.isfinite(bounds) | (is_far & ((cells.halved >= HALVED_TIMES) | (times == QUARTERED)))
        found[cells.leaves[is_lost]] = np.inf
        np.maximum.at(found, cells.leaves[~is_far], bounds[~is_far])
        cells = _quartered(pieces, roofs, cells.at(is_far & np.isfinite(found[cells.leaves])))
        if not len(cells.pieces):
            break
    return found


def _bounds(pieces: BezierPieces, roofs: Roofs, cells: Cells, limit: float) -> FloatArray:
    """(N,): bounds of the distance between the points of cells and their images; infinite if a corner is farther than
    the limit from its image."""
    found = np.empty(len(cells.pieces))
    for some in chunks(len(found), AT_ONCE):
        which, images = cells.pieces[some], cells.images[some]
        apart = pieces.coefficients[which] - bilinear_pieces(images)
        squares = (apart * apart).sum(axis=1)
        found[some] = np.sqrt(squares.max(axis=1)) + pieces.excess[which]
        found[some][squares[:, CORNERS].max(axis=1) > limit * limit] = np.inf
        # Bilinear images over both triangles are off the triangles, and so may be their corners.
        folds = roofs.folded(images, cells.leaves[some][:, None])
        over, under = np.maximum(folds.max(axis=1), 0.0), np.maximum(-folds.min(axis=1), 0.0)
        found[some] += np.divide(over * under, over + under, out=np.zeros_like(over), where=over * under > 0)
        found[some] += cells.off[some].max(axis=1)
    return found


def _quartered(pieces: BezierPieces, roofs: Roofs, cells: Cells) -> Cells:
    """The quarters of cells."""
    which, count = cells.pieces, len(cells.pieces)
    is_patch = ~(pieces.has_net(which) | pieces.is_bilinear(which))
    pieces.split(which[pieces.first_child[which] == NONE])
    children = pieces.first_child[which][:, None] + np.arange(4)
    nine = np.where(is_patch[:, None, None], HALVED, SUBDIVIDED)
    rows = np.arange(count)[:, None, None]
    points = np.empty((count, 9, 3))
    points[rows, nine] = pieces.coefficients[children][..., CORNERS].swapaxes(2, 3)
    following = cells.corners[:, FOLLOWING]
    corners = np.concatenate([cells.corners, (cells.corners + following) // 2, following[:, :1]], axis=1)
    corners[:, 8] = cells.corners[:, [0, 2]].sum(axis=1) // 2
    start, end = cells.images, cells.images[:, FOLLOWING]
    images = np.concatenate([start, (start + end) / 2, start[:, :1]], axis=1)
    # Sides between two of the cells are bent; beyond others the image is the one of an undivided cell.
    keys = cells.leaves[:, None] * PLACES**2 + corners[:, 4:8]
    _, where, times = np.unique(keys, return_inverse=True, return_counts=True)
    is_bent = np.concatenate([times[where].reshape(count, 4) == 2, np.ones((count, 1), dtype=bool)], axis=1)
    at, point = np.nonzero(is_bent)
    images[at, 4 + point] = roofs.images(points[at, 4 + point], cells.leaves[at])
    at, side = np.nonzero(pieces.sides[which] != NONE)
    along = (end - start)[at, side]
    share = dot_products(points[at, 4 + side] - start[at, side], along)
    share /= np.maximum(squared_norms(along), np.finfo(float).tiny)
    images[at, 4 + side] = start[at, side] + np.clip(share, 0.0, 1.0)[:, None] * along
    off = np.concatenate([cells.off, np.zeros((count, 5))], axis=1)
    at, side = np.nonzero(~is_bent[:, :4] & (pieces.sides[which] == NONE))
    middles = images[at, 4 + side]
    off[at, 4 + side] = np.sqrt(squared_norms(middles - roofs.images(middles, cells.leaves[at])))
    return Cells(
        children.ravel(),
        np.repeat(cells.leaves, 4),
        corners[rows, nine].reshape(-1, 4),
        images[rows, nine].reshape(-1, 4, 3),
        off[rows, nine].reshape(-1, 4),
        np.repeat(cells.halved + is_patch, 4),
    )
