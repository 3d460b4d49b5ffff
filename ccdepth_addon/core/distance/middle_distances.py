# SPDX-License-Identifier: GPL-3.0-or-later
"""Lower bounds of the distance between points near the middles of regular faces and a level's triangles over the same
face, from the planes of the triangles nearby and the rate at which points of the level separate. docs/distance.md,
Least depths.
"""

from __future__ import annotations

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.types import BoolArray, FloatArray
from ..arrays.vectors import cross_products, dot_products, lengths, squared_norms, transformed_nets, units
from ..bounds.norm_bounds import Vertices
from ..surface.bicubic import (
    HALVES,
    NET_CORNERS,
    NET_TO_BERNSTEIN,
    SECOND_DIFFERENCE,
    SPLINE_HALVES,
    SPLINE_TO_BERNSTEIN,
    tensor,
)
from ..surface.evaluation import spline_weights
from ..surface.squares import SQUARE
from .foot_bounds import LARGEST_TILT, LEAST_SINE, MIDDLE, MIDDLE_SECONDS, ROUNDING, Turns, likely_distances

# The vertices of a level around the middle of a face, in leaves from the middle on; and for each sample its place, the
# triangles nearby, and the least distance of all other triangles in parameters.
AROUND = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (-1, 0), (-1, -1), (0, -1)])
SAMPLES = (
    ((0.5, 0.5), 0.5, [(0, 1, 2), (0, 2, 3)]),
    ((0.5, 0.0), 0.25, [(0, 1, 2), (6, 1, 0)]),
    ((0.0, 0.5), 0.25, [(4, 0, 3), (0, 2, 3)]),
    ((0.0, 0.0), 0.5, [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5), (0, 5, 6), (0, 6, 1)]),
)

# At level 0 a face is one leaf.
OF_LEVEL_0 = SAMPLES[:1]

PART = HALVES[0] @ HALVES[1] @ SPLINE_TO_BERNSTEIN
PART_ROWS = tensor(PART, PART)

# (40, 16): the Bernstein coefficients of a net, its points at the corners, and S_uu, S_vv and S_uuvv.
OF_HULLS = 20
HULLS_AND_SECONDS = np.concatenate(
    [
        NET_TO_BERNSTEIN,
        np.eye(16)[NET_CORNERS],
        tensor(SECOND_DIFFERENCE, np.eye(4)),
        tensor(np.eye(4), SECOND_DIFFERENCE),
        tensor(SECOND_DIFFERENCE, SECOND_DIFFERENCE),
    ]
)

# The 16 parts of a face; (16, 16, 16): their nets; (80, 16): S_u, S_v, S_uu, S_vv and S_uv at their middles.
PARTS = 16
QUARTERS = [one @ other for other in SPLINE_HALVES for one in SPLINE_HALVES]
PART_NETS = np.array([np.kron(one, other) for one in QUARTERS for other in QUARTERS])
PART_MIDDLES = (np.concatenate([MIDDLE[1:], MIDDLE_SECONDS]) @ PART_NETS).swapaxes(0, 1).reshape(80, 16)


def middle_distances(nets: FloatArray, rates: FloatArray, level: int, vertices: Vertices) -> FloatArray:
    """(P,): for regular faces with nets (4, 4, P, 3), the largest lower bound, over some points of ``middle_parts``, of
    the distance from a point of the surface to the triangles of a level over the same face. rates: (P,), from
    ``rates_of``.
    """
    points = nets.reshape(16, -1, 3)
    size = 0.5**level
    middle = 0.5 if level else 0.0
    places = middle + size * AROUND if level else SQUARE
    drawn = transformed_nets(_vertex_rows(places, size, vertices), points)
    samples = SAMPLES[: 4 if vertices is Vertices.CONTROL else 3] if level else OF_LEVEL_0
    there = transformed_nets(
        _value_rows(np.array([middle + size * np.array(place) for place, _, _ in samples])), points
    )
    planes = {}
    for triangle in {each for _, _, triangles in samples for each in triangles}:
        a, b, c = (drawn[corner] for corner in triangle)
        normal = cross_products(b - a, c - a)
        planes[triangle] = a, normal / np.maximum(lengths(normal), np.finfo(float).tiny)[:, None]
    best = np.zeros(points.shape[1])
    for number, (place, apart, triangles) in enumerate(samples):
        # T at the sample's own parameters: on a side, a diagonal or a vertex.
        ends = {(0.5, 0.5): (0, 2), (0.5, 0.0): (0, 1), (0.0, 0.5): (0, 3), (0.0, 0.0): (0, 0)}[place]
        off = lengths(there[number] - (drawn[ends[0]] + drawn[ends[1]]) / 2)
        least = rates * (apart * size) - off
        for triangle in triangles:
            corner, normal = planes[triangle]
            np.minimum(least, np.abs(dot_products(there[number] - corner, normal)), out=least)
        np.maximum(best, least, out=best)
    return best * (1 - ROUNDING)


def most_curved_parts(nets: FloatArray) -> FloatArray:
    """(4, 4, P, 3): for each regular face with nets (4, 4, P, 3) the net of the one of its 16 parts with the largest
    estimated distance between triangles and surface."""
    uu, vv, uv = part_seconds(np.ascontiguousarray(nets.reshape(16, -1, 3).swapaxes(1, 2)))
    heights = np.max(np.abs([uu, vv, uu + vv + 2 * uv, uu + vv - 2 * uv]), axis=0)
    chosen = heights.argmax(axis=0)
    found = np.empty_like(nets)
    for part in range(16):
        own = np.flatnonzero(chosen == part)
        if len(own):
            found[:, :, own] = matrix_product(PART_NETS[part], nets[:, :, own].reshape(16, -1, 3)).reshape(4, 4, -1, 3)
    return found


def part_seconds(nets: FloatArray) -> FloatArray:
    """(3, 16, P): S_uu, S_vv and S_uv along the normals at the middles of the 16 parts of faces with nets (16, 3, P),
    for parameters with one unit for the face."""
    along_u, along_v, *seconds = matrix_product(PART_MIDDLES, nets).reshape(5, 16, *nets.shape[1:])
    normals = along_u[:, [1, 2, 0]] * along_v[:, [2, 0, 1]] - along_u[:, [2, 0, 1]] * along_v[:, [1, 2, 0]]
    lengths = np.sqrt((normals * normals).sum(axis=1))
    found = np.stack([(each * normals).sum(axis=1) for each in seconds])
    return found * (PARTS / np.maximum(lengths, np.finfo(float).tiny))


def likely_at_parts(nets: FloatArray, level: int, vertices: Vertices, is_turned: BoolArray) -> FloatArray:
    """(P,): estimates of the distance between the triangles of a level, 1 or later, and the surface over faces with
    nets (16, 3, P). Estimates prove nothing. is_turned: as in ``foot_bounds``."""
    seconds = part_seconds(nets)
    if level == 1:
        # Leaves have four parts each.
        seconds = seconds.reshape(3, 2, 2, 2, 2, -1).mean(axis=(2, 4)).reshape(3, 4, -1)
    return likely_distances(seconds, vertices, is_turned).max(axis=0) * 0.25**level


def middle_parts(nets: FloatArray) -> FloatArray:
    """(16, P, 3): points whose hull holds the surface of nets (4, 4, P, 3) over parameters from a half to three
    quarters."""
    return transformed_nets(PART_ROWS, nets.reshape(16, -1, 3))


def tight_boxes(nets: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(P, 3) twice: the corners of boxes that hold the surface, and every level's vertices and triangles, over regular
    faces with nets (4, 4, P, 3)."""
    hull, seconds = _hulls(nets)
    beyond = _beyond(*(np.abs(each).max(axis=0) for each in seconds))
    return hull.min(axis=0) - beyond, hull.max(axis=0) + beyond


def are_apart(nets: FloatArray, hulls: FloatArray, reach: float) -> BoolArray:
    """(P,) bool: whether a plane proves that hulls of points (R, P, 3) are farther than the reach from every level over
    regular faces with nets (4, 4, P, 3)."""
    others, seconds = _hulls(nets)
    beyond = _beyond(*(np.sqrt(squared_norms(each).max(axis=0)) for each in seconds))
    centre = others.mean(axis=0)
    direction = hulls.mean(axis=0) - centre
    gap = dot_products(hulls - centre, direction[None]).min(axis=0)
    gap -= dot_products(others - centre, direction[None]).max(axis=0)
    return gap > (reach + beyond) * (1 + ROUNDING) * lengths(direction)


def _hulls(nets: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
    """(20, P, 3): points whose hull holds the surface over regular faces with nets (4, 4, P, 3), and the control mesh;
    and (R, P, 3) each, S_uu, S_vv and S_uuvv."""
    points = transformed_nets(HULLS_AND_SECONDS, nets.reshape(16, -1, 3))
    return points[:OF_HULLS], np.split(points[OF_HULLS:], [8, 16])


def _beyond(uu: FloatArray, vv: FloatArray, both: FloatArray) -> FloatArray:
    """The distances of vertices of levels after the control mesh from the surface: h²(S_uu + S_vv)/6 and
    h⁴S_uuvv/36."""
    return ((uu + vv) / 24 + both / 576) * (1 + ROUNDING)


def rates_of(nets: FloatArray, condition: float) -> FloatArray:
    """(P,): rates r for regular faces with nets (4, 4, P, 3): two points of a level whose parameters differ by Δ are at
    least rΔ apart. A rate is not above zero where nothing is known, or where the other diagonal may be drawn.
    condition: of the axes of the object's space.

    As in ``foot_bounds``, with T in place of S (docs/distance.md, Lemma 4): on every triangle T_u is an average of the
    net's differences along u, and T_v along v.
    """
    _, along_u, along_v = transformed_nets(MIDDLE, nets.reshape(16, -1, 3))
    normal = cross_products(along_u, along_v)
    square = np.maximum(squared_norms(normal), np.finfo(float).tiny)[:, None]
    x, y, n = cross_products(along_v, normal) / square, cross_products(normal, along_u) / square, units(normal)
    steps_u, steps_v = np.diff(nets, axis=0).reshape(12, -1, 3), np.diff(nets, axis=1).reshape(12, -1, 3)

    def largest(steps: FloatArray, direction: FloatArray) -> FloatArray:
        return np.abs(dot_products(steps, direction)).max(axis=0)

    def lack(steps: FloatArray, dual: FloatArray) -> FloatArray:
        return 1 + ROUNDING - dot_products(steps, dual).min(axis=0)

    turns = Turns(lack(steps_u, x), largest(steps_u, y) + ROUNDING, largest(steps_v, x) + ROUNDING, lack(steps_v, y))
    sizes = lengths(x), lengths(y)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        tilts = turns.solve(largest(steps_u, n), largest(steps_v, n))
        is_known = turns.are_known & ((tilts[0] * sizes[0] + tilts[1] * sizes[1]) * condition <= LARGEST_TILT)
        is_known &= square[:, 0] > LEAST_SINE**2 * squared_norms(along_u) * squared_norms(along_v)
        return np.where(is_known, 1 / np.maximum(*turns.transposed().solve(*sizes)), 0.0)


def _value_rows(places: FloatArray) -> FloatArray:
    """(n, 16): the functionals of a net that give the surface at parameters (n, 2)."""
    along, across = (spline_weights(each) for each in places.T)
    return np.einsum("in,jn->nij", along, across).reshape(-1, 16)


def _vertex_rows(places: FloatArray, size: float, vertices: Vertices) -> FloatArray:
    """(n, 16): the functionals of a net that give a level's vertices at parameters (n, 2). size: of the level's
    leaves."""
    if vertices is Vertices.LIMIT:
        return _value_rows(places)
    rows = []
    for t in places.T:
        second = np.stack([1 - t, 3 * t - 2, 1 - 3 * t, t])
        rows.append(spline_weights(t) - size**2 / 6 * second)
    return np.einsum("in,jn->nij", *rows).reshape(-1, 16)
