# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances of single regular leaves by feet on the surface, from the leaf's own triangles.

Where ``foot_bounds`` uses second derivatives, this module bounds T - S itself, in Bernstein form over the part of each
quarter of the leaf over one triangle, in the frame of the quarter's middle. docs/distance.md, Single leaves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.types import FloatArray
from ..bounds.norm_bounds import Vertices
from ..surface.bicubic import CORNERS, GREVILLE, NET_CORNERS, NET_TO_BERNSTEIN, SPLINE_HALVES
from ..surface.squares import SQUARE
from ..surface.triangle_coefficients import coefficients_over
from .foot_bounds import MIDDLE, ROUNDING, Frame, along_axes, along_normals, foot_distances

# The corners of the leaf's two triangles.
TRIANGLES = [0, 1, 2], [0, 2, 3]

# The coefficients of degree 6 over a triangle that are points of the surface.
ENDS = [0, 21, 27]


@dataclass(frozen=True)
class _Quarter:
    """Functionals of a leaf's net for a quarter. net: (16, 16), the quarter's net. errors: (R, 16), the Bernstein
    coefficients of T - S over each triangle there; the first ``ends`` of them are values."""

    net: FloatArray
    errors: FloatArray
    ends: int


@cache
def _quarters(vertices: Vertices) -> list[_Quarter]:
    """The quarters of a leaf drawn with the diagonal from corner 0 to 2."""
    drawn = np.eye(16)[NET_CORNERS] if vertices is Vertices.CONTROL else NET_TO_BERNSTEIN[CORNERS]
    found = []
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        net = np.kron(SPLINE_HALVES[i], SPLINE_HALVES[j])
        ends, others = [], []
        for corners in TRIANGLES if i == j else TRIANGLES[j : j + 1]:
            rows, values = (coefficients_over(SQUARE[corners]), ENDS) if i == j else (np.eye(16), list(CORNERS))
            places = np.column_stack([([i, j] + rows @ GREVILLE) / 2, np.ones(len(rows))])
            weights = places @ np.linalg.inv(np.column_stack([SQUARE[corners], np.ones(3)]))
            errors: FloatArray = weights @ drawn[corners] - rows @ NET_TO_BERNSTEIN @ net
            ends.append(errors[values])
            others.append(np.delete(errors, values, axis=0))
        found.append(_Quarter(net, np.concatenate(ends + others), sum(map(len, ends))))
    return found


def leaf_feet(
    nets: FloatArray, vertices: Vertices, curvature: FloatArray, speed: FloatArray, longest: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(P,) each, for nets (16, 3, P) of regular leaves drawn with the diagonal from corner 0 to 2: B, as of
    ``FootBounds.at_level``, with feet up to 1 from equal parameters; B with feet up to ``longest``; and an estimate of
    the largest distance at points of the triangles, without proof. curvature, speed: (P,), κ and α of all of the
    surface within reach of feet.
    """
    nets = nets - matrix_product(MIDDLE[:1], nets)
    along, reach, reached = np.zeros((3, nets.shape[2]))
    rounding = ROUNDING * np.abs(nets).max(axis=(0, 1))
    for quarter in _quarters(vertices):
        frame = Frame.of(matrix_product(quarter.net, nets))
        errors = matrix_product(quarter.errors, nets)
        squares = (errors * errors).sum(axis=1)
        components = np.abs(along_axes(frame.axes, errors))
        np.maximum(reached, components[: quarter.ends, 0].max(axis=0), out=reached)
        highest = along_normals(components, frame.tilts).max(axis=0) + rounding * (1 + frame.tilt)
        np.maximum(along, np.where(frame.is_known, highest, np.inf), out=along)
        np.maximum(reach, squares.max(axis=0), out=reach)
    along, reach = along * (1 + ROUNDING), np.sqrt(reach) * (1 + ROUNDING) + rounding
    bounds, on_leaves = (foot_distances(along, reach, curvature, speed, each) for each in (1.0, longest))
    return bounds, on_leaves, reached
