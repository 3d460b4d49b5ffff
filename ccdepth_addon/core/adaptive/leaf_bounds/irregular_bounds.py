# SPDX-License-Identifier: GPL-3.0-or-later
"""Error bounds over faces of any kind, by refinement (docs/adaptive.md, Any other quad).

A quad's descendants are squares in its parameters. A regular one is bicubic, and is compared in Bernstein form. Any
other is compared by way of the bilinear facet over its control points, which is within a known distance of the surface,
and refined again while that decides. They are compared

- with the triangles of a template: where a square lies in one of them, that is linear over it; where the template's
  lines cut it, by the matrices of its parts (``triangle_bounds``);
- or with bilinear facets.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...arrays.types import FloatArray, IndexArray
from ...arrays.vectors import squared_norms, transformed_nets
from ...bounds.norm_bounds import Vertices, second_order_extraordinary, support_bounds
from ...surface.bicubic import bilinear_coefficients, patch_coefficients
from ...surface.patches import PatchKind, PatchKinds, classify_patches, extraordinary_nets, regular_nets
from ...surface.refinement import Refinement
from ..templates import QUAD_POINTS, templates
from .triangle_bounds import QUARTER_TURN, ErrorBounds, barycentric, template_rows

# After so many the rest of a quad around an irregular vertex is small against the quad.
REFINEMENTS = 8

# Weights and lengths are small multiples of dyadic fractions; anything less is rounding.
NOTHING = 1e-9

# Where a bound along the normals is needed, facets have to be within this part of the limit.
NEAR_FACET = 1 / 16


@dataclass(frozen=True)
class Squares:
    """N square parts of the parameters of quads.

    bases: (N,) intp, the quad of each; paths: (N,) intp, the children on the way there as digits of base 4 after a
    leading 1; origins: (N, 2), their corners 0; axes: (N, 2, 2), the sides from there to corners 1 and 3.
    """

    bases: IndexArray
    paths: IndexArray
    origins: FloatArray
    axes: FloatArray

    @staticmethod
    def whole(count: int) -> Squares:
        """All of each quad."""
        axes = np.broadcast_to(np.eye(2), (count, 2, 2))
        return Squares(np.arange(count), np.ones(count, dtype=np.intp), np.zeros((count, 2)), axes)

    def at(self, chosen: IndexArray) -> Squares:
        return Squares(self.bases[chosen], self.paths[chosen], self.origins[chosen], self.axes[chosen])

    def children(self) -> Squares:
        """The four children of each, from corner 0 on; corner 0 of a child is a corner of the square."""
        origins = self.origins[:, None] + np.einsum("ci,nij->ncj", QUAD_POINTS[:4], self.axes)
        turns = np.stack([np.linalg.matrix_power(QUARTER_TURN, turn) for turn in range(4)]) / 2
        axes = np.einsum("cij,njk->ncik", turns, self.axes)
        paths = 4 * self.paths[:, None] + np.arange(4)
        return Squares(np.repeat(self.bases, 4), paths.ravel(), origins.reshape(-1, 2), axes.reshape(-1, 2, 2))

    def corners(self) -> FloatArray:
        """(4, N, 2)."""
        return self.origins + np.einsum("ci,nij->cnj", QUAD_POINTS[:4], self.axes)


# Error bounds over squares with Bernstein coefficients (16, N, 3), (N,) each.
Comparison = Callable[[FloatArray, Squares], ErrorBounds]


def template_error_bounds(
    children: Refinement,
    points: FloatArray,
    key: tuple[int, int],
    normals: FloatArray,
    limit: float,
    room: FloatArray | None = None,
) -> ErrorBounds:
    """(P,): upper bounds of ‖S - T‖, for P quads and the triangles of a template.

    children: of all the quads, whose bases these are. points: (8 or more, P, 3), as in ``templates.QUAD_POINTS``; key:
    pattern and alternative; normals: (T, P, 3), of the triangles. For limit and room see ``_refined_error_bounds``.
    """

    def compare(coefficients: FloatArray, squares: Squares) -> ErrorBounds:
        return _off_template(coefficients, squares, points, key, normals)

    return _refined_error_bounds(children, Squares.whole(points.shape[1]).children(), compare, limit, room)


def fan_error_bounds(
    quarters: Refinement, facets: FloatArray, normals: FloatArray, limit: float, room: FloatArray | None = None
) -> ErrorBounds:
    """(C,): upper bounds of ‖S - F‖, for the quarters of some faces and bilinear facets over their corners (4, C, 3).

    quarters: the children of the faces. normals: (T, C, 3), those of all triangles there. For limit and
    room see ``_refined_error_bounds``.
    """

    def compare(coefficients: FloatArray, squares: Squares) -> ErrorBounds:
        return _off_facets(coefficients, squares, facets, normals)

    return _refined_error_bounds(quarters, Squares.whole(facets.shape[1]), compare, limit, room)


def _refined_error_bounds(
    refinement: Refinement, squares: Squares, compare: Comparison, limit: float, room: FloatArray | None
) -> ErrorBounds:
    """Error bounds over quads of which the refinement's descendants are squares.

    Without room they are as tight as it takes to compare the whole error with the limit. With room (quads,) they are
    tight along the normals, and compare the error along the normals with the limit, and the errors along and across
    together with the room. Of a quad that exceeds one of these the bounds say nothing more.
    """
    count = int(squares.bases.max(initial=-1)) + 1
    found = ErrorBounds(*(np.zeros(count) for _ in range(3)))
    for step in range(REFINEMENTS):
        kinds = classify_patches(refinement.mesh).kinds[: len(refinement.bases)]
        regular, rest = np.flatnonzero(kinds == PatchKind.REGULAR), np.flatnonzero(kinds != PatchKind.REGULAR)
        coefficients = patch_coefficients(regular_nets(refinement.mesh, regular)).reshape(16, -1, 3)
        _raise(found, squares.at(regular), compare(coefficients, squares.at(regular)))
        if not len(rest):
            break
        refinement, squares = refinement.keep(kinds != PatchKind.REGULAR), squares.at(rest)
        near = facet_distances(refinement, classify_patches(refinement.mesh))
        left = compare(bilinear_coefficients(refinement.control_facets()).reshape(16, -1, 3), squares)
        reached = left + ErrorBounds(near, near, near)
        if room is None:
            beyond, seen_beyond, enough = found.whole > limit, left.whole - near > limit, reached.whole <= limit
        else:
            beyond = (found.normal > limit) | (found.normal + found.tangential > room)
            seen_beyond, enough = left.normal - near > limit, near <= NEAR_FACET * limit
        beyond[squares.bases[seen_beyond]] = True
        settled = enough | beyond[squares.bases] | (step == REFINEMENTS - 1)
        _raise(found, squares.at(np.flatnonzero(settled)), reached.at(np.flatnonzero(settled)))
        refinement, squares = refinement.keep(~settled).refined(), squares.at(np.flatnonzero(~settled)).children()
        if not len(refinement.bases):
            break
    return found


def facet_distances(refinement: Refinement, patches: PatchKinds) -> FloatArray:
    """(descendants,): upper bounds of the distance between quads' surface and the facets over their control points."""
    mesh, kinds = refinement.mesh, patches.kinds[: len(refinement.bases)]
    bounds = np.empty(len(kinds))
    others = kinds == PatchKind.IRREGULAR
    if np.any(others):
        bounds[others] = support_bounds(mesh, Vertices.CONTROL)[: len(kinds)][others]
    extraordinary = np.flatnonzero(kinds == PatchKind.EXTRAORDINARY)
    corners = patches.extraordinary_corners[extraordinary]
    valences = mesh.vertex_face_counts[mesh.corner_vertices[corners]]
    for valence in np.unique(valences).tolist():
        of_valence = valences == valence
        nets = extraordinary_nets(mesh, corners[of_valence], valence)
        bounds[extraordinary[of_valence]] = second_order_extraordinary(nets, Vertices.CONTROL).value
    return bounds


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
