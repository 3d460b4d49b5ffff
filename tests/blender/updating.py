# SPDX-License-Identifier: GPL-3.0-or-later
"""Update Result called in tests, and what it is tested on."""

import bpy

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import TOLERANCE, subdivide


def set_scene(**settings: object) -> None:
    """Set the scene's settings; a tolerance is absolute unless it says otherwise."""
    if "tolerance" in settings:
        settings.setdefault("tolerance_mode", "ABSOLUTE")
    for name, value in settings.items():
        setattr(bpy.context.scene.ccdepth, name, value)


def made_result(**settings: object) -> tuple[bpy.types.Object, bpy.types.Object]:
    """A cube and the result made of it, with the scene's settings."""
    set_scene(tolerance=TOLERANCE)
    source = scene.add_object(meshes.cube(), "Cage")
    [result] = subdivide(source, **settings)
    return source, result


def update(*objects: bpy.types.Object, **settings: object) -> None:
    addon.finish("update", *objects, **settings)


def stale_line(result: bpy.types.Object) -> str:
    """What the panel says when everything touched has been examined."""
    addon.examine_touched()
    return addon.module("ui.panels").stale_line(bpy.context.scene.ccdepth, result.data, result)


def move_vertex(mesh: bpy.types.Mesh, distance: float = 0.1) -> None:
    mesh.vertices[0].co.x += distance
    mesh.update()
