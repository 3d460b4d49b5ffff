# SPDX-License-Identifier: GPL-3.0-or-later
"""Error bounds over faces of any kind, by refinement (docs/adaptive.md, Any other quad).

A quad's descendants (``descent``) are squares in its parameters. A bicubic one is compared in Bernstein form. Any
other is compared by way of the bilinear facet over its control points, which is within a known distance of the surface,
and refined again while that decides. They are compared

- with the triangles of a template: where a square lies in one of them, that is linear over it; where the template's
  lines cut it, by the matrices of its parts (``triangle_bounds``);
- or with bilinear facets.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ...arrays.types import FloatArray, IndexArray
from ...arrays.vectors import selected_vectors, squared_dots, squared_norms, transformed_nets
from ...surface.bicubic import facet_coefficients
from ..templates import COUNTS, QUAD_POINTS, template_groups, templates
from .descent import Descent, Pieces, Squares
from .triangle_bounds import ErrorBounds, barycentric_rows, template_rows
from .triangle_shapes import triangle_normals

# After so many the rest of a quad around an irregular vertex is small against the quad.
REFINEMENTS = 8

# Weights and lengths are small multiples of dyadic fractions; anything less is rounding.
NOTHING = 1e-9

# Where a bound along the normals is needed, facets have to be within this part of the limit.
NEAR_FACET = 1 / 18


# The triangles of a template.
MOST_TRIANGLES = 5

# Error bounds over squares with Bernstein coefficients (16, N, 3), (N,) each.
Comparison = Callable[[FloatArray, Squares], ErrorBounds]


def template_error_bounds(
    descent: Descent,
    chosen: IndexArray,
    points: FloatArray,
    numbers: IndexArray,
    limit: float,
    room: FloatArray | None = None,
) -> ErrorBounds:
    """(P,): upper bounds of ‖S - T‖, for P chosen quads and the triangles of a template each.

    descent: of quads, which are its bases. points: (8 or more, P, 3), as in ``templates.QUAD_POINTS``. numbers: (P,),
    of the templates (``templates.template_numbers``). For limit and room see ``_descended_error_bounds``.
    """
    normals = np.zeros_like(points, shape=(MOST_TRIANGLES, *points.shape[1:]))
    for pattern, alternative, own in template_groups(numbers):
        template = templates(pattern)[alternative]
        normals[: len(template), own] = triangle_normals(selected_vectors(points, own), template)

    def compare(coefficients: FloatArray, squares: Squares) -> ErrorBounds:
        return _off_templates(coefficients, squares, points, numbers, normals)

    return _descended_error_bounds(descent, chosen, chosen, compare, limit, room)


def fan_error_bounds(
    descent: Descent,
    chosen: IndexArray,
    quarters: IndexArray,
    facets: FloatArray,
    normals: FloatArray,
    limit: float,
    room: FloatArray | None = None,
) -> ErrorBounds:
    """(C,): upper bounds of ‖S - F‖, for the quarters (C,) of chosen faces and bilinear facets over their corners
    (4, C, 3).

    descent: of faces whose quarters are its bases. normals: (T, C, 3), those of all triangles there. For limit and room
    see ``_descended_error_bounds``.
    """

    def compare(coefficients: FloatArray, squares: Squares) -> ErrorBounds:
        return _off_facets(coefficients, squares, facets, normals)

    return _descended_error_bounds(descent, chosen, quarters, compare, limit, room)


def _descended_error_bounds(
    descent: Descent,
    chosen: IndexArray,
    bases: IndexArray,
    compare: Comparison,
    limit: float,
    room: FloatArray | None,
) -> ErrorBounds:
    """(bases,) error bounds over the bases of chosen faces; ``compare`` has bases by their index here.

    Without room they are as tight as it takes to compare the whole error with the limit. With room (bases,) they are
    tight along the normals, and compare the error along the normals with the limit, and the errors along and across
    together with the room. Of a quad that exceeds one of these the bounds say nothing more.
    """
    found = ErrorBounds(*(np.zeros(len(bases)) for _ in range(3)))
    wanted = descent.start(chosen)
    for level in range(REFINEMENTS):
        pieces = descent.pieces(level, wanted)
        squares, near = replace(pieces.squares, bases=np.searchsorted(bases, pieces.squares.bases)), pieces.near
        is_last = level == REFINEMENTS - 1
        if room is None:
            left = compare(pieces.coefficients, squares)
            reached = left + ErrorBounds(near, near, near)
            exact = np.flatnonzero(near == 0)
            _raise(found, squares.at(exact), left.at(exact))
            beyond = found.whole > limit
            beyond[squares.bases[left.whole - near > limit]] = True
            settled = (reached.whole <= limit) | (near == 0) | beyond[squares.bases] | is_last
            _raise(found, squares.at(np.flatnonzero(settled)), reached.at(np.flatnonzero(settled)))
        else:
            # What is not near enough is refined, whatever it is compared with, unless its quad exceeds the limit.
            settled = (near <= NEAR_FACET * limit) | is_last
            _compare_and_raise(found, pieces, squares, np.flatnonzero(settled), compare)
            beyond = (found.normal > limit) | (found.normal + found.tangential > room)
            left_out = np.flatnonzero(beyond[squares.bases] & ~settled)
            _compare_and_raise(found, pieces, squares, left_out, compare)
            settled[left_out] = True
        if np.all(settled):
            break
        wanted = descent.children(level, wanted[~settled])
    return found


def _compare_and_raise(
    found: ErrorBounds, pieces: Pieces, squares: Squares, chosen: IndexArray, compare: Comparison
) -> None:
    """Raise the bounds of quads to those of chosen pieces over squares."""
    if len(chosen):
        near, own = pieces.near[chosen], squares.at(chosen)
        left = compare(selected_vectors(pieces.coefficients, chosen), own)
        _raise(found, own, left + ErrorBounds(near, near, near))


def _raise(found: ErrorBounds, squares: Squares, error_bounds: ErrorBounds) -> None:
    """Raise the bounds of each quad to those of its squares."""
    np.maximum.at(found.whole, squares.bases, error_bounds.whole)
    np.maximum.at(found.normal, squares.bases, error_bounds.normal)
    np.maximum.at(found.tangential, squares.bases, error_bounds.tangential)


def _off_facets(coefficients: FloatArray, squares: Squares, facets: FloatArray, normals: FloatArray) -> ErrorBounds:
    """(N,): error bounds of facets (4, C, 3) over squares with Bernstein coefficients (16, N, 3)."""
    found = ErrorBounds(*(np.zeros(len(squares.bases)) for _ in range(3)))
    u, v = squares.corners().transpose(2, 0, 1)
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
    over = np.einsum("kcn,kni->cni", weights, facets[:, squares.bases])
    vectors = coefficients - facet_coefficients(over)
    for of_triangle in normals:
        _raise_at(found, np.arange(len(squares.bases)), vectors, of_triangle[squares.bases])
    return found


def _off_templates(
    coefficients: FloatArray, squares: Squares, points: FloatArray, numbers: IndexArray, normals: FloatArray
) -> ErrorBounds:
    """(N,): error bounds of templates over squares with Bernstein coefficients (16, N, 3). points, numbers and normals
    of the squares' bases: as in ``template_error_bounds``, and (MOST_TRIANGLES, P, 3)."""
    found, tables = ErrorBounds(*(np.zeros(len(squares.bases)) for _ in range(3))), _triangle_tables()
    own = numbers[squares.bases]
    weights = tables.weights(own, squares.corners())
    covered = np.all(weights >= -NOTHING, axis=(2, 3))
    inside = np.flatnonzero(np.any(covered, axis=0))
    triangles = covered[:, inside].argmax(axis=0)
    bases = squares.bases[inside]
    vertices = points[tables.vertices[own[inside], triangles].T, bases]
    flat = np.einsum("nck,kni->cni", weights[triangles, inside], vertices)
    vectors = selected_vectors(coefficients, inside) - facet_coefficients(flat)
    _raise_at(found, inside, vectors, normals[triangles, bases])
    cut = np.flatnonzero(~np.any(covered, axis=0))
    # Paths are longer than the leading digit, so they and templates have numbers together.
    keys = squares.paths[cut] * tables.count + own[cut]
    for key in np.unique(keys).tolist():
        path, number = divmod(key, tables.count)
        chosen = cut[keys == key]
        rows, bases = template_rows(number % 16, number // 16, path), squares.bases[chosen]
        given = np.concatenate([selected_vectors(coefficients, chosen), selected_vectors(points[:8], bases)])
        vectors = transformed_nets(rows.matrix, given)
        found.put(chosen, ErrorBounds.of(vectors, rows.triangles, selected_vectors(normals, bases)))
    return found


@dataclass(frozen=True)
class _TriangleTables:
    """By the number of a template: how many triangles it has (count,); and of each triangle the vertices (count,
    MOST_TRIANGLES, 3), and their weights at a place, linear functions of (u, v, 1), (count, MOST_TRIANGLES, 3, 3),
    times areas (count, MOST_TRIANGLES). A triangle that a template does not have weighs -1 everywhere."""

    counts: IndexArray
    vertices: IndexArray
    linear: FloatArray
    areas: FloatArray

    @property
    def count(self) -> int:
        return len(self.areas)

    def weights(self, numbers: IndexArray, places: FloatArray) -> FloatArray:
        """(T, N, C, 3), at places (C, N, 2), of the triangles of templates (N,)."""
        most = int(self.counts[numbers].max(initial=1))
        linear = self.linear[numbers, :most].transpose(2, 1, 0, 3)[:, :, :, None]
        u, v = places.transpose(2, 1, 0)[..., None]
        # Dividends and divisors are exact for parameters.
        return (u * linear[0] + v * linear[1] + linear[2]) / self.areas[numbers, :most].T[:, :, None, None]


@cache
def _triangle_tables() -> _TriangleTables:
    count = 16 * int(COUNTS.max())
    counts, vertices = np.zeros(count, dtype=np.intp), np.zeros((count, MOST_TRIANGLES, 3), dtype=np.intp)
    linear, areas = np.zeros((count, MOST_TRIANGLES, 3, 3)), np.ones((count, MOST_TRIANGLES))
    linear[:, :, 2] = -1.0
    for pattern in np.flatnonzero(COUNTS).tolist():
        for alternative, template in enumerate(templates(pattern)):
            number = 16 * alternative + pattern
            counts[number] = len(template)
            for place, triangle in enumerate(template):
                vertices[number, place] = triangle
                linear[number, place], areas[number, place] = barycentric_rows(QUAD_POINTS[list(triangle)])
    return _TriangleTables(counts, vertices, linear, areas)


def _raise_at(found: ErrorBounds, chosen: IndexArray, vectors: FloatArray, normals: FloatArray) -> None:
    """Raise the bounds of some squares to vectors (R, n, 3), over triangles with unit normals (n, 3)."""
    squares, along = squared_norms(vectors), squared_dots(vectors, normals)
    across = np.maximum(squares - along, 0.0)
    for values, own in ((found.whole, squares), (found.normal, along), (found.tangential, across)):
        values[chosen] = np.maximum(values[chosen], np.sqrt(own.max(axis=0, initial=0.0)))
