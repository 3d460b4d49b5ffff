# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators on many objects: user CPU time of each part, which should grow no faster than the number of objects.

Cubes with a mesh each; objects that share one mesh, at one scale, each at its own, and with a Bevel each.

python benchmarks/many_objects.py -- [COUNT …]               with the bpy wheel
blender -b --python benchmarks/many_objects.py -- [COUNT …]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy

COUNTS = (200, 400, 800)


def cubes(count: int) -> None:
    """Objects with a mesh each."""
    for index in range(count):
        _add_object(_cube(), index)


def users(count: int) -> None:
    """Objects that share one mesh."""
    mesh = _cube()
    for index in range(count):
        _add_object(mesh, index)


def scaled_users(count: int) -> None:
    """Objects that share one mesh, at scales without a largest one along every axis."""
    users(count)
    for index, blender_object in enumerate(bpy.context.scene.objects):
        stretch = 1.0 + index / count
        blender_object.scale = (stretch, 1.0 / stretch, 1.0)


def bevelled_users(count: int) -> None:
    """Objects that share one mesh, with a modifier each."""
    users(count)
    for blender_object in bpy.context.scene.objects:
        blender_object.modifiers.new("Bevel", "BEVEL").segments = 2


SCENES: tuple[Callable[[int], None], ...] = (cubes, users, scaled_users, bevelled_users)


def _cube() -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new("Cube")
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh.from_pydata(corners, [], faces)
    return mesh


def _add_object(mesh: bpy.types.Mesh, index: int) -> None:
    added = bpy.data.objects.new("Cube", mesh)
    added.location.x = 3.0 * index
    bpy.context.scene.collection.objects.link(added)
    added.select_set(True)


def measure(make: Callable[[int], None], count: int, operator: Callable[..., set[str]], **settings: Any) -> None:
    """Print the figures of one operator in one scene."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    make(count)
    bpy.context.view_layer.objects.active = bpy.context.scene.objects[0]
    bpy.context.view_layer.update()
    start = process_time()
    operator(**settings)
    print(f"  {count:6,} {make.__name__:<16}{process_time() - start:8.2f} s", flush=True)


def main(*counts: int) -> None:
    if not hasattr(bpy.types.Scene, "ccdepth"):
        import ccdepth_addon

        ccdepth_addon.register()
    print(f"Blender {bpy.app.version_string}")
    operators = {
        "Compute Depth": (bpy.ops.ccdepth.compute, {"method": "SECOND_ORDER"}),
        "Apply Adaptive Subdivision": (bpy.ops.ccdepth.subdivide, {"tolerance": 0.01}),
        "Apply Adaptive Subdivision, In Place": (bpy.ops.ccdepth.subdivide, {"tolerance": 0.01, "output": "IN_PLACE"}),
    }
    for name, (operator, settings) in operators.items():
        print(name)
        for make in SCENES:
            for count in counts or COUNTS:
                measure(make, count, operator, **settings)


if __name__ == "__main__":
    main(*map(int, sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else ()))
