# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance of a level's leaves, both ways, by a map of the surface onto each leaf's own triangles.

Cells of the surface over a leaf are mapped bilinearly into a convex quad, onto which both triangles are mapped
linearly; points on a side of the leaf are mapped to this side. The map meets every point of the triangles, so the
largest distance between a point and its image bounds the distance both ways. docs/distance.md, Lemma 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import AT_ONCE, chunks
from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import columns, cross_products, dot_products, lengths, products, squared_norms, units
from ..surface.bicubic import CORNERS
from .bezier_pieces import BezierPieces, bilinear_pieces
from .spread import NONE
from .triangles import to_quads

# How many times cells are quartered, and bicubic patches halved.
QUARTERED, HALVED_TIMES = 20, 3

# Places in a leaf are counted along both of its sides in steps of this part; of its corners; the corner after each.
PLACES = 1 << (QUARTERED + 2)
CORNERS_OF_LEAF = (PLACES // 2) * np.array([0, PLACES, PLACES + 1, 1])
FOLLOWING = [1, 2, 3, 0]

# Two triangles over a square, the diagonal along the first axis from the origin; and the least turn at a corner of an
# unfolded pair, in parts of its longest side squared. Less than that rounding might hide.
SQUARE = np.array([[0.0, 0.0], [0.5, -0.5], [1.0, 0.0], [0.5, 0.5]])
LEAST_TURN = 2.0**-20

# The least sine of a triangle's angle, squared, that tells points beside each other across the triangle.
LEAST_AREA = 2.0**-40

# Nine points of a cell: its corners, the middles of its sides, its middle. The corners of its quarters among these, for
# quarters in the order of ``bezier_pieces.QUARTERS``, and for the children of subdivision.
HALVED = np.array([[0, 4, 8, 7], [4, 1, 5, 8], [7, 8, 6, 3], [8, 5, 2, 6]])
SUBDIVIDED = np.array([[0, 4, 8, 7], [1, 5, 8, 4], [2, 6, 8, 5], [3, 7, 8, 6]])


@dataclass(frozen=True)
class Charts:
    """The two triangles of K leaves over a convex quad of the plane, linear over both parts. corners: (K, 4, 3), the
    diagonal from corner 0 to 2; places: (K, 4, 2), of these in the plane, the diagonal along the first axis from the
    origin. along: (K, 3), how fast points change along the diagonal; across: (K, 2, 3), how fast away from the diagonal
    on the first triangle and on the second one."""

    corners: FloatArray
    places: FloatArray
    along: FloatArray
    across: FloatArray

    @staticmethod
    def over(quads: FloatArray, is_turned: BoolArray) -> Charts:
        """The triangles of quads (K, 4, 3), with the diagonal from corner 0 to 2, or (K,) bool from corner 1 to 3:
        unfolded into the plane, or over a square where the unfolded pair is not convex."""
        corners = np.where(is_turned[:, None, None], np.roll(quads, -1, axis=1), quads)
        off = corners - corners[:, :1]
        along = units(off[:, 2])
        heights = lengths(cross_products(along[:, None], off)) * [0.0, -1.0, 0.0, 1.0]
        places = np.stack([dot_products(off, along[:, None]), heights], axis=2)
        sides = np.roll(places, -1, axis=1) - places
        turns = sides[..., 0] * np.roll(sides, -1, axis=1)[..., 1] - sides[..., 1] * np.roll(sides, -1, axis=1)[..., 0]
        longest = (sides * sides).sum(axis=2).max(axis=1)
        places[~(turns > LEAST_TURN * longest[:, None]).all(axis=1)] = SQUARE
        along = off[:, 2] / places[:, 2, :1]
        across = off[:, [1, 3]] - places[:, [1, 3], :1] * along[:, None]
        return Charts(corners, places, along, across / np.abs(places[:, [1, 3], 1:]))

    @property
    def folds(self) -> FloatArray:
        """(K,): the jump of the derivative across the diagonal."""
        return lengths(self.across.sum(axis=1))

    def points(self, places: FloatArray, leaves: IndexArray) -> FloatArray:
        """(N, 4, 3): the points of the triangles of leaves (N,) at places (N, 4, 2)."""
        side, off = places[..., :1], places[..., 1:]
        first, second = self.across[leaves].swapaxes(0, 1)
        found: FloatArray = self.corners[leaves, :1] + side * self.along[leaves][:, None]
        found += np.maximum(-off, 0.0) * first[:, None] + np.maximum(off, 0.0) * second[:, None]
        return found

    def nearest(self, points: FloatArray, leaves: IndexArray) -> FloatArray:
        """(N, 2): about the places of the triangles' points nearest to points (N, 3); in any case places of the
        quad."""
        corners, points = columns(self.corners[leaves]), columns(points)
        _, nearest, is_first = to_quads(points, corners)
        off = nearest - corners[0]
        side, diagonal = np.where(is_first, corners[1], corners[3]) - corners[0], corners[2] - corners[0]
        a, b, c = products(side, side), products(side, diagonal), products(diagonal, diagonal)
        p, q = products(side, off), products(diagonal, off)
        scale = a * c - b * b
        # Without area, the points along the longer side.
        is_flat = scale <= LEAST_AREA * a * c
        shares = np.where(is_flat, np.stack([p * (a > c), q * (a <= c)]), np.stack([c * p - b * q, a * q - b * p]))
        scale = np.where(is_flat, np.maximum(a, c), scale)
        shares = np.divide(shares, scale, out=np.zeros_like(shares), where=scale > 0)
        shares = np.clip(shares, 0.0, 1.0)
        shares /= np.maximum(shares.sum(axis=0), 1.0)
        of_side = np.where(is_first[:, None], self.places[leaves, 1], self.places[leaves, 3])
        found: FloatArray = shares[0][:, None] * of_side + shares[1][:, None] * self.places[leaves, 2]
        return found


@dataclass(frozen=True)
class Cells(Table):
    """N cells of the surface, of one size. pieces, leaves: (N,) intp, the piece and the leaf of each. corners: (N, 4)
    intp, the place in the leaf of each corner; images: (N, 4, 2), places of the corners' images. halved: (N,) intp, the
    number of times that a bicubic patch was halved."""

    pieces: IndexArray
    leaves: IndexArray
    corners: IndexArray
    images: FloatArray
    halved: IndexArray


def mapped_bounds(pieces: BezierPieces, quads: FloatArray, is_turned: BoolArray, limit: float) -> FloatArray:
    """(K,): bounds of the distance, both ways, between the surface over leaves and their triangles, by a map; infinite
    beyond the limit. pieces: of the leaves, which come first, in their order. quads: (K, 4, 3), as drawn; is_turned: as
    of ``Charts.over``."""
    charts = Charts.over(quads, is_turned)
    found, leaves = np.zeros(len(quads)), np.arange(len(quads))
    # Corners of pieces at an extraordinary vertex are counted from this vertex on.
    turns = (pieces.unit_mesh.corner_edges.reshape(-1, 4) == pieces.sides[leaves, :1]).argmax(axis=1)
    turned = (turns[:, None] + np.arange(4)) % 4
    images = charts.places[leaves[:, None], (turned - is_turned[:, None]) % 4]
    cells = Cells(leaves, leaves, CORNERS_OF_LEAF[turned], images, np.zeros_like(leaves))
    for times in range(QUARTERED + 1):
        bounds = _bounds(pieces, charts, cells, limit)
        # Of numbers beyond double precision nothing is proved.
        is_far = ~(bounds <= limit)
        is_lost = ~np.isfinite(bounds) | (is_far & ((cells.halved >= HALVED_TIMES) | (times == QUARTERED)))
        found[cells.leaves[is_lost]] = np.inf
        np.maximum.at(found, cells.leaves[~is_far], bounds[~is_far])
        cells = _quartered(pieces, charts, cells.at(is_far & np.isfinite(found[cells.leaves])))
        if not len(cells.pieces):
            break
    return found


def _bounds(pieces: BezierPieces, charts: Charts, cells: Cells, limit: float) -> FloatArray:
    """(N,): bounds of the distance between the points of cells and their images; infinite if a corner is farther than
    the limit from its image."""
    found, folds = np.empty(len(cells.pieces)), charts.folds
    for some in chunks(len(found), AT_ONCE):
        which, images, leaves = cells.pieces[some], cells.images[some], cells.leaves[some]
        apart = pieces.coefficients[which] - bilinear_pieces(charts.points(images, leaves))
        squares = (apart * apart).sum(axis=1)
        found[some] = np.sqrt(squares.max(axis=1)) + pieces.excess[which]
        found[some][squares[:, CORNERS].max(axis=1) > limit * limit] = np.inf
        # Bilinear points over both triangles are off the triangles.
        over, under = (np.maximum(each * images[..., 1], 0.0).max(axis=1) for each in (-1, 1))
        bent = np.divide(over * under, over + under, out=np.zeros_like(over), where=over * under > 0)
        found[some] += bent * folds[leaves]
    return found


def _quartered(pieces: BezierPieces, charts: Charts, cells: Cells) -> Cells:
    """The quarters of cells."""
    which = cells.pieces
    is_patch = ~(pieces.has_net(which) | pieces.is_bilinear(which))
    pieces.split(which[pieces.first_child[which] == NONE])
    children = pieces.children(which)
    nine = np.where(is_patch[:, None, None], HALVED, SUBDIVIDED)
    rows = np.arange(len(which))[:, None, None]
    points = np.empty((len(which), 9, 3))
    points[rows, nine] = pieces.coefficients[children][..., CORNERS].swapaxes(2, 3)
    following = cells.corners[:, FOLLOWING]
    middles, middle = (cells.corners + following) // 2, cells.corners[:, [0, 2]].sum(axis=1) // 2
    corners = np.concatenate([cells.corners, middles, middle[:, None]], axis=1)
    images = np.empty((len(which), 9, 2))
    images[:, :4] = cells.images
    images[:, 4:8] = _images_of_sides(pieces, charts, cells, points[:, 4:8], middles)
    images[:, 8] = charts.nearest(points[:, 8], cells.leaves)
    return Cells(
        children.ravel(),
        np.repeat(cells.leaves, 4),
        corners[rows, nine].reshape(-1, 4),
        images[rows, nine].reshape(-1, 4, 2),
        np.repeat(cells.halved + is_patch, 4),
    )


def _images_of_sides(
    pieces: BezierPieces, charts: Charts, cells: Cells, points: FloatArray, places: IndexArray
) -> FloatArray:
    """(N, 4, 2): the images of the middles of cells' sides. points: (N, 4, 3), of the surface there; places: (N, 4), of
    the middles in the leaf."""
    start, end = cells.images, cells.images[:, FOLLOWING]
    images = (start + end) / 2
    # Sides between two of the cells are bent; beyond others the image is the one of an undivided cell.
    keys = (cells.leaves[:, None] * PLACES**2 + places).ravel()
    _, first, where, times = np.unique(keys, return_index=True, return_inverse=True, return_counts=True)
    # Both cells take the same place, as the nearest point can change at once from one triangle to the other.
    is_shared = times == 2
    nearest, of_both = np.empty((len(first), 2)), first[is_shared]
    nearest[is_shared] = charts.nearest(points.reshape(-1, 3)[of_both], cells.leaves[of_both // 4])
    is_bent = is_shared[where].reshape(-1, 4)
    images[is_bent] = nearest[where.reshape(-1, 4)[is_bent]]
    # A side of the leaf is mapped to itself.
    at, side = np.nonzero(pieces.sides[cells.pieces] != NONE)
    ends = charts.points(cells.images, cells.leaves)
    begin = ends[at, side]
    along = ends[:, FOLLOWING][at, side] - begin
    share = dot_products(points[at, side] - begin, along)
    share /= np.maximum(squared_norms(along), np.finfo(float).tiny)
    images[at, side] = start[at, side] + np.clip(share, 0.0, 1.0)[:, None] * (end - start)[at, side]
    return images
