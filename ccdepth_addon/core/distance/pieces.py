# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface in a shell, divided until each has a bound. docs/distance.md, Quads of a level."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import dot_products, lengths
from ..surface.bicubic import QUARTERS
from ..surface.triangle_coefficients import triangle_quarters
from .piece_hulls import Pieces, off_at_equal
from .shell_bounds import shell_bounds
from .shells import Shell
from .side_bounds import Beside

# The number of times pieces are halved both ways before their base is given up, and the first time at which a base is
# given up for too many more open pieces than before. A curve without proved places meets twice as many pieces each
# time, a single point no more.
SPLITS, SETTLED_AT = 5, 2

# The number of pieces of which all quarters are bounded together.
MOST_TOGETHER = 1 << 9

# The number of times pieces are halved at equal parameters.
SPLITS_AT_EQUAL = 2


@dataclass(frozen=True)
class Form:
    """The kind of hull of pieces. values: the hull points on the surface. quarters: four (R, R), from the coefficients
    of a piece to the coefficients of its quarters; none where pieces cannot be divided."""

    values: IndexArray
    quarters: tuple[FloatArray, ...]


SQUARE_FORM = Form(np.array([0, 3, 12, 15]), QUARTERS)
TRIANGLE_FORM = Form(np.array([0, 21, 27]), triangle_quarters())
HULL_FORM = Form(np.zeros(0, dtype=np.intp), ())


def include_pieces(
    found: FloatArray,
    bases: IndexArray,
    pieces: Pieces,
    form: Form,
    limits: FloatArray,
    shell: Shell,
    beside: Beside | None = None,
) -> None:
    """Raise the bounds found (n,) of bases to the bounds of their pieces; infinite where no bound within the limits
    (n,) is proved. bases: (P,), of the pieces. beside: as in ``shell_bounds``."""

    def bounds(some: Pieces) -> FloatArray:
        return shell_bounds(shell, some, beside)

    def reached(some: Pieces) -> FloatArray:
        return _heights_at(shell, form.values, some)

    _include(found, bases, pieces, form, limits, SPLITS, bounds, reached)


def include_at_equal(found: FloatArray, bases: IndexArray, pieces: Pieces, form: Form, limits: FloatArray) -> None:
    """Raise the bounds found (n,) to distances at equal parameters, as in ``include_pieces``."""

    def reached(some: Pieces) -> FloatArray:
        off: FloatArray = lengths(some.hulls[form.values] - some.flats[form.values]).max(axis=0, initial=0.0)
        return off

    _include(found, bases, pieces, form, limits, SPLITS_AT_EQUAL, off_at_equal, reached)


def _include(
    found: FloatArray,
    bases: IndexArray,
    pieces: Pieces,
    form: Form,
    limits: FloatArray,
    splits: int,
    bounds_of: Callable[[Pieces], FloatArray],
    reached_by: Callable[[Pieces], FloatArray],
) -> None:
    """Raise the bounds found (n,) to bounds of pieces, halved both ways up to a number of times; infinite where they
    reach beyond the limits (n,), or as soon as more pieces of a base are open than before."""
    before = np.full(len(found), np.inf)
    for split in range(splits + 1 if form.quarters else 1):
        is_last = split == splits or not form.quarters
        if is_last:
            before = np.zeros(len(found))
        counts, left = np.zeros(len(found)), []
        for parts in _taken_together(form, len(bases)) if split else ((),):
            own, some = _still_open(found, bases, pieces)
            if parts:
                own, some = np.tile(own, len(parts)), some.divided(parts)
            found[own[reached_by(some) > limits[own]]] = np.inf
            own, some = _still_open(found, own, some)
            bounds = bounds_of(some)
            is_open = bounds > limits[own]
            np.maximum.at(found, own[~is_open], bounds[~is_open])
            counts += np.bincount(own[is_open], minlength=len(found))
            if is_last or split >= SETTLED_AT:
                found[counts > before] = np.inf
            left.append((own[is_open], some.at(is_open)))
        owners, (first, *others) = zip(*(_still_open(found, *each) for each in left), strict=True)
        bases, pieces = np.concatenate(owners), first.joined(others)
        before = counts
        if not len(bases):
            return


def _taken_together(form: Form, count: int) -> Sequence[Sequence[FloatArray]]:
    """The quarters to bound together of a number of pieces: one after the other if they are many, so that bases are
    given up between."""
    return [[rows] for rows in form.quarters] if count > MOST_TOGETHER else [form.quarters]


def _still_open(found: FloatArray, bases: IndexArray, pieces: Pieces) -> tuple[IndexArray, Pieces]:
    """The bases with finite bounds so far, and their pieces."""
    left = np.isfinite(found[bases])
    return bases[left], pieces.at(left)


def _heights_at(shell: Shell, values: IndexArray, pieces: Pieces) -> FloatArray:
    """(P,): the largest heights over the triangles' planes among values, the hull points on the surface."""
    if not len(values):
        return np.zeros(len(pieces.triangles))
    triangles = shell.triangles
    points = pieces.hulls[values] - triangles.corners[pieces.triangles, 0]
    return np.abs(dot_products(points, triangles.normals[pieces.triangles])).max(axis=0)
