# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances of the triangles that a level of a regular face is drawn as, at all levels at once: feet on the surface.

Every point of a triangle has a foot on the surface nearby, along the normal there, and the feet cover the surface. So
the part of the error that is tangential does not count. docs/distance.md has lemmas and constants; letters are those
used there. Parameters have one unit for the face, and a level's subfaces the size h = 2⁻ʲ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import BoolArray, FloatArray
from ..arrays.vectors import cross_products, squared_norms
from ..bounds.norm_bounds import Vertices
from ..surface.bicubic import SECOND_DIFFERENCE, SPLINE_TO_BERNSTEIN, apply, largest_norm, tensor

# Quadratic splines, and linear ones, in Bernstein form of degree 3.
FIRST_DIFFERENCE = np.diff(np.eye(4), axis=0)
QUADRATIC = np.array([[1, 1, 0], [0, 2, 0], [0, 1, 1]]) / 2
TWO_TO_THREE = np.array([[3, 0, 0], [1, 2, 0], [0, 2, 1], [0, 0, 3]]) / 3
ONE_TO_THREE = np.array([[3, 0], [2, 1], [1, 2], [0, 3]]) / 3

# (16, 16) each: S_uu, S_vv and S_uv of a net, as pieces of degree (3, 3); (4, 16): S_uuvv at the corners.
ALONG_U = tensor(ONE_TO_THREE @ SECOND_DIFFERENCE, SPLINE_TO_BERNSTEIN)
ALONG_V = tensor(SPLINE_TO_BERNSTEIN, ONE_TO_THREE @ SECOND_DIFFERENCE)
MIXED = tensor(TWO_TO_THREE @ QUADRATIC @ FIRST_DIFFERENCE, TWO_TO_THREE @ QUADRATIC @ FIRST_DIFFERENCE)
FOURTH = tensor(SECOND_DIFFERENCE, SECOND_DIFFERENCE)

# Third derivatives are splines as well: differences whose largest bounds them. S_uuu and S_vvv, S_uuv, S_uvv.
THIRD_DIFFERENCE = np.diff(SECOND_DIFFERENCE, axis=0)
THIRDS = (
    tensor(THIRD_DIFFERENCE, np.eye(4)),
    tensor(SECOND_DIFFERENCE, FIRST_DIFFERENCE),
    tensor(FIRST_DIFFERENCE, SECOND_DIFFERENCE),
    tensor(np.eye(4), THIRD_DIFFERENCE),
)

# S, S_u and S_v at the middle of a face.
VALUE, SLOPE = np.array([[1, 23, 23, 1]]) / 48, np.array([[-1, -5, 5, 1]]) / 8
MIDDLE = np.concatenate([tensor(VALUE, VALUE), tensor(SLOPE, VALUE), tensor(VALUE, SLOPE)])

# S_uu, S_vv and S_uv there.
CURVE = np.array([[1, -1, -1, 1]]) / 2
MIDDLE_SECONDS = np.concatenate([tensor(CURVE, VALUE), tensor(VALUE, CURVE), tensor(SLOPE, SLOPE)])

# Where S_u and S_v at the middle have a smaller sine between them nothing is proved. So frames are off by less than
# 2⁻⁴⁰ of themselves, and what is computed in them by less than the part ROUNDING of the largest coefficient.
LEAST_SINE, ROUNDING = 2.0**-10, 2.0**-30

# A sine: two normals that are nearer to a third one than 45° do not face apart.
LARGEST_TILT = 0.7


@dataclass(frozen=True)
class FootBounds:
    """Of P faces. second, third, plain, fourth: (P,) float64 with |n·e| ≤ min(second h² + third h³, plain h²) +
    fourth h⁴ =: b, lengths; reach: (P,) with ‖e‖ ≤ reach h² =: w. curvature: (P,), at least the principal curvatures of
    the face, 1 / length; speed: (P,), at least how fast parameters change with the way along it, 1 / length. All are
    infinite where the face is not shown to be an immersion.
    tilt: (P,), at least how far normals as long along n₀ as that are from it: of the surface, and of triangles with
    vertices on it. middle: (P,), about what is reached at the middle, times h², and control_middle: with control
    vertices; prove nothing.
    """

    second: FloatArray
    third: FloatArray
    plain: FloatArray
    fourth: FloatArray
    reach: FloatArray
    curvature: FloatArray
    speed: FloatArray
    tilt: FloatArray
    middle: FloatArray
    control_middle: FloatArray

    def at(self, level: int, curvature: FloatArray, speed: FloatArray, longest: float = 1.0) -> FloatArray:
        """(P,): B = b + κw², at least how far the level's triangles of each face are from the surface, and the surface
        over it from the triangles of the face and of those that touch it; infinite where that is not proved.

        curvature, speed: (P,), κ and α, the largest of the face and of all faces that touch it. longest: how far from
        equal parameters feet may be, as a part of the face.
        """
        size = 0.5**level
        with np.errstate(invalid="ignore", over="ignore"):
            along = np.minimum(self.second + size * self.third, self.plain) * size**2 + self.fourth * size**4
            reach = self.reach * size**2
            bounds = along + curvature * reach**2
            proved = (curvature * bounds <= 0.5 - ROUNDING) & (2 * reach * speed <= longest * (1 - ROUNDING))
        return np.where(proved, bounds, np.inf)


@dataclass(frozen=True)
class Derivatives:
    """Bounds of derivatives of one component: second: (3, P), of uu, vv and uv; third: (4, P), of uuu, uuv, uvv, vvv;
    fourth: (P,), of uuvv."""

    second: FloatArray
    third: FloatArray
    fourth: FloatArray

    @staticmethod
    def of(component: FloatArray) -> Derivatives:
        """Of nets of one component (16, P), rounding covered."""
        rounding = ROUNDING * np.abs(component).max(axis=0)
        second = np.stack([np.abs(rows @ component).max(axis=0) for rows in (ALONG_U, ALONG_V, MIXED)])
        third = np.stack([np.abs(rows @ component).max(axis=0) for rows in THIRDS])
        return Derivatives(second + rounding, third + rounding, np.abs(FOURTH @ component).max(axis=0) + rounding)

    def error(self, vertices: Vertices) -> FloatArray:
        """(P,): |e| ≤ this times h², at every level; and what control vertices are off the surface besides."""
        uu, vv, uv = self.second
        error = (uu + vv) / 8 + uv / 4
        return error if vertices is Vertices.LIMIT else error + (uu + vv) / 6 + self.fourth / 36


def foot_bounds(nets: FloatArray, vertices: Vertices, is_turned: BoolArray) -> FootBounds:
    """Of nets (4, 4, P, 3) of regular faces. is_turned: (P,) bool, whether subfaces are drawn with the diagonal from
    corner 1 to corner 3 of the face, in place of the one from 0 to 2."""
    points = nets.reshape(16, -1, 3)
    frame = Frame.of(points)
    zeta, xi, eta = frame.derivatives
    turns = _turns(xi, eta)
    tilts = turns.solve(*((zeta.second[:2] + zeta.second[2]) / 2))
    errors = [each.error(vertices) for each in frame.derivatives]
    across = tilts[0] * errors[1] + tilts[1] * errors[2]
    second, third, plain = _along(frame.heights, zeta, vertices, is_turned)
    a, b = turns.transposed().solve(*frame.dual_lengths)
    uu, vv, uv = zeta.second + tilts[0] * xi.second + tilts[1] * eta.second
    found = (
        second + across,
        third,
        plain + across,
        zeta.fourth / 36 if vertices is Vertices.CONTROL else np.zeros_like(across),
        errors[0] + frame.lengths[0] * errors[1] + frame.lengths[1] * errors[2],
        uu * a * a + 2 * uv * a * b + vv * b * b,
        np.maximum(a, b),
        tilts[0] * frame.dual_lengths[0] + tilts[1] * frame.dual_lengths[1],
    )
    proved = frame.is_known & turns.are_known
    bounds = [np.where(proved, each * (1 + ROUNDING), np.inf) for each in found]
    middles = (_at_middle(frame.heights, each) for each in (vertices, Vertices.CONTROL))
    return FootBounds(*bounds, *middles)


@dataclass(frozen=True)
class Frame:
    """The middle's n₀, S_u, S_v: X = ζ n₀ + ξ S_u + η S_v. heights: (16, P), the nets' ζ from the middle on.
    derivatives: of ζ, ξ and η. lengths: (2, P), of S_u and S_v; dual_lengths: (2, P), of the vectors that ξ and η are
    products with. is_known: (P,) bool."""

    heights: FloatArray
    derivatives: tuple[Derivatives, Derivatives, Derivatives]
    lengths: FloatArray
    dual_lengths: FloatArray
    is_known: BoolArray

    @staticmethod
    def of(points: FloatArray) -> Frame:
        """Of nets (16, P, 3)."""
        middle, along_u, along_v = np.einsum("rk,kpd->rpd", MIDDLE, points)
        normal = cross_products(along_u, along_v)
        square, squares = squared_norms(normal), np.stack([squared_norms(along_u), squared_norms(along_v)])
        is_known = square > LEAST_SINE**2 * squares[0] * squares[1]
        square = np.where(is_known, square, 1.0)
        duals = cross_products(along_v, normal) / square[:, None], cross_products(normal, along_u) / square[:, None]
        axes = (normal / np.sqrt(square)[:, None], *duals)
        heights, *across = (np.einsum("kpd,pd->kp", points - middle, axis) for axis in axes)
        derivatives = Derivatives.of(heights), Derivatives.of(across[0]), Derivatives.of(across[1])
        dual_lengths = np.sqrt(np.stack([squared_norms(each) for each in duals]))
        return Frame(heights, derivatives, np.sqrt(squares), dual_lengths, is_known)


@dataclass(frozen=True)
class Turns:
    """How far S_u and S_v are from those of the middle, in these, at most: (P,) each, of S_u along S_u and S_v, and of
    S_v along S_u and S_v. are_known: (P,) bool, whether no combination of them vanishes."""

    uu: FloatArray
    uv: FloatArray
    vu: FloatArray
    vv: FloatArray

    @property
    def _determinant(self) -> FloatArray:
        return (1 - self.uu) * (1 - self.vv) - self.uv * self.vu

    @property
    def are_known(self) -> BoolArray:
        return (self.uu < 1 - ROUNDING) & (self.vv < 1 - ROUNDING) & (self._determinant > ROUNDING)

    def transposed(self) -> Turns:
        """With the two mixed ones exchanged."""
        return Turns(self.uu, self.vu, self.uv, self.vv)

    def solve(self, first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The largest x, y with x ≤ first + uu x + uv y and y ≤ second + vu x + vv y."""
        determinant = np.where(self.are_known, self._determinant, 1.0)
        return (
            (first * (1 - self.vv) + self.uv * second) / determinant,
            (second * (1 - self.uu) + self.vu * first) / determinant,
        )


def _turns(xi: Derivatives, eta: Derivatives) -> Turns:
    """Nothing in a face is farther than half its size from the middle, either way."""
    (xi_u, xi_v), (eta_u, eta_v) = ((each.second[:2] + each.second[2]) / 2 for each in (xi, eta))
    return Turns(xi_u, eta_u, xi_v, eta_v)


def _along(
    heights: FloatArray, zeta: Derivatives, vertices: Vertices, is_turned: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """second, third and plain of ``FootBounds``, of the part along n₀ alone."""
    rounding = ROUNDING * np.abs(heights).max(axis=0)
    uu, vv, uv = (rows @ heights for rows in (ALONG_U, ALONG_V, MIXED))
    uv = np.where(is_turned, -uv, uv)
    off = (uu + vv) / 6 if vertices is Vertices.CONTROL else np.zeros_like(uu)
    second = np.maximum(_highest(uu, vv, uv) - off, _highest(-uu, -vv, -uv) + off).max(axis=0)
    above = _highest(uu.max(axis=0), vv.max(axis=0), uv.max(axis=0))
    below = _highest(-uu.min(axis=0), -vv.min(axis=0), -uv.min(axis=0))
    plain = np.maximum(above - off.min(axis=0), below + off.max(axis=0)) + np.ptp(uv, axis=0) / 27
    uuu, uuv, uvv, vvv = zeta.third
    third = (uuu + 3 * uuv + 3 * uvv + vvv) / 48
    if vertices is Vertices.CONTROL:
        third = third + (uuu + uuv + uvv + vvv) / 12
    return second + rounding, third, plain + rounding


def _at_middle(heights: FloatArray, vertices: Vertices) -> FloatArray:
    """middle of ``FootBounds``."""
    uu, vv, uv = MIDDLE_SECONDS @ heights
    off = (uu + vv) / 6 if vertices is Vertices.CONTROL else np.zeros_like(uu)
    return np.max(np.abs([uu / 8 - off, vv / 8 - off, (uu + vv) / 8 - np.abs(uv) / 4 - off, off]), axis=0)


def _highest(uu: FloatArray, vv: FloatArray, uv: FloatArray) -> FloatArray:
    """How far a triangle's points are above a quadratic surface with these second derivatives, at most: over a square
    of side 1, with the diagonal from (0, 0) to (1, 1)."""
    diagonal = uu + vv + 2 * uv
    highest = np.maximum(np.maximum(uu, vv), np.maximum(diagonal, 0.0)) / 8
    is_inside = (uv < 0) & (uu + uv > 0) & (vv + uv > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = uu * vv * diagonal / (8 * (uu * vv - uv * uv))
    return np.where(is_inside, np.maximum(inside, highest), highest)


def equal_bounds(nets: FloatArray, vertices: Vertices) -> FloatArray:
    """(P,): of nets (4, 4, P, 3) of regular faces, ‖e‖ at equal parameters at most, with either diagonal, times 4⁻ʲ for
    the level j."""
    uu, vv, uv = (largest_norm(apply(rows, nets)) for rows in (ALONG_U, ALONG_V, MIXED))
    bounds = (uu + vv) / 8 + uv / 4
    if vertices is Vertices.CONTROL:
        bounds = bounds + (uu + vv) / 6 + largest_norm(apply(FOURTH, nets)) / 36
    return bounds * (1 + ROUNDING) + ROUNDING * np.abs(nets - nets[1, 1]).max(axis=(0, 1, 3))
