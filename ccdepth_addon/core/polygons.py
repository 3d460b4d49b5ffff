# SPDX-License-Identifier: GPL-3.0-or-later
"""Polygons that are drawn as a whole, as Blender triangulates them (docs/adaptive.md, Polygons).

A polygon with one loop of vertices is compared with the fan of bilinear quads between its vertices and its centroid:
seen along the polygon's normal, both cover the same region, each once, if the quads of the fan are convex there and go
round the centroid once. Both then stay between the lowest and the highest vertex, whichever triangles are drawn, so no
point of the one is farther from the other than that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .mesh import FloatArray, IndexArray
from .norms import cross_products
from .templates import templates

# How far, in radians, the angles around the centroid may be from a full turn by rounding.
ANGLE_ROUNDING = 1e-6


def polygon_thickness(facets: FloatArray, bent: NDArray[np.bool_], starts: IndexArray) -> tuple[FloatArray, FloatArray]:
    """(P,) float64: how thick each polygon is along its normal, inf where it is seen as no region; (P, 3) normals.

    facets: (4, C, 3), the fan's quads: corner, middle of the side after it, centroid, middle of the side before. bent:
    (C,) whether the polygon has a vertex of its own at the middle after each corner; starts: (P,) its first corner.
    """
    sizes = np.diff(starts, append=facets.shape[1])
    corners, middles, centroids, _ = facets
    # The normal of Newell: half the cross products of consecutive vertices, seen from the centroid.
    spokes, between = corners - centroids, middles - centroids
    following = facets[0][_next(starts, sizes)] - centroids
    doubled = cross_products(spokes, between) + cross_products(between, following)
    normals = np.add.reduceat(doubled, starts)
    lengths = np.linalg.norm(normals, axis=1)
    flat = lengths > 0
    normals /= np.where(flat, lengths, 1.0)[:, None]
    of_corner = np.repeat(normals, sizes, axis=0)

    heights = np.einsum("ij,ij->i", spokes, of_corner)
    middle_heights = np.where(bent, np.einsum("ij,ij->i", between, of_corner), heights)
    highest = np.maximum.reduceat(np.maximum(heights, middle_heights), starts)
    lowest = np.minimum.reduceat(np.minimum(heights, middle_heights), starts)
    convex = np.logical_and.reduceat(_convex(facets, of_corner), starts)
    region = flat & convex & _once_around(facets, of_corner, starts)
    region[sizes == 3] &= _inner_triangles_turn_left(facets, bent, normals[sizes == 3], starts[sizes == 3])
    # A plain triangle is its own plane.
    thickness = np.where((sizes == 3) & ~np.logical_or.reduceat(bent, starts), 0.0, highest - lowest)
    return np.where(region, thickness, np.inf), normals


def thickness_of_quads(points: FloatArray, pattern: int, alternative: int) -> FloatArray:
    """(P,) float64: how thick quads with split sides are as polygons; inf where they or a template are no region.

    points: (8 or more, P, 3), in the order of ``templates.QUAD_POINTS``. As long as the triangles of a template cover
    the same region once, the polygon is no farther from them than it is thick.
    """
    split_sides = np.array([pattern >> side & 1 for side in range(4)], dtype=bool)
    corners = points[:4].swapaxes(0, 1)
    chords = (corners + np.roll(corners, -1, axis=1)) / 2
    middles = np.where(split_sides[:, None], points[4:8].swapaxes(0, 1), chords)
    centres = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    facets = np.stack([corners, middles, centres, np.roll(middles, 1, axis=1)]).reshape(4, -1, 3)
    bent = np.tile(split_sides, len(corners))
    thickness, normals = polygon_thickness(facets, bent, 4 * np.arange(len(corners)))
    for triangle in templates(pattern)[alternative]:
        thickness[~turns_left(points[list(triangle)], normals)] = np.inf
    return thickness


def turns_left(points: FloatArray, normals: FloatArray) -> NDArray[np.bool_]:
    """(P,) whether triangles (3, P, 3) go round counter-clockwise, seen along normals (P, 3)."""
    a, b, c = points
    return np.einsum("ij,ij->i", cross_products(b - a, c - a), normals) > 0


def _inner_triangles_turn_left(
    facets: FloatArray, bent: NDArray[np.bool_], normals: FloatArray, starts: IndexArray
) -> NDArray[np.bool_]:
    """For triangles with two bent sides, whether their middles and the corner that touches one of them turn left.

    The convex quads of the fan see to all other triangles of ``templates.triangle_template``.
    """
    fine = np.ones(len(starts), dtype=bool)
    for side in range(3):
        after, before = starts + (side + 1) % 3, starts + (side + 2) % 3
        both = np.flatnonzero(bent[starts + side] & bent[after] & ~bent[before])
        middles = facets[1, starts[both] + side], facets[1, after[both]]
        fine[both] &= turns_left(np.stack([*middles, facets[0, before[both]]]), normals[both])
    return fine


def _next(starts: IndexArray, sizes: IndexArray) -> IndexArray:
    following = np.arange(1, sizes.sum() + 1)
    following[starts + sizes - 1] = starts
    return following


def _convex(facets: FloatArray, normals: FloatArray) -> NDArray[np.bool_]:
    """(C,) whether each quad of the fan turns left at every corner, or goes straight on, seen along the normal."""
    sides = np.roll(facets, -1, axis=0) - facets
    turns = np.einsum("kij,ij->ki", cross_products(np.roll(sides, 1, axis=0), sides), normals)
    return np.all(turns > 0, axis=0)


def _once_around(facets: FloatArray, normals: FloatArray, starts: IndexArray) -> NDArray[np.bool_]:
    """(P,) whether the quads' angles at the centroid are a full turn together."""
    first, second = facets[3] - facets[2], facets[1] - facets[2]
    sines = np.einsum("ij,ij->i", cross_products(first, second), normals)
    # Cosines of what is seen along the normal: without the parts along it.
    heights = np.einsum("ij,ij->i", first, normals) * np.einsum("ij,ij->i", second, normals)
    cosines = np.einsum("ij,ij->i", first, second) - heights
    turns = np.add.reduceat(np.arctan2(sines, cosines), starts)
    return np.abs(turns - 2 * np.pi) < ANGLE_ROUNDING
