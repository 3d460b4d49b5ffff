# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals and heights of a template's triangles, and vectors taken apart along and across normals."""

from __future__ import annotations

import numpy as np

from ...arrays.types import FloatArray
from ...arrays.vectors import cross_products, dot_products, squared_norms
from ..templates import Template


def triangle_normals(points: FloatArray, template: Template) -> FloatArray:
    """(T, P, 3): unit normals of the triangles over quads' points (8 or more, P, 3); zero where there is no area."""
    return normals_of(np.stack([points[list(triangle)] for triangle in template]))


def normals_of(triangles: FloatArray) -> FloatArray:
    """(T, P, 3): unit normals of triangles with vertices (T, 3, P, 3); zero where there is no area."""
    a, b, c = triangles.swapaxes(0, 1)
    crosses = cross_products(b - a, c - a)
    lengths = np.sqrt(squared_norms(crosses))[..., None]
    return crosses / np.where(lengths > 0, lengths, 1.0)


def least_heights(points: FloatArray, template: Template) -> FloatArray:
    """(P,): the least height of the triangles over quads' points (8 or more, P, 3)."""
    heights = np.full(points.shape[1], np.inf)
    for triangle in template:
        corners = points[list(triangle)]
        areas = np.sqrt(squared_norms(cross_products(corners[1] - corners[0], corners[2] - corners[0])))
        longest = np.sqrt(squared_norms(np.roll(corners, -1, axis=0) - corners)).max(axis=0)
        heights = np.minimum(heights, areas / np.where(longest > 0, longest, 1.0))
    return heights


def along_and_across(vectors: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(R, P) twice: the lengths of vectors (R, P, 3) along unit normals (P, 3) and across them."""
    along = np.abs(dot_products(vectors, normals))
    return along, np.sqrt(np.maximum(squared_norms(vectors) - along**2, 0.0))
