# SPDX-License-Identifier: GPL-3.0-or-later
"""The same mesh has the same result to the last bit, however many threads there are."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).resolve().parents[2]

# Large enough for several pieces of work at once, and for products that libraries share out over their threads.
PROGRAM = """
import os, sys
os.cpu_count = lambda: int(sys.argv[1])
from hashlib import sha256
import numpy as np
from ccdepth_addon.core.adaptive.planner import AdaptiveRequest, Mode, subdivide_adaptively
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from ccdepth_addon.core.depth.face_depths import face_depths
from ccdepth_addon.core.adaptive.templates import Transitions
from ccdepth_addon.core.deviation import measure_deviation
from tests.core.test_halves import triangles_of
from tests import meshes

MESHES = {
    "landscape": lambda: meshes.with_random_creases(meshes.landscape(100, 100), seed=1, share=0.05),
    "poles": lambda: meshes.bumpy(meshes.trapezohedron(64), 0.05),
    "triangles": lambda: meshes.bumpy(meshes.bipyramid(9), 0.1),
}
for name, made in MESHES.items():
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(made()), smooth_corners=True)
    diagonal = float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))
    found = face_depths(mesh, 1e-2 * diagonal, "CERTIFIED", "LIMIT")
    arrays = [found.depths, found.bounds, found.distances, found.exact]
    for transitions in Transitions:
        request = AdaptiveRequest(1e-2 * diagonal, Mode.ADAPTIVE, transitions, 10**6)
        adaptive = subdivide_adaptively(mesh, request, mesh.positions)
        arrays += [adaptive.mesh.positions, adaptive.mesh.corner_vertices, adaptive.bounds, adaptive.depths]
        if transitions is Transitions.TRIANGLES and name != "landscape":
            measured = measure_deviation(mesh, adaptive.mesh.positions, triangles_of(adaptive), accuracy=1.0)
            arrays += [measured.face_bounds, measured.triangle_bounds, np.array([measured.proved, measured.reached])]
    print(name, sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest())
"""


def digests(threads: int) -> str:
    """With so many threads of ours, and of the libraries behind numpy."""
    limits = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")
    environment = os.environ | dict.fromkeys(limits, str(threads)) | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", PROGRAM, str(threads)]
    return subprocess.run(command, env=environment, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def test_bits_do_not_depend_on_threads() -> None:
    alone = digests(1)
    assert len(alone.splitlines()) == 3
    assert digests(2) == alone
