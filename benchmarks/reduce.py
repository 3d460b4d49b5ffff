# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles of Reduce, its time, and the triangles of Decimate alone from a uniform level by trial.

python benchmarks/reduce.py -- [PART OF A NAME…]        with the bpy wheel

Within 1e-3 and 3e-4 of the diagonal. Triangles without Reduce are those of the adaptive mesh; proved and reached are
parts of the tolerance, by Measure Deviation afterwards. By trial, without a proof: the fewest triangles that Decimate
leaves of level 3 with a reached distance within the tolerance, by bisection of its ratio. Exits with 1 for more
triangles than ``MOST``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np

import ccdepth_addon
from ccdepth_addon.core import PolygonMesh, apply_boundary_rule, measure_deviation
from tests import meshes
from tests.blender import scene

RELATIVE_TOLERANCES = (1e-3, 3e-4)

# The most triangles there may be at 1e-3.
MOST = {"bevelled cube": 560, "bevelled cylinder": 1000, "Suzanne after one step": 3700}

LEVEL, BISECTIONS = 3, 7


def bevelled_cube() -> bpy.types.Object:
    bpy.ops.mesh.primitive_cube_add(size=2)
    return _finished(bpy.context.object, "NONE")


def bevelled_cylinder() -> bpy.types.Object:
    bpy.ops.mesh.primitive_cylinder_add(vertices=16)
    return _finished(bpy.context.object, "ANGLE")


def suzanne() -> bpy.types.Object:
    bpy.ops.mesh.primitive_monkey_add(calc_uvs=True)
    return _finished(bpy.context.object, "")


def _finished(added: bpy.types.Object, bevel_limit: str) -> bpy.types.Object:
    """The object with a bevel, if wanted, and one step of subdivision, both applied."""
    if bevel_limit:
        bevel = added.modifiers.new("Bevel", "BEVEL")
        bevel.width, bevel.segments, bevel.limit_method = 0.1, 2, bevel_limit
    scene.add_subdivision(added, 1)
    for modifier in list(added.modifiers):
        bpy.ops.object.modifier_apply(modifier=modifier.name)
    return added


def torus() -> bpy.types.Object:
    return scene.add_object(meshes.torus(24, 12))


def landscape() -> bpy.types.Object:
    return scene.add_object(meshes.landscape(20, 20))


def without_uvs(make: Callable[[], bpy.types.Object]) -> Callable[[], bpy.types.Object]:
    def made() -> bpy.types.Object:
        added = make()
        for layer in list(added.data.uv_layers):
            added.data.uv_layers.remove(layer)
        return added

    return made


CASES: dict[str, Callable[[], bpy.types.Object]] = {
    "bevelled cube": without_uvs(bevelled_cube),
    "bevelled cube, UV map": bevelled_cube,
    "bevelled cylinder": without_uvs(bevelled_cylinder),
    "bevelled cylinder, UV map": bevelled_cylinder,
    "Suzanne after one step": without_uvs(suzanne),
    "Suzanne after one step, UV map": suzanne,
    "torus": torus,
    "landscape": landscape,
}


def triangles_of(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    positions = np.zeros(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", positions)
    mesh.calc_loop_triangles()
    triangles = np.zeros(3 * len(mesh.loop_triangles), dtype=np.intc)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    return positions.reshape(-1, 3).astype(np.float64), triangles.reshape(-1, 3).astype(np.intp)


def control_of(added: bpy.types.Object) -> PolygonMesh:
    return apply_boundary_rule(scene.polygon_mesh_of(added.data), smooth_corners=True)


def by_trial(added: bpy.types.Object, control: PolygonMesh, tolerance: float) -> int:
    """The fewest triangles that Decimate makes of a uniform level within the tolerance, as far as tried."""
    subdivision = scene.add_subdivision(added, LEVEL)
    subdivision.use_limit_surface, subdivision.quality = True, 10
    modifier = added.modifiers.new("Decimate", "DECIMATE")
    modifier.use_collapse_triangulate = True
    low, high, fewest = 0.0, 1.0, 0
    for _ in range(BISECTIONS):
        modifier.ratio = (low + high) / 2 if low else high / 4
        evaluated = added.evaluated_get(bpy.context.evaluated_depsgraph_get())
        positions, triangles = triangles_of(evaluated.to_mesh())
        evaluated.to_mesh_clear()
        if measure_deviation(control, positions, triangles, enough=tolerance).reached > tolerance:
            low = modifier.ratio
        else:
            high, fewest = modifier.ratio, len(triangles)
    added.modifiers.clear()
    return fewest


def report(name: str, relative: float) -> bool:
    """Print a row; returns whether there are few enough triangles."""
    scene.clear()
    added = CASES[name]()
    control = control_of(added)
    bpy.context.view_layer.objects.active = added
    added.select_set(True)
    start = perf_counter()
    bpy.ops.ccdepth.subdivide(tolerance=relative, tolerance_mode="RELATIVE", reduce=True)
    seconds = perf_counter() - start
    made = bpy.context.selected_objects[0].data
    tolerance = made.ccdepth.world_tolerance
    positions, triangles = triangles_of(made)
    found = measure_deviation(control, positions, triangles, tolerance=tolerance)
    print(
        f"{name:34}{relative:10g}{len(triangles):11,}{made.ccdepth.unreduced_triangles:11,}"
        f"{by_trial(added, control, tolerance):11,}{found.proved / tolerance:9.3f}{found.reached / tolerance:9.3f}"
        f"{seconds:9.1f}",
        flush=True,
    )
    return relative != RELATIVE_TOLERANCES[0] or len(triangles) <= MOST.get(name.partition(",")[0], len(triangles))


def main(wanted: list[str]) -> int:
    """The exit status."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    ccdepth_addon.register()
    columns = f"{'triangles':>11}{'without':>11}{'by trial':>11}{'proved':>9}{'reached':>9}{'seconds':>9}"
    print(f"{'':34}{'tolerance':>10}{columns}")
    rows = [
        (name, relative)
        for name in CASES
        for relative in RELATIVE_TOLERANCES
        if not wanted or any(part in name for part in wanted)
    ]
    failed = [f"{name} at {relative:g}" for name, relative in rows if not report(name, relative)]
    print("Too many triangles: " + ("; ".join(failed) if failed else "none"))
    return int(bool(failed))


if __name__ == "__main__":
    status = main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
    sys.stdout.flush()
    sys.exit(status)
