# SPDX-License-Identifier: GPL-3.0-or-later
"""Processor time of adaptive subdivision for meshes of several kinds, here and in other checkouts.

python benchmarks/adaptive_times.py [--against CHECKOUT…] [--repeats N] [PART OF A NAME…]        with the bpy wheel

Each checkout has a process of its own, with one thread; the processes take turns, so that a busy machine slows all of
them. Prints for each the time of the first run, without caches; the median of the others; faces; and faces a second.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

from benchmarks.adaptive_faces import MODELLED
from tests import meshes
from tests.blender import scene

ROOT = Path(__file__).resolve().parent.parent
REPEATS = 5

# The program of a process: reads meshes and limits, and reports times and faces, by the core's public interface alone.
WORKER = """
import json, sys, time
import numpy as np
import ccdepth_addon.core.arrays.threads as threads
from ccdepth_addon.core import (
    AdaptiveRequest, Mode, apply_boundary_rule, polygon_mesh, subdivide_adaptively
)
threads._thread_count = lambda: 1
for line in sys.stdin:
    path, limit = json.loads(line)
    with np.load(path) as saved:
        mesh = polygon_mesh(saved["positions"], saved["face_sizes"], saved["corner_vertices"])
    mesh = apply_boundary_rule(mesh, smooth_corners=True)
    request = AdaptiveRequest(limit, Mode.ADAPTIVE, 10_000_000)
    start = time.process_time()
    found = subdivide_adaptively(mesh, request, mesh.positions)
    print(json.dumps([time.process_time() - start, len(found.bounds)]), flush=True)
"""


def suzanne(levels: int) -> meshes.MeshData:
    base = scene.add_suzanne()
    if levels:
        scene.add_subdivision(base, levels)
    return scene.evaluated_mesh_data(base)


def triangulated_hills(points: int) -> meshes.MeshData:
    """The Delaunay triangles of random points, on a wavy height field."""
    places = np.random.default_rng(0).uniform(0.0, 1.0, (points, 2))
    found = delaunay_2d_cdt([Vector(place) for place in places.tolist()], [], [], 0, 1e-9)
    x, y = np.array([[*place] for place in found[0]]).T
    triangles = np.array(found[2])
    positions = np.stack([x, y, 0.1 * np.sin(6 * x) * np.cos(5 * y)], axis=1)
    return meshes.MeshData(positions, np.full(len(triangles), 3), triangles.ravel())


@dataclass(frozen=True)
class Case:
    """A mesh, and the tolerance, in units or in parts of the diagonal."""

    make: Callable[[], meshes.MeshData]
    tolerance: float
    is_relative: bool = True

    def limit(self, data: meshes.MeshData) -> float:
        return self.tolerance * (float(np.linalg.norm(np.ptp(data.positions, axis=0))) if self.is_relative else 1.0)


CASES = {
    "Suzanne": Case(lambda: suzanne(0), 0.01, is_relative=False),
    "Suzanne after one step": Case(lambda: suzanne(1), 3e-4),
    "Suzanne after three steps": Case(lambda: suzanne(3), 2e-5, is_relative=False),
    "bevelled cube": Case(MODELLED["bevelled cube"], 3e-4),
    "bevelled cylinder": Case(MODELLED["bevelled cylinder"], 3e-4),
    "valence 64": Case(lambda: meshes.fan(64, 1), 0.01, is_relative=False),
    "valence 360": Case(lambda: meshes.fan(360, 1), 0.01, is_relative=False),
    "planar triangles": Case(MODELLED["planar triangles"], 1e-4),
    "triangles between 500 points": Case(lambda: triangulated_hills(500), 2e-4),
    "triangles between 2,000 points": Case(lambda: triangulated_hills(2000), 2e-4),
}


def saved(case: Case, path: Path) -> float:
    """Make a mesh and save it; returns the limit."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    data = meshes.single_precision(case.make())
    np.savez(path, positions=data.positions, face_sizes=data.face_sizes, corner_vertices=data.corner_vertices)
    return case.limit(data)


def asked(worker: subprocess.Popen[str], path: Path, limit: float) -> tuple[float, int]:
    """Seconds and faces of one run."""
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write(json.dumps([str(path), limit]) + "\n")
    worker.stdin.flush()
    seconds, faces = json.loads(worker.stdout.readline())
    return seconds, faces


def started(checkout: Path) -> subprocess.Popen[str]:
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-c", WORKER], cwd=checkout, **pipes)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--against", nargs="*", type=Path, default=[])
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument("names", nargs="*")
    given = parser.parse_args()
    chosen = [name for name in CASES if not given.names or any(part in name for part in given.names)]
    checkouts = [ROOT, *given.against]
    with tempfile.TemporaryDirectory() as directory, ExitStack() as open_ones:
        workers = [open_ones.enter_context(started(checkout)) for checkout in checkouts]
        for name in chosen:
            path = Path(directory) / "mesh.npz"
            limit = saved(CASES[name], path)
            rounds = [[asked(worker, path, limit) for worker in workers] for _ in range(given.repeats + 1)]
            for checkout, runs in zip(checkouts, zip(*rounds, strict=True), strict=True):
                (first, faces), *rest = runs
                seconds = median(taken for taken, _ in rest) if rest else first
                print(
                    f"{name:32}{checkout.name:20}{first:8.2f} s{seconds:8.2f} s{faces:10,} faces"
                    f"{faces / seconds:10,.0f} a second",
                    flush=True,
                )


if __name__ == "__main__":
    main()
