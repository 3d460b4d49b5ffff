# SPDX-License-Identifier: GPL-3.0-or-later
"""Error bounds of polygons, as Blender triangulates them (docs/adaptive.md, Polygons).

A polygon with one loop of vertices is compared with the fan of bilinear quads between its vertices and its centroid, or
with the triangles of a template. Seen along some direction, these cover a region once if the quads of the fan are
convex there and go round the centroid once, and all triangles of the template turn left.

- Seen along the polygon's normal, all possible triangles between the vertices cover the region as well, and lie over
  its convex hull, between the lowest and the highest vertex. So the polygon's thickness and the depth of its dents,
  both together, bound the distance.
- Seen along the line that Blender looks along, the drawn triangles cover the region once. So the thickness of the
  polygon along such a line bounds the distance.

Blender looks along the polygon's normal in the object's space. ``axes``, (3, 3) float64, has the axes of that space as
its columns, in the coordinates of the proofs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import cross_products, squared_norms, units
from ..mesh.folded_quads import is_folded
from .templates import templates

# Rounding of a thickness, in parts of the vertices' distance from the centroid: 16 roundings or less. This rounding
# matters for a thickness divided by a small cosine.
HEIGHT_ROUNDING = 2.0**-48

# Rounding of the sum of angles around the centroid, in radians.
ANGLE_ROUNDING = 1e-6


# Blender adds differences times sums of coordinates, both rounded, in single precision: each component of the sum over
# the n vertices is off by (n + 4) roundings of twice the largest coordinate times the way around, at most, and all
# three by twice as much. Vertices and unit vectors are rounded as well.
SINGLE_ROUNDING, MORE_ROUNDINGS = 4 * 2.0**-24, 16

# The largest ratio of stretches between the spaces: beyond, single precision might decide the line along which Blender
# looks at a polygon.
MOST_UNEVEN = 1e4


def polygon_thickness(
    facets: FloatArray,
    bent: BoolArray,
    starts: IndexArray,
    axes: FloatArray,
    triangles: Sequence[FloatArray] = (),
    largest: float = 0.0,
) -> FloatArray:
    """(P,) float64: upper bounds of the distance between a polygon, as Blender triangulates it, and its fan or
    template; inf where neither proof holds.

    facets: (4, C, 3), the fan's quads: corner, middle of the side after it, centroid, middle of the side before. bent:
    (C,) whether the polygon has a vertex of its own at the middle after each corner; starts: (P,) its first corner.
    triangles: (3, P, 3) each, those of a template. largest: the largest coordinate in the space of the axes.
    """
    sizes = np.diff(starts, append=facets.shape[1])
    corners, middles, centroids, _ = facets
    spokes, between = corners - centroids, middles - centroids
    following = corners[_next(starts, sizes)]
    normals = fan_normals(facets, starts)
    of_corner = np.repeat(normals, sizes, axis=0)

    heights = np.einsum("ij,ij->i", spokes, of_corner)
    middle_heights = np.where(bent, np.einsum("ij,ij->i", between, of_corner), heights)
    highest = np.maximum.reduceat(np.maximum(heights, middle_heights), starts)
    lowest = np.minimum.reduceat(np.minimum(heights, middle_heights), starts)
    # A plain triangle is its own plane.
    is_plain = (sizes == 3) & ~np.logical_or.reduceat(bent, starts)
    thickness = np.where(is_plain, 0.0, highest - lowest)

    is_region = _is_region(facets, bent, starts, normals, triangles)
    found = np.where(is_region, np.hypot(thickness, _dents(facets, following, bent, of_corner, starts)), np.inf)
    if np.linalg.cond(axes) <= MOST_UNEVEN:
        lines = units(normals @ axes @ axes.T)
        turns = line_turns(facets, starts, axes, largest)
        cosines = np.einsum("ij,ij->i", normals, lines) - turns
        fine = (cosines > 0) & _is_region(facets, bent, starts, lines, triangles, turns)
        fine[sizes == 3] &= ~_is_folded_from_middle(facets, bent, starts[sizes == 3], axes)
        reaches = np.sqrt(np.maximum.reduceat(np.maximum(squared_norms(spokes), squared_norms(between)), starts))
        thickest = np.where(is_plain, 0.0, thickness + HEIGHT_ROUNDING * reaches)
        found = np.where(fine, np.minimum(found, thickest / np.where(fine, cosines, 1.0)), found)
    return found


def fan_normals(facets: FloatArray, starts: IndexArray) -> FloatArray:
    """(P, 3): the unit normals of Newell of polygons by their fans. facets, starts: as of ``polygon_thickness``."""
    return units(_newell_normals(facets, starts))


def _newell_normals(facets: FloatArray, starts: IndexArray) -> FloatArray:
    """(P, 3): the sums of the cross products of consecutive vertices, seen from the centroid."""
    corners, middles, centroids, _ = facets
    following = corners[_next(starts, np.diff(starts, append=facets.shape[1]))]
    between = middles - centroids
    doubled = cross_products(corners - centroids, between) + cross_products(between, following - centroids)
    found: FloatArray = np.add.reduceat(doubled, starts)
    return found


def line_turns(facets: FloatArray, starts: IndexArray, axes: FloatArray, largest: float) -> FloatArray:
    """(P,): bounds of the distance between Blender's unit vectors along its lines and the computed unit vectors, as
    Blender's sums are in single precision (docs/adaptive.md, Polygons). Arguments: as of ``polygon_thickness``."""
    corners, middles, _, _ = facets
    sizes = np.diff(starts, append=facets.shape[1])
    inverse = np.linalg.inv(axes)
    halves = (middles - corners, corners[_next(starts, sizes)] - middles)
    around = np.add.reduceat(sum(np.sqrt(squared_norms(half @ inverse.T)) for half in halves), starts)
    normals = _newell_normals(facets, starts)
    seen = normals @ axes
    doubled = np.sqrt(squared_norms(seen)) / abs(np.linalg.det(axes))
    off = SINGLE_ROUNDING * (2 * sizes + MORE_ROUNDINGS) * largest * around
    # The error of a unit vector, taken along the axes, and then as a unit vector again.
    with np.errstate(divide="ignore", invalid="ignore"):
        stretches = np.sqrt(squared_norms(seen @ axes.T) / squared_norms(seen))
        found = 2 * np.linalg.norm(axes, 2) * (off / doubled) / stretches
    # Unit vectors are no farther from each other than 2, which is too far for anything.
    return np.where(np.isfinite(found), np.minimum(found, 2.0), 2.0)


def thickness_of_quads(
    points: FloatArray, pattern: int, alternative: int, axes: FloatArray, largest: float = 0.0
) -> FloatArray:
    """(P,) float64: upper bounds of the distance between quads with split sides, as polygons, and the triangles of a
    template; inf where there is no proof.

    points: (8 or more, P, 3), in the order of ``templates.QUAD_POINTS``.
    """
    split_sides = np.array([pattern >> side & 1 for side in range(4)], dtype=bool)
    corners = points[:4].swapaxes(0, 1)
    chords = (corners + np.roll(corners, -1, axis=1)) / 2
    middles = np.where(split_sides[:, None], points[4:8].swapaxes(0, 1), chords)
    centres = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    facets = np.stack([corners, middles, centres, np.roll(middles, 1, axis=1)]).reshape(4, -1, 3)
    bent = np.tile(split_sides, len(corners))
    triangles = [points[list(triangle)] for triangle in templates(pattern)[alternative]]
    return polygon_thickness(facets, bent, 4 * np.arange(len(corners)), axes, triangles, largest)


def _is_region(
    facets: FloatArray,
    bent: BoolArray,
    starts: IndexArray,
    directions: FloatArray,
    triangles: Sequence[FloatArray],
    turns: FloatArray | None = None,
) -> BoolArray:
    """(P,) whether fans and templates cover a region once, seen along directions (P, 3), and along all directions
    within the turns (P,) of these."""
    sizes = np.diff(starts, append=facets.shape[1])
    turns = np.zeros(len(starts)) if turns is None else turns
    of_corner, is_three = np.repeat(directions, sizes, axis=0), sizes == 3
    found = np.logical_and.reduceat(_convex(facets, of_corner, np.repeat(turns, sizes)), starts)
    found &= _once_around(facets, of_corner, starts)
    found[is_three] &= _inner_triangles_turn_left(facets, bent, directions[is_three], starts[is_three], turns[is_three])
    for triangle in triangles:
        found &= _turns_left(triangle, directions, turns)
    return found


def _are_along(crosses: FloatArray, directions: FloatArray, turns: FloatArray) -> BoolArray:
    """(…, P) whether vectors (…, P, 3) are on the side of all directions as near to some (P, 3) as turns (P,)."""
    found: BoolArray = np.einsum("...ij,ij->...i", crosses, directions) > turns * np.sqrt(squared_norms(crosses))
    return found


def _turns_left(points: FloatArray, directions: FloatArray, turns: FloatArray) -> BoolArray:
    """(P,) whether triangles (3, P, 3) go round counter-clockwise, seen along directions; as of ``_is_region``."""
    a, b, c = points
    return _are_along(cross_products(b - a, c - a), directions, turns)


def _inner_triangles_turn_left(
    facets: FloatArray, bent: BoolArray, directions: FloatArray, starts: IndexArray, turns: FloatArray
) -> BoolArray:
    """For triangles with two bent sides, whether their middles and the corner that touches one of them turn left.

    The convex quads of the fan prove all other triangles of ``templates.triangle_template``.
    """
    fine = np.ones(len(starts), dtype=bool)
    for side in range(3):
        after, before = starts + (side + 1) % 3, starts + (side + 2) % 3
        both = np.flatnonzero(bent[starts + side] & bent[after] & ~bent[before])
        middles = facets[1, starts[both] + side], facets[1, after[both]]
        fine[both] &= _turns_left(np.stack([*middles, facets[0, before[both]]]), directions[both], turns[both])
    return fine


def _is_folded_from_middle(facets: FloatArray, bent: BoolArray, starts: IndexArray, axes: FloatArray) -> BoolArray:
    """The triangles with one bent side that Blender might cut along the diagonal apart from its middle."""
    found = np.zeros(len(starts), dtype=bool)
    for side in range(3):
        own, after, before = starts + side, starts + (side + 1) % 3, starts + (side + 2) % 3
        one = np.flatnonzero(bent[own] & ~bent[after] & ~bent[before])
        quads = np.stack([facets[1, own[one]], facets[0, after[one]], facets[0, before[one]], facets[0, own[one]]])
        found[one] = is_folded(quads, axes)
    return found


def _dents(
    facets: FloatArray, following: FloatArray, bent: BoolArray, normals: FloatArray, starts: IndexArray
) -> FloatArray:
    """(P,): distances between polygons and their convex hulls, seen along their normals; inf without a proof.

    A proof needs a polygon that is convex but for dents by vertices at the middles of sides.
    """
    corners, middles, _, _ = facets
    sides, bends = following - corners, middles - corners
    sides -= np.einsum("ij,ij->i", sides, normals)[:, None] * normals
    squares = squared_norms(sides)
    depths = np.einsum("ij,ij->i", cross_products(sides, bends), normals)
    depths /= np.sqrt(np.where(squares > 0, squares, 1.0))
    places = np.einsum("ij,ij->i", sides, bends)
    within = (places >= 0) & (places <= squares) & (squares > 0)
    depths = np.where(bent, np.where(within, depths, np.inf), 0.0)

    # The hull has no dents, and turns left wherever it turns.
    around = np.where((depths > 0)[:, None], (corners + following) / 2, middles)
    ends = np.append(starts[1:], len(corners)) - 1
    before = np.arange(-1, len(corners) - 1)
    before[starts] = ends
    turns = np.einsum("ij,ij->i", cross_products(corners - around[before], around - corners), normals)
    return np.where(np.logical_and.reduceat(turns >= 0, starts), np.maximum.reduceat(depths, starts).clip(0), np.inf)


def _next(starts: IndexArray, sizes: IndexArray) -> IndexArray:
    following = np.arange(1, sizes.sum() + 1)
    following[starts + sizes - 1] = starts
    return following


def _convex(facets: FloatArray, directions: FloatArray, turns: FloatArray) -> BoolArray:
    """(C,) whether each quad of the fan turns left at every corner, seen along its direction; as of ``_is_region``."""
    sides = np.roll(facets, -1, axis=0) - facets
    return np.all(_are_along(cross_products(np.roll(sides, 1, axis=0), sides), directions, turns), axis=0)


def _once_around(facets: FloatArray, directions: FloatArray, starts: IndexArray) -> BoolArray:
    """(P,) whether the quads' angles at the centroid are a full turn together."""
    first, second = facets[3] - facets[2], facets[1] - facets[2]
    sines = np.einsum("ij,ij->i", cross_products(first, second), directions)
    # Cosines of the projections along the direction.
    heights = np.einsum("ij,ij->i", first, directions) * np.einsum("ij,ij->i", second, directions)
    cosines = np.einsum("ij,ij->i", first, second) - heights
    turns = np.add.reduceat(np.arctan2(sines, cosines), starts)
    return np.abs(turns - 2 * np.pi) < ANGLE_ROUNDING
