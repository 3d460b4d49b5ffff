# SPDX-License-Identifier: GPL-3.0-or-later
"""Work on poles of very many faces can be stopped: it gives control back often."""

from __future__ import annotations

from itertools import islice
from time import process_time

from ccdepth_addon.core.depth.face_depths import face_depths_stepwise
from tests import meshes

VALENCE = 5000

# So many steps are looked at, after the first one, which checks the mesh.
STEPS = 60

# Seconds of processor time: ten times what was measured, and a fifth of what it was without steps.
LONGEST = 1.0


def test_first_order_around_a_large_pole() -> None:
    mesh = meshes.to_polygon_mesh(meshes.trapezohedron(VALENCE))
    steps = face_depths_stepwise(mesh, 0.01, "FIRST_ORDER", "CONTROL")
    next(steps)
    longest, before = 0.0, process_time()
    for _ in islice(steps, STEPS):
        longest, before = max(longest, process_time() - before), process_time()
    assert longest < LONGEST
