# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances of a template's triangles from the surface (docs/adaptive.md, Triangles on the surface).

The triangles' vertices lie on the surface, at their own parameters; the distance is measured at equal parameters, so it
holds in both directions. Over a piece of the surface that is bicubic, S - T on a part of a triangle is a polynomial of
total degree 6, and no longer than the longest of its 28 Bernstein coefficients over that part. These are linear in the
control net, so a template is a matrix for each kind of net:

- a bicubic quad: 16 Bernstein coefficients, by the quarters of triangles. Where S - T is nearly quadratic it is enough
  to take it apart: the quadratic polynomial with its values at the vertices and the middles of the sides, and the rest,
  monomial by monomial;
- a quad at extraordinary vertices: its net, by way of the bicubic pieces of some levels (``stencils``); what is left
  at such a vertex is compared with its bilinear facet, which is within a known part of the second-order norm.

Any other quad is refined first (``irregular_bounds``).

How exact: all parameters are multiples of 1/16 of the square, so the sums below are exact in double precision, and each
weight is off by the rounding of one division. docs/adaptive.md (Rounding) has what follows from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import pairwise

import numpy as np

from ...arrays.types import BoolArray, FloatArray, IndexArray
from ...arrays.vectors import selected_vectors, squared_norms, transformed_nets
from ...bounds.norm_bounds import certified_limit_factor
from ...bounds.norms import second_differences
from ...surface.bicubic import SPLINE_TO_BERNSTEIN, bilinear_coefficients, tensor
from ...surface.squares import WHOLE_QUAD, Square
from ...surface.stencils import Valences, patch_stencils, quad_stencils
from ...surface.triangle_coefficients import DEGREE, arguments_of, bicubic_basis, coefficients_over, counts_of
from ..templates import QUAD_POINTS, Triangle, templates

# From the Bernstein coefficients of a cubic over [0, 1] to its coefficients of (x - 1/2)^i; and back.
TO_POWERS = np.array([[1, 3, 3, 1], [-6, -6, 6, 6], [12, -12, -12, 12], [-8, 24, -24, 8]]) / 8
FROM_POWERS = np.array([[24, -12, 6, -3], [24, -4, -2, 3], [24, 4, -2, -3], [24, 12, 6, 3]]) / 24

# The monomials (u - 1/2)^i (v - 1/2)^j → 4i + j that are more than quadratic. Rounding changes bounds of their distance
# from their quadratic parts by less than 2⁻⁴⁸: 16 sums of numbers below 1/8, and two times nine of such below 3/8.
BEYOND_QUADRATIC = [4 * i + j for i in range(4) for j in range(4) if i + j > 2]
OFF_ROUNDING = 2.0**-48

# The Bernstein coefficients, of 16 in [i, j] → 4i + j, that are the values at corners 0 to 3.
CORNER_COEFFICIENTS = [0, 12, 15, 3]

# For sorting places.
AS_COMPLEX = np.array([1.0, 1.0j])

# Levels of bicubic pieces around an extraordinary vertex.
LEVELS_AT_VERTEX = 5


def to_monomials() -> FloatArray:
    """(10, 16): from Bernstein coefficients to those of (u - 1/2)^i (v - 1/2)^j that are more than quadratic."""
    return np.kron(TO_POWERS, TO_POWERS)[BEYOND_QUADRATIC]


def off_quadratic(triangles: list[FloatArray]) -> FloatArray:
    """(10,): upper bounds of the distance of each of these monomials from its own quadratic part, over some triangles
    (3, 2): by Bernstein coefficients over their quarters."""
    return np.max([_off_quadratic(tuple(triangle.ravel().tolist())) for triangle in triangles], axis=0)


@cache
def _off_quadratic(places: tuple[float, ...]) -> FloatArray:
    """(10,): the same over one triangle, by the parameters of its vertices; templates share these."""
    triangle = np.array(places).reshape(3, 2)
    monomials = np.kron(FROM_POWERS, FROM_POWERS)[:, BEYOND_QUADRATIC]
    blossoms, shares = _quadratic_blossoms(triangle, monomials), _shares_of_pairs()
    largest = np.zeros(len(BEYOND_QUADRATIC))
    for part in _quartered(triangle):
        own = barycentric(triangle, part)
        quadratic = np.einsum("rpq,pa,qb,abm->rm", shares, own, own, blossoms, optimize=True)
        off = coefficients_over(part) @ monomials - quadratic
        largest = np.maximum(largest, np.abs(off).max(axis=0))
    return largest + OFF_ROUNDING


def _quadratic_blossoms(triangle: FloatArray, coefficients: FloatArray) -> FloatArray:
    """(3, 3, N): of the quadratic polynomials with the values of bicubics (16, N) at a triangle's vertices and at the
    middles of its sides, the blossoms at every two vertices."""
    values = np.einsum("abi,in->abn", _at_middles(triangle), coefficients)
    at_vertices = np.einsum("aan->an", values)
    # A vertex is the middle between it and itself, where this is its value.
    return 2 * values - (at_vertices[:, None] + at_vertices[None]) / 2


def _at_middles(triangle: FloatArray) -> FloatArray:
    """(3, 3, 16): the basis half-way between every two vertices of a triangle (3, 2)."""
    middles = (triangle[:, None] + triangle[None]) / 2
    return bicubic_basis(middles.reshape(-1, 2)).reshape(3, 3, 16)


def _shares_of_pairs() -> FloatArray:
    """(28, 3, 3): the share of each two vertices among the pairs of a coefficient's six arguments, in order: raises a
    polynomial of degree 2, by its blossoms, to degree 6."""
    counts = counts_of(6)
    pairs = counts[:, :, None] * counts[:, None, :] - counts[:, :, None] * np.eye(3, dtype=np.intp)
    return pairs / 30


def barycentric(triangle: FloatArray, points: FloatArray) -> FloatArray:
    """(…, 3): points (…, 2) as averages of a triangle's vertices (3, 2)."""
    return _barycentric(triangle, np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1))


def _barycentric(triangle: FloatArray, points: FloatArray) -> FloatArray:
    """(…, 3): the same of homogeneous points (…, 3). Dividend and divisor are exact for parameters."""
    opposite, doubled_area = barycentric_rows(triangle)
    return (points @ opposite) / (points[..., 2:] * doubled_area)


def barycentric_rows(triangle: FloatArray) -> tuple[FloatArray, float]:
    """(3, 3): from places (u, v, 1) to the weights of a triangle's vertices (3, 2) there, times twice its area; and
    that. They are exact for parameters."""
    (bx, by), (cx, cy) = np.roll(triangle, -1, axis=0).T, np.roll(triangle, -2, axis=0).T
    opposite = np.stack([by - cy, cx - bx, bx * cy - by * cx])
    return opposite, float(triangle[0] @ opposite[:2, 0] + opposite[2, 0])


def functionals(part: FloatArray, square: Square, triangle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(28, 16) and (28, 3): the coefficients of S and of T over a part (3, 2) of a triangle (3, 2).

    S by its Bernstein coefficients over the square that holds the part, T by its values at the triangle's vertices.
    """
    domain_points = counts_of(DEGREE).astype(np.float64) @ np.column_stack([part, np.ones(3)])
    return coefficients_over(square.from_parent(part)), _barycentric(triangle, domain_points)


@dataclass(frozen=True)
class Rows:
    """R functionals of N control points, each a coefficient of S - T over a part of a triangle of the template.

    matrix: (R, N); places: (R, 12) the six arguments at which the blossom is the coefficient, in parameters of the
    quad, in order. Parts that share a side have the same coefficients on it: S - T is continuous, and a polynomial
    there.
    """

    matrix: FloatArray
    places: FloatArray

    def of(self, surface: FloatArray, points: FloatArray) -> FloatArray:
        """(R, N): functionals of N numbers, of which the coefficients of S (16, N) and the quad's points (8 or more, N)
        are."""
        product: FloatArray = self.matrix[:, :16] @ surface + self.matrix[:, 16:] @ points[:8]
        return product

    def at(self, kept: BoolArray) -> Rows:
        """Some of them."""
        return Rows(np.ascontiguousarray(self.matrix[kept]), self.places[kept])

    @staticmethod
    def joined(parts: list[Rows]) -> Rows:
        """All of them, each once."""
        matrix, places = (np.concatenate(each) for each in zip(*((p.matrix, p.places) for p in parts), strict=True))
        return Rows(matrix, places).at(Rows.is_first(parts))

    @staticmethod
    def is_first(parts: list[Rows]) -> BoolArray:
        """(all of them,) which are no repetitions of others before."""
        places = np.concatenate([part.places for part in parts])
        found = np.zeros(len(places), dtype=bool)
        found[np.unique(places, axis=0, return_index=True)[1]] = True
        return found


def clipped(triangle: FloatArray, square: Square) -> list[FloatArray]:
    """The part of a triangle inside a square, as triangles (3, 2)."""
    corners = square.corners()
    polygon = list(triangle)
    for corner, following in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        side = following - corner
        heights = [float(side[0] * (p - corner)[1] - side[1] * (p - corner)[0]) for p in polygon]
        clipped = []
        for i, (point, height) in enumerate(zip(polygon, heights, strict=True)):
            previous, previous_height = polygon[i - 1], heights[i - 1]
            if height * previous_height < 0:
                # All of these are dyadic fractions, and the quotient is one: nothing is rounded.
                crossing = previous_height * point - height * previous
                clipped.append(crossing / (previous_height - height))
            if height >= 0:
                clipped.append(point)
        polygon = clipped
    fans = [np.array([polygon[0], b, c]) for b, c in pairwise(polygon[1:])]
    return [fan for fan in fans if _has_area(fan)]


def _has_area(triangle: FloatArray) -> bool:
    """Whether the corners (3, 2) are not on one line. numpy 2.5 takes no cross product of vectors in a plane."""
    one, other = triangle[1:] - triangle[0]
    return bool(one[0] * other[1] != one[1] * other[0])


def _quartered(triangle: FloatArray) -> list[FloatArray]:
    """A triangle's four quarters."""
    a, b, c = triangle
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return [np.array(part) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]


def square_at(path: int) -> Square:
    """The square that a path of children leads to, digits of base 4 after a leading 1."""
    square = WHOLE_QUAD
    for digit in np.base_repr(path, 4)[1:]:
        square = square.child(int(digit))
    return square


@lru_cache(maxsize=2048)
def template_rows(pattern: int, alternative: int, path: int, *, fine: bool = False) -> Rows:
    """S - T over a square for a whole template, as functionals of 24 numbers: 16 coefficients of S over the square, and
    the quad's 8 points.

    path: to the square, digits of base 4 after a leading 1. fine: over the quarters of each part.
    """
    square, rows = square_at(path), list[Rows]()
    for triangle in templates(pattern)[alternative]:
        for part in clipped(QUAD_POINTS[list(triangle)], square):
            rows += [_rows_over(piece, square, triangle) for piece in (_quartered(part) if fine else [part])]
    return Rows.joined(rows)


def _rows_over(part: FloatArray, square: Square, triangle: Triangle) -> Rows:
    """Those over a part (3, 2) of one triangle, without those at its vertices, where S - T is 0."""
    vertices = QUAD_POINTS[list(triangle)]
    of_surface, of_vertices = functionals(part, square, vertices)
    of_points = np.zeros((len(of_vertices), 8))
    of_points[:, list(triangle)] = of_vertices
    places = np.sort((part @ AS_COMPLEX)[arguments_of(DEGREE)], axis=1)
    kept = ~((places[:, 0] == places[:, -1]) & np.isin(places[:, 0], vertices @ AS_COMPLEX))
    return Rows(np.hstack([of_surface, -of_points]), places.view(np.float64)).at(kept)


@lru_cache(maxsize=256)
def bicubic_rows(pattern: int, alternative: int) -> FloatArray:
    """(R, 16): S - T over a bicubic quad with Bernstein coefficients [i, j] → 4i + j, u along i, by the triangles'
    quarters."""
    return template_rows(pattern, alternative, 1, fine=True).of(np.eye(16), BICUBIC_POINTS)


@dataclass(frozen=True)
class QuadraticRows:
    """S - T over a bicubic quad, split into the quadratic parts over whole triangles, and the rest.

    matrix: (Q + 10, 16), functionals for the quadratic parts, then the coefficients of S of monomials that are more
    than quadratic, T having none. weights: (10, 1) how far the monomials are off their own quadratic parts. The rest is
    no longer than the sum of the coefficients' lengths, so weighted.
    """

    matrix: FloatArray
    weights: FloatArray


@lru_cache(maxsize=256)
def quadratic_rows(pattern: int, alternative: int) -> QuadraticRows:
    """With Bernstein coefficients as for ``bicubic_rows``."""
    triangles = [QUAD_POINTS[list(triangle)] for triangle in templates(pattern)[alternative]]
    both = np.concatenate([*map(_off_at_middles, triangles), to_monomials()])
    return QuadraticRows(both, off_quadratic(triangles)[:, None])


def _off_at_middles(triangle: FloatArray) -> FloatArray:
    """(4, 16): S - T at the middles of a triangle's sides, and half the sum of these: the coefficients of the quadratic
    part over the triangle's quarters, but for zeros at the vertices."""
    values = _at_middles(triangle)
    sides = np.stack([values[i, j] - (values[i, i] + values[j, j]) / 2 for i, j in ((0, 1), (1, 2), (2, 0))])
    return np.concatenate([sides, sides.sum(axis=0, keepdims=True) / 2])


@dataclass(frozen=True)
class LastSquare:
    """Functionals of N points for the last square at an extraordinary vertex. matrix: (R, N), B - T over it, where B is
    the bilinear facet over the limits at its corners. differences: (2n + 10, N), the second differences of its net;
    S - B is no longer than the longest of these, times factor."""

    matrix: FloatArray
    differences: FloatArray
    factor: float


@dataclass(frozen=True)
class ExtraordinaryRows:
    """S - T over a quad with extraordinary corners, as functionals of N points. bicubic: (R, N), over bicubic pieces;
    last: what is left at each of these corners."""

    bicubic: FloatArray
    last: Sequence[LastSquare]


@lru_cache(maxsize=512)
def extraordinary_rows(valences: Valences, pattern: int, alternative: int) -> ExtraordinaryRows:
    """The rows for valences of 3 or more; the pattern is counted from the first corner on."""
    points, pieces = extraordinary_points(valences), quad_pieces(valences)
    each = _rows_of_pieces(pattern, alternative, tuple(path for path, _ in pieces.bicubic))
    rows = [own.of(surface, points) for own, (_, surface) in zip(each, pieces.bicubic, strict=True)]
    last = []
    for path, valence, net in pieces.last:
        facet = bilinear_coefficients(patch_stencils(valence).limits @ net).reshape(16, -1)
        of_facet = template_rows(pattern, alternative, path).of(facet, points)
        last.append(LastSquare(of_facet, differences_at_vertex(valence, net), certified_limit_factor(valence)))
    return ExtraordinaryRows(np.concatenate(rows), last)


@lru_cache(maxsize=512)
def _rows_of_pieces(pattern: int, alternative: int, paths: tuple[int, ...]) -> Sequence[Rows]:
    """``template_rows`` over the squares at some paths, what several of them share but once: the same for all valences
    that have these."""
    rows = [template_rows(pattern, alternative, path) for path in paths]
    is_kept = Rows.is_first(rows)
    starts = np.cumsum([len(own.places) for own in rows])[:-1]
    return [own.at(kept) for own, kept in zip(rows, np.split(is_kept, starts), strict=True)]


@dataclass(frozen=True)
class QuadPieces:
    """The parts of a quad with extraordinary corners, as functionals of its net of N points, with the paths to their
    squares. bicubic: (16, N), Bernstein coefficients; last: at each extraordinary corner its valence n and the net of
    the last square there, (2n + 8, N)."""

    bicubic: Sequence[tuple[int, FloatArray]]
    last: Sequence[tuple[int, int, FloatArray]]


def quad_pieces(valences: Valences) -> QuadPieces:
    """Of a quad with corners of these valences, on ``LEVELS_AT_VERTEX`` levels."""
    to_bernstein = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN)
    bicubic: list[tuple[int, FloatArray]] = []
    last: list[tuple[int, int, FloatArray]] = []
    for corner, (valence, net) in enumerate(zip(valences, quad_stencils(valences).children, strict=True)):
        if valence == 4:
            bicubic.append((4 + corner, to_bernstein @ net))
            continue
        stencils, path, smaller = patch_stencils(valence), 4 + corner, net
        for _ in range(1, LEVELS_AT_VERTEX):
            path *= 4
            for child, regular in enumerate(np.split(stencils.regular, 3), 1):
                bicubic.append((path + child, to_bernstein @ regular @ smaller))
            smaller = stencils.refined @ smaller
        last.append((path, valence, smaller))
    return QuadPieces(bicubic, last)


def differences_at_vertex(valence: int, net: FloatArray) -> FloatArray:
    """(2n + 10, …): the second differences of a net (2n + 8, …) at a vertex of valence n."""
    middles, ones, others = second_differences(valence)
    return 2 * net[middles] - net[ones] - net[others]


def extraordinary_points(valences: Valences) -> FloatArray:
    """(9, N): the points of a quad and its centre, on the limit surface, from its net."""
    stencils = quad_stencils(valences)
    to_bernstein = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN)
    corners = [
        (to_bernstein[CORNER_COEFFICIENTS] if valence == 4 else patch_stencils(valence).limits) @ net
        for valence, net in zip(valences, stencils.children, strict=True)
    ]
    middles = [
        corners[side][1] if valence == 4 else corners[(side + 1) % 4][3] for side, valence in enumerate(valences)
    ]
    return np.concatenate([stencils.limits, middles, corners[1][2:3]])


# (9, 16): the points of a bicubic quad and its centre from its Bernstein coefficients.
BICUBIC_POINTS = bicubic_basis(np.concatenate([QUAD_POINTS, [[0.5, 0.5]]]))


def bicubic_distances(rows: FloatArray, coefficients: FloatArray, chosen: IndexArray) -> FloatArray:
    """(n,): upper bounds of ‖S - T‖, for chosen ones of Bernstein coefficients (16, P, 3)."""
    return longest(transformed_nets(rows, selected_vectors(coefficients, chosen)))


def quadratic_distances(
    rows: QuadraticRows, coefficients: FloatArray, chosen: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """(n,) twice: upper bounds of the lengths of the quadratic parts, and of the rest, to be added; for chosen ones as
    in ``bicubic_distances``."""
    vectors = transformed_nets(rows.matrix, selected_vectors(coefficients, chosen))
    rest = np.sqrt(squared_norms(vectors[-len(rows.weights) :]))
    rest *= rows.weights
    return longest(vectors[: -len(rows.weights)]), rest.sum(axis=0)


def longest(vectors: FloatArray) -> FloatArray:
    """(P,): the largest length of vectors (R, P, 3), which are overwritten."""
    vectors *= vectors
    squares = vectors[..., 0]
    squares += vectors[..., 1]
    squares += vectors[..., 2]
    return np.sqrt(squares.max(axis=0))


def extraordinary_distances(rows: ExtraordinaryRows, nets: FloatArray) -> FloatArray:
    """(P,): upper bounds of ‖S - T‖, for points (N, P, 3)."""
    found = longest(transformed_nets(rows.bicubic, nets))
    for last in rows.last:
        left, differences = (longest(transformed_nets(each, nets)) for each in (last.matrix, last.differences))
        np.maximum(found, left + last.factor * differences, out=found)
    return found
