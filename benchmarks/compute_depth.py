# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute Depth on a million quads, next to one level of Blender's Subdivision Surface on the same mesh.

python benchmarks/compute_depth.py [SIDE] [REPEATS]          with the bpy wheel
blender -b --python benchmarks/compute_depth.py -- [SIDE] [REPEATS]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np

from ccdepth_addon.core.depth import METHODS

SIDE = 1000
REPEATS = 5

# Fine enough for every face to need some levels.
RELATIVE_TOLERANCE = 1e-6


def add_grid(side: int) -> bpy.types.Object:
    """A grid of side × side quads with hills on it."""
    x, y = np.meshgrid(np.linspace(0.0, 10.0, side + 1), np.linspace(0.0, 10.0, side + 1))
    positions = np.stack([x, y, np.sin(3 * x) * np.cos(2 * y)], axis=2).astype(np.float32)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    quads = first[:, None] + np.array([0, 1, side + 2, side + 1])
    mesh = bpy.data.meshes.new("Grid")
    mesh.vertices.add((side + 1) ** 2)
    mesh.loops.add(4 * side * side)
    mesh.polygons.add(side * side)
    mesh.vertices.foreach_set("co", positions.ravel())
    mesh.loops.foreach_set("vertex_index", quads.astype(np.int32).ravel())
    mesh.polygons.foreach_set("loop_start", np.arange(0, 4 * side * side, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    grid = bpy.data.objects.new("Grid", mesh)
    bpy.context.scene.collection.objects.link(grid)
    bpy.context.view_layer.objects.active = grid
    grid.select_set(True)
    return grid


def compute_depth(method: str) -> float:
    """Seconds for the operator as a whole: reading the mesh, bounds, depths, attributes, colours and record."""
    return _seconds(
        lambda: bpy.ops.ccdepth.compute(tolerance=RELATIVE_TOLERANCE, tolerance_mode="RELATIVE", method=method)
    )


def evaluate_subdivision(grid: bpy.types.Object) -> float:
    """Seconds for Blender to evaluate one level of Subdivision Surface, from nothing to the mesh."""
    modifier = grid.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = 1

    def evaluate() -> None:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        evaluated = grid.evaluated_get(depsgraph).to_mesh()
        assert len(evaluated.polygons) == 4 * len(grid.data.polygons)

    seconds = _seconds(evaluate)
    grid.modifiers.remove(modifier)
    bpy.context.view_layer.update()
    return seconds


def _seconds(work: Callable[[], object]) -> float:
    start = perf_counter()
    work()
    return perf_counter() - start


def main(side: int = SIDE, repeats: int = REPEATS) -> None:
    if not hasattr(bpy.types.Scene, "ccdepth"):
        import ccdepth_addon

        ccdepth_addon.register()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    grid = add_grid(side)
    print(f"Blender {bpy.app.version_string}, numpy {np.__version__}, {side * side:,} quads, median of {repeats}")
    # Subdivision first: it would have to interpolate the attributes that Compute Depth leaves on the mesh.
    times = {"Subdivision Surface, one level": [evaluate_subdivision(grid) for _ in range(repeats)]}
    for method in METHODS:
        times[f"Compute Depth, {method}"] = [compute_depth(method) for _ in range(repeats)]
    for name, seconds in times.items():
        print(f"  {name:<32}{median(seconds):6.2f} s   ({min(seconds):.2f} to {max(seconds):.2f})", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else ()))
