# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances of faces of any kind from the surface, by refinement (docs/adaptive.md, Any other quad).

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
from ...arrays.vectors import selected_vectors, transformed_nets
from ...surface.bicubic import facet_coefficients
from ...surface.squares import Squares
from ..templates import COUNTS, QUAD_POINTS, templates
from .descent import Descent
from .triangle_bounds import barycentric_rows, longest, template_rows

# After so many the rest of a quad around an irregular vertex is small against the quad.
REFINEMENTS = 8

# Weights and lengths are small multiples of dyadic fractions; anything less is rounding.
NOTHING = 1e-9

# The triangles of a template.
MOST_TRIANGLES = 5

# (N,): distances over squares with Bernstein coefficients (16, N, 3).
Comparison = Callable[[FloatArray, Squares], FloatArray]


def template_distances(
    descent: Descent, chosen: IndexArray, points: FloatArray, numbers: IndexArray, limit: float
) -> FloatArray:
    """(P,): upper bounds of ‖S - T‖, for P chosen quads and the triangles of a template each, as tight as it takes to
    compare them with the limit.

    descent: of quads, which are its bases. points: (8 or more, P, 3), as in ``templates.QUAD_POINTS``. numbers: (P,),
    of the templates (``templates.template_numbers``).
    """

    def compare(coefficients: FloatArray, squares: Squares) -> FloatArray:
        return _off_templates(coefficients, squares, points, numbers)

    return _descended(descent, chosen, chosen, compare, limit)


def fan_distances(
    descent: Descent, chosen: IndexArray, quarters: IndexArray, facets: FloatArray, limit: float
) -> FloatArray:
    """(C,): the same of ‖S - F‖, for the quarters (C,) of chosen faces and bilinear facets over their corners
    (4, C, 3). descent: of faces whose quarters are its bases."""

    def compare(coefficients: FloatArray, squares: Squares) -> FloatArray:
        return _off_facets(coefficients, squares, facets)

    return _descended(descent, chosen, quarters, compare, limit)


def _descended(
    descent: Descent, chosen: IndexArray, bases: IndexArray, compare: Comparison, limit: float
) -> FloatArray:
    """(bases,) distances over the bases of chosen faces; ``compare`` has bases by their index here. Of a base that
    exceeds the limit they say nothing more."""
    found = np.zeros(len(bases))
    wanted = descent.start(chosen)
    for level in range(REFINEMENTS):
        pieces = descent.pieces(level, wanted)
        squares, near = replace(pieces.squares, bases=np.searchsorted(bases, pieces.squares.bases)), pieces.near
        distances = compare(pieces.coefficients, squares)
        beyond = np.zeros(len(bases), dtype=bool)
        beyond[squares.bases[distances - near > limit]] = True
        distances += near
        settled = (distances <= limit) | (near == 0) | beyond[squares.bases] | (level == REFINEMENTS - 1)
        np.maximum.at(found, squares.bases[settled], distances[settled])
        if np.all(settled):
            break
        wanted = descent.children(level, wanted[~settled])
    return found


def _off_facets(coefficients: FloatArray, squares: Squares, facets: FloatArray) -> FloatArray:
    """(N,): distances of facets (4, C, 3) over squares with Bernstein coefficients (16, N, 3)."""
    u, v = squares.corners().transpose(2, 0, 1)
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
    over = np.einsum("kcn,kni->cni", weights, facets[:, squares.bases])
    return longest(coefficients - facet_coefficients(over))


def _off_templates(coefficients: FloatArray, squares: Squares, points: FloatArray, numbers: IndexArray) -> FloatArray:
    """(N,): distances of templates over squares with Bernstein coefficients (16, N, 3). points and numbers of the
    squares' bases: as in ``template_distances``."""
    found, tables = np.empty(len(squares.bases)), _triangle_tables()
    own = numbers[squares.bases]
    weights = tables.weights(own, squares.corners())
    covered = np.all(weights >= -NOTHING, axis=(2, 3))
    inside = np.flatnonzero(np.any(covered, axis=0))
    triangles = covered[:, inside].argmax(axis=0)
    vertices = points[tables.vertices[own[inside], triangles].T, squares.bases[inside]]
    flat = np.einsum("nck,kni->cni", weights[triangles, inside], vertices)
    found[inside] = longest(selected_vectors(coefficients, inside) - facet_coefficients(flat))
    cut = np.flatnonzero(~np.any(covered, axis=0))
    # Paths are longer than the leading digit, so they and templates have numbers together.
    keys = squares.paths[cut] * tables.count + own[cut]
    for key in np.unique(keys).tolist():
        path, number = divmod(key, tables.count)
        chosen = cut[keys == key]
        rows, of_points = template_rows(number % 16, number // 16, path), points[:8]
        given = [selected_vectors(coefficients, chosen), selected_vectors(of_points, squares.bases[chosen])]
        found[chosen] = longest(transformed_nets(rows.matrix, np.concatenate(given)))
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
