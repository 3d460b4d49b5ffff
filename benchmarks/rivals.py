# SPDX-License-Identifier: GPL-3.0-or-later
"""A comparison of meshes by other programs and by this one, on models as people make them: docs/comparison.md has the
tables.

python -m pip install -r benchmarks/rivals_requirements.txt
python benchmarks/rivals.py -- [PART OF A NAME…]

Each row is a mesh: its faces and triangles, its distance from the limit surface in parts of the tolerance, and its
seconds of processor time. The distance is found twice: by samples and libigl, both ways against a level many times
finer; and by Measure Deviation, reached and proved.

"Asked" is the mesh of a program given the tolerance. "By trial" is the mesh of fewest triangles within the tolerance by
samples, of ``TRIALS`` bisections of the program's parameter: the seconds of the whole search, samples included, are
beside the seconds of the mesh's run. Programs that reduce begin with the surface two levels above the least sufficient
one, or one level above, if two are finer than the mesh for samples; making that level counts.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from importlib.metadata import version
from pathlib import Path
from time import process_time

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

# Lagrange and bpy bring their own TBB, and Lagrange does not work with bpy's.
with suppress(ImportError):
    import lagrange

import bpy  # isort: skip
import numpy as np

import ccdepth_addon
from benchmarks.least_levels import FINEST_LEVEL, MODELS, choose, shown
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.deviation import measure_deviation
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests.blender import scene

NAMES = ("bevelled cylinder", "UV sphere", "torus 48 × 12", "Suzanne", "goblet", "figure")
TOLERANCES = (1e-3, 3e-4)
PACKAGES = ("bpy", "libigl", "adobe-lagrange", "meshoptimizer", "manifold3d", "fast-simplification")

FINEST_TRIANGLES = 1_100_000
MOST_SAMPLES = 400_000
LEVELS_ABOVE = 2
TRIALS = 10
# The range of tolerances to try, in parts of the tolerance to meet.
LEAST_TOLD, MOST_TOLD = 1 / 256, 8.0
MEASURING_SECONDS = 60.0


class RefusedError(Exception):
    """The error of a program that does not take the model; the message says why."""


@dataclass(frozen=True)
class Drawn:
    """A drawn mesh. positions: (V, 3) float64; triangles: (T, 3) int64; faces: the number of its faces."""

    positions: FloatArray
    triangles: IndexArray
    faces: int


@dataclass(frozen=True)
class Made:
    """A mesh, and the seconds of its run; for a search by trial, all runs and seconds."""

    drawn: Drawn
    seconds: float
    trials: int = 1
    search_seconds: float = 0.0


class Model:
    """An object, its control mesh, and its surface many levels deep."""

    def __init__(self, name: str) -> None:
        scene.clear()
        self.holder = MODELS[name]()
        choose(self.holder)
        self.control: PolygonMesh = apply_boundary_rule(scene.polygon_mesh_of(self.holder.data), smooth_corners=True)
        self.diagonal = float(np.linalg.norm(np.ptp(self.control.positions, axis=0)))

    @property
    def finest_level(self) -> int:
        corners = self.control.corner_count
        levels = range(2, FINEST_LEVEL + 1)
        return max((level for level in levels if corners * 4**level < 2 * FINEST_TRIANGLES), default=1)

    @cached_property
    def finest(self) -> Drawn:
        return self.at_level(self.finest_level)

    def at_level(self, level: int) -> Drawn:
        """The drawn mesh of the modifier at a level, its vertices on the limit surface."""
        positions, triangles = shown(self.holder, level, limit=True)
        return Drawn(positions, triangles, self.control.corner_count * 4 ** (level - 1))

    def distance(self, drawn: Drawn) -> float:
        """The largest distance both ways that samples find."""
        import igl

        steps = max(n for n in range(1, 7) if n == 1 or len(drawn.triangles) * (n + 1) * (n + 2) / 2 <= MOST_SAMPLES)
        samples = np.array([(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]) / steps
        points = np.einsum("sk,tkc->tsc", samples, drawn.positions[drawn.triangles]).reshape(-1, 3)
        finest = self.finest
        there = igl.point_mesh_squared_distance(points, finest.positions, finest.triangles)[0].max()
        back = igl.point_mesh_squared_distance(finest.positions, drawn.positions, drawn.triangles)[0].max()
        return float(max(there, back) ** 0.5)


# How meshes are made


def timed(make: Callable[[], Drawn]) -> Made:
    start = process_time()
    drawn = make()
    return Made(drawn, process_time() - start)


def least_level(model: Model, tolerance: float) -> Made:
    """The mesh of Blender's modifier at the least sufficient level."""
    finest, start = model.finest, process_time()
    for level in range(1, FINEST_LEVEL + 1):
        made = timed(partial(model.at_level, level))
        if len(made.drawn.triangles) >= len(finest.triangles):
            break
        if model.distance(made.drawn) <= tolerance:
            return Made(made.drawn, made.seconds, level, process_time() - start)
    raise RefusedError("no level of those that can be told apart from the finest")


def by_trial(
    model: Model,
    tolerance: float,
    told: tuple[float, float],
    make: Callable[[float], Drawn],
    *,
    more_is_finer: bool,
) -> Made:
    """The mesh of fewest triangles within the tolerance, of some made from parameters between two, bisected."""
    start = process_time()
    low, high, best = np.log(told[0]), np.log(told[1]), None
    for _ in range(TRIALS):
        middle = (low + high) / 2
        made = timed(partial(make, float(np.exp(middle))))
        holds = model.distance(made.drawn) <= tolerance
        if holds and (best is None or len(made.drawn.triangles) < len(best.drawn.triangles)):
            best = made
        low, high = (low, middle) if holds == more_is_finer else (middle, high)
    if best is None:
        raise RefusedError("none of the meshes that were tried is within the tolerance")
    return Made(best.drawn, best.seconds, TRIALS, process_time() - start)


def read(mesh: bpy.types.Mesh) -> Drawn:
    """The triangles that Blender draws of a mesh."""
    positions = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", positions)
    mesh.calc_loop_triangles()
    triangles = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    return Drawn(positions.reshape(-1, 3).astype(float), triangles.reshape(-1, 3).astype(np.int64), len(mesh.polygons))


def own_level(model: Model, tolerance: float) -> Made:
    def make() -> Drawn:
        bpy.ops.ccdepth.compute(tolerance=tolerance, tolerance_mode="ABSOLUTE", vertices="LIMIT")
        bpy.ops.ccdepth.set_levels()
        level = model.holder.modifiers[0].levels
        model.holder.modifiers.clear()
        return model.at_level(max(level, 1))

    return timed(make)


def own_adaptive(model: Model, tolerance: float, *, reduce: bool) -> Made:
    def make() -> Drawn:
        bpy.ops.ccdepth.subdivide(tolerance=tolerance, tolerance_mode="ABSOLUTE", reduce=reduce, output="NEW_OBJECT")
        return read(bpy.context.active_object.data)

    made = timed(make)
    result = bpy.context.active_object
    if result == model.holder:
        raise RefusedError("nothing was made")
    bpy.data.objects.remove(result)
    model.holder.hide_set(False)
    choose(model.holder)
    return made


def lagrange_mesh(model: Model, deviation: float) -> Drawn:
    if "lagrange" not in globals():
        raise RefusedError("Lagrange is not installed")
    mesh = lagrange.SurfaceMesh()
    mesh.add_vertices(model.control.positions)
    mesh.add_hybrid(model.control.face_sizes.astype(np.uint32), model.control.corner_vertices.astype(np.uint32))
    divided = lagrange.subdivision.subdivide_mesh(
        mesh,
        scheme=lagrange.subdivision.SchemeType.CatmullClark,
        adaptive=True,
        max_chordal_deviation=deviation,
        use_limit_surface=True,
    )
    faces = divided.num_facets
    lagrange.triangulate_polygonal_facets(divided)
    return Drawn(np.array(divided.vertices, dtype=float), np.array(divided.facets, dtype=np.int64), faces)


def decimated(fine: Drawn, ratio: float) -> Drawn:
    mesh = bpy.data.meshes.new("Fine")
    mesh.from_pydata(fine.positions, [], fine.triangles)
    holder = scene.add_mesh(mesh)
    holder.modifiers.new("Decimate", "DECIMATE").ratio = ratio
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get())
    drawn = read(evaluated.to_mesh())
    evaluated.to_mesh_clear()
    bpy.data.objects.remove(holder)
    bpy.data.meshes.remove(mesh)
    return drawn


def fast_simplified(fine: Drawn, ratio: float) -> Drawn:
    import fast_simplification

    positions, triangles = fast_simplification.simplify(
        fine.positions.astype(np.float32), fine.triangles.astype(np.int32), target_reduction=1 - ratio
    )
    return Drawn(positions.astype(float), triangles.astype(np.int64), len(triangles))


def mesh_optimized(fine: Drawn, error: float) -> Drawn:
    import meshoptimizer

    indices = fine.triangles.ravel().astype(np.uint32)
    destination = np.empty_like(indices)
    count = meshoptimizer.simplify(
        destination,
        indices,
        fine.positions.astype(np.float32),
        target_index_count=3,
        target_error=error,
        options=meshoptimizer.SIMPLIFY_ERROR_ABSOLUTE,
    )
    triangles = destination[:count].reshape(-1, 3).astype(np.int64)
    return Drawn(fine.positions, triangles, len(triangles))


def manifold_simplified(fine: Drawn, error: float) -> Drawn:
    import manifold3d

    mesh = manifold3d.Mesh(fine.positions.astype(np.float32), fine.triangles.astype(np.uint32))
    solid = manifold3d.Manifold(mesh)
    if solid.status() != manifold3d.Error.NoError:
        raise RefusedError(f"takes closed surfaces alone ({solid.status().name})")
    simple = solid.simplify(error).to_mesh()
    triangles = np.array(simple.tri_verts, dtype=np.int64)
    return Drawn(np.array(simple.vert_properties, dtype=float), triangles, len(triangles))


# What is printed

HEADER = (
    f"{'':38}{'faces':>10}{'triangles':>11}{'sampled':>9}{'reached':>9}{'proved':>9}{'seconds':>9}"
    f"{'trials':>8}{'search':>9}"
)


def row(model: Model, name: str, tolerance: float, make: Callable[[], Made]) -> None:
    """Print the mesh of a program, or the reason for its refusal."""
    try:
        made = make()
    except (RefusedError, ImportError) as error:
        print(f"{name:38}  {error}", flush=True)
        return
    drawn = made.drawn
    used, triangles = np.unique(drawn.triangles, return_inverse=True)
    deviation = measure_deviation(
        model.control,
        drawn.positions[used],
        triangles.reshape(-1, 3).astype(np.intp),
        time_limit=MEASURING_SECONDS,
        tolerance=tolerance,
        limit=tolerance,
    )
    parts = "".join(f"{of / tolerance:9.2f}" for of in (model.distance(drawn), deviation.reached, deviation.proved))
    search = f"{made.trials:8}{made.search_seconds:9.1f}" if made.trials > 1 else f"{'':17}"
    print(f"{name:38}{drawn.faces:10,}{len(drawn.triangles):11,}{parts}{made.seconds:9.2f}{search}", flush=True)


def compare(model: Model, tolerance: float) -> None:
    """Print a table."""
    row(model, "CC Depth: adaptive", tolerance, lambda: own_adaptive(model, tolerance, reduce=False))
    row(model, "CC Depth: adaptive, Reduce", tolerance, lambda: own_adaptive(model, tolerance, reduce=True))
    row(model, "CC Depth: Set Subdivision Levels", tolerance, lambda: own_level(model, tolerance))
    level = least_level(model, tolerance)
    row(model, "Blender: least level, by trial", tolerance, lambda: level)
    fine_level = min(level.trials + LEVELS_ABOVE, model.finest_level)

    def from_fine(make: Callable[[Drawn, float], Drawn]) -> Callable[[float], Drawn]:
        return lambda parameter: make(model.at_level(fine_level), parameter)

    told = (LEAST_TOLD * tolerance, MOST_TOLD * tolerance)
    tolerant: dict[str, Callable[[float], Drawn]] = {
        "Lagrange": lambda deviation: lagrange_mesh(model, deviation),
        "meshoptimizer": from_fine(mesh_optimized),
        "manifold3d": from_fine(manifold_simplified),
    }
    for name, make in tolerant.items():
        row(model, f"{name}: asked", tolerance, partial(timed, partial(make, tolerance)))
        search = partial(by_trial, model, tolerance, told, make, more_is_finer=False)
        row(model, f"{name}: by trial", tolerance, search)
    ratios: dict[str, Callable[[float], Drawn]] = {
        "Blender's Decimate": from_fine(decimated),
        "fast-simplification": from_fine(fast_simplified),
    }
    for name, make in ratios.items():
        search = partial(by_trial, model, tolerance, (1e-3, 1.0), make, more_is_finer=True)
        row(model, f"{name}: by trial", tolerance, search)


def main() -> int:
    ccdepth_addon.register()
    wanted = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    print(", ".join(f"{package} {version(package)}" for package in PACKAGES))
    print("Distances are parts of the tolerance.")
    for name in NAMES:
        if wanted and not any(part in name for part in wanted):
            continue
        model = Model(name)
        for tolerance in TOLERANCES:
            print(f"\n{name}, {model.control.face_count:,} faces, {tolerance:g} of the diagonal\n{HEADER}", flush=True)
            compare(model, tolerance * model.diagonal)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
