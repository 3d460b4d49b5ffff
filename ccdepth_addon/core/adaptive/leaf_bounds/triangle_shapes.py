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


def least_heights(triangles: FloatArray) -> FloatArray:
    """(P,): the least height of triangles with vertices (T, 3, P, 3)."""
    a, b, c = triangles.swapaxes(0, 1)
    areas = np.sqrt(squared_norms(cross_products(b - a, c - a)))
    longest = np.sqrt(np.max([squared_norms(each) for each in (b - a, c - b, a - c)], axis=0))
    return (areas / np.where(longest > 0, longest, 1.0)).min(axis=0)


def along_and_across(vectors: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(R, P) twice: the lengths of vectors (R, P, 3) along unit normals (P, 3) and across them."""
    along = np.abs(dot_products(vectors, normals))
    return along, np.sqrt(np.maximum(squared_norms(vectors) - along**2, 0.0))
