# SPDX-License-Identifier: GPL-3.0-or-later
"""What the triangles of a template miss of the surface: bounds for a quad as it is really drawn (docs/adaptive.md).

The triangles' vertices lie on the surface, at their own parameters; the distance is measured at equal parameters, so it
holds in both directions. Over a piece of the surface that is bicubic, S - T on a part of a triangle is a polynomial of
total degree 6, and no longer than the longest of its 28 Bernstein coefficients over that part. These are linear in the
control net, so a template is a matrix for each kind of net:

- a bicubic quad: 16 Bernstein coefficients, by the quarters of triangles. Where S - T is nearly quadratic it is enough
  to take it apart: the quadratic polynomial with its values at the vertices and the middles of the sides, and the rest,
  monomial by monomial;
- a quad at an extraordinary vertex: its net, by way of the bicubic pieces of some levels (``stencils``); what is left
  at the vertex is compared with its bilinear facet, which is within a known part of the second-order norm.

Any other quad is refined first (``refined_bounds``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import pairwise
from math import factorial

import numpy as np

from .blocks import blocks
from .bounds import certified_limit_factor
from .coordinates import applied, chosen_vectors
from .mesh import FloatArray, IndexArray
from .norms import second_differences, squared_dots, squared_norms
from .splines import SPLINE_TO_BERNSTEIN, bilinear_coefficients, tensor
from .stencils import patch_stencils
from .templates import QUAD_POINTS, templates

DEGREE = 6

# A row, or a part of a triangle, that is less is nothing but rounding.
ROW_ROUNDING = 1e-12

# The monomials (u - 1/2)^i (v - 1/2)^j → 4i + j that are more than quadratic; and how often a triangle is quartered to
# find how far these are off their quadratic parts: once more would tell 1 % less.
BEYOND_QUADRATIC = [4 * i + j for i in range(4) for j in range(4) if i + j > 2]
QUARTERINGS = 3

# The Bernstein coefficients, of 16 in [i, j] → 4i + j, that are the values at corners 0 to 3.
CORNER_COEFFICIENTS = [0, 12, 15, 3]

# A quarter turn, counter-clockwise, of row vectors.
QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])

# How many levels of bicubic pieces are looked at around an extraordinary vertex; and in a closer look, on how many of
# them by the quarters of triangles: farther in that would make no difference any more.
COARSE_LEVELS = 2
FINE_LEVELS = 5
QUARTERED_LEVELS = 2

# Coefficients, as numbers, that are looked at together, and quads at least.
VALUES_AT_ONCE = 1 << 18
FEWEST_AT_ONCE = 64


@dataclass(frozen=True)
class Square:
    """A square part of a quad's parameters: where its corner 0 lies, and its sides from there as rows (2, 2)."""

    origin: FloatArray
    axes: FloatArray

    def from_parent(self, points: FloatArray) -> FloatArray:
        """(N, 2) parameters of the quad as parameters of the square."""
        return (points - self.origin) @ self.axes.T / (self.axes[0] @ self.axes[0])

    def corners(self) -> FloatArray:
        return self.origin + QUAD_POINTS[:4] @ self.axes

    def child(self, number: int) -> Square:
        """The quarter at a corner, which is its own corner 0."""
        axes = np.linalg.matrix_power(QUARTER_TURN, number) @ self.axes / 2
        return Square(self.origin + QUAD_POINTS[number] @ self.axes, axes)


WHOLE_QUAD = Square(np.zeros(2), np.eye(2))


@cache
def _domain(degree: int) -> FloatArray:
    """(28 for degree 6, 3): barycentric coordinates of the domain points of a polynomial's Bernstein coefficients."""
    return np.array([(i, j, degree - i - j) for i in range(degree + 1) for j in range(degree + 1 - i)]) / degree


def _bernstein_basis(degree: int, points: FloatArray) -> FloatArray:
    """(N, 28 for degree 6): the Bernstein polynomials over a triangle at barycentric coordinates (N, 3)."""
    exponents = np.rint(_domain(degree) * degree).astype(int)
    multinomials = [factorial(degree) / (factorial(i) * factorial(j) * factorial(k)) for i, j, k in exponents.tolist()]
    return np.prod(points[:, None, :] ** exponents[None, :, :], axis=2) * np.array(multinomials)


@cache
def _values_to_coefficients(degree: int) -> FloatArray:
    """(28, 28) for degree 6: from the values of a polynomial at the domain points to its Bernstein coefficients."""
    return np.linalg.inv(_bernstein_basis(degree, _domain(degree)))


@cache
def _quadratic_part() -> FloatArray:
    """(24, 28): from the Bernstein coefficients of f over a triangle to those of its quadratic part over the four
    quarters of it, six each.

    The quadratic part has the values of f at the vertices and the middles of the sides. It is no longer than the
    longest of these coefficients.
    """
    to_quadratic = _values_to_coefficients(2) @ _bernstein_basis(DEGREE, _domain(2))
    over_quarters = [
        _values_to_coefficients(2) @ _bernstein_basis(2, _domain(2) @ quarter) for quarter in _quartered(np.eye(3))
    ]
    return np.concatenate(over_quarters) @ to_quadratic


def _monomials(points: FloatArray) -> FloatArray:
    """(N, 16): (u - 1/2)^i (v - 1/2)^j → 4i + j at parameters (N, 2)."""
    along, across = np.moveaxis((points - 0.5)[..., None] ** np.arange(4), 1, 0)
    return np.einsum("ni,nj->nij", along, across).reshape(len(points), 16)


@cache
def to_monomials() -> FloatArray:
    """(10, 16): from Bernstein coefficients to those of the ``_monomials`` that are more than quadratic."""
    grid = np.stack(np.divmod(np.arange(16), 4), axis=1) / 3
    return (np.linalg.inv(_monomials(grid)) @ bicubic_basis(grid))[BEYOND_QUADRATIC]


def off_quadratic(triangles: list[FloatArray]) -> FloatArray:
    """(10,): how far each of these monomials is off its own quadratic part, over all of some triangles (3, 2), at most:
    by Bernstein coefficients over parts of these."""
    largest = np.zeros(len(BEYOND_QUADRATIC))
    for triangle in triangles:
        quadratic = _values_to_coefficients(2) @ _monomials(_domain(2) @ triangle)[:, BEYOND_QUADRATIC]
        parts = [triangle]
        for _ in range(QUARTERINGS):
            parts = [quarter for part in parts for quarter in _quartered(part)]
        for part in parts:
            points = _domain(DEGREE) @ part
            values = _monomials(points)[:, BEYOND_QUADRATIC]
            values -= _bernstein_basis(2, _barycentric(triangle, points)) @ quadratic
            largest = np.maximum(largest, np.abs(_values_to_coefficients(DEGREE) @ values).max(axis=0))
    return largest


def bicubic_basis(points: FloatArray) -> FloatArray:
    """(N, 16): the bicubic Bernstein basis at parameters (N, 2)."""

    def cubic(x: FloatArray) -> FloatArray:
        return np.stack([(1 - x) ** 3, 3 * x * (1 - x) ** 2, 3 * x * x * (1 - x), x**3], axis=1)

    return np.einsum("ni,nj->nij", cubic(points[:, 0]), cubic(points[:, 1])).reshape(len(points), 16)


def _barycentric(triangle: FloatArray, points: FloatArray) -> FloatArray:
    """(N, 3): points (N, 2) as averages of a triangle's vertices (3, 2)."""
    square = np.column_stack([triangle, np.ones(3)])
    return np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(square)


def _functionals(part: FloatArray, square: Square, triangle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(28, 16) and (28, 3): the coefficients of S and of T over a part (3, 2) of a triangle (3, 2).

    S by its Bernstein coefficients over the square that holds the part, T by its values at the triangle's vertices.
    """
    points = _domain(DEGREE) @ part
    of_surface = _values_to_coefficients(DEGREE) @ bicubic_basis(square.from_parent(points))
    return of_surface, _barycentric(triangle, points)


@dataclass(frozen=True)
class Rows:
    """R functionals of N control points. matrix: (R, N); triangles: (R,) which triangle of the template each is for."""

    matrix: FloatArray
    triangles: IndexArray

    def of(self, surface: FloatArray, points: FloatArray) -> Rows:
        """Functionals of the coefficients of S and the quad's points, where S is (16, N) and the points (8 or more, N):
        as functionals of N numbers."""
        return Rows(self.matrix[:, :16] @ surface + self.matrix[:, 16:] @ points[:8], self.triangles)

    @staticmethod
    def joined(parts: list[Rows]) -> Rows:
        """All of them, triangle by triangle, without zeros and what is there already, with whatever sign."""
        matrix = np.concatenate([part.matrix for part in parts])
        triangles = np.concatenate([part.triangles for part in parts])
        kept = np.flatnonzero(np.abs(matrix).max(axis=1) > ROW_ROUNDING)
        kept = kept[np.argsort(triangles[kept], kind="stable")]
        matrix, triangles = matrix[kept], triangles[kept]
        first = np.argmax(np.abs(matrix) > ROW_ROUNDING, axis=1)
        upwards = matrix * np.sign(np.take_along_axis(matrix, first[:, None], axis=1))
        rounded = np.round(np.column_stack([triangles, upwards]) / ROW_ROUNDING)
        _, kept = np.unique(rounded, axis=0, return_index=True)
        kept.sort()
        return Rows(np.ascontiguousarray(matrix[kept]), triangles[kept])


@dataclass(frozen=True)
class Misses:
    """How far P quads are from the surface, (P,) float64 each: in all, along the normals of their triangles, and across
    these."""

    whole: FloatArray
    normal: FloatArray
    tangential: FloatArray

    @staticmethod
    def of(vectors: FloatArray, triangles: IndexArray, normals: FloatArray) -> Misses:
        """Of vectors (R, P, 3) that belong to triangles, in ascending order, with unit normals (T, P, 3)."""
        largest = np.zeros((3, vectors.shape[1]))
        starts = np.searchsorted(triangles, np.arange(len(normals) + 1)).tolist()
        for triangle, (start, end) in enumerate(pairwise(starts)):
            if start == end:
                continue
            own = vectors[start:end]
            along, squares = squared_dots(own, normals[triangle]), squared_norms(own)
            for most, values in zip(largest, (squares, along, squares - along), strict=True):
                np.maximum(most, values.max(axis=0), out=most)
        return Misses(*np.sqrt(largest))

    @staticmethod
    def joined(parts: list[Misses]) -> Misses:
        """Those of all quads, block after block."""
        return Misses(
            np.concatenate([part.whole for part in parts]),
            np.concatenate([part.normal for part in parts]),
            np.concatenate([part.tangential for part in parts]),
        )

    def __add__(self, other: Misses) -> Misses:
        return Misses(self.whole + other.whole, self.normal + other.normal, self.tangential + other.tangential)

    def at(self, chosen: IndexArray) -> Misses:
        """Some of them, by index."""
        return Misses(self.whole[chosen], self.normal[chosen], self.tangential[chosen])

    def put(self, chosen: IndexArray, other: Misses) -> None:
        """Replace some of them."""
        self.whole[chosen], self.normal[chosen], self.tangential[chosen] = other.whole, other.normal, other.tangential

    def or_more(self, other: Misses) -> Misses:
        """The larger of both."""
        return Misses(
            np.maximum(self.whole, other.whole),
            np.maximum(self.normal, other.normal),
            np.maximum(self.tangential, other.tangential),
        )

    def columns(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """In all, along the normals, and across."""
        return self.whole, self.normal, self.tangential

    def times(self, factor: float) -> Misses:
        return Misses(factor * self.whole, factor * self.normal, factor * self.tangential)


def _clipped(triangle: FloatArray, square: Square) -> list[FloatArray]:
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
                clipped.append(previous + (point - previous) * (previous_height / (previous_height - height)))
            if height >= 0:
                clipped.append(point)
        polygon = clipped
    fans = [np.array([polygon[0], b, c]) for b, c in pairwise(polygon[1:])]
    return [fan for fan in fans if abs(np.linalg.det(fan[1:] - fan[0])) > ROW_ROUNDING]


def _quartered(triangle: FloatArray) -> list[FloatArray]:
    """A triangle's four quarters."""
    a, b, c = triangle
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return [np.array(part) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]


def _square_at(path: int) -> Square:
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
    square, matrices, triangles = _square_at(path), [np.zeros((0, 24))], [np.zeros(0, dtype=np.intp)]
    for number, triangle in enumerate(templates(pattern)[alternative]):
        places = QUAD_POINTS[list(triangle)]
        for part in _clipped(places, square):
            for piece in _quartered(part) if fine else [part]:
                of_surface, of_vertices = _functionals(piece, square, places)
                of_points = np.zeros((len(of_vertices), 8))
                of_points[:, list(triangle)] = of_vertices
                matrices.append(np.hstack([of_surface, -of_points]))
                triangles.append(np.full(len(of_surface), number))
    return Rows(np.concatenate(matrices), np.concatenate(triangles))


@lru_cache(maxsize=256)
def regular_rows(pattern: int, alternative: int) -> Rows:
    """S - T over a bicubic quad with Bernstein coefficients [i, j] → 4i + j, u along i, by the triangles' quarters."""
    return Rows.joined([template_rows(pattern, alternative, 1, fine=True).of(np.eye(16), regular_points())])


@dataclass(frozen=True)
class QuadraticRows:
    """S - T over a bicubic quad, taken apart into the quadratic parts over whole triangles, and the rest.

    matrix: (Q + 10, 16), functionals for the quadratic parts, then the coefficients of S of monomials that are more
    than quadratic, T having none. triangles: (Q,) as in ``Rows``. weights: (10, 1) how far the monomials are off their
    own quadratic parts. The rest is no longer than the sum of the coefficients' lengths, so weighted.
    """

    matrix: FloatArray
    triangles: IndexArray
    weights: FloatArray


@lru_cache(maxsize=256)
def quadratic_rows(pattern: int, alternative: int) -> QuadraticRows:
    """With Bernstein coefficients as for ``regular_rows``."""
    rows = template_rows(pattern, alternative, 1).of(np.eye(16), regular_points())
    coefficients = rows.matrix.reshape(-1, len(_domain(DEGREE)), 16)
    triangles = rows.triangles.reshape(len(coefficients), -1)[:, 0]
    matrix = (_quadratic_part() @ coefficients).reshape(-1, 16)
    quadratic = Rows.joined([Rows(matrix, np.repeat(triangles, len(_quadratic_part())))])
    both = np.concatenate([quadratic.matrix, to_monomials()])
    weights = off_quadratic([QUAD_POINTS[list(triangle)] for triangle in templates(pattern)[alternative]])
    return QuadraticRows(both, quadratic.triangles, weights[:, None])


@dataclass(frozen=True)
class ExtraordinaryRows:
    """S - T over a quad whose corner 0 is extraordinary, as functionals of its net of 2n + 8 points.

    pieces: over bicubic pieces. last: B - T over what is left at the vertex; differences: (2n + 10, 2n + 8), the second
    differences of its net, which bound S - B.
    """

    pieces: Rows
    last: Rows
    differences: FloatArray


@lru_cache(maxsize=512)
def extraordinary_rows(valence: int, pattern: int, alternative: int, *, fine: bool) -> ExtraordinaryRows:
    """The rows for a valence of 3, 5 or more; the pattern is counted from the extraordinary corner on."""
    stencils = patch_stencils(valence)
    points = extraordinary_points(valence)
    to_bernstein = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN)
    net, rows = np.eye(2 * valence + 8), []
    levels = FINE_LEVELS if fine else COARSE_LEVELS
    for level in range(1, levels + 1):
        for child in (1, 2, 3):
            surface = to_bernstein @ stencils.regular[16 * (child - 1) : 16 * child] @ net
            quartered = fine and level <= QUARTERED_LEVELS
            rows.append(template_rows(pattern, alternative, 4**level + child, fine=quartered).of(surface, points))
        net = stencils.refined @ net
    facet = bilinear_coefficients(stencils.limits @ net).reshape(16, -1)
    last = Rows.joined([template_rows(pattern, alternative, 4**levels).of(facet, points)])
    differences = np.array([2 * net[a] - net[b] - net[c] for a, b, c in second_differences(valence)])
    return ExtraordinaryRows(Rows.joined(rows), last, differences)


@lru_cache(maxsize=64)
def extraordinary_points(valence: int) -> FloatArray:
    """(9, 2n + 8): the points of a quad and its centre, on the limit surface, from its net."""
    stencils = patch_stencils(valence)
    corner_rows = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN)[CORNER_COEFFICIENTS]
    first, second, third = (corner_rows @ net for net in stencils.regular.reshape(3, 16, -1))
    return np.concatenate([stencils.limits, [first[3], first[1], second[1], third[1]], first[2:3]])


@cache
def regular_points() -> FloatArray:
    """(9, 16): the points of a quad and its centre from its Bernstein coefficients."""
    return bicubic_basis(np.concatenate([QUAD_POINTS, [[0.5, 0.5]]]))


def regular_misses(rows: Rows, coefficients: FloatArray, normals: FloatArray) -> Misses:
    """‖S - T‖ at most, for Bernstein coefficients (16, P, 3) and the triangles' normals (T, P, 3)."""
    return Misses.joined(
        [
            Misses.of(applied(rows.matrix, coefficients[:, block]), rows.triangles, normals[:, block])
            for block in blocks(coefficients.shape[1], at_once(len(rows.matrix)))
        ]
    )


def regular_distances(rows: Rows, coefficients: FloatArray, chosen: IndexArray) -> FloatArray:
    """(n,): the same in all, for chosen ones of Bernstein coefficients (16, P, 3)."""
    found = np.empty(len(chosen))
    for block in blocks(len(chosen), at_once(len(rows.matrix))):
        found[block] = _longest(applied(rows.matrix, chosen_vectors(coefficients, chosen[block])))
    return found


def quadratic_misses(rows: QuadraticRows, coefficients: FloatArray, normals: FloatArray) -> tuple[Misses, Misses]:
    """‖S - T‖ at most, as the sum of two: what the quadratic parts miss, and the rest. As for ``regular_misses``."""
    found = [
        _quadratic_misses(rows, coefficients[:, block], normals[:, block])
        for block in blocks(coefficients.shape[1], at_once(len(rows.matrix)))
    ]
    return Misses.joined([quadratic for quadratic, _ in found]), Misses.joined([rest for _, rest in found])


def _quadratic_misses(rows: QuadraticRows, coefficients: FloatArray, normals: FloatArray) -> tuple[Misses, Misses]:
    vectors = applied(rows.matrix, coefficients)
    quadratic = Misses.of(vectors[: len(rows.triangles)], rows.triangles, normals)
    return quadratic, rest_misses(vectors[len(rows.triangles) :], rows.weights, normals)


def rest_misses(monomials: FloatArray, weights: FloatArray, normals: FloatArray) -> Misses:
    """What coefficients (10, P, 3) of monomials, with weights (10, P) or (10, 1) for how far these are off their
    quadratic parts, add for triangles with unit normals (T, P, 3)."""
    squares = squared_norms(monomials)
    rest = Misses(_weighted(weights, squares), *np.zeros((2, len(normals[0]))))
    for normal in normals:
        along = squared_dots(monomials, normal)
        np.maximum(rest.normal, _weighted(weights, along), out=rest.normal)
        np.maximum(rest.tangential, _weighted(weights, np.maximum(squares - along, 0.0)), out=rest.tangential)
    return rest


def _weighted(weights: FloatArray, squares: FloatArray) -> FloatArray:
    """(P,): the sum of lengths, from their squares (10, P)."""
    lengths = np.sqrt(squares)
    lengths *= weights
    return lengths.sum(axis=0)


def quadratic_distances(
    rows: QuadraticRows, coefficients: FloatArray, chosen: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """(n,) twice: the same in all, for chosen ones of Bernstein coefficients (16, P, 3)."""
    quadratic, rest = np.empty((2, len(chosen)))
    for block in blocks(len(chosen), at_once(len(rows.matrix))):
        vectors = applied(rows.matrix, chosen_vectors(coefficients, chosen[block]))
        rest[block] = _weighted(rows.weights, squared_norms(vectors[len(rows.triangles) :]))
        quadratic[block] = _longest(vectors[: len(rows.triangles)])
    return quadratic, rest


def _longest(vectors: FloatArray) -> FloatArray:
    """(P,): the largest length of vectors (R, P, 3), which are overwritten."""
    vectors *= vectors
    squares = vectors[..., 0]
    squares += vectors[..., 1]
    squares += vectors[..., 2]
    return np.sqrt(squares.max(axis=0))


def extraordinary_misses(rows: ExtraordinaryRows, nets: FloatArray, normals: FloatArray) -> Misses:
    """‖S - T‖ at most, for nets (2n + 8, P, 3) and the triangles' normals (T, P, 3)."""
    return Misses.joined(
        [
            _extraordinary_misses(rows, nets[:, block], normals[:, block])
            for block in blocks(nets.shape[1], at_once(len(rows.pieces.matrix)))
        ]
    )


def _extraordinary_misses(rows: ExtraordinaryRows, nets: FloatArray, normals: FloatArray) -> Misses:
    """At the vertex S - B is within a factor of the second differences; so is each component of it within theirs."""
    valence = (len(nets) - 8) // 2
    pieces = Misses.of(applied(rows.pieces.matrix, nets), rows.pieces.triangles, normals)
    differences = applied(rows.differences, nets)
    left = Misses.of(applied(rows.last.matrix, nets), rows.last.triangles, normals)
    at_vertex = Misses(*(np.zeros(nets.shape[1]) for _ in range(3)))
    for triangle in np.unique(rows.last.triangles).tolist():
        own = np.full(len(differences), triangle)
        found = Misses.of(differences, own, normals)
        at_vertex = at_vertex.or_more(found.times(certified_limit_factor(valence)))
    return pieces.or_more(left + at_vertex)


def at_once(rows: int) -> int:
    """How many quads have so many coefficients that these stay in the processor's cache."""
    return max(FEWEST_AT_ONCE, VALUES_AT_ONCE // (3 * rows))
