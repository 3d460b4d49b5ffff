# SPDX-License-Identifier: GPL-3.0-or-later
"""The least sufficient level, by trial, beside the level that Set Subdivision Levels sets, on models as people make
them.

python benchmarks/least_levels.py -- [METHOD] [PART OF A NAME…]        with the bpy wheel and libigl

METHOD: as of --method; by distance if left out.

The trial compares the mesh of Blender's modifier at a level with a mesh many levels deeper, its vertices on the limit
surface: the largest distance both ways, from dense samples on both (libigl). Level 0 counts as 1, as nothing is moved
at level 0. Rows with a trial within 3 % of the tolerance, at the least level or at the level before, do not count:
samples decide nothing there. Exits with 1 unless nineteen rows of twenty have the least level, the others one more.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from functools import cache
from math import radians
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np

import ccdepth_addon
from ccdepth_addon.core import METHODS
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from tests.blender import scene

TOLERANCES = (1e-2, 1e-3, 3e-4)
FINEST_FACES, FINEST_LEVEL = 400_000, 8
UNDECIDED = 0.03
NO_LEVEL = 99

# Points on a triangle, in barycentric coordinates.
SAMPLES = np.array([(i, j, 6 - i - j) for i in range(7) for j in range(7 - i)]) / 6


def made(name: str, **options: object) -> bpy.types.Object:
    """An object with a mesh built by an operator of bmesh."""
    import bmesh  # The bpy wheel has it only after bpy.

    mesh, shape = bpy.data.meshes.new("Model"), bmesh.new()
    getattr(bmesh.ops, name)(shape, **options)
    shape.to_mesh(mesh)
    shape.free()
    return scene.add_mesh(mesh)


def choose(holder: bpy.types.Object) -> None:
    """Select an object alone, and make it the active one."""
    layer = bpy.context.view_layer
    # Without an update, the list has holes in place of removed objects.
    layer.update()
    for each in list(layer.objects):
        each.select_set(each == holder)
    layer.objects.active = holder


def applied(holder: bpy.types.Object, kind: str, **options: object) -> bpy.types.Object:
    """The object with a modifier applied."""
    modifier = holder.modifiers.new("Modifier", kind)
    for name, value in options.items():
        setattr(modifier, name, value)
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get())
    holder.data = bpy.data.meshes.new_from_object(evaluated)
    holder.modifiers.clear()
    return holder


def cylinder() -> bpy.types.Object:
    return made("create_cone", cap_ends=True, segments=16, radius1=1, radius2=1, depth=2)


def cube() -> bpy.types.Object:
    return made("create_cube", size=2)


def torus(major: int, minor: int) -> bpy.types.Object:
    bpy.ops.mesh.primitive_torus_add(major_segments=major, minor_segments=minor)
    return bpy.context.active_object


def lathe() -> bpy.types.Object:
    """A goblet, turned out of a profile."""
    profile = [(0.0, 0.0), (0.6, 0.0), (0.6, 0.08), (0.1, 0.15), (0.08, 0.7), (0.3, 0.9), (0.5, 1.3), (0.48, 1.6)]
    mesh = bpy.data.meshes.new("Profile")
    count = len(profile)
    mesh.from_pydata([(x, 0.0, z) for x, z in profile], [(i, i + 1) for i in range(count - 1)], [])
    return applied(scene.add_mesh(mesh), "SCREW", steps=12, render_steps=12, use_merge_vertices=True)


def inset_panels() -> bpy.types.Object:
    """A box with a panel on each side that is inset and pushed in."""
    holder = cube()
    choose(holder)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.inset(thickness=0.3, use_individual=True)
    bpy.ops.mesh.inset(thickness=0.05, depth=-0.1, use_individual=True)
    bpy.ops.object.mode_set(mode="OBJECT")
    return holder


def scan() -> bpy.types.Object:
    """A stone of triangles of all sizes, as scans are after decimation."""
    holder = made("create_icosphere", subdivisions=4, radius=1)
    for vertex in holder.data.vertices:
        x, y, z = vertex.co
        vertex.co *= 1 + 0.12 * np.sin(3 * x + y) * np.cos(2 * y - z) + 0.04 * np.sin(7 * z + 2 * x)
    return applied(holder, "DECIMATE", ratio=0.2)


def figure() -> bpy.types.Object:
    """A body with arms and legs, of quads of all sizes."""
    points = [(0, 0, 0), (0, 0, 1), (0, 0, 1.6), (0.9, 0, 1), (1.5, 0.2, 0.9), (-0.9, 0, 1), (-1.5, 0.2, 0.9)]
    points += [(0.4, 0, -0.9), (0.4, 0.1, -1.8), (-0.4, 0, -0.9), (-0.4, 0.1, -1.8)]
    mesh = bpy.data.meshes.new("Bones")
    mesh.from_pydata(points, [(0, 1), (1, 2), (1, 3), (3, 4), (1, 5), (5, 6), (0, 7), (7, 8), (0, 9), (9, 10)], [])
    return applied(scene.add_mesh(mesh), "SKIN")


def creased_cube() -> bpy.types.Object:
    holder = cube()
    creases = holder.data.attributes.new("crease_edge", "FLOAT", "EDGE")
    creases.data.foreach_set("value", [1.0 if index % 3 == 0 else 0.0 for index in range(12)])
    return holder


MODELS: dict[str, Callable[[], bpy.types.Object]] = {
    "cube": cube,
    "bevelled cube": lambda: applied(cube(), "BEVEL", width=0.1, segments=2),
    "chamfered cube": lambda: applied(cube(), "BEVEL", width=0.2, segments=1),
    "creased cube": creased_cube,
    "bevelled cylinder": lambda: applied(
        cylinder(), "BEVEL", width=0.1, segments=2, limit_method="ANGLE", angle_limit=radians(30)
    ),
    "cylinder": cylinder,
    "cone": lambda: made("create_cone", cap_ends=True, segments=32, radius1=1, radius2=0, depth=2),
    "UV sphere": lambda: made("create_uvsphere", u_segments=32, v_segments=16, radius=1),
    "icosphere": lambda: made("create_icosphere", subdivisions=3, radius=1),
    "torus 12 × 8": lambda: torus(12, 8),
    "torus 48 × 12": lambda: torus(48, 12),
    "Suzanne": scene.add_suzanne,
    "goblet": lathe,
    "inset panels": inset_panels,
    "stone of triangles": scan,
    "figure": figure,
}


def shown(holder: bpy.types.Object, level: int, *, limit: bool) -> tuple[FloatArray, IndexArray]:
    """The triangles that Blender draws at a level."""
    modifier = scene.add_subdivision(holder, level)
    modifier.use_limit_surface, modifier.quality = limit, 10
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    positions = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", positions)
    mesh.calc_loop_triangles()
    triangles = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    evaluated.to_mesh_clear()
    holder.modifiers.clear()
    return positions.reshape(-1, 3).astype(np.float64), triangles.reshape(-1, 3).astype(np.int64)


def reached(mesh: tuple[FloatArray, IndexArray], finest: tuple[FloatArray, IndexArray]) -> float:
    """The largest distance both ways that samples find."""
    import igl  # The one program that needs it.

    positions, triangles = mesh
    points = np.einsum("sk,tkc->tsc", SAMPLES, positions[triangles]).reshape(-1, 3)
    there = igl.point_mesh_squared_distance(points, *finest)[0].max()
    back = igl.point_mesh_squared_distance(finest[0], *mesh)[0].max()
    return float(max(there, back) ** 0.5)


def level_set(holder: bpy.types.Object, tolerance: float, vertices: str, method: str) -> int:
    """The level that Set Subdivision Levels sets; NO_LEVEL for a refusal."""
    bpy.ops.ccdepth.compute(tolerance=tolerance, tolerance_mode="RELATIVE", vertices=vertices, method=method)
    try:
        bpy.ops.ccdepth.set_levels()
    except RuntimeError:
        return NO_LEVEL
    level = holder.modifiers[0].levels
    holder.modifiers.clear()
    return max(level, 1)


def compare(name: str, counts: Counter[str], method: str) -> None:
    """Print a row for each kind of vertices and tolerance, and count how they end."""
    scene.clear()
    holder = MODELS[name]()
    choose(holder)
    corners = len(holder.data.loops)
    finest_level = next(level for level in range(1, 99) if corners * 4**level > FINEST_FACES or level == FINEST_LEVEL)
    finest = shown(holder, finest_level, limit=True)
    diagonal = float(np.linalg.norm(holder.dimensions))
    for vertices in ("LIMIT", "CONTROL"):

        @cache
        def trial(level: int, limit: bool = vertices == "LIMIT") -> float:
            return reached(shown(holder, level, limit=limit), finest) / diagonal

        for tolerance in TOLERANCES:
            least = next((level for level in range(1, finest_level - 1) if trial(level) <= tolerance), None)
            if least is None:
                continue
            near = [trial(level) / tolerance for level in range(max(least - 1, 1), least + 1)]
            level = level_set(holder, tolerance, vertices, method)
            over = "refused" if level == NO_LEVEL else f"{level - least} more" if level > least else "least"
            over = "BELOW" if level < least else over
            counted = not any(abs(ratio - 1) < UNDECIDED for ratio in near)
            counts[over] += counted
            text = "refused" if level == NO_LEVEL else f"set {level}"
            ratios = ", ".join(f"{ratio:.2f}" for ratio in near)
            print(
                f"{name:20} {vertices:8} {tolerance:7.0e}  least {least} ({ratios})  {text}"
                + ("" if over == "least" else f"  {over}")
                + ("" if counted else "  (does not count)"),
                flush=True,
            )


def main() -> int:
    ccdepth_addon.register()
    wanted = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    method = wanted.pop(0) if wanted and wanted[0] in METHODS else "DISTANCE"
    counts = Counter[str]()
    for name in MODELS:
        if not wanted or any(part in name for part in wanted):
            compare(name, counts, method)
    rows = sum(counts.values())
    print(f"{rows} rows: " + ", ".join(f"{count} {over}" for over, count in counts.most_common()))
    return int(counts["least"] < 0.95 * rows or counts["least"] + counts["1 more"] < rows)


if __name__ == "__main__":
    raise SystemExit(main())
