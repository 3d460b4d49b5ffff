# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of bicubic leaves by maps of the surface onto the leaf's own triangles, independent of parameters.

The triangles of a leaf's template are quartered into cells. Each vertex of a cell has a place in the square of
parameters, of the point of the triangles nearest to the surface there; vertices on a segment of the border have places
on this segment. docs/adaptive.md, Maps, has the proof.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import dot_products, lengths, selected_vectors, squared_norms, transformed_nets
from ..surface.triangle_coefficients import DEGREE, bicubic_basis, coefficients_over, counts_of
from .template_rows import BICUBIC_POINTS, barycentric_rows, quartered
from .templates import QUAD_POINTS, TRIANGLE_COUNTS, TRIANGLES, template_groups

# The numbers of times triangles are quartered; a larger one where a smaller one does not decide.
QUARTERED = 1, 2, 3

# (28, 3): the Bernstein coefficients of a linear function over a triangle from its values at the vertices.
LINEAR = counts_of(DEGREE) / DEGREE


@dataclass(frozen=True)
class _Triangles:
    """The triangles of a template, as a function of places: an affine function, and for each of C chords between two
    triangles max(g, 0) times a fold, g affine and 0 on the chord.

    triangles: (T, 3), segments: (E, 2), of the points of a quad. affine: (3, 8), the coefficients of u, v and 1 from
    these points; chords: (C, 3), the coefficients of g; folds: (C, 8), from these points.
    """

    triangles: IndexArray
    segments: IndexArray
    affine: FloatArray
    chords: FloatArray
    folds: FloatArray

    def beyond(self, places: FloatArray) -> FloatArray:
        """(C, …): g at places (…, 2)."""
        return np.moveaxis(places @ self.chords[:, :2].T + self.chords[:, 2], -1, 0)


@dataclass(frozen=True)
class _Cells:
    """The cells of a template with V vertices.

    at: (V, 2), the vertices' parameters; points: (V, 16), from the coefficients of the surface to its points there.
    on_segments: (E, V) bool, the segments that may hold a place; in_triangles: (V,) bool, whether triangles may; fixed:
    the vertices of the template. vertices: (N, 3) intp, of each cell; rows: N times (28, 16), from the coefficients of
    the surface to those over a cell.
    """

    at: FloatArray
    points: FloatArray
    on_segments: BoolArray
    in_triangles: BoolArray
    fixed: IndexArray
    vertices: IndexArray
    rows: list[FloatArray]


def template_maps(coefficients: FloatArray, numbers: IndexArray, limits: FloatArray) -> FloatArray:
    """(P,): bounds of the distance between the surface and the triangles of bicubic quads, both ways, with coefficients
    (16, P, 3) and template numbers (P,); infinite where no bound within the limits (P,) is found."""
    found = np.full(len(numbers), np.inf)
    for pattern, alternative, own in template_groups(numbers):
        for times in QUARTERED:
            if not len(own):
                break
            is_near, bounds = _mapped(
                16 * alternative + pattern, times, selected_vectors(coefficients, own), limits[own]
            )
            own = own[is_near]
            within = bounds <= limits[own]
            found[own[within]], own = bounds[within], own[~within]
    return found


def _mapped(number: int, times: int, nets: FloatArray, limits: FloatArray) -> tuple[BoolArray, FloatArray]:
    """(P,) bool, whether all vertices of cells are within the limits of their images; and the bounds of these quads."""
    template, cells = _triangles(number), _cells(number, times)
    points, surface = (transformed_nets(rows, nets) for rows in (BICUBIC_POINTS, cells.points))
    places = _nearest(template, cells, points, surface)
    beyond, folds = template.beyond(places), transformed_nets(template.folds, points)
    along, across, at_zero = transformed_nets(template.affine, points)
    images = places[..., :1] * along + places[..., 1:] * across + at_zero
    for over, fold in zip(beyond, folds, strict=True):
        images += np.maximum(over, 0.0)[..., None] * fold
    is_near = lengths(surface - images).max(axis=0) <= limits
    own = np.flatnonzero(is_near)
    nets, images, beyond, bent = (
        selected_vectors(nets, own),
        selected_vectors(images, own),
        beyond[..., own],
        lengths(folds[:, own]),
    )
    bounds = np.zeros(len(own))
    for vertices, rows in zip(cells.vertices, cells.rows, strict=True):
        apart = transformed_nets(rows, nets) - transformed_nets(LINEAR, images[vertices])
        largest = lengths(apart).max(axis=0)
        # Linear images over several triangles are off the triangles.
        for over, length in zip(beyond[:, vertices], bent, strict=True):
            above, below = (np.maximum(each, 0.0).max(axis=0) for each in (over, -over))
            largest += length * above * below / np.maximum(above + below, np.finfo(float).tiny)
        np.maximum(bounds, largest, out=bounds)
    return is_near, bounds


def _nearest(template: _Triangles, cells: _Cells, points: FloatArray, surface: FloatArray) -> FloatArray:
    """(V, P, 2): the places of vertices at points (V, P, 3) of the surface, with points (8, P, 3) of quads."""
    places, least = np.zeros((*surface.shape[:2], 2)), np.full(surface.shape[:2], np.inf)

    def put(off: FloatArray, found: FloatArray, may_be: BoolArray) -> None:
        squares = squared_norms(off)
        is_nearer = may_be & (squares < least)
        least[is_nearer] = squares[is_nearer]
        places[is_nearer] = found[is_nearer]

    for (start, end), is_on in zip(template.segments, cells.on_segments, strict=True):
        way, seen = points[end] - points[start], surface - points[start]
        share = np.clip(dot_products(seen, way) / np.maximum(squared_norms(way), np.finfo(float).tiny), 0.0, 1.0)
        found = QUAD_POINTS[start] + share[..., None] * (QUAD_POINTS[end] - QUAD_POINTS[start])
        put(seen - share[..., None] * way, found, is_on[:, None])
    for first, second, third in template.triangles:
        along, across, seen = points[second] - points[first], points[third] - points[first], surface - points[first]
        a, b, c = squared_norms(along), dot_products(along, across), squared_norms(across)
        p, q, area = dot_products(seen, along), dot_products(seen, across), np.maximum(a * c - b * b, 1e-300)
        shares = (c * p - b * q) / area, (a * q - b * p) / area
        is_inside = (shares[0] > 0) & (shares[1] > 0) & (shares[0] + shares[1] < 1)
        one, other = (each[..., None] for each in shares)
        sides = QUAD_POINTS[[second, third]] - QUAD_POINTS[first]
        found = QUAD_POINTS[first] + one * sides[0] + other * sides[1]
        put(seen - one * along - other * across, found, is_inside & cells.in_triangles[:, None])
    places[cells.fixed] = cells.at[cells.fixed][:, None]
    return np.clip(places, 0.0, 1.0)


@cache
def _triangles(number: int) -> _Triangles:
    triangles = TRIANGLES[number, : TRIANGLE_COUNTS[number]]
    functions = {0: _affine(triangles[0])}
    chords, folds = [], []
    # Each triangle comes after one that it shares a chord with.
    while len(functions) < len(triangles):
        for own, triangle in enumerate(triangles):
            before = [each for each in functions if len(np.intersect1d(triangles[each], triangle)) == 2]
            if own in functions or not before:
                continue
            (apex,) = np.flatnonzero(~np.isin(triangle, triangles[before[0]]))
            opposite, doubled_area = barycentric_rows(QUAD_POINTS[triangle])
            chords.append(opposite[:, apex] / doubled_area)
            folds.append(np.eye(8)[triangle[apex]] - np.append(QUAD_POINTS[triangle[apex]], 1.0) @ functions[before[0]])
            functions[own] = functions[before[0]] + np.outer(chords[-1], folds[-1])
    sides = np.sort(np.concatenate([triangles, np.roll(triangles, -1, axis=1)]).reshape(2, -1), axis=0)
    return _Triangles(triangles, np.unique(sides, axis=1).T, functions[0], np.array(chords), np.array(folds))


def _affine(triangle: IndexArray) -> FloatArray:
    """(3, 8): the coefficients of u, v and 1 of the function with the values of a triangle's points."""
    opposite, doubled_area = barycentric_rows(QUAD_POINTS[triangle])
    found: FloatArray = opposite / doubled_area @ np.eye(8)[triangle]
    return found


@cache
def _cells(number: int, times: int) -> _Cells:
    template = _triangles(number)
    parts = [QUAD_POINTS[each] for each in template.triangles]
    for _ in range(times):
        parts = [quarter for part in parts for quarter in quartered(part)]
    at, vertices = np.unique(np.concatenate(parts), axis=0, return_inverse=True)
    is_inside, fixed = (at > 0) & (at < 1), QUAD_POINTS[np.unique(template.triangles)]
    low, high = (reach(QUAD_POINTS[template.segments], axis=1)[:, None] for reach in (np.min, np.max))
    # A segment on a side has the same u, or the same v, as its vertices.
    is_on = ((low <= at) & (at <= high) & (is_inside | (low == high))).all(axis=2)
    return _Cells(
        at,
        bicubic_basis(at),
        is_on | is_inside.all(axis=1),
        is_inside.all(axis=1),
        np.flatnonzero((at[:, None] == fixed).all(axis=2).any(axis=1)),
        vertices.reshape(-1, 3),
        [coefficients_over(part) for part in parts],
    )
