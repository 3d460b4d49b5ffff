# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute Depth on a million quads, next to one level of Blender's Subdivision Surface on the same mesh, as shipped.

The mesh is a grid, once all regular and once with one percent of its vertices extraordinary. Memory is what Python and
NumPy take at most, beyond the mesh and Blender's attributes for the results.

python benchmarks/compute_depth.py -- [SIDE] [REPEATS]       with the bpy wheel
blender -b --python benchmarks/compute_depth.py -- [SIDE] [REPEATS]
"""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable
from itertools import product
from pathlib import Path
from statistics import median
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np

from benchmarks.hills import hills
from ccdepth_addon.core.depth.face_depths import METHODS, VERTICES

SIDE = 1000
REPEATS = 5

# Fine enough for every face to need some levels.
RELATIVE_TOLERANCE = 1e-6

# The others take as long with either kind of vertices.
BY_BOTH_VERTICES = ("DISTANCE", "CERTIFIED")


def add_grid(side: int, insets: int) -> bpy.types.Object:
    """An object of it, active and selected."""
    positions, quads = hills(side, insets)
    mesh = bpy.data.meshes.new("Grid")
    mesh.vertices.add(len(positions))
    mesh.loops.add(quads.size)
    mesh.polygons.add(len(quads))
    mesh.vertices.foreach_set("co", positions.astype(np.float32).ravel())
    mesh.loops.foreach_set("vertex_index", quads.astype(np.int32).ravel())
    mesh.polygons.foreach_set("loop_start", np.arange(0, quads.size, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    grid = bpy.data.objects.new("Grid", mesh)
    bpy.context.scene.collection.objects.link(grid)
    bpy.context.view_layer.objects.active = grid
    grid.select_set(True)
    return grid


def compute_depth(method: str, vertices: str) -> float:
    """Seconds for the operator as a whole: reading the mesh, bounds, depths, attributes, colours and record."""
    return _seconds(
        lambda: bpy.ops.ccdepth.compute(
            tolerance=RELATIVE_TOLERANCE, tolerance_mode="RELATIVE", method=method, vertices=vertices
        )
    )


def peak_memory(method: str, vertices: str) -> int:
    """Bytes that Python and NumPy take at most during the operator."""
    tracemalloc.start()
    compute_depth(method, vertices)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


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
    print(f"Blender {bpy.app.version_string}, numpy {np.__version__}, median of {repeats}")
    for insets in (0, side * side // 800):
        measure(side, insets, repeats)


def measure(side: int, insets: int, repeats: int) -> None:
    """Print the figures of one mesh."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    grid = add_grid(side, insets)
    faces = len(grid.data.polygons)
    print(f"{faces:,} quads, {8 * insets / len(grid.data.vertices):.2%} of the vertices extraordinary")
    # Subdivision first: it would have to interpolate the attributes that Compute Depth leaves on the mesh.
    _report("Subdivision Surface, one level", [evaluate_subdivision(grid) for _ in range(repeats)])
    for method, vertices in product(METHODS, VERTICES):
        if vertices == "LIMIT" and method not in BY_BOTH_VERTICES:
            continue
        seconds = [compute_depth(method, vertices) for _ in range(repeats)]
        memory = f"{peak_memory(method, vertices) / faces:.0f} bytes per face"
        _report(f"Compute Depth, {method}, {vertices}", seconds, memory)


def _report(name: str, seconds: list[float], more: str = "") -> None:
    times = f"{median(seconds):6.2f} s   ({min(seconds):.2f} to {max(seconds):.2f})"
    print(f"  {name:<37}{times}   {more}".rstrip(), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else ()))
