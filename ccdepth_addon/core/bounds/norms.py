# SPDX-License-Identifier: GPL-3.0-or-later
"""First- and second-order norms of control nets: the largest first or second difference.

A regular net is a (4, 4, P, 3) array, an extraordinary net of valence n a (2n + 8, P, 3) array in Stam's order
(see ``patches``). Norms are (P,) float64 in the unit of the positions.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import FloatArray
from ..arrays.vectors import squared_norms
from ..surface.patches import ring_index


def _largest(vectors: Iterable[FloatArray]) -> FloatArray:
    """(P,): the longest of several (P, 3) vectors."""
    squares = iter(map(squared_norms, vectors))
    largest = next(squares)
    for square in squares:
        np.maximum(largest, square, out=largest)
    return np.sqrt(largest)


def second_order_norm_regular(net: FloatArray) -> FloatArray:
    """M of a regular patch: the largest of its 16 second differences (Cheng, Chen and Yong 2006, section 2)."""
    along_u = (2 * net[i, j] - net[i - 1, j] - net[i + 1, j] for i in (1, 2) for j in range(4))
    along_v = (2 * net[i, j] - net[i, j - 1] - net[i, j + 1] for j in (1, 2) for i in range(4))
    return np.maximum(_largest(along_u), _largest(along_v))


def second_differences(valence: int) -> NDArray[np.intp]:
    """(3, 2n + 10): the second differences 2V_a - V_b - V_c of an extraordinary net, as indices a, b and c into it.

    Cheng, Chen and Yong 2006, section 3: n of a spoke with the spoke after the next, n of a spoke between its two
    diagonals, and ten in the outer rows.
    """
    n = valence
    numbers = np.arange(1, n + 1)
    spokes = [np.zeros(n, dtype=np.intp), ring_index(n, 2 * numbers), ring_index(n, 2 * numbers + 4)]
    diagonals = [ring_index(n, 2 * numbers + end) for end in (2, 1, 3)]
    v1, v2, v3, v4, v5, v6, v7, v8 = 0, *(ring_index(n, number) for number in range(2, 9))
    o2, o3, o4, o5, o6, o7, o8 = range(2 * n + 1, 2 * n + 8)
    outer = [
        (v3, v2, o8),
        (v4, v1, o7),
        (v5, v6, o6),
        (v5, v4, o3),
        (v6, v1, o4),
        (v7, v8, o5),
        (o7, o6, o8),
        (o6, o2, o7),
        (o3, o2, o4),
        (o4, o3, o5),
    ]
    return np.hstack([spokes, diagonals, np.transpose(outer)])


def second_order_norm_extraordinary(net: FloatArray) -> FloatArray:
    """M of an extraordinary patch: the largest of its 2n + 10 second differences."""
    middles, ones, others = second_differences((len(net) - 8) // 2)
    differences = 2 * net.take(middles, axis=0)
    differences -= net.take(ones, axis=0)
    differences -= net.take(others, axis=0)
    return np.sqrt(squared_norms(differences).max(axis=0))


def first_order_norm_regular(net: FloatArray) -> FloatArray:
    """The largest of the 24 edges of a regular net."""
    along_u = (net[i + 1, j] - net[i, j] for i in range(3) for j in range(4))
    along_v = (net[i, j + 1] - net[i, j] for j in range(3) for i in range(4))
    return np.maximum(_largest(along_u), _largest(along_v))


def first_order_norm_extraordinary(net: FloatArray) -> FloatArray:
    """The largest edge of an extraordinary net: each second difference is one of two edges that meet."""
    ones, others = _edge_ends((len(net) - 8) // 2)
    edges = net.take(ones, axis=0)
    edges -= net.take(others, axis=0)
    return np.sqrt(squared_norms(edges).max(axis=0))


def _edge_ends(valence: int) -> NDArray[np.intp]:
    """(2, edges): the two ends of every edge that a second difference spans."""
    middles, ones, others = second_differences(valence)
    ends = np.concatenate([middles, middles]), np.concatenate([ones, others])
    points = 2 * valence + 8
    edges = np.unique(points * np.minimum(*ends) + np.maximum(*ends))
    return np.array(np.divmod(edges, points))
