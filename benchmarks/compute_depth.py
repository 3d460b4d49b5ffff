# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute Depth on a million quads, next to one level of Blender's Subdivision Surface on the same mesh, as shipped.

The mesh is a grid, once all regular and once with one percent of its vertices extraordinary; then spheres with poles of
64 and 360 faces, and a smaller grid with many creases. Memory is what Python and NumPy take at most, beyond the mesh
and Blender's attributes for the results.

python benchmarks/compute_depth.py -- [SIDE] [REPEATS]       with the bpy wheel
blender -b --python benchmarks/compute_depth.py -- [SIDE] [REPEATS]
"""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable
from functools import partial
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

# Fine enough for every face to need some levels; and the same on the smaller meshes.
RELATIVE_TOLERANCE = 1e-6
SMALLER_TOLERANCE = 1e-4

# The faces around the poles, and the number of edges of the smaller grid for each creased one.
POLES = (64, 360)
CREASED_PART = 5

# The others take as long with either kind of vertices.
BY_BOTH_VERTICES = ("DISTANCE", "CERTIFIED")


def add_grid(side: int, insets: int) -> bpy.types.Object:
    """An object of a grid, active and selected."""
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


def add_sphere(faces_at_pole: int) -> bpy.types.Object:
    """An object of a UV sphere, active and selected."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=faces_at_pole, ring_count=faces_at_pole // 2)
    return bpy.context.active_object


def add_creased_grid(side: int) -> bpy.types.Object:
    """An object of a grid, active and selected, with creases of all kinds on some of its edges."""
    grid = add_grid(side, 0)
    generator = np.random.default_rng(1)
    count = len(grid.data.edges)
    sharpness = np.where(generator.random(count) < 1 / CREASED_PART, generator.choice([0.3, 0.6, 1.0], count), 0.0)
    creases = grid.data.attributes.new("crease_edge", "FLOAT", "EDGE")
    creases.data.foreach_set("value", sharpness.astype(np.float32))
    return grid


def compute_depth(method: str, vertices: str, tolerance: float) -> float:
    """Seconds for the operator as a whole: reading the mesh, bounds, depths, attributes and record."""
    return _seconds(
        lambda: bpy.ops.ccdepth.compute(
            tolerance=tolerance, tolerance_mode="RELATIVE", method=method, vertices=vertices
        )
    )


def peak_memory(method: str, vertices: str, tolerance: float) -> int:
    """Bytes that Python and NumPy take at most during the operator."""
    tracemalloc.start()
    compute_depth(method, vertices, tolerance)
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
        assert len(evaluated.polygons) == len(grid.data.loops)

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
    small = max(side // 10, 8)
    for name, add, tolerance in (
        ("a grid", lambda: add_grid(side, 0), RELATIVE_TOLERANCE),
        ("a grid with extraordinary vertices", lambda: add_grid(side, side * side // 800), RELATIVE_TOLERANCE),
        *((f"poles of {count}", partial(add_sphere, count), SMALLER_TOLERANCE) for count in POLES),
        ("a grid with creases", lambda: add_creased_grid(small), SMALLER_TOLERANCE),
        ("a smaller grid", lambda: add_grid(small, 0), RELATIVE_TOLERANCE),
    ):
        measure(name, add, tolerance, repeats)


def measure(name: str, add: Callable[[], bpy.types.Object], tolerance: float, repeats: int) -> None:
    """Print the figures of one mesh."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    holder = add()
    faces = len(holder.data.polygons)
    print(f"{name}, {faces:,} faces, tolerance {tolerance:.0e} of the diagonal")
    # Subdivision first: it would have to interpolate the attributes that Compute Depth leaves on the mesh.
    _report("Subdivision Surface, one level", [evaluate_subdivision(holder) for _ in range(repeats)])
    for method, vertices in product(METHODS, VERTICES):
        if vertices == "LIMIT" and method not in BY_BOTH_VERTICES:
            continue
        seconds = [compute_depth(method, vertices, tolerance) for _ in range(repeats)]
        memory = f"{peak_memory(method, vertices, tolerance) / faces:.0f} bytes per face"
        _report(f"Compute Depth, {method}, {vertices}", seconds, memory)


def _report(name: str, seconds: list[float], more: str = "") -> None:
    times = f"{median(seconds):6.2f} s   ({min(seconds):.2f} to {max(seconds):.2f})"
    print(f"  {name:<37}{times}   {more}".rstrip(), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else ()))
