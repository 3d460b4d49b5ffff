# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision of 126,000 quads to a million faces, next to Blender's Subdivision Surface as it is shipped.

python benchmarks/adaptive_speed.py -- [TOLERANCE] [REPEATS]        with the bpy wheel
blender -b --python benchmarks/adaptive_speed.py -- [TOLERANCE] [REPEATS]

The mesh is Suzanne after four levels; TOLERANCE is in parts of her diagonal. The modifier, with limit surface, is timed
at each level up to the one that meets the same tolerance: before it there are quads whose surface is sampled farther
off the planes of both their triangles, along whichever diagonal. All are timed in turn. Memory is what Python and NumPy
take at most.
"""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np

from benchmarks.adaptive_faces import QUADS_AT_ONCE, Quads, quads_of, surface_grid
from benchmarks.adaptive_faces import children as children_of
from ccdepth_addon.core.adaptive.planner import AdaptiveMesh, subdivide_adaptively
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests.blender import scene

OPERATOR = "Apply Adaptive Subdivision"

TOLERANCE = 5.3e-6
REPEATS = 3
LEVELS = 4
MOST_FACES = 10_000_000
MOST_UNIFORM_FACES = 50_000_000


def suzanne() -> bpy.types.Object:
    """Suzanne after some levels, as an object of its own, active and selected."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    base = scene.add_suzanne()
    scene.add_subdivision(base, LEVELS)
    made = scene.add_object(scene.evaluated_mesh_data(base), "Base")
    bpy.data.meshes.remove(base.data)
    bpy.context.view_layer.objects.active = made
    made.select_set(True)
    return made


def levels_needed(mesh: PolygonMesh, limit: float) -> tuple[int, int]:
    """The least level with every quad within the limit by samples, and the least level with all quads of 99 % of the
    faces within it."""
    level, of_most, frontier = 0, -1, quads_of(mesh)
    while True:
        frontier = children_of(mesh, frontier, off_their_planes(mesh, frontier) > limit)
        if of_most < 0 and len(np.unique(mesh.corner_faces[frontier.corners])) <= 0.01 * mesh.face_count:
            of_most = level
        if not len(frontier.corners):
            return level, of_most
        level += 1


def off_their_planes(mesh: PolygonMesh, quads: Quads) -> FloatArray:
    """(quads,): the distance of the surface from the nearer plane of a quad's two triangles, along the better diagonal:
    no more than the distance from the triangles."""
    found = [np.zeros(0)]
    for start in range(0, len(quads.corners), QUADS_AT_ONCE):
        block = slice(start, start + QUADS_AT_ONCE)
        surface = surface_grid(mesh, Quads(quads.corners[block], quads.origins[block], quads.side))
        corners = surface[:, [0, -1, -1, 0], [0, 0, -1, -1]]
        of_diagonals = []
        for diagonal in (((0, 1, 2), (0, 2, 3)), ((1, 2, 3), (1, 3, 0))):
            heights = [np.abs(_heights(surface, corners[:, list(triangle)])) for triangle in diagonal]
            of_diagonals.append(np.minimum(*heights).max(axis=(1, 2)))
        found.append(np.minimum(*of_diagonals))
    return np.concatenate(found)


def _heights(surface: FloatArray, triangles: FloatArray) -> FloatArray:
    """(quads, …): the heights of points (quads, …, 3) over the planes of triangles (quads, 3, 3)."""
    a, b, c = triangles.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return np.einsum("qijk,qk->qij", surface - a[:, None, None], normals)


def subdivide(mesh: PolygonMesh, limit: float) -> AdaptiveMesh:
    request = AdaptiveRequest(limit, Mode.ADAPTIVE, MOST_FACES)
    return subdivide_adaptively(mesh, request, mesh.positions)


def modifier(base: bpy.types.Object, level: int) -> float:
    """Seconds to evaluate the modifier, with limit surface, from nothing to the mesh."""
    added = base.modifiers.new("Subdivision", "SUBSURF")
    added.levels = level

    def evaluate() -> None:
        made = base.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
        assert len(made.polygons) == len(base.data.polygons) * 4**level

    taken = seconds(evaluate)
    base.modifiers.remove(added)
    bpy.context.view_layer.update()
    return taken


def operator(tolerance: float) -> float:
    """Seconds for Apply Adaptive Subdivision; the result is removed again."""
    before = set(bpy.data.objects)
    taken = seconds(lambda: bpy.ops.ccdepth.subdivide(tolerance=tolerance, tolerance_mode="RELATIVE"))
    for made in set(bpy.data.objects) - before:
        bpy.data.meshes.remove(made.data)
    for kept in before:
        kept.hide_set(False)
        kept.select_set(True)
        bpy.context.view_layer.objects.active = kept
    return taken


def seconds(work: Callable[[], object]) -> float:
    start = perf_counter()
    work()
    return perf_counter() - start


def peak_memory(work: Callable[[], object]) -> int:
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@dataclass(frozen=True)
class Job:
    """Something to time: its name, and a remark."""

    name: str
    run: Callable[[], float]
    remark: str


def jobs_of_ours(mesh: PolygonMesh, limit: float, tolerance: float, faces: int) -> list[Job]:
    core_peak = peak_memory(lambda: subdivide(mesh, limit))
    operator_peak = peak_memory(lambda: operator(tolerance))
    return [
        Job("core", lambda: seconds(lambda: subdivide(mesh, limit)), f"{core_peak / faces:.0f} bytes a face"),
        Job(OPERATOR, lambda: operator(tolerance), f"{operator_peak / faces:.0f} bytes a face"),
    ]


def jobs_of_modifier(base: bpy.types.Object, needed: int) -> list[Job]:
    """The levels up to the needed one, without too large levels."""
    counts = {level: len(base.data.polygons) * 4**level for level in range(1, needed + 1)}
    return [
        Job(name_of_level(level), partial(modifier, base, level), f"{count:,} faces")
        for level, count in counts.items()
        if count <= MOST_UNIFORM_FACES
    ]


def name_of_level(level: int) -> str:
    return f"Subdivision Surface, level {level}"


def report(jobs: list[Job], rounds: list[dict[str, float]], needed: str) -> None:
    for job in jobs:
        times = [taken[job.name] for taken in rounds]
        print(f"  {job.name:<30}{median(times):7.2f} s   ({min(times):.2f} to {max(times):.2f})   {job.remark}")
    if needed in rounds[0]:
        ratios = [taken[OPERATOR] / taken[needed] for taken in rounds]
        print(
            f"  {OPERATOR} took {median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f}) of the time of {needed}"
        )


def main(tolerance: float = TOLERANCE, repeats: int = REPEATS) -> None:
    if not hasattr(bpy.types.Scene, "ccdepth"):
        import ccdepth_addon

        ccdepth_addon.register()
    base = suzanne()
    mesh = apply_boundary_rule(scene.polygon_mesh_of(base.data), smooth_corners=True)
    limit = tolerance * float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))
    found = subdivide(mesh, limit)
    faces, deepest = len(found.bounds), found.depths.max()
    del found
    print(f"Blender {bpy.app.version_string}, numpy {np.__version__}, median of {repeats}")
    print(f"{mesh.face_count:,} quads, {tolerance:g} of the diagonal: {faces:,} faces, deepest {deepest}")
    level, of_most = levels_needed(mesh, limit)
    print(f"  Subdivision Surface needs level {level}, or {of_most} for 99 % of the faces")
    jobs = [*jobs_of_ours(mesh, limit, tolerance, faces), *jobs_of_modifier(base, level)]
    # In turn, so that a busy machine slows all of them.
    rounds = [{job.name: job.run() for job in jobs} for _ in range(repeats)]
    report(jobs, rounds, name_of_level(level))


if __name__ == "__main__":
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    main(float(given[0]) if given else TOLERANCE, int(given[1]) if len(given) > 1 else REPEATS)
