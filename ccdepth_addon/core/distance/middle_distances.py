# SPDX-License-Identifier: GPL-3.0-or-later
"""The least distances of points near the middles of regular faces from all that a level draws over the same face.

docs/distance.md, Least depths: planes of the triangles there, and the rate at which the level's points go apart.
"""

from __future__ import annotations

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.types import BoolArray, FloatArray
from ..arrays.vectors import cross_products, dot_products, lengths, squared_norms, transformed_nets, units
from ..bounds.norm_bounds import Vertices
from ..surface.bicubic import HALVES, NET_TO_BERNSTEIN, SECOND_DIFFERENCE, SPLINE_HALVES, SPLINE_TO_BERNSTEIN, tensor
from ..surface.evaluation import spline_weights
from .foot_bounds import LARGEST_TILT, LEAST_SINE, MIDDLE, MIDDLE_SECONDS, ROUNDING, Turns, likely_distances

# Vertices of a level around the middle of a face, in leaves from there on; and for each sample its place, how far from
# it in parameters other triangles are at least, and the triangles between.
AROUND = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (-1, 0), (-1, -1), (0, -1)])
SAMPLES = (
    ((0.5, 0.5), 0.5, [(0, 1, 2), (0, 2, 3)]),
    ((0.5, 0.0), 0.25, [(0, 1, 2), (6, 1, 0)]),
    ((0.0, 0.5), 0.25, [(4, 0, 3), (0, 2, 3)]),
    ((0.0, 0.0), 0.5, [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5), (0, 5, 6), (0, 6, 1)]),
)

# The points of a net at the corners of a face.
AT_CORNERS = [5, 9, 10, 6]

# At level 0 a face is one leaf.
CORNERS = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
OF_LEVEL_0 = SAMPLES[:1]

PART = HALVES[0] @ HALVES[1] @ SPLINE_TO_BERNSTEIN
PART_ROWS = tensor(PART, PART)

# (40, 16): of a net the Bernstein coefficients and the points at the corners; then S_uu, S_vv and S_uuvv.
OF_HULLS = 20
HULLS_AND_SECONDS = np.concatenate(
    [
        NET_TO_BERNSTEIN,
        np.eye(16)[AT_CORNERS],
        tensor(SECOND_DIFFERENCE, np.eye(4)),
        tensor(np.eye(4), SECOND_DIFFERENCE),
        tensor(SECOND_DIFFERENCE, SECOND_DIFFERENCE),
    ]
)

# The parts of a face; (16, 16, 16): their nets; (80, 16): S_u, S_v, S_uu, S_vv and S_uv at their middles.
PARTS = 16
QUARTERS = [one @ other for other in SPLINE_HALVES for one in SPLINE_HALVES]
PART_NETS = np.array([np.kron(one, other) for one in QUARTERS for other in QUARTERS])
PART_MIDDLES = (np.concatenate([MIDDLE[1:], MIDDLE_SECONDS]) @ PART_NETS).swapaxes(0, 1).reshape(80, 16)


def middle_distances(nets: FloatArray, rates: FloatArray, level: int, vertices: Vertices) -> FloatArray:
    """(P,) of nets (4, 4, P, 3) of regular faces: how far a point of the surface is at least from the triangles of a
    level over the same face.

    The largest found of some points of ``middle_parts``. rates: (P,), as of ``rates_of``.
    """
    points = nets.reshape(16, -1, 3)
    size = 0.5**level
    middle = 0.5 if level else 0.0
    places = middle + size * AROUND if level else CORNERS
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
    """(4, 4, P, 3): of nets (4, 4, P, 3) of regular faces those of one of their 16 parts each, on which a level's
    triangles are farthest from the surface, about."""
    uu, vv, uv = part_seconds(np.ascontiguousarray(nets.reshape(16, -1, 3).swapaxes(1, 2)))
    heights = np.max(np.abs([uu, vv, uu + vv + 2 * uv, uu + vv - 2 * uv]), axis=0)
    chosen = heights.argmax(axis=0)
    found = np.empty_like(nets)
    for part in range(16):
        own = np.flatnonzero(chosen == part)
        if len(own):
            found[:, :, own] = matrix_product(PART_NETS[part], nets[:, :, own].reshape(16, -1)).reshape(4, 4, -1, 3)
    return found


def part_seconds(nets: FloatArray) -> FloatArray:
    """(3, 16, P): S_uu, S_vv and S_uv along the normals at the middles of the 16 parts of faces with nets (16, 3, P),
    for parameters with one unit for the face."""
    along_u, along_v, *seconds = matrix_product(PART_MIDDLES, nets.reshape(16, -1)).reshape(5, 16, *nets.shape[1:])
    normals = along_u[:, [1, 2, 0]] * along_v[:, [2, 0, 1]] - along_u[:, [2, 0, 1]] * along_v[:, [1, 2, 0]]
    lengths = np.sqrt((normals * normals).sum(axis=1))
    found = np.stack([(each * normals).sum(axis=1) for each in seconds])
    return found * (PARTS / np.maximum(lengths, np.finfo(float).tiny))


def likely_at_parts(nets: FloatArray, level: int, vertices: Vertices, is_turned: BoolArray) -> FloatArray:
    """(P,): how far the triangles of a level, 1 or later, are about from the surface over faces with nets (16, 3, P).
    Proves nothing. is_turned: as of ``foot_bounds``."""
    seconds = part_seconds(nets)
    if level == 1:
        # Leaves have four parts each.
        seconds = seconds.reshape(3, 2, 2, 2, 2, -1).mean(axis=(2, 4)).reshape(3, 4, -1)
    return likely_distances(seconds, vertices, is_turned).max(axis=0) * 0.25**level


def middle_parts(nets: FloatArray) -> FloatArray:
    """(16, P, 3): points whose hull holds the surface over parameters from a half to three quarters, of nets
    (4, 4, P, 3)."""
    return transformed_nets(PART_ROWS, nets.reshape(16, -1, 3))


def tight_boxes(nets: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(P, 3) twice, boxes that hold the surface over regular faces with nets (4, 4, P, 3), and every level's vertices
    and triangles there."""
    hull, seconds = _hulls(nets)
    beyond = _beyond(*(np.abs(each).max(axis=0) for each in seconds))
    return hull.min(axis=0) - beyond, hull.max(axis=0) + beyond


def are_apart(nets: FloatArray, hulls: FloatArray, reach: float) -> BoolArray:
    """(P,) bool: hulls of points (R, P, 3) farther than the reach from every level over regular faces with nets
    (4, 4, P, 3), as a plane between them shows."""
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
    """(P,): two points of a level over a face whose parameters differ by Δ are at least this times Δ apart, of nets
    (4, 4, P, 3) of regular faces; not above zero where that is not known, or whether diagonals are drawn from corner 0
    to 2. condition: of the axes of the object's space.

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
    """(n, 16): functionals of nets, the surface at parameters (n, 2)."""
    along, across = (spline_weights(each) for each in places.T)
    return np.einsum("in,jn->nij", along, across).reshape(-1, 16)


def _vertex_rows(places: FloatArray, size: float, vertices: Vertices) -> FloatArray:
    """(n, 16): functionals of nets, the vertices of a level whose leaves have this size, at parameters (n, 2)."""
    if vertices is Vertices.LIMIT:
        return _value_rows(places)
    rows = []
    for t in places.T:
        second = np.stack([1 - t, 3 * t - 2, 1 - 3 * t, t])
        rows.append(spline_weights(t) - size**2 / 6 * second)
    return np.einsum("in,jn->nij", *rows).reshape(-1, 16)
