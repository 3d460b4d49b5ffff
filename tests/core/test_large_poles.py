# SPDX-License-Identifier: GPL-3.0-or-later
"""Work on poles of very many faces can be stopped: it tells its progress often."""

from __future__ import annotations

import itertools
from time import process_time

import pytest

from ccdepth_addon.core.depth.face_depths import face_depths
from tests import meshes

VALENCE = 5000

# So many reports of progress are looked at.
REPORTS = 60

# Seconds of processor time: ten times what was measured, and a fifth of what it was with a report for each level.
LONGEST = 1.0


class Enough(Exception):
    """So much has been seen."""


def test_first_order_around_a_large_pole() -> None:
    mesh = meshes.to_polygon_mesh(meshes.trapezohedron(VALENCE))
    times: list[float] = []

    def note(fraction: float) -> None:
        times.append(process_time())
        if len(times) > REPORTS:
            raise Enough

    with pytest.raises(Enough):
        face_depths(mesh, 0.01, "FIRST_ORDER", "CONTROL", note)
    assert max(after - before for before, after in itertools.pairwise(times)) < LONGEST
