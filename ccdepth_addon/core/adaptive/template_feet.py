# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of leaves by feet: of the distance between the triangles of a bicubic leaf and points of the surface nearby.

The surface has to be smooth and regular in the leaf and in all leaves that touch the leaf; sizes may differ.
docs/distance.md, Leaves of several sizes, has the notation.
"""

from __future__ import annotations

import numpy as np

from ..arrays.chunks import FEW_AT_ONCE, index_chunks
from ..arrays.matrix_products import matrix_product
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import lengths
from ..distance.foot_bounds import MIDDLE, ROUNDING, Frame, along_axes, along_normals, foot_distances
from ..surface.bicubic import NET_TO_BERNSTEIN
from .plan import Plan
from .rings import largest_around, with_rings
from .template_rows import bounds_over_parts
from .templates import template_numbers

BERNSTEIN_TO_NET = np.linalg.inv(NET_TO_BERNSTEIN)

# Leaves below this part of their coordinates have no feet: coordinates have relative errors of at most 2⁻⁴⁸, and second
# differences of larger leaves have relative errors below ROUNDING.
LEAST_SIZE = 2.0**-13


def bounds_by_feet(plan: Plan, leaves: IndexArray) -> FloatArray:
    """(n,): bounds of the distance between the triangles of leaves, ascending, and the surface; infinite beyond the
    least limit around, and without feet."""
    found, limits = np.full(len(leaves), np.inf), plan.limits_around(leaves, 1)
    which = np.flatnonzero(plan.surfaces.are_smooth(leaves))
    curvature, speed = _constants_around(plan, leaves[which])
    which, curvature, speed = (each[np.isfinite(curvature)] for each in (which, curvature, speed))
    for some in index_chunks(np.arange(len(which)), FEW_AT_ONCE):
        own = leaves[which[some]]
        drawn, coefficients = plan.approximation(own), plan.surfaces.coefficients(own)
        numbers = template_numbers(drawn.patterns, drawn.alternatives)
        found[which[some]] = template_feet(coefficients, numbers, curvature[some], speed[some], limits[which[some]])
        plan.report()
    return np.where(found <= limits, found, np.inf)


def template_feet(
    coefficients: FloatArray, numbers: IndexArray, curvature: FloatArray, speed: FloatArray, limits: FloatArray
) -> FloatArray:
    """(P,): B of bicubic leaves with coefficients (16, P, 3) and template numbers (P,), as tight as a comparison with
    the limits (P,) needs. curvature, speed: (P,), κ and α around each leaf, α in units of m per length."""
    nets, _ = _nets(coefficients)
    frame, rounding = Frame.of(nets), ROUNDING * np.abs(nets).max(axis=(0, 1))

    def distances(off: FloatArray, own: IndexArray) -> FloatArray:
        components = np.abs(along_axes(frame.axes[:, :, own], off.swapaxes(1, 2)))
        heights = along_normals(components, frame.tilts[:, own])
        along = heights.max(axis=0) * (1 + ROUNDING) + rounding[own] * (1 + frame.tilt[own])
        reach = lengths(off).max(axis=0) * (1 + ROUNDING) + rounding[own]
        return foot_distances(along, reach, curvature[own], speed[own], 1.0)

    return np.where(frame.is_known, bounds_over_parts(coefficients, numbers, limits, distances), np.inf)


def _constants_around(plan: Plan, leaves: IndexArray) -> tuple[FloatArray, FloatArray]:
    """(n,) each: κ, and α in units of the shortest side per length, of leaves, ascending, with all leaves that touch
    them."""
    tree, near = plan.tree, with_rings(plan.tree, leaves, 1)
    curvature, speed = np.full((2, len(near)), np.inf)
    sizes = np.ldexp(1.0, -tree.levels[near].T.astype(np.int32))
    for some in index_chunks(np.flatnonzero(plan.surfaces.are_smooth(near)), FEW_AT_ONCE):
        nets, are_large = _nets(plan.surfaces.coefficients(near[some]))
        frame = Frame.of(nets)
        own = np.flatnonzero(frame.is_known & are_large)
        curvature[some[own]] = frame.curvature[own] * (1 + ROUNDING)
        speed[some[own]] = (frame.speeds * sizes[:, some]).max(axis=0)[own] * (1 + ROUNDING)
        plan.report()
    own = np.searchsorted(near, leaves)
    largest = [largest_around(tree, near, each)[own] for each in (curvature, speed, 1 / sizes.min(axis=0))]
    return largest[0], largest[1] * largest[2]


def _nets(coefficients: FloatArray) -> tuple[FloatArray, BoolArray]:
    """(16, 3, n): the nets of bicubic leaves with coefficients (16, n, 3), relative to their middles; and (n,) bool:
    whether leaves are large enough for their coordinates."""
    vectors = coefficients.swapaxes(1, 2)
    # Differences come first: differences of near values are exact.
    local = vectors - vectors[:1]
    largest, size = (np.abs(each).max(axis=(0, 1)) for each in (vectors, local))
    nets = matrix_product(BERNSTEIN_TO_NET, local)
    nets -= matrix_product(MIDDLE[:1], nets)
    are_large: BoolArray = size >= LEAST_SIZE * largest
    return nets, are_large
