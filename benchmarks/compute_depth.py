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
from pathlib import Path
from statistics import median
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np
from numpy.typing import NDArray

from ccdepth_addon.core.depth.face_depths import METHODS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

SIDE = 1000
REPEATS = 5

# Fine enough for every face to need some levels.
RELATIVE_TOLERANCE = 1e-6


def hills(side: int, insets: int) -> tuple[FloatArray, IntArray]:
    """Positions (V, 3) and quads (F, 4) of a hilly grid, some of whose quads, no two of them near, have a quad inset.

    Each inset makes eight extraordinary vertices, four of valence 3 and four of valence 5.
    """
    x, y = np.meshgrid(np.linspace(0.0, 10.0, side + 1), np.linspace(0.0, 10.0, side + 1))
    positions = np.stack([x, y, np.sin(3 * x) * np.cos(2 * y)], axis=2).reshape(-1, 3)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    quads = first[:, None] + np.array([0, 1, side + 2, side + 1])
    apart = np.arange(2, side - 2, 4)
    chosen = np.random.default_rng(1).permutation(np.add.outer(apart * side, apart).ravel())[:insets]
    outer = quads[chosen]
    corners = positions[outer]
    inner = len(positions) + np.arange(4 * len(chosen)).reshape(-1, 4)
    around = np.stack([outer, np.roll(outer, -1, axis=1), np.roll(inner, -1, axis=1), inner], axis=2)
    middles = (corners + corners.mean(axis=1, keepdims=True)) / 2
    return (
        np.concatenate([positions, middles.reshape(-1, 3)]),
        np.concatenate([np.delete(quads, chosen, axis=0), inner, around.reshape(-1, 4)]),
    )


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


def compute_depth(method: str) -> float:
    """Seconds for the operator as a whole: reading the mesh, bounds, depths, attributes, colours and record."""
    return _seconds(
        lambda: bpy.ops.ccdepth.compute(tolerance=RELATIVE_TOLERANCE, tolerance_mode="RELATIVE", method=method)
    )


def peak_memory(method: str) -> int:
    """Bytes that Python and NumPy take at most during the operator."""
    tracemalloc.start()
    compute_depth(method)
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
    for method in METHODS:
        seconds = [compute_depth(method) for _ in range(repeats)]
        _report(f"Compute Depth, {method}", seconds, f"{peak_memory(method) / faces:.0f} bytes per face")


def _report(name: str, seconds: list[float], more: str = "") -> None:
    times = f"{median(seconds):6.2f} s   ({min(seconds):.2f} to {max(seconds):.2f})"
    print(f"  {name:<32}{times}   {more}".rstrip(), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else ()))
