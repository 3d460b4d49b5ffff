# SPDX-License-Identifier: GPL-3.0-or-later
"""What the facets of a regular patch miss of it, at its own level and at all later ones.

Derivations: docs/methods.md, Certified. With A = S_uu, B = S_vv, R = S_uuvv for knots 1 apart, h = 2⁻ʲ and (s, t) the
place in a facet j levels after the patch's own,

    control vertices:  L - S = -(h²/6)(αA* + βB*) + (h⁴/36)αβR*,   α = (1-s)³ + s³,  β likewise in t, both in [1/4, 1]
    limit vertices:    L - S =  (h²/8)(αA* + βB*) + (h⁴/64)αβR*,   α = 4s(1-s),      β likewise in t, both in [0, 1]

the stars marking places inside the same facet, off by at most ``MISMATCH`` of h in units of the weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from .bounds import Vertices
from .mesh import FloatArray
from .norms import squared_norms
from .splines import (
    SECOND_DIFFERENCE,
    SPLINE_TO_BERNSTEIN,
    apply,
    bilinear_coefficients,
    elevated,
    largest_norm,
    second_derivatives,
    tensor,
)

# h²/6 and h²/8 with h = 1; the weights' least value; the largest of |α(u* - u)|/h: s(1-s)|1-2s| is at most √3/18, and
# with limit vertices 4/3 of it. Both are rounded up.
SCALE = {Vertices.CONTROL: 1 / 6, Vertices.LIMIT: 1 / 8}
LEAST_WEIGHT = {Vertices.CONTROL: 1 / 4, Vertices.LIMIT: 0.0}
MISMATCH = {Vertices.CONTROL: 0.09623, Vertices.LIMIT: 0.12831}


def facet_error(net: FloatArray, vertices: Vertices) -> FloatArray:
    """(4, 4, P, 3): Bernstein coefficients of S - L over each patch's own facet."""
    return apply(_facet_error(vertices), net).reshape(net.shape)


@cache
def _facet_error(vertices: Vertices) -> FloatArray:
    """(16, 16): the same as functionals of the net, coefficient [i, j] in row 4i + j."""
    points = np.eye(16).reshape(4, 4, 16)
    values = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN).reshape(4, 4, 16)
    corners = points[[1, 2, 2, 1], [1, 1, 2, 2]] if vertices is Vertices.CONTROL else values[[0, 3, 3, 0], [0, 0, 3, 3]]
    return (values - bilinear_coefficients(corners)).reshape(16, 16)


CORNER_ROWS = [0, 3, 12, 15]
SIDE_ROWS = [1, 2, 4, 7, 8, 11, 13, 14]


def control_facet_bounds(net: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(P,) float64 each: ‖L - S‖ over the patches' own facets with control vertices, at most and at least.

    Of the 16 coefficients the four in the middle are 0, and those at the corners are values.
    """
    squares = squared_norms(apply(_facet_error(Vertices.CONTROL)[CORNER_ROWS + SIDE_ROWS], net))
    at_corners = squares[:4].max(axis=0)
    return np.sqrt(np.maximum(at_corners, squares[4:].max(axis=0))), np.sqrt(at_corners)


@dataclass(frozen=True)
class LaterBounds:
    """Upper bounds of P patches for the facets of every later level: (P,) float64 each.

    together: the largest of ‖A + B‖; apart: of the combinations with one weight at its least; curves: of ‖A‖ and ‖B‖;
    twist: of ‖R‖; change: of ‖A_u‖ plus that of ‖B_v‖. With control vertices apart and change are only worked out
    where curves is the larger of curves and together: elsewhere they cannot help.
    """

    vertices: Vertices
    together: FloatArray
    apart: FloatArray
    curves: FloatArray
    twist: FloatArray
    change: FloatArray

    def at(self, levels: int) -> FloatArray:
        """(P,) float64: ‖L - S‖ at most, so many levels after the patch's own."""
        h = 0.5**levels
        scale = h * h * SCALE[self.vertices]
        mixed = np.maximum(self.together, self.apart) + MISMATCH[self.vertices] * h * self.change
        if self.vertices is Vertices.CONTROL:
            # The 12 Bernstein coefficients that a facet has are of A, B, or both at its corners.
            mixed = np.minimum(mixed, np.maximum(self.together, self.curves))
        return scale * (mixed + scale * self.twist)


def later_bounds(net: FloatArray, vertices: Vertices) -> LaterBounds:
    """The bounds for the levels after the nets' own; nets are (4, 4, P, 3)."""
    derivatives = apply(second_derivatives(), net)
    a = derivatives[:8].reshape(2, 4, -1, 3)
    b = derivatives[8:16].reshape(4, 2, -1, 3)
    a_bicubic, b_bicubic = elevated(a), elevated(b.swapaxes(0, 1)).swapaxes(0, 1)
    curves = np.maximum(largest_norm(_rows(a)), largest_norm(_rows(b)))
    together = largest_norm(_rows(a_bicubic + b_bicubic))
    apart = curves.copy()
    change = np.zeros(len(curves))
    if vertices is Vertices.CONTROL:
        # Only where A and B work against each other does it matter how much.
        opposed = np.flatnonzero(curves > together)
        a_bicubic, b_bicubic = a_bicubic.take(opposed, axis=2), b_bicubic.take(opposed, axis=2)
        least = LEAST_WEIGHT[vertices]
        mixed = largest_norm(_rows(a_bicubic + least * b_bicubic))
        apart[opposed] = np.maximum(mixed, largest_norm(_rows(least * a_bicubic + b_bicubic)))
        change[opposed] = _change(a.take(opposed, axis=2), b.take(opposed, axis=2))
    else:
        change = _change(a, b)
    return LaterBounds(vertices, together, apart, curves, twist=largest_norm(derivatives[16:]), change=change)


def _rows(coefficients: FloatArray) -> FloatArray:
    rows = coefficients.shape[0] * coefficients.shape[1]
    return coefficients.reshape(rows, *coefficients.shape[2:])


def _change(a: FloatArray, b: FloatArray) -> FloatArray:
    return largest_norm(a[1] - a[0]) + largest_norm(b[:, 1] - b[:, 0])


def sampled_error(net: FloatArray, vertices: Vertices, levels: int) -> FloatArray:
    """(P,) float64: ‖L - S‖ at least, some levels on: its value at places in the facets at the patch's corners."""
    return largest_norm(apply(_samples(vertices, levels), net))


@cache
def _samples(vertices: Vertices, levels: int) -> FloatArray:
    """(places, 16): L - S as functionals of the net, in the facets at the corners of the patch."""
    h = 0.5**levels
    ends, middles = (0.0, 1.0), (h / 2, 1 - h / 2)
    sides = [*product(ends, middles), *product(middles, ends)]
    # Control facets are worst at corners or along sides, limit facets in the middle or along sides.
    others = product(ends, ends) if vertices is Vertices.CONTROL else product(middles, middles)
    return np.concatenate([_error_at(vertices, h, u, v) for u, v in [*sides, *others]])


def _error_at(vertices: Vertices, h: float, u: float, v: float) -> FloatArray:
    """(1, 16): L - S at one place (u, v) of a patch whose facets have side h."""
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

    A limit vertex is the spline itself; a control point lies h²/6 of its second derivative before it.
    """
    if vertices is Vertices.LIMIT:
        return _spline_at(x)
    second = np.array([[1 - x, x]]) @ SECOND_DIFFERENCE
    return _spline_at(x) - h * h / 6 * second
