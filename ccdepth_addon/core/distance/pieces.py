# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface in a shell, divided until each has a bound. docs/distance.md, Quads of a level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import dot_products, lengths
from ..surface.bicubic import HALVES
from ..surface.triangle_coefficients import triangle_quarters
from .piece_hulls import Pieces, off_at_equal
from .shell_bounds import shell_bounds
from .shells import Shell

# The number of times pieces are halved both ways before their base is given up, and the first time at which a base is
# given up for too many more open pieces than before. A curve without proved places meets twice as many pieces each
# time, a single point no more.
SPLITS, SETTLED_AT = 5, 2

# The number of times pieces are halved at equal parameters.
SPLITS_AT_EQUAL = 2


@dataclass(frozen=True)
class Form:
    """The kind of hull of pieces. values: the hull points on the surface. quarters: four (R, R), from the coefficients
    of a piece to the coefficients of its quarters; none where pieces cannot be divided."""

    values: IndexArray
    quarters: tuple[FloatArray, ...]


SQUARE_FORM = Form(np.array([0, 3, 12, 15]), tuple(np.kron(one, other) for one in HALVES for other in HALVES))
TRIANGLE_FORM = Form(np.array([0, 21, 27]), triangle_quarters())
HULL_FORM = Form(np.zeros(0, dtype=np.intp), ())


def include_pieces(
    shell: Shell,
    found: FloatArray,
    bases: IndexArray,
    pieces: Pieces,
    form: Form,
    limit: float,
    off_beyond: FloatArray | None = None,
    *,
    growth: float,
) -> None:
    """Raise the bounds found (n,) of bases to the bounds of their pieces; infinite where no bound within the limit is
    proved. bases: (P,), of the pieces. off_beyond: as in ``shell_bounds``. growth: the largest factor by which the
    number of open pieces may grow."""
    before = np.full(len(found), np.inf)
    for split in range(SPLITS + 1):
        beyond = _heights_at(shell, form.values, pieces) > limit
        found[bases[beyond]] = np.inf
        left = np.flatnonzero(np.isfinite(found[bases]))
        bases, pieces = bases[left], pieces.at(left)
        if not len(left):
            return
        bounds = shell_bounds(shell, pieces, off_beyond)
        is_open = bounds > limit
        np.maximum.at(found, bases[~is_open], bounds[~is_open])
        if split == SPLITS or not form.quarters:
            found[bases[is_open]] = np.inf
            return
        counts = np.bincount(bases[is_open], minlength=len(found))
        if split >= SETTLED_AT:
            found[counts > growth * before] = np.inf
        before = counts
        is_open &= np.isfinite(found[bases])
        bases, pieces = np.tile(bases[is_open], 4), pieces.at(np.flatnonzero(is_open)).divided(form.quarters)


def include_at_equal(found: FloatArray, bases: IndexArray, pieces: Pieces, form: Form, limit: float) -> None:
    """Raise the bounds found (n,) to distances at equal parameters, as in ``include_pieces``."""
    for split in range(SPLITS_AT_EQUAL + 1):
        off = off_at_equal(pieces)
        is_open = off > limit
        np.maximum.at(found, bases[~is_open], off[~is_open])
        if split == SPLITS_AT_EQUAL or not form.quarters:
            found[bases[is_open]] = np.inf
            return
        if len(form.values):
            reached = lengths(pieces.hulls[form.values] - pieces.flats[form.values]).max(axis=0)
            found[bases[reached > limit]] = np.inf
        is_open &= np.isfinite(found[bases])
        bases, pieces = np.tile(bases[is_open], 4), pieces.at(np.flatnonzero(is_open)).divided(form.quarters)


def _heights_at(shell: Shell, values: IndexArray, pieces: Pieces) -> FloatArray:
    """(P,): the largest heights over the triangles' planes among values, the hull points on the surface."""
    if not len(values):
        return np.zeros(len(pieces.triangles))
    triangles = shell.triangles
    points = pieces.hulls[values] - triangles.corners[pieces.triangles, 0]
    return np.abs(dot_products(points, triangles.normals[pieces.triangles])).max(axis=0)
