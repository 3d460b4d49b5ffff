# SPDX-License-Identifier: GPL-3.0-or-later
"""Templates: the triangles that tessellate a quad, for each pattern of split sides.

The points of a quad are its corners 0 to 3 and the middles 4 to 7 of the sides from them; a pattern has bit s set when
side s is split. The four triangles or fewer of a template have no angle below 26° on a square.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import FloatArray, IndexArray

Triangle = tuple[int, int, int]
Template = tuple[Triangle, ...]


# The points of a quad in its parameters.
QUAD_POINTS: FloatArray = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0], [1, 0.5], [0.5, 1], [0, 0.5]])

# The way inwards from there.
INWARDS: FloatArray = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [0, 1], [-1, 0], [0, -1], [1, 0]], dtype=np.float64)

WHOLE = 0
ALL_SPLIT = 15

PLAIN: tuple[Template, ...] = (((0, 1, 2), (0, 2, 3)), ((1, 2, 3), (1, 3, 0)))
ONE_SIDE: tuple[Template, ...] = (((0, 4, 3), (4, 1, 2), (4, 2, 3)),)
SIDES_IN_A_ROW: tuple[Template, ...] = (((4, 1, 5), (0, 4, 3), (4, 5, 3), (5, 2, 3)),)
LEFT_HALF: tuple[Template, ...] = (((0, 4, 6), (0, 6, 3)), ((4, 6, 3), (4, 3, 0)))
RIGHT_HALF: tuple[Template, ...] = (((4, 1, 2), (4, 2, 6)), ((1, 2, 6), (1, 6, 4)))
OPPOSITE_SIDES: tuple[Template, ...] = tuple(left + right for left in LEFT_HALF for right in RIGHT_HALF)
THREE_SIDES: tuple[Template, ...] = tuple((*left, (4, 1, 5), (5, 2, 6), (4, 5, 6)) for left in LEFT_HALF)

# Each pattern once; its rotations are made from it.
CANONICAL = {0b0000: PLAIN, 0b0001: ONE_SIDE, 0b0011: SIDES_IN_A_ROW, 0b0101: OPPOSITE_SIDES, 0b0111: THREE_SIDES}


def templates(pattern: int) -> tuple[Template, ...]:
    """The templates for a pattern other than ``ALL_SPLIT``, whose quads are always split."""
    if pattern == ALL_SPLIT:
        raise ValueError("a quad whose four sides are split has no template")
    turns = _turns(pattern)
    return tuple(
        tuple(_rotated(t, turns) for t in template) for template in CANONICAL[rotated_pattern(pattern, -turns)]
    )


def _turns(pattern: int) -> int:
    """The number of sides by which a pattern is turned from its pattern in ``CANONICAL``."""
    return next((turns for turns in range(4) if rotated_pattern(pattern, -turns) in CANONICAL), 0)


def rotated_pattern(pattern: int, turns: int) -> int:
    """The pattern with side s become side s + turns."""
    turns %= 4
    return (pattern << turns | pattern >> (4 - turns)) & ALL_SPLIT


def _rotated(triangle: Triangle, turns: int) -> Triangle:
    a, b, c = ((point + turns) % 4 + point // 4 * 4 for point in triangle)
    return a, b, c


# For each pattern the number of its templates.
COUNTS = np.array([0 if pattern == ALL_SPLIT else len(templates(pattern)) for pattern in range(16)])


def template_numbers(patterns: NDArray[np.int8], alternatives: IndexArray | NDArray[np.int8]) -> IndexArray:
    """(P,): a number for each template. Patterns are below 16."""
    return alternatives.astype(np.intp) * 16 + patterns


def template_groups(numbers: IndexArray) -> Iterator[tuple[int, int, IndexArray]]:
    """Each pattern and alternative among template numbers (P,), with the indices of its entries."""
    for number in np.unique(numbers).tolist():
        yield number % 16, number // 16, np.flatnonzero(numbers == number)


def triangle_table(each: Sequence[Template]) -> tuple[IndexArray, IndexArray]:
    """(n, T, 3) and (n,): the vertices of the templates' triangles, and their numbers. Shorter templates are padded by
    repeating a triangle."""
    counts = np.array([len(template) for template in each])
    repeated = [[*template, *[template[0]] * (counts.max() - len(template))] for template in each]
    return np.array(repeated, dtype=np.intp), counts


def _all_templates() -> list[Template]:
    """The templates by number; unused numbers repeat a template."""
    patterns = [templates(pattern) for pattern in range(ALL_SPLIT)]
    rows = [[own[min(alternative, len(own) - 1)] for own in (*patterns, PLAIN)] for alternative in range(COUNTS.max())]
    return [template for row in rows for template in row]


# By the number of a template, as in ``triangle_table``; without split sides there are fewer triangles.
TRIANGLES, TRIANGLE_COUNTS = triangle_table(_all_templates())


# The same for a triangle of the control mesh: corners 0 to 2, middles 3 to 5.
ONE_SIDE_OF_TRIANGLE: Template = ((2, 0, 3), (2, 3, 1))
TWO_SIDES_OF_TRIANGLE: Template = ((3, 1, 4), (0, 3, 2), (3, 4, 2))


def triangle_template(pattern: int) -> Template:
    """The template of a triangle with one or two split sides; with three split sides the triangle itself is split."""
    for turns in range(3):
        for source, template in ((0b001, ONE_SIDE_OF_TRIANGLE), (0b011, TWO_SIDES_OF_TRIANGLE)):
            if (source << turns | source >> (3 - turns)) & 0b111 == pattern:
                return tuple(
                    tuple((point + turns) % 3 + point // 3 * 3 for point in triangle)  # type: ignore[misc]
                    for triangle in template
                )
    raise ValueError("a triangle whose sides are all whole or all split has no template")


# Weights of such a triangle's corners for its corners and middles.
TRIANGLE_POINTS: FloatArray = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]], dtype=np.float64
)

# By patterns, as in ``triangle_table``.
TRIANGLES_OF_TRIANGLE, COUNTS_OF_TRIANGLE = triangle_table([((0, 1, 2),), *map(triangle_template, range(1, 7))])
