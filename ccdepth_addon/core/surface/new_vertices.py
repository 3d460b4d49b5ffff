# SPDX-License-Identifier: GPL-3.0-or-later
"""The limit positions of the new vertices of a Catmull-Clark step on edges and in quads.

A new vertex has four quads around it, and of its edges only the two halves of the divided edge can be sharp, both
alike. Its limit depends on its ring alone: on the sum A of the ends of these halves, B of the other two edges' ends,
and D of the four points across the quads. With V the vertex, each level with a sharpness of 1 or more takes V, A, B and
D to (catmull_clark; the new A has the midpoints, and the sum of the face points is the new D)

    3V/4 + A/8,   V + A/2,   (V + B/2) / 2 + D'/4,   D' = V + A/2 + B/2 + D/4,

each smooth level leaves the limit (16V + 4A + 4B + D) / 36, and an infinite sharpness that of the crease, (4V + A) / 6.
In the level where a sharpness ends the step is a mean of the sharp and the smooth one. So the limit's weights are those
of the whole sharpnesses below and above, interpolated.
"""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from .sharpness import LARGEST_SEMI_SHARPNESS


def _limit_weights() -> FloatArray:
    """(13, 4): the weights of V, A, B and D in the limit, for sharpnesses 0 to 10, and twice for infinite ones."""
    step = np.array([[3 / 4, 1 / 8, 0, 0], [1, 1 / 2, 0, 0], [3 / 4, 1 / 8, 3 / 8, 1 / 16], [1, 1 / 2, 1 / 2, 1 / 4]])
    rows = [np.array([16.0, 4.0, 4.0, 1.0]) / 36]
    for _ in range(int(LARGEST_SEMI_SHARPNESS)):
        rows.append(rows[-1] @ step)
    crease = np.array([4.0, 1.0, 0.0, 0.0]) / 6
    return np.stack([*rows, crease, crease])


LIMIT_WEIGHTS = _limit_weights()


def limits_of_new_vertices(mesh: PolygonMesh, count: int) -> FloatArray:
    """(count, 3, 3) float64: the limit positions at corners 1, 2 and 3 of the first faces of a mesh.

    mesh: made by ``subdivide``, or a submesh of such a mesh that has all faces around these corners. The faces come
    from quads, and have the vertex point at corner 0.
    """
    own = np.arange(count)
    following, before = _across(mesh, own, 1), _across(mesh, own, 2)
    opposite = _across(mesh, following, 1)
    vertices = [_points(mesh, quads, 0) for quads in (own, following, opposite, before)]
    edge_points = [_points(mesh, own, 1), _points(mesh, opposite, 1), _points(mesh, opposite, 3), _points(mesh, own, 3)]
    centre = _points(mesh, own, 2)
    limits = np.empty((count, 3, 3))
    own_weight, of_edge_points, _, of_vertices = LIMIT_WEIGHTS[0]
    limits[:, 1] = own_weight * centre + of_edge_points * _sum(edge_points) + of_vertices * _sum(vertices)
    for corner, side, beside in ((1, 0, following), (3, 3, before)):
        # Without a quad across, the side is infinitely sharp, and these points do not count.
        over, beyond = _across(mesh, own, side), _across(mesh, beside, 3 - side)
        along = vertices[0] + _points(mesh, beside, 0)
        across = centre + _points(mesh, over, 2)
        diagonals = [_points(mesh, quads, corner) for quads in (beside, over)]
        diagonals += [_points(mesh, quads, 4 - corner) for quads in (own, beyond)]
        ring = np.stack([_points(mesh, own, corner), along, across, _sum(diagonals)])
        weights = _interpolated(mesh.edge_sharpness[mesh.corner_edges[4 * own + side]])
        limits[:, corner - 1] = np.einsum("kp,kpc->pc", weights, ring)
    return limits


def _sum(points: list[FloatArray]) -> FloatArray:
    """(P, 3): in the order of the list."""
    total = points[0].copy()
    for some in points[1:]:
        total += some
    return total


def _across(mesh: PolygonMesh, quads: IndexArray, side: int) -> IndexArray:
    """(P,) intp: the quads across a side of quads, the one from corner ``side`` on; without one, the quad itself."""
    return mesh.twin[4 * quads + side] // 4


def _points(mesh: PolygonMesh, quads: IndexArray, corner: int) -> FloatArray:
    """(P, 3): the vertices at one corner of quads."""
    return mesh.positions.take(mesh.corner_vertices[4 * quads + corner], axis=0)


def _interpolated(sharpness: FloatArray) -> FloatArray:
    """(4, P): the weights for sharpnesses (P,)."""
    capped = np.minimum(sharpness, len(LIMIT_WEIGHTS) - 2)
    below = np.floor(capped).astype(np.intp)
    part = (capped - below)[:, None]
    weights: FloatArray = (1 - part) * LIMIT_WEIGHTS[below] + part * LIMIT_WEIGHTS[below + 1]
    return weights.T
