# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals of bicubic quads at samples, and the choices that these decide: diagonals, the way to split, and whether to
split at all before anything is proved."""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import (
    cross_products,
    dot_products,
    lengths,
    selected_vectors,
    squared_norms,
    transformed_nets,
    units,
)
from ..surface.triangle_coefficients import bicubic_basis
from .leaf_approximation import ways_by_coefficients
from .rectangle_tree import ALONG_U, ALONG_V
from .templates import INWARDS, QUAD_POINTS, TRIANGLE_COUNTS, TRIANGLES, template_groups

# The cross product of tangents below this part of their product has no direction.
NO_AREA = 1e-12

# The part of a quad that is a little inside.
A_LITTLE = 2.0**-8

# The places of samples along a line of parameters.
ALONG = np.linspace(0.0, 1.0, 5)
SAMPLES = np.stack(np.meshgrid(ALONG, ALONG, indexing="ij"), axis=-1).reshape(-1, 2)

# Normals decide how to split a leaf where they miss this part of the angle; less is a tie.
TELLING, TIE = 0.25, 1e-6


def normals_of_quads(coefficients: FloatArray) -> FloatArray:
    """(8, P, 3): the normals of bicubic quads with coefficients (16, P, 3), at ``QUAD_POINTS``; where there is none, as
    between coincident vertices, those a little inside."""
    found = _normals_at(coefficients, QUAD_POINTS)
    missing = ~found.any(axis=2)
    if missing.any():
        found[missing] = _normals_at(coefficients, QUAD_POINTS + A_LITTLE * INWARDS)[missing]
    return found


def ways_of_normals(coefficients: FloatArray, angle: float) -> IndexArray:
    """(P,): how to halve bicubic quads with coefficients (16, P, 3): across the direction in which interpolated normals
    miss more, across the longer sides where neither misses more. Where normals miss little of the angle, in radians,
    the surface is uneven, and its second derivatives decide."""
    normals = _normals_at(coefficients, SAMPLES).reshape(len(ALONG), len(ALONG), -1, 3)
    missed = []
    for lines in (normals, normals.swapaxes(0, 1)):
        drawn = units((1 - ALONG)[:, None, None, None] * lines[0] + ALONG[:, None, None, None] * lines[-1])
        missed.append(lengths(lines - drawn).max(axis=(0, 1)))
    sizes = _sizes(coefficients)
    is_tie = np.abs(missed[0] - missed[1]) <= TIE
    is_u = np.where(is_tie, sizes[0] >= sizes[1], missed[0] >= missed[1])
    ways = np.where(is_u, ALONG_U, ALONG_V)
    return np.where(np.max(missed, axis=0) < TELLING * angle, ways_by_coefficients(coefficients), ways)


def better_diagonals(coefficients: FloatArray) -> IndexArray:
    """(P,): the diagonal of bicubic quads with coefficients (16, P, 3), from corner 0 or from corner 1, whose normals
    miss the normal in the middle less."""
    places = np.concatenate([QUAD_POINTS[:4], [[0.5, 0.5]]])
    first, second, third, fourth, middle = _normals_at(coefficients, places)
    off = [lengths(units(one + other) - middle) for one, other in ((first, third), (second, fourth))]
    return np.where(off[1] < off[0], 1, 0)


def are_narrow(corners: FloatArray, reaches: FloatArray) -> BoolArray:
    """(P,) bool: whether two opposite sides of quads with corners (4, P, 3) are shorter than the reaches (P,)."""
    short = lengths(np.roll(corners, -1, axis=0) - corners) < reaches
    found: BoolArray = (short[0] & short[2]) | (short[1] & short[3])
    return found


def sampled_angles(coefficients: FloatArray, numbers: IndexArray) -> FloatArray:
    """(2, P): angles of shading and of facets that samples of bicubic quads with coefficients (16, P, 3) and template
    numbers (P,) reach, in radians: of shading the smaller one of both pairings (``paired_triangles``)."""
    found = np.zeros((2, len(numbers)))
    for pattern, alternative, own in template_groups(numbers):
        nets = selected_vectors(coefficients, own)
        normals, surfaces = _normals_at(nets, SAMPLES), transformed_nets(bicubic_basis(SAMPLES), nets)
        at_points, points = normals_of_quads(nets), transformed_nets(bicubic_basis(QUAD_POINTS), nets)
        number, shading = 16 * alternative + pattern, np.zeros((2, len(own)))
        for triangle in TRIANGLES[number, : TRIANGLE_COUNTS[number]]:
            weights, inside = _weights_of_samples(tuple(triangle.tolist()))
            surface, corners, stored = surfaces[inside], points[triangle], at_points[triangle]
            seen = _weights_of(corners, surface)
            for each, own_weights in zip(shading, (weights[..., None], seen), strict=True):
                drawn = sum(own_weights[:, k, :, None] * stored[k] for k in range(3))
                np.maximum(each, _largest_between(normals[inside], units(drawn)), out=each)
            flat = units(cross_products(corners[1] - corners[0], corners[2] - corners[0]))
            found[1, own] = np.maximum(found[1, own], _largest_between(normals[inside], flat))
        found[0, own] = shading.min(axis=0)
    return found


@cache
def _weights_of_samples(triangle: tuple[int, ...]) -> tuple[FloatArray, IndexArray]:
    """(R, 3): the weights of a triangle's corners, among ``QUAD_POINTS``, at the samples inside; and (R,) these."""
    corners = np.column_stack([QUAD_POINTS[list(triangle)], np.ones(3)])
    weights = np.column_stack([SAMPLES, np.ones(len(SAMPLES))]) @ np.linalg.inv(corners)
    inside = np.flatnonzero((weights > -TIE).all(axis=1))
    return weights[inside], inside


def _weights_of(corners: FloatArray, points: FloatArray) -> FloatArray:
    """(R, 3, P): the weights of triangles' corners (3, P, 3) at the feet of points (R, P, 3) on their planes."""
    one, other = corners[1] - corners[0], corners[2] - corners[0]
    normal = cross_products(one, other)
    area = np.maximum(squared_norms(normal), 1e-300)
    away = points - corners[0]
    second = dot_products(cross_products(other, normal), away) / area
    third = dot_products(cross_products(normal, one), away) / area
    return np.stack([1 - second - third, second, third], axis=1)


def _largest_between(normals: FloatArray, drawn: FloatArray) -> FloatArray:
    """(P,): the largest angle between unit vectors (R, P, 3); samples without a normal do not count."""
    off = np.where(normals.any(axis=-1), lengths(normals - drawn), 0.0).max(axis=0)
    return 2 * np.arcsin(np.minimum(off / 2, 1.0))


def _sizes(coefficients: FloatArray) -> FloatArray:
    """(2, P): the lengths of bicubic quads along u and v, the larger of two opposite sides."""
    net = coefficients.reshape(4, 4, -1, 3)
    along = lengths(net[3, [0, 3]] - net[0, [0, 3]]).max(axis=0)
    across = lengths(net[[0, 3], 3] - net[[0, 3], 0]).max(axis=0)
    return np.stack([along, across])


@lru_cache(maxsize=64)
def _tangent_bases(places: tuple[tuple[float, float], ...]) -> tuple[FloatArray, FloatArray]:
    """(N, 16) twice: multiples of the derivatives along u and v of the bicubic Bernstein basis at parameters."""
    u, v = (each[:, None] for each in np.array(places).T)

    def basis(t: FloatArray) -> tuple[FloatArray, FloatArray]:
        s = 1 - t
        values = np.hstack([s**3, 3 * s * s * t, 3 * s * t * t, t**3])
        return values, np.hstack([-s * s, s * s - 2 * s * t, 2 * s * t - t * t, t * t])

    (along, turned), (across, other) = basis(u), basis(v)
    return tuple(np.einsum("ni,nj->nij", *each).reshape(-1, 16) for each in ((turned, across), (along, other)))  # type: ignore[return-value]


def _normals_at(coefficients: FloatArray, places: FloatArray) -> FloatArray:
    """(N, P, 3): unit normals of bicubic quads at places (N, 2), zero where there is none."""
    bases = _tangent_bases(tuple(map(tuple, places.tolist())))
    first, second = (transformed_nets(basis, coefficients) for basis in bases)
    normals = cross_products(first, second)
    lengths_of = squared_norms(first), squared_norms(second)
    clear = squared_norms(normals) > NO_AREA**2 * lengths_of[0] * lengths_of[1]
    # Between coincident vertices tangents are nothing but rounding.
    least = (NO_AREA * np.abs(coefficients).max(axis=(0, 2))) ** 2
    clear &= (lengths_of[0] > least) & (lengths_of[1] > least)
    return np.where(clear[..., None], units(normals), 0.0)
