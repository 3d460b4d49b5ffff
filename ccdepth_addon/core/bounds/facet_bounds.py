# SPDX-License-Identifier: GPL-3.0-or-later
"""Error bounds of the facets of a regular patch, at its own level and at all later ones.

Derivations: docs/methods.md, Certified. With A = S_uu, B = S_vv, R = S_uuvv for knots 1 apart, h = 2⁻ʲ and (s, t) the
parameters in a facet j levels after the patch's own,

    control vertices:  L - S = -(h²/6)(αA* + βB*) + (h⁴/36)αβR*,   α = (1-s)³ + s³,  β likewise in t, both in [1/4, 1]
    limit vertices:    L - S =  (h²/8)(αA* + βB*) + (h⁴/64)αβR*,   α = 4s(1-s),      β likewise in t, both in [0, 1]

where * marks values at other parameters in the same facet, off by at most ``MISMATCH`` of h in units of the weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from ..arrays.tables import Table
from ..arrays.types import FloatArray
from ..arrays.vectors import squared_norms
from ..surface.bicubic import (
    SECOND_DIFFERENCE,
    SPLINE_TO_BERNSTEIN,
    apply,
    bilinear_coefficients,
    elevated,
    largest_norm,
    second_derivatives,
    tensor,
)
from .norm_bounds import Vertices

# h²/6 and h²/8 with h = 1; the weights' least value; the largest |α(u* - u)|/h: s(1-s)|1-2s| is at most √3/18, and 4/3
# of it with limit vertices. Both are rounded up.
SCALE = {Vertices.CONTROL: 1 / 6, Vertices.LIMIT: 1 / 8}
LEAST_WEIGHT = {Vertices.CONTROL: 1 / 4, Vertices.LIMIT: 0.0}
MISMATCH = {Vertices.CONTROL: 0.09623, Vertices.LIMIT: 0.12831}


def facet_error(net: FloatArray, vertices: Vertices) -> FloatArray:
    """(4, 4, P, 3): Bernstein coefficients of S - L over each patch's own facet."""
    return apply(FACET_ERRORS[vertices], net).reshape(net.shape)


def _facet_error(vertices: Vertices) -> FloatArray:
    """(16, 16): the coefficients of ``facet_error`` as functionals of the net, coefficient [i, j] in row 4i + j."""
    points = np.eye(16).reshape(4, 4, 16)
    values = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN).reshape(4, 4, 16)
    corners = points[[1, 2, 2, 1], [1, 1, 2, 2]] if vertices is Vertices.CONTROL else values[[0, 3, 3, 0], [0, 0, 3, 3]]
    return (values - bilinear_coefficients(corners)).reshape(16, 16)


FACET_ERRORS = {vertices: _facet_error(vertices) for vertices in Vertices}
CORNER_ROWS = [0, 3, 12, 15]
SIDE_ROWS = [1, 2, 4, 7, 8, 11, 13, 14]


def control_corner_errors(net: FloatArray) -> FloatArray:
    """(P,) float64: the largest ‖L - S‖ at the corners of the patches' own facets with control vertices."""
    return largest_norm(apply(FACET_ERRORS[Vertices.CONTROL][CORNER_ROWS], net))


def control_facet_bounds(net: FloatArray, at_corners: FloatArray) -> FloatArray:
    """(P,) float64: upper bounds of ‖L - S‖ over the patches' own facets with control vertices.

    at_corners: ``control_corner_errors``. Of the 16 coefficients the four in the middle are 0, and those at the corners
    are values.
    """
    return np.maximum(at_corners, largest_norm(apply(FACET_ERRORS[Vertices.CONTROL][SIDE_ROWS], net)))


@dataclass(frozen=True)
class LaterBounds(Table):
    """Bounds of P patches for the facets of every later level: (P,) float64 each.

    Upper bounds. together: of ‖A + B‖; apart: of the combinations with one weight at its least; curves: of ‖A‖ and ‖B‖;
    twist: of ‖R‖; change: of ‖A_u‖ plus that of ‖B_v‖. With control vertices apart and change are computed only where
    curves exceeds together: elsewhere they cannot help.
    A lower bound. at_corners: the largest ‖A + B‖ at the patch's corners.
    """

    vertices: Vertices
    together: FloatArray
    apart: FloatArray
    curves: FloatArray
    twist: FloatArray
    change: FloatArray
    at_corners: FloatArray

    def after(self, levels: int) -> FloatArray:
        """(P,) float64: upper bounds of ‖L - S‖, a number of levels after the patch's own."""
        h = 0.5**levels
        scale = h * h * SCALE[self.vertices]
        mixed = np.maximum(self.together, self.apart) + MISMATCH[self.vertices] * h * self.change
        if self.vertices is Vertices.CONTROL:
            # The 12 Bernstein coefficients that a facet has are of A, B, or both at its corners.
            mixed = np.minimum(mixed, np.maximum(self.together, self.curves))
        return scale * (mixed + scale * self.twist)

    def least(self, levels: int) -> FloatArray:
        """(P,) float64: lower bounds of ‖L - S‖. At a corner of the patch ‖L - S‖ is ‖A + B - sR‖ times s with control
        vertices.

        With limit vertices the bound is 0, as corners tell nothing; ``sampled_error`` has better bounds.
        """
        if self.vertices is Vertices.LIMIT:
            return np.zeros(len(self.twist))
        scale = 0.25**levels * SCALE[self.vertices]
        return scale * np.maximum(self.at_corners - scale * self.twist, 0.0)


# The functionals of ``LATER_FUNCTIONALS``, part by part.
TOGETHER, CURVES, TWIST, CHANGE_OF_A, CHANGE_OF_B = (
    slice(0, 16),
    slice(16, 32),
    slice(32, 36),
    slice(36, 40),
    slice(40, 44),
)


def later_bounds(net: FloatArray, vertices: Vertices) -> LaterBounds:
    """The bounds for the levels after the nets' own; nets are (4, 4, P, 3)."""
    control = vertices is Vertices.CONTROL
    squares = squared_norms(apply(LATER_FUNCTIONALS[: TWIST.stop if control else None], net))
    together, curves, twist = (np.sqrt(squares[part].max(axis=0)) for part in (TOGETHER, CURVES, TWIST))
    if control:
        apart, change = _apart_and_change(net, curves, together)
    else:
        apart = curves
        change = sum(np.sqrt(squares[part].max(axis=0)) for part in (CHANGE_OF_A, CHANGE_OF_B))
    at_corners = np.sqrt(squares[TOGETHER][CORNER_ROWS].max(axis=0))
    return LaterBounds(vertices, together, apart, curves, twist, change, at_corners)


def _apart_and_change(net: FloatArray, curves: FloatArray, together: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(P,) each, with control vertices; computed only where A and B oppose each other."""
    apart, change = curves.copy(), np.zeros(len(curves))
    opposed = np.flatnonzero(curves > together)
    if len(opposed):
        nets = net.take(opposed, axis=2)
        apart[opposed] = largest_norm(apply(APART_FUNCTIONALS, nets))
        changes = squared_norms(apply(LATER_FUNCTIONALS[TWIST.stop :], nets))
        change[opposed] = np.sqrt(changes[:4].max(axis=0)) + np.sqrt(changes[4:].max(axis=0))
    return apart, change


def _later_functionals() -> FloatArray:
    """(44, 16): Bernstein coefficients of A + B (4 × 4), A (2 × 4) and B (4 × 2), R (2 × 2), A_u (4) and B_v (4)."""
    a, b, twist = _parts()
    together = _bicubic(a, b, 1.0, 1.0)
    changes = np.concatenate([a[1] - a[0], b[:, 1] - b[:, 0]])
    return np.concatenate([together, a.reshape(8, 16), b.reshape(8, 16), twist, changes])


def _apart_functionals(least: float) -> FloatArray:
    """(32, 16): Bernstein coefficients of A + least · B and of least · A + B."""
    a, b, _ = _parts()
    return np.concatenate([_bicubic(a, b, 1.0, least), _bicubic(a, b, least, 1.0)])


def _parts() -> tuple[FloatArray, FloatArray, FloatArray]:
    """(2, 4, 16), (4, 2, 16), (4, 16): the functionals of A, B and R."""
    derivatives = second_derivatives()
    return derivatives[:8].reshape(2, 4, 16), derivatives[8:16].reshape(4, 2, 16), derivatives[16:]


def _bicubic(a: FloatArray, b: FloatArray, weight_a: float, weight_b: float) -> FloatArray:
    """(16, 16): the functionals of a weighted sum of A and B, both raised to bicubic form."""
    return (weight_a * elevated(a) + weight_b * elevated(b.swapaxes(0, 1)).swapaxes(0, 1)).reshape(16, 16)


LATER_FUNCTIONALS = _later_functionals()
APART_FUNCTIONALS = _apart_functionals(LEAST_WEIGHT[Vertices.CONTROL])


def sampled_error(net: FloatArray, vertices: Vertices, levels: int) -> FloatArray:
    """(P,) float64: lower bounds of ‖L - S‖, a number of levels later, sampled in the facets at the patch's corners."""
    return largest_norm(apply(_samples(vertices, levels), net))


@cache
def _samples(vertices: Vertices, levels: int) -> FloatArray:
    """(samples, 16): L - S as functionals of the net, in the facets at the corners of the patch."""
    h = 0.5**levels
    ends, middles = (0.0, 1.0), (h / 2, 1 - h / 2)
    sides = [*product(ends, middles), *product(middles, ends)]
    # Errors of control facets are largest at corners or along sides, of limit facets in the middle or along sides.
    others = product(ends, ends) if vertices is Vertices.CONTROL else product(middles, middles)
    return np.concatenate([_error_at(vertices, h, u, v) for u, v in [*sides, *others]])


def _error_at(vertices: Vertices, h: float, u: float, v: float) -> FloatArray:
    """(1, 16): L - S at parameters (u, v) of a patch with facets of side h."""
    value = tensor(_spline_at(u), _spline_at(v))
    low_u, low_v = (min(np.floor(x / h), 1 / h - 1) * h for x in (u, v))
    s, t = (u - low_u) / h, (v - low_v) / h
    facet = np.zeros((1, 16))
    for corner_u, weight_u in ((low_u, 1 - s), (low_u + h, s)):
        for corner_v, weight_v in ((low_v, 1 - t), (low_v + h, t)):
            corner = tensor(_vertex_at(vertices, corner_u, h), _vertex_at(vertices, corner_v, h))
            facet += weight_u * weight_v * corner
    return facet - value


def _spline_at(x: float) -> FloatArray:
    """(1, 4): the value of a cubic B-spline segment at x as a functional of its four points."""
    bernstein = np.array([[(1 - x) ** 3, 3 * x * (1 - x) ** 2, 3 * x * x * (1 - x), x**3]])
    return bernstein @ SPLINE_TO_BERNSTEIN


def _vertex_at(vertices: Vertices, x: float, h: float) -> FloatArray:
    """(1, 4): the vertex at a knot x after refinement to spacing h.

    A limit vertex is the spline's value; a control point is that minus h²/6 of the second derivative.
    """
    if vertices is Vertices.LIMIT:
        return _spline_at(x)
    second = np.array([[1 - x, x]]) @ SECOND_DIFFERENCE
    return _spline_at(x) - h * h / 6 * second
