# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of flat convex polygons that touch no other face, at all levels at once. docs/distance.md, Polygons alone."""

from __future__ import annotations

import numpy as np

from ..arrays.masks import mask
from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import cross_products, dot_products, lengths, squared_norms, units
from ..bounds.polygon_bounds import ANGLE_ROUNDING
from ..mesh.polygon_mesh import PolygonMesh
from .certified_depth import LEAST_TURN


def lone_polygon_bounds(mesh: PolygonMesh, faces: IndexArray) -> FloatArray:
    """(n,): bounds of the distance, both ways, between what is drawn of faces (n,), ascending, at any level and the
    surface over them; infinite but of convex polygons with more than four corners that touch no other face."""
    found = np.full(len(faces), np.inf)
    chosen = np.flatnonzero(mesh.face_sizes[faces] > 4)
    if not len(chosen):
        return found
    is_chosen = mask(mesh.face_count, faces[chosen])
    own, sizes = np.flatnonzero(is_chosen[mesh.corner_faces]), mesh.face_sizes[faces[chosen]]
    starts, vertices = np.cumsum(sizes) - sizes, mesh.corner_vertices[own]
    points, before, following = (
        mesh.positions[mesh.corner_vertices[some]] for some in (own, mesh.previous_corner[own], mesh.next_corner[own])
    )
    sides, last = following - points, points - before
    spokes = points - np.repeat(np.add.reduceat(points, starts) / sizes[:, None], sizes, axis=0)
    normals = np.repeat(units(np.add.reduceat(cross_products(spokes, sides), starts)), sizes, axis=0)
    heights, turns = dot_products(spokes, normals), dot_products(cross_products(last, sides), normals)
    level = dot_products(last, sides) - dot_products(last, normals) * dot_products(sides, normals)
    longest = np.repeat(np.maximum.reduceat(squared_norms(sides), starts), sizes)
    is_once_around = np.abs(np.add.reduceat(np.arctan2(turns, level), starts) - 2 * np.pi) < ANGLE_ROUNDING
    sharpness = mesh.vertex_sharpness[vertices]
    fits = (mesh.vertex_face_counts[vertices] == 1) & ((sharpness == 0) | np.isinf(sharpness))
    fits &= turns > LEAST_TURN * longest
    # The curve of the border, and the sides of every level, are within a sixth of the second difference of the border.
    off = np.where(np.isinf(sharpness), 0.0, lengths(sides - last) / 6)
    thickness = np.maximum.reduceat(heights, starts) - np.minimum.reduceat(heights, starts)
    bounds = np.hypot(2 * np.maximum.reduceat(off, starts), thickness)
    found[chosen] = np.where(np.logical_and.reduceat(fits, starts) & is_once_around, bounds, np.inf)
    return found
