# SPDX-License-Identifier: GPL-3.0-or-later
"""The proved and reached distances of Measure Deviation, and its time, on results of all kinds.

python benchmarks/deviation.py -- [PART OF A NAME…] [FILE.obj@TOLERANCE…]        with the bpy wheel

Meshes are triangulated by Blender; of files, adaptive results are measured at parts of the diagonal. The ratio is the
proved over the reached distance; seconds are processor time, of making a result and of measuring it. Results are
measured with the tolerance of their making, as by the operator. Exits with 1 if the accuracy of 5 % is not met, or the
verdict about the tolerance is open.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np
from scipy.spatial import Delaunay

from ccdepth_addon.core.adaptive.planner import AdaptiveRequest, Mode, subdivide_adaptively
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.deviation import measure_deviation
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.blender import scene
from tests.blender.named_meshes import NAMED

ACCURACY = 0.05
RELATIVE_TOLERANCES = (1e-2, 1e-3)
MOST_FACES = 3_000_000
SECONDS = 900.0


@dataclass(frozen=True)
class Case:
    """A mesh of triangles next to a control mesh."""

    name: str
    control: PolygonMesh
    positions: FloatArray
    triangles: IndexArray
    tolerance: float = 0.0
    making: float = 0.0

    def moved(self, by: FloatArray) -> Case:
        length = float(np.linalg.norm(by))
        return replace(self, name=f"{self.name}, moved {length:.3g}", positions=self.positions + by)


def control_of(data: meshes.MeshData) -> PolygonMesh:
    single = meshes.single_precision(data)
    return apply_boundary_rule(meshes.to_polygon_mesh(single), smooth_corners=True)


def triangles_of(mesh: bpy.types.Mesh) -> tuple[FloatArray, IndexArray]:
    """Positions and triangles as Blender draws them."""
    positions = np.zeros(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", positions)
    mesh.calc_loop_triangles()
    triangles = np.zeros(3 * len(mesh.loop_triangles), dtype=np.intc)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    return positions.reshape(-1, 3).astype(np.float64), triangles.reshape(-1, 3).astype(np.intp)


def evaluated(added: bpy.types.Object) -> tuple[FloatArray, IndexArray]:
    found = added.evaluated_get(bpy.context.evaluated_depsgraph_get())
    result = triangles_of(found.to_mesh())
    found.to_mesh_clear()
    return result


def subdivided(
    data: meshes.MeshData, level: int, *, limit: bool, decimate: float = 1.0
) -> tuple[FloatArray, IndexArray]:
    scene.clear()
    added = scene.add_object(data)
    modifier = scene.add_subdivision(added, level)
    modifier.use_limit_surface, modifier.quality = limit, 10
    if decimate < 1:
        added.modifiers.new("Decimate", "DECIMATE").ratio = decimate
    return evaluated(added)


def diagonal(control: PolygonMesh) -> float:
    return float(np.linalg.norm(np.ptp(control.positions, axis=0)))


def adaptive(name: str, control: PolygonMesh, tolerance: float) -> Case:
    request = AdaptiveRequest(tolerance, Mode.ADAPTIVE, MOST_FACES)
    start = process_time()
    made = subdivide_adaptively(control, request, control.positions).mesh
    making = process_time() - start
    scene.clear()
    sizes = np.diff(made.face_starts).astype(np.intp)
    added = scene.add_object(meshes.MeshData(made.positions, sizes, made.corner_vertices.astype(np.intp)))
    return Case(name, control, *triangles_of(added.data), tolerance, making)


def random_points() -> PolygonMesh:
    """Hills over the Delaunay triangles of 500 random points: needles at the border, poles and folds."""
    points = np.random.default_rng(1).random((500, 2))
    heights = 0.05 * np.sin(6 * points[:, 0]) * np.cos(5 * points[:, 1])
    triangles = Delaunay(points).simplices.tolist()
    return control_of(meshes.from_faces(np.column_stack([points, heights]), triangles))


def of_file(path: str) -> PolygonMesh:
    scene.clear()
    bpy.ops.wm.obj_import(filepath=path)
    return control_of(scene.evaluated_mesh_data(bpy.context.selected_objects[0]))


def cases(wanted: list[str]) -> Iterator[Case]:
    def is_wanted(name: str) -> bool:
        return not wanted or any(part in name for part in wanted)

    suzanne = scene.suzanne()
    control = control_of(suzanne)
    for level in (1, 2, 3, 4):
        for limit in (False, True):
            name = f"Suzanne, level {level}, {'limit' if limit else 'control'} vertices"
            if is_wanted(name):
                yield Case(name, control, *subdivided(suzanne, level, limit=limit))
    for ratio in (0.5, 0.1, 0.02):
        name = f"Suzanne, level 3, Decimate {ratio}"
        if is_wanted(name):
            yield Case(name, control, *subdivided(suzanne, 3, limit=True, decimate=ratio))
    if is_wanted("Suzanne moved"):
        case = Case("Suzanne moved: level 3", control, *subdivided(suzanne, 3, limit=True))
        for length in (1e-3, 1e-2, 0.1, 1.0):
            yield case.moved(length * np.array([0.6, 0.64, 0.48]))
    for name, make in NAMED.items():
        for relative in RELATIVE_TOLERANCES:
            full = f"adaptive {relative:g}: {name}"
            if is_wanted(full):
                of_name = control_of(make())
                yield adaptive(full, of_name, relative * diagonal(of_name))
    if is_wanted("adaptive 0.0002 absolute: 500 random points"):
        yield adaptive("adaptive 0.0002 absolute: 500 random points", random_points(), 2e-4)
    for path, _, relative in (name.rpartition("@") for name in wanted if "@" in name):
        control = of_file(path)
        yield adaptive(f"adaptive {relative}: {Path(path).stem}", control, float(relative) * diagonal(control))
    for name, level in (("large: Suzanne, level 5", 5), ("large: Suzanne, level 6", 6)):
        if wanted and is_wanted(name):
            yield Case(name, control, *subdivided(suzanne, level, limit=True))


def main() -> int:
    wanted = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    missed = 0
    print(f"{'':52}{'triangles':>10}{'proved':>12}{'reached':>12}{'ratio':>8}{'making':>9}{'seconds':>9}")
    for case in cases(wanted):
        start = process_time()
        found = measure_deviation(
            case.control,
            case.positions,
            case.triangles,
            accuracy=ACCURACY,
            time_limit=SECONDS,
            limit=case.tolerance,
        )
        seconds = process_time() - start
        ratio = found.proved / max(found.reached, np.finfo(float).tiny)
        is_decided = found.proved <= case.tolerance or found.reached > case.tolerance or not case.tolerance
        missed += not (found.accuracy_met and is_decided)
        print(
            f"{case.name:52}{len(case.triangles):10,}{found.proved:12.5g}{found.reached:12.5g}{ratio:8.3f}"
            f"{case.making:9.1f}{seconds:9.1f}"
            + ("" if found.accuracy_met else "  not met")
            + ("" if is_decided else "  not decided"),
            flush=True,
        )
    return int(missed > 0)


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    sys.exit(status)
