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
from dataclasses import replace

import numpy as np

from ...arrays.types import FloatArray, IndexArray
from ...arrays.vectors import squared_norms, transformed_nets
from ...surface.bicubic import bilinear_coefficients
from ..templates import QUAD_POINTS, templates
from .descent import Descent, Squares
from .triangle_bounds import ErrorBounds, barycentric, template_rows

# After so many the rest of a quad around an irregular vertex is small against the quad.
REFINEMENTS = 8

# Weights and lengths are small multiples of dyadic fractions; anything less is rounding.
NOTHING = 1e-9

# Where a bound along the normals is needed, facets have to be within this part of the limit.
NEAR_FACET = 1 / 16


# Error bounds over squares with Bernstein coefficients (16, N, 3), (N,) each.
Comparison = Callable[[FloatArray, Squares], ErrorBounds]


def template_error_bounds(
    descent: Descent,
    chosen: IndexArray,
    points: FloatArray,
    key: tuple[int, int],
    normals: FloatArray,
    limit: float,
    room: FloatArray | None = None,
) -> ErrorBounds:
    """(P,): upper bounds of ‖S - T‖, for P chosen quads and the triangles of a template.

    descent: of quads, which are its bases. points: (8 or more, P, 3), as in ``templates.QUAD_POINTS``; key: pattern and
    alternative; normals: (T, P, 3), of the triangles. For limit and room see ``_descended_error_bounds``.
    """

    def compare(coefficients: FloatArray, squares: Squares) -> ErrorBounds:
        return _off_template(coefficients, squares, points, key, normals)

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
        left = compare(pieces.coefficients, squares)
        exact = np.flatnonzero(near == 0)
        _raise(found, squares.at(exact), left.at(exact))
        reached = left + ErrorBounds(near, near, near)
        if room is None:
            beyond, seen_beyond, enough = found.whole > limit, left.whole - near > limit, reached.whole <= limit
        else:
            beyond = (found.normal > limit) | (found.normal + found.tangential > room)
            seen_beyond, enough = left.normal - near > limit, near <= NEAR_FACET * limit
        beyond[squares.bases[seen_beyond]] = True
        settled = enough | (near == 0) | beyond[squares.bases] | (level == REFINEMENTS - 1)
        _raise(found, squares.at(np.flatnonzero(settled)), reached.at(np.flatnonzero(settled)))
        if np.all(settled):
            break
        wanted = descent.children(level, wanted[~settled])
    return found


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
    vectors = coefficients - bilinear_coefficients(over).reshape(16, -1, 3)
    for of_triangle in normals:
        _raise_at(found, np.arange(len(squares.bases)), vectors, of_triangle[squares.bases])
    return found


def _off_template(
    coefficients: FloatArray, squares: Squares, points: FloatArray, key: tuple[int, int], normals: FloatArray
) -> ErrorBounds:
    """(N,): error bounds of a template over squares with Bernstein coefficients (16, N, 3)."""
    pattern, alternative = key
    found = ErrorBounds(*(np.zeros(len(squares.bases)) for _ in range(3)))
    corners = squares.corners()
    for number, triangle in enumerate(templates(pattern)[alternative]):
        places = QUAD_POINTS[list(triangle)]
        weights = barycentric(places, corners)
        covered = np.all(weights >= -NOTHING, axis=(0, 2))
        apart = np.any(np.all(weights <= NOTHING, axis=0), axis=1) | _boxes_apart(places, corners)
        inside = np.flatnonzero(covered)
        vertices = points[list(triangle)][:, squares.bases[inside]]
        flat = np.einsum("cnk,kni->cni", weights[:, inside], vertices)
        vectors = coefficients[:, inside] - bilinear_coefficients(flat).reshape(16, -1, 3)
        _raise_at(found, inside, vectors, normals[number, squares.bases[inside]])
        cut = np.flatnonzero(~covered & ~apart)
        for path in np.unique(squares.paths[cut]).tolist():
            chosen = cut[squares.paths[cut] == path]
            of_template = template_rows(pattern, alternative, path)
            rows = of_template.matrix[of_template.triangles == number]
            if not len(rows):
                continue
            bases = squares.bases[chosen]
            given = np.concatenate([coefficients[:, chosen], points[:8, bases]])
            _raise_at(found, chosen, transformed_nets(rows, given), normals[number, bases])
    return found


def _raise_at(found: ErrorBounds, chosen: IndexArray, vectors: FloatArray, normals: FloatArray) -> None:
    """Raise the bounds of some squares to vectors (R, n, 3), over triangles with unit normals (n, 3)."""
    squares = squared_norms(vectors)
    along = np.einsum("rni,ni->rn", vectors, normals) ** 2
    across = np.maximum(squares - along, 0.0)
    for values, own in ((found.whole, squares), (found.normal, along), (found.tangential, across)):
        values[chosen] = np.maximum(values[chosen], np.sqrt(own.max(axis=0, initial=0.0)))


def _boxes_apart(places: FloatArray, corners: FloatArray) -> FloatArray:
    """(N,) bool: whether squares (4, N, 2) lie beside the triangle along one of the axes."""
    above = corners.min(axis=0) >= places.max(axis=0) - NOTHING
    below = corners.max(axis=0) <= places.min(axis=0) + NOTHING
    return np.any(above | below, axis=1)
