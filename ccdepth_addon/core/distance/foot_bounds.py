# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances between the triangles of a regular face and the surface, at all levels at once, by feet on the surface.

Every point of a triangle has a foot on the surface nearby, along the normal there, and the feet cover the surface. So
the tangential part of the error does not count. docs/distance.md has the lemmas, the constants and the notation. In
parameters a face has size 1, and the subfaces of level j have size h = 2⁻ʲ.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray
from ..arrays.vectors import crosses, products
from ..bounds.norm_bounds import Vertices
from ..surface.bicubic import FIRST_DIFFERENCE, second_derivatives, tensor

# The first derivative of a cubic spline, a quadratic spline, in Bernstein form.
QUADRATIC_SLOPES = np.array([[1, 1, 0], [0, 2, 0], [0, 1, 1]]) / 2 @ FIRST_DIFFERENCE

# (25, 16): the Bernstein coefficients of S_uu, S_vv and S_uv of a net, and the rows of each; (4, 16): S_uuvv at the
# corners.
UU_AND_VV, FOURTH = np.split(second_derivatives(), [16])
SECONDS = np.concatenate([UU_AND_VV, tensor(QUADRATIC_SLOPES, QUADRATIC_SLOPES)])
OF_SECONDS = slice(0, 8), slice(8, 16), slice(16, 25)

# S, S_u and S_v at the middle of a face.
VALUE, SLOPE = np.array([[1, 23, 23, 1]]) / 48, np.array([[-1, -5, 5, 1]]) / 8
MIDDLE = np.concatenate([tensor(VALUE, VALUE), tensor(SLOPE, VALUE), tensor(VALUE, SLOPE)])

# S_uu, S_vv and S_uv at the middle of a face.
CURVE = np.array([[1, -1, -1, 1]]) / 2
MIDDLE_SECONDS = np.concatenate([tensor(CURVE, VALUE), tensor(VALUE, CURVE), tensor(SLOPE, SLOPE)])

# Below this sine between S_u and S_v at the middle, nothing is proved. So frames have relative errors below 2⁻⁴⁰, and
# components in frames have errors below the part ROUNDING of the largest coefficient.
LEAST_SINE, ROUNDING = 2.0**-10, 2.0**-30

# A sine: two normals within 45° of a third normal do not face apart.
LARGEST_TILT = 0.7


@dataclass(frozen=True)
class FootBounds(Table):
    """The constants of P faces from which feet follow at every level.

    second, fourth: (P,) float64, lengths with |n·e| ≤ second h² + fourth h⁴ =: b. reach: (P,), with ‖e‖ ≤ reach h² =:
    w. curvature: (P,), a bound of the principal curvatures, 1 / length. speed: (P,), a bound of the change of
    parameters per length along the surface, 1 / length. All are infinite where the face is not shown to be an
    immersion. tilt: (P,), a bound of ‖n - n₀‖ over all n with n·n₀ = 1 along normals, of the surface and of triangles
    with vertices on the surface. middle, control_middle: (P,), estimates of the distance at the middle, divided by h²,
    for limit and control vertices; estimates prove nothing.
    """

    second: FloatArray
    fourth: FloatArray
    reach: FloatArray
    curvature: FloatArray
    speed: FloatArray
    tilt: FloatArray
    middle: FloatArray
    control_middle: FloatArray

    def at_level(self, level: int, curvature: FloatArray, speed: FloatArray, longest: float = 1.0) -> FloatArray:
        """(P,): B = b + κw², a bound of the distance between the level's triangles of each face and the surface, and
        between the surface over the face and the triangles of the face and of the faces that touch it; infinite where
        nothing is proved.

        curvature, speed: (P,), κ and α, each the largest of the face and of all faces that touch it. longest: the
        largest distance of feet from equal parameters, as a part of the face.
        """
        size = 0.5**level
        with np.errstate(invalid="ignore", over="ignore"):
            along = self.second * size**2 + self.fourth * size**4
            return foot_distances(along, self.reach * size**2, curvature, speed, longest)


def foot_distances(
    along: FloatArray, reach: FloatArray, curvature: FloatArray, speed: FloatArray, longest: float
) -> FloatArray:
    """(P,): B from b, w, κ and α, (P,) each; infinite where Lemma 1 does not hold. longest: as of
    ``FootBounds.at_level``."""
    with np.errstate(invalid="ignore", over="ignore"):
        bounds = along + curvature * reach**2
        proved = (curvature * bounds <= 0.5 - ROUNDING) & (2 * reach * speed <= longest * (1 - ROUNDING))
    return np.where(proved, bounds, np.inf)


def foot_bounds(nets: FloatArray, vertices: Vertices, is_turned: BoolArray) -> FootBounds:
    """The constants of regular faces with nets (16, 3, P). is_turned: (P,) bool, whether subfaces are drawn with the
    diagonal from corner 1 to corner 3 of the face, in place of the diagonal from 0 to 2. With control vertices either
    diagonal may be drawn, and the bounds hold for both."""
    frame = Frame.of(nets)
    errors = frame.errors(vertices)
    found = (
        along_normals(np.stack([_along(frame, vertices, is_turned), *errors[1:]]), frame.tilts),
        frame.fourth[0] / 36 if vertices is Vertices.CONTROL else np.zeros_like(errors[0]),
        errors[0] + frame.lengths[0] * errors[1] + frame.lengths[1] * errors[2],
        frame.curvature,
        np.maximum(*frame.speeds),
        frame.tilt,
    )
    second, fourth, reach, curvature, speed, tilt = (
        np.where(frame.is_known, each * (1 + ROUNDING), np.inf) for each in found
    )
    seconds = matrix_product(MIDDLE_SECONDS, frame.heights)
    middle, control_middle = (likely_distances(seconds, each, is_turned) for each in (vertices, Vertices.CONTROL))
    return FootBounds(second, fourth, reach, curvature, speed, tilt, middle, control_middle)


@dataclass(frozen=True)
class Turns:
    """Bounds of the changes of S_u and S_v over a face, as components along S_u and S_v of the middle: (P,) each, of
    S_u along S_u and S_v, then of S_v along S_u and S_v. are_known: (P,) bool, whether S_u and S_v are shown to be
    independent."""

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
        """The turns with the two mixed components exchanged."""
        return Turns(self.uu, self.vu, self.uv, self.vv)

    def solve(self, first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The largest x, y with x ≤ first + uu x + uv y and y ≤ second + vu x + vv y."""
        determinant = np.where(self.are_known, self._determinant, 1.0)
        return (
            (first * (1 - self.vv) + self.uv * second) / determinant,
            (second * (1 - self.uu) + self.vu * first) / determinant,
        )


@dataclass(frozen=True)
class Frame:
    """The frame n₀, S_u, S_v at the middle of each face: X = ζ n₀ + ξ S_u + η S_v.

    axes: (3, 3, P), the dual vectors that give ζ, ξ and η as dot products. heights: (16, P), ζ of the net's points,
    seen from the middle. highest, lowest: (3, 3, P), bounds of each component of S_uu, S_vv and S_uv; fourth: (3, P),
    of |S_uuvv|; all with rounding included. lengths: (2, P), of S_u and S_v. turns: of S_u and S_v over the face.
    is_known: (P,) bool, whether the face is shown to be an immersion.
    """

    axes: FloatArray
    heights: FloatArray
    highest: FloatArray
    lowest: FloatArray
    fourth: FloatArray
    lengths: FloatArray
    turns: Turns
    is_known: BoolArray

    @staticmethod
    def of(nets: FloatArray) -> Frame:
        """The frames of regular faces with nets (16, 3, P)."""
        middle, along_u, along_v = matrix_product(MIDDLE, nets)
        normal = crosses(along_u, along_v)
        square, squares = products(normal, normal), np.stack([products(along_u, along_u), products(along_v, along_v)])
        has_normal = square > LEAST_SINE**2 * squares[0] * squares[1]
        square = np.where(has_normal, square, 1.0)
        axes = np.stack(
            [normal / np.sqrt(square), crosses(along_v, normal) / square, crosses(normal, along_u) / square]
        )
        local = along_axes(axes, nets - middle)
        rounding = ROUNDING * np.maximum(local.max(axis=0), -local.min(axis=0))
        second = matrix_product(SECONDS, local)
        highest = np.stack([second[some].max(axis=0) for some in OF_SECONDS]) + rounding
        lowest = np.stack([second[some].min(axis=0) for some in OF_SECONDS]) - rounding
        fourth = np.abs(matrix_product(FOURTH, local)).max(axis=0) + rounding
        # Both parameters of every point of a face are within half a face of the middle.
        largest = np.maximum(highest, -lowest)
        (xi_u, xi_v), (eta_u, eta_v) = ((largest[:2, component] + largest[2, component]) / 2 for component in (1, 2))
        turns = Turns(xi_u, eta_u, xi_v, eta_v)
        is_known = has_normal & turns.are_known
        return Frame(axes, local[:, 0], highest, lowest, fourth, np.sqrt(squares), turns, is_known)

    @cached_property
    def largest(self) -> FloatArray:
        """(3, 3, P): the largest |S_uu|, |S_vv| and |S_uv| of each component."""
        return np.maximum(self.highest, -self.lowest)

    @cached_property
    def tilts(self) -> FloatArray:
        """(2, P): σ_u and σ_v of ``along_normals``."""
        return np.stack(self.turns.solve(*((self.largest[:2, 0] + self.largest[2, 0]) / 2)))

    @cached_property
    def dual_lengths(self) -> tuple[FloatArray, FloatArray]:
        """|x| and |y|, (P,) each."""
        return np.sqrt(products(self.axes[1], self.axes[1])), np.sqrt(products(self.axes[2], self.axes[2]))

    @cached_property
    def tilt(self) -> FloatArray:
        """(P,): a bound of ‖n - n₀‖ over the face, n·n₀ = 1."""
        return self.tilts[0] * self.dual_lengths[0] + self.tilts[1] * self.dual_lengths[1]

    @property
    def speeds(self) -> tuple[FloatArray, FloatArray]:
        """a and b, (P,) each: the largest changes of u and v along a path of length 1."""
        return self.turns.transposed().solve(*self.dual_lengths)

    @property
    def curvature(self) -> FloatArray:
        """κ, (P,): a bound of the principal curvatures."""
        a, b = self.speeds
        uu, vv, uv = along_normals(self.largest, self.tilts)
        found: FloatArray = uu * a * a + 2 * uv * a * b + vv * b * b
        return found

    def errors(self, vertices: Vertices) -> FloatArray:
        """(3, P): bounds of the components of e at every level, divided by h²."""
        uu, vv, uv = self.largest
        errors = (uu + vv) / 8 + uv / 4
        return errors if vertices is Vertices.LIMIT else errors + (uu + vv) / 6 + self.fourth / 36


def along_axes(axes: FloatArray, vectors: FloatArray) -> FloatArray:
    """(R, 3, P): the dot products of vectors (R, 3, P) with axes (3, 3, P)."""
    found = np.empty_like(vectors)
    for component, axis in enumerate(axes):
        own = found[:, component]
        np.multiply(vectors[:, 0], axis[0], out=own)
        own += vectors[:, 1] * axis[1]
        own += vectors[:, 2] * axis[2]
    return found


def along_normals(components: FloatArray, tilts: FloatArray) -> FloatArray:
    """(…, P): bounds of |n·X| ≤ |ζ| + σ_u|ξ| + σ_v|η| for normals n over faces and vectors X with components |ζ|, |ξ|
    and |η| of at most (…, 3, P). tilts: (2, P), σ_u and σ_v."""
    found: FloatArray = components[..., 0, :] + tilts[0] * components[..., 1, :]
    found += tilts[1] * components[..., 2, :]
    return found


def _along(frame: Frame, vertices: Vertices, is_turned: BoolArray) -> FloatArray:
    """``FootBounds.second`` for the component along n₀ alone."""
    highest, lowest = frame.highest[:, 0], frame.lowest[:, 0]
    uv, least_uv = np.where(is_turned, [-lowest[2], -highest[2]], [highest[2], lowest[2]])
    above, below = _highest(highest[0], highest[1], uv), _highest(-lowest[0], -lowest[1], -least_uv)
    if vertices is Vertices.CONTROL:
        above = np.maximum(above, _highest(highest[0], highest[1], -least_uv)) - (lowest[0] + lowest[1]) / 6
        below = np.maximum(below, _highest(-lowest[0], -lowest[1], uv)) + (highest[0] + highest[1]) / 6
    return np.maximum(above, below) + (uv - least_uv) / 27


def likely_distances(seconds: FloatArray, vertices: Vertices, is_turned: BoolArray) -> FloatArray:
    """(…, P): estimates of the distance of triangles from the surface, divided by h², from second derivatives along the
    normal, S_uu, S_vv and S_uv (3, …, P). Estimates prove nothing. is_turned: as in ``foot_bounds``."""
    uu, vv, uv = seconds
    at_limit = np.stack([uu / 8, vv / 8, (uu + vv) / 8 + np.where(is_turned, -uv, uv) / 4])
    if vertices is Vertices.LIMIT:
        return np.abs(at_limit).max(axis=0)
    off = (uu + vv) / 6
    return np.maximum(np.abs(at_limit - off).max(axis=0), np.abs(off))


def _highest(uu: FloatArray, vv: FloatArray, uv: FloatArray) -> FloatArray:
    """The largest height of a triangle's points over a quadratic surface with these second derivatives: over a square
    of side 1, with the diagonal from (0, 0) to (1, 1)."""
    diagonal = uu + vv + 2 * uv
    highest = np.maximum(np.maximum(uu, vv), np.maximum(diagonal, 0.0)) / 8
    is_inside = (uv < 0) & (uu + uv > 0) & (vv + uv > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = uu * vv * diagonal / (8 * (uu * vv - uv * uv))
    return np.where(is_inside, np.maximum(inside, highest), highest)


def twists(nets: FloatArray) -> FloatArray:
    """(P,): bounds of the distance between bilinear facets, with vertices on the surface over regular faces with nets
    (16, 3, P), and their triangles along either diagonal; multiply by 4⁻ʲ for level j. docs/distance.md, Facets."""
    frame = Frame.of(nets)
    highest = along_normals(frame.largest[2], frame.tilts) / 2
    points = nets - nets[5]
    longest = _longest(SECONDS[OF_SECONDS[2]], points) / 4 + ROUNDING * np.abs(points).max(axis=(0, 1))
    return np.where(frame.is_known, np.minimum(highest, longest), longest) * (1 + ROUNDING)


def _longest(rows: FloatArray, points: FloatArray) -> FloatArray:
    """(P,): the longest of the combinations, by rows (R, 16), of points (16, 3, P)."""
    vectors = matrix_product(rows, points)
    return np.sqrt((vectors * vectors).sum(axis=1).max(axis=0))


def equal_bounds(nets: FloatArray, vertices: Vertices) -> FloatArray:
    """(P,): bounds of ‖e‖ at equal parameters over regular faces with nets (16, 3, P), with either diagonal; multiply
    by 4⁻ʲ for level j."""
    points = nets - nets[5]
    uu, vv, uv = (_longest(SECONDS[some], points) for some in OF_SECONDS)
    bounds = (uu + vv) / 8 + uv / 4
    if vertices is Vertices.CONTROL:
        bounds = bounds + (uu + vv) / 6 + _longest(FOURTH, points) / 36
    return bounds * (1 + ROUNDING) + ROUNDING * np.abs(points).max(axis=(0, 1))
