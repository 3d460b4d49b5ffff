# SPDX-License-Identifier: GPL-3.0-or-later
"""Error bounds of polygons, as Blender triangulates them (docs/adaptive.md, Polygons).

A polygon with one loop of vertices is compared with the fan of bilinear quads between its vertices and its centroid.
Seen along some direction, the fan covers a region once if its quads are convex there and go round the centroid once.

- Seen along the polygon's normal, all possible triangles between the vertices cover the region as well, and lie over
  its convex hull, between the lowest and the highest vertex. So the polygon's thickness and the depth of its dents,
  both together, bound the distance.
- Seen along the line that Blender looks along, the drawn triangles cover the region once. So the thickness of the
  polygon along such a line bounds the distance.

Blender looks along the polygon's normal in the object's space. ``axes``, (3, 3) float64, has the axes of that space as
its columns, in the coordinates of the proofs.
"""

from __future__ import annotations

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import cross_products, squared_norms, units

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
    facets: FloatArray, bent: BoolArray, starts: IndexArray, axes: FloatArray | None, largest: float = 0.0
) -> FloatArray:
    """(P,) float64: upper bounds of the distance between a polygon of more than four vertices, as Blender
    triangulates it, and its fan; inf where neither proof holds.

    facets: (4, C, 3), the fan's quads: corner, middle of the side after it, centroid, middle of the side before. bent:
    (C,) whether the polygon has a vertex of its own at the middle after each corner; starts: (P,) its first corner.
    axes: None uses the first proof alone. largest: the largest coordinate in the space of the axes.
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
    thickness = highest - lowest

    is_region = _is_region(facets, starts, normals)
    found = np.where(is_region, np.hypot(thickness, _dents(facets, following, bent, of_corner, starts)), np.inf)
    if axes is not None and np.linalg.cond(axes) <= MOST_UNEVEN:
        lines = units(normals @ axes @ axes.T)
        turns = line_turns(facets, starts, axes, largest)
        cosines = np.einsum("ij,ij->i", normals, lines) - turns
        fine = (cosines > 0) & _is_region(facets, starts, lines, turns)
        reaches = np.sqrt(np.maximum.reduceat(np.maximum(squared_norms(spokes), squared_norms(between)), starts))
        thickest = thickness + HEIGHT_ROUNDING * reaches
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


def _is_region(
    facets: FloatArray, starts: IndexArray, directions: FloatArray, turns: FloatArray | None = None
) -> BoolArray:
    """(P,) whether fans cover a region once, seen along directions (P, 3), and along all directions within the turns
    (P,) of these."""
    sizes = np.diff(starts, append=facets.shape[1])
    turns = np.zeros(len(starts)) if turns is None else turns
    of_corner = np.repeat(directions, sizes, axis=0)
    are_convex = np.logical_and.reduceat(_convex(facets, of_corner, np.repeat(turns, sizes)), starts)
    return are_convex & _once_around(facets, of_corner, starts)


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
    crosses = cross_products(np.roll(sides, 1, axis=0), sides)
    turns_left = np.einsum("...ij,ij->...i", crosses, directions) > turns * np.sqrt(squared_norms(crosses))
    return np.all(turns_left, axis=0)


def _once_around(facets: FloatArray, directions: FloatArray, starts: IndexArray) -> BoolArray:
    """(P,) whether the quads' angles at the centroid are a full turn together."""
    first, second = facets[3] - facets[2], facets[1] - facets[2]
    sines = np.einsum("ij,ij->i", cross_products(first, second), directions)
    # Cosines of the projections along the direction.
    heights = np.einsum("ij,ij->i", first, directions) * np.einsum("ij,ij->i", second, directions)
    cosines = np.einsum("ij,ij->i", first, second) - heights
    turns = np.add.reduceat(np.arctan2(sines, cosines), starts)
    return np.abs(turns - 2 * np.pi) < ANGLE_ROUNDING
