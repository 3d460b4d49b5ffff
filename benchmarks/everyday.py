# SPDX-License-Identifier: GPL-3.0-or-later
"""The time that Compute Depth takes by distance on models as people make them, and the depths it finds.

python benchmarks/everyday.py [--save DIRECTORY] [--compare DIRECTORY] [NAME…]        with the bpy wheel

Each row tells the seconds of processor time, the faces, the deepest depth, the level for all faces, the leaves in all
(4 to the power of each depth), the share with depths proved minimal, and the largest memory so far. --save keeps the
depths; --compare counts the faces that are deeper than the kept ones, and shallower. OPENBLAS_NUM_THREADS=1 keeps
threads of matrix products from counting twice.
"""

from __future__ import annotations

import argparse
import resource
import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np

import ccdepth_addon
from benchmarks.compute_depth import add_grid
from benchmarks.least_levels import applied, choose, cube, figure, lathe, made, scan
from tests.blender import scene

TOLERANCES = (1e-2, 1e-3, 1e-4)


def monkey(levels: int) -> bpy.types.Object:
    bpy.ops.mesh.primitive_monkey_add()
    return applied(bpy.context.active_object, "SUBSURF", levels=levels)


def cylinder(sides: int) -> bpy.types.Object:
    return made("create_cone", cap_ends=True, segments=sides, radius1=1, radius2=1, depth=2)


def bevelled(holder: bpy.types.Object) -> bpy.types.Object:
    return applied(holder, "BEVEL", width=0.05, segments=2, limit_method="ANGLE")


def cubes(side: int) -> bpy.types.Object:
    """Bevelled cubes in rows and columns."""
    holder = applied(made("create_cube", size=0.8), "BEVEL", width=0.1, segments=2)
    holder = applied(holder, "ARRAY", count=side, relative_offset_displace=(1.3, 0, 0))
    return applied(holder, "ARRAY", count=side, relative_offset_displace=(0, 1.3, 0))


def sphere(segments: int) -> bpy.types.Object:
    bpy.ops.mesh.primitive_uv_sphere_add(segments=segments, ring_count=segments // 2)
    return bpy.context.active_object


def text() -> bpy.types.Object:
    """Bevelled letters."""
    bpy.ops.object.text_add()
    holder = bpy.context.active_object
    holder.data.body, holder.data.extrude, holder.data.bevel_depth = "Quality 4.2", 0.1, 0.02
    bpy.ops.object.convert(target="MESH")
    return bpy.context.active_object


def cube_and_sliver() -> bpy.types.Object:
    """A cube beside a triangle without area."""
    mesh = bpy.data.meshes.new("Cube and Sliver")
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh.from_pydata([*corners, (3, 0, 0), (4, 0, 0), (5, 0, 0)], [], [*sides, (8, 9, 10)])
    return scene.add_mesh(mesh)


MODELS: dict[str, Callable[[], bpy.types.Object]] = {
    "cube": cube,
    "Suzanne": lambda: monkey(0),
    "Suzanne, one step": lambda: monkey(1),
    "Suzanne, two steps": lambda: monkey(2),
    "cylinder of 32": lambda: cylinder(32),
    "bevelled cylinder of 32": lambda: bevelled(cylinder(32)),
    "cylinder of 128": lambda: cylinder(128),
    "cylinder of 256": lambda: cylinder(256),
    "bevelled cylinder of 256": lambda: bevelled(cylinder(256)),
    "UV sphere of 32": lambda: sphere(32),
    "UV sphere of 128": lambda: sphere(128),
    "icosphere": lambda: made("create_icosphere", subdivisions=5, radius=1),
    "100 bevelled cubes": lambda: cubes(10),
    "900 bevelled cubes": lambda: cubes(30),
    "bevelled text": text,
    "goblet": lathe,
    "stone of triangles": scan,
    "figure": figure,
    "cube and sliver": cube_and_sliver,
    "one face of 500": lambda: made("create_circle", cap_ends=True, segments=500, radius=1),
    "cylinder of 512": lambda: cylinder(512),
    "grid of 90,000": lambda: add_grid(300, 0),
    "grid of 93,600, uneven": lambda: add_grid(300, 900),
    "grid of 1,000,000": lambda: add_grid(1000, 0),
}


def main(wanted: list[str], save: Path | None, compare: Path | None) -> None:
    """Print a row for each wanted model, or each model, and each tolerance."""
    ccdepth_addon.register()
    for name in MODELS:
        if name in wanted or not wanted:
            for tolerance in TOLERANCES:
                row(name, tolerance, save, compare)


def row(name: str, tolerance: float, save: Path | None, compare: Path | None) -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    holder = MODELS[name]()
    choose(holder)
    begun = process_time()
    bpy.ops.ccdepth.compute(tolerance=tolerance, tolerance_mode="RELATIVE", method="DISTANCE")
    seconds, record = process_time() - begun, holder.data.ccdepth
    depths = np.zeros(len(holder.data.polygons), dtype=np.int32)
    holder.data.attributes["ccdepth"].data.foreach_get("value", depths)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    leaves, level = int((4.0**depths).sum()), record.uniform_level
    figures = f"{depths.max():2} {level:2} {leaves:10,} {record.exact_faces / len(depths):5.0%} {memory:6,} MB"
    print(f"{name:<25}{tolerance:g} {seconds:8.2f} s {len(depths):9,} {figures}", end="", flush=True)
    file = f"{name} {tolerance:g}.npz".replace(" ", "_")
    if compare and (compare / file).is_file():
        with np.load(compare / file) as kept:
            deeper, shallower = (kept["depths"] < depths).mean(), (kept["depths"] > depths).mean()
            print(f"   deeper {deeper:.2%}, shallower {shallower:.2%}, level {level - kept['level']:+d}", end="")
    print(flush=True)
    if save:
        save.mkdir(parents=True, exist_ok=True)
        np.savez(save / file, depths=depths, level=level, seconds=seconds)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--save", type=Path)
    parser.add_argument("--compare", type=Path)
    parser.add_argument("names", nargs="*")
    arguments = parser.parse_args()
    main(arguments.names, arguments.save, arguments.compare)
