# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance of a level's leaves, both ways, by a map of the surface onto each leaf's own triangles, or onto the
triangles of leaves that share a side.

Cells of the surface over a leaf are mapped bilinearly into a convex polygon, onto which both triangles are mapped
linearly; points on a side of the leaf are mapped to this side, or if it is open near it. The map meets every point of
the triangles, so the largest distance between a point and its image bounds the distance both ways. docs/distance.md,
Lemmas 11 and 12.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import AT_ONCE, chunks
from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import dot_products, squared_norms
from ..surface.bicubic import CORNERS
from .bezier_pieces import BezierPieces, bilinear_pieces
from .charts import Charts
from .open_sides import PLACES, OpenSides
from .spread import NONE

# How many times cells are quartered, and bicubic patches halved: of one leaf, and of leaves together.
QUARTERED, HALVED_TIMES, HALVED_TOGETHER = 20, 3, 6

# Places of a leaf's corners, as of ``PLACES``; the corner after each.
CORNERS_OF_LEAF = (PLACES // 2) * np.array([0, PLACES, PLACES + 1, 1])
FOLLOWING = [1, 2, 3, 0]

# Nine points of a cell: its corners, the middles of its sides, its middle. The corners of its quarters among these, for
# quarters in the order of ``bezier_pieces.QUARTERS``, and for the children of subdivision.
HALVED = np.array([[0, 4, 8, 7], [4, 1, 5, 8], [7, 8, 6, 3], [8, 5, 2, 6]])
SUBDIVIDED = np.array([[0, 4, 8, 7], [1, 5, 8, 4], [2, 6, 8, 5], [3, 7, 8, 6]])


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
    charts, every = Charts.over(quads, is_turned), np.ones(len(quads), dtype=bool)
    return _bounds_of_leaves(
        pieces, charts, OpenSides.none(charts, pieces), is_turned, limit, every, every, HALVED_TIMES
    )


def joined_bounds(
    pieces: BezierPieces,
    quads: FloatArray,
    is_turned: BoolArray,
    limit: float,
    is_known: BoolArray,
    is_sought: BoolArray,
    is_both: BoolArray,
) -> FloatArray:
    """(K,): as of ``mapped_bounds``, for sought leaves (K,) bool, with the surface near sides of two leaves mapped to
    the triangles of either leaf. is_known: (K,) bool, whether the diagonal drawn is known, without which leaves have no
    bound. is_both: (K,) bool, sought leaves with bounds both ways; others have bounds of the surface alone."""
    opened, charts = OpenSides.of(Charts.over(quads, is_turned), pieces, is_turned, is_known)
    is_sought, is_both = is_sought & is_known, is_both & is_known
    return _bounds_of_leaves(pieces, charts, opened, is_turned, limit, is_sought, is_both, HALVED_TOGETHER)


def _bounds_of_leaves(
    pieces: BezierPieces,
    charts: Charts,
    opened: OpenSides,
    is_turned: BoolArray,
    limit: float,
    is_sought: BoolArray,
    is_both: BoolArray,
    most_halved: int,
) -> FloatArray:
    """(K,): the bounds of leaves with charts, as of ``joined_bounds``. most_halved: how many times bicubic patches
    are."""
    leaves, found, beside = np.arange(len(is_both)), *np.zeros((2, len(is_both)))
    # Corners of pieces at an extraordinary vertex are counted from this vertex on.
    turns = (pieces.unit_mesh.corner_edges.reshape(-1, 4) == pieces.sides[leaves, :1]).argmax(axis=1)
    turned = (turns[:, None] + np.arange(4)) % 4
    images = charts.places[leaves[:, None], (turned - is_turned[:, None]) % 4]
    cells = Cells(leaves, leaves, CORNERS_OF_LEAF[turned], images, np.zeros_like(leaves))
    for times in range(QUARTERED + 1):
        bounds = _bounds(pieces, charts, cells, limit)
        # Of numbers beyond double precision nothing is proved.
        is_far = ~(bounds <= limit)
        is_lost = ~np.isfinite(bounds) | (is_far & ((cells.halved >= most_halved) | (times == QUARTERED)))
        bounds[is_far] = np.where(is_lost, np.inf, 0.0)[is_far]
        reached = opened.reached(charts, cells.leaves, cells.images, pieces.sides[cells.pieces])
        at, place = np.nonzero(reached != NONE)
        np.maximum.at(found, cells.leaves, bounds)
        np.maximum.at(beside, reached[at, place], bounds[at])
        is_live = is_both & np.isfinite(np.maximum(found, beside))
        is_wanted = (is_sought & np.isfinite(found))[cells.leaves]
        is_wanted[at[is_live[reached[at, place]]]] = True
        cells = _quartered(pieces, charts, opened, is_live, cells.at(is_far & ~is_lost & is_wanted))
        if not len(cells.pieces):
            break
    found = np.where(is_both, np.maximum(found, beside), found)
    return np.where(is_sought, found, np.inf)


def _bounds(pieces: BezierPieces, charts: Charts, cells: Cells, limit: float) -> FloatArray:
    """(N,): bounds of the distance between the points of cells and their images; infinite if a corner is farther than
    the limit from its image."""
    found = np.empty(len(cells.pieces))
    for some in chunks(len(found), AT_ONCE):
        which, images, leaves = cells.pieces[some], cells.images[some], cells.leaves[some]
        apart = pieces.coefficients[which] - bilinear_pieces(charts.points(images, leaves))
        squares = (apart * apart).sum(axis=1)
        found[some] = np.sqrt(squares.max(axis=1)) + pieces.excess[which]
        found[some][squares[:, CORNERS].max(axis=1) > limit * limit] = np.inf
        # Bilinear points over several triangles are off the triangles.
        found[some] += charts.bends(images, leaves)
    return found


def _quartered(pieces: BezierPieces, charts: Charts, opened: OpenSides, is_live: BoolArray, cells: Cells) -> Cells:
    """The quarters of cells. is_live: (K,) bool, leaves that may still have bounds both ways."""
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
    images[:, 4:8] = _images_of_sides(pieces, charts, opened, is_live, cells, points[:, 4:8], middles)
    images[:, 8] = charts.nearest(points[:, 8], cells.leaves)
    return Cells(
        children.ravel(),
        np.repeat(cells.leaves, 4),
        corners[rows, nine].reshape(-1, 4),
        images[rows, nine].reshape(-1, 4, 2),
        np.repeat(cells.halved + is_patch, 4),
    )


def _images_of_sides(
    pieces: BezierPieces,
    charts: Charts,
    opened: OpenSides,
    is_live: BoolArray,
    cells: Cells,
    points: FloatArray,
    places: IndexArray,
) -> FloatArray:
    """(N, 4, 2): the images of the middles of cells' sides. points: (N, 4, 3), of the surface there; places: (N, 4), of
    the middles in the leaf. is_live: as of ``_quartered``."""
    start, end = cells.images, cells.images[:, FOLLOWING]
    images, points = ((start + end) / 2).reshape(-1, 2), points.reshape(-1, 3)
    leaves, edges = np.repeat(cells.leaves, 4), pieces.sides[cells.pieces].ravel()
    which = np.where(edges == NONE, NONE, opened.of_edges[edges])
    on_open, inside = np.flatnonzero(which != NONE), np.flatnonzero(edges == NONE)
    # Sides between two of the cells are bent; beyond others the image is the one of an undivided cell. Both cells take
    # the same place, as the nearest point can change at once from one triangle to the other.
    keys = leaves[inside] * PLACES**2 + places.ravel()[inside]
    first, where, times = np.unique(keys, return_index=True, return_inverse=True, return_counts=True)[1:]
    bent = inside[first[times == 2]]
    nearest = np.empty((len(first), 2))
    nearest[times == 2] = charts.nearest(points[bent], leaves[bent])
    is_bent = times[where] == 2
    images[inside[is_bent]] = nearest[where[is_bent]]
    # An open side is bent for both of its leaves, or for each alone if neither has a bound both ways.
    own, place = which[on_open], places.ravel()[on_open]
    way = (leaves[on_open] != opened.leaves[own, 0]).astype(np.intp)
    keys = own * PLACES + opened.steps(own, way, place)
    first, where, times = np.unique(keys, return_index=True, return_inverse=True, return_counts=True)[1:]
    is_bent = (times == 2) | ~is_live[opened.leaves[own[first]]].any(axis=1)
    nearest = np.empty((len(first), 2))
    nearest[is_bent] = opened.kites.nearest(points[on_open[first[is_bent]]], own[first[is_bent]])
    bent = np.flatnonzero(is_bent[where])
    images[on_open[bent]] = opened.images(own[bent], way[bent], nearest[where[bent]])
    # Any other side of the leaf is mapped to itself.
    images = images.reshape(-1, 4, 2)
    at, side = np.divmod(np.flatnonzero((edges != NONE) & (which == NONE)), 4)
    ends = charts.points(cells.images, cells.leaves)
    begin = ends[at, side]
    along = ends[:, FOLLOWING][at, side] - begin
    share = dot_products(points.reshape(-1, 4, 3)[at, side] - begin, along)
    share /= np.maximum(squared_norms(along), np.finfo(float).tiny)
    images[at, side] = start[at, side] + np.clip(share, 0.0, 1.0)[:, None] * (end - start)[at, side]
    return images
