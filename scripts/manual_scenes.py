# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes of the manual's pictures: runs inside a Blender with a window, sets one scene after another, and waits for
its picture.

The folder of ``CCDEPTH_PICTURES`` gets a file NAME.ready for each scene; once the file is gone, the next scene follows.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import bmesh
import bpy

FOLDER = Path(os.environ["CCDEPTH_PICTURES"])
INTERVAL = 0.5

# Ticks between the setting of a scene and its picture: regions are drawn a few times before they are settled.
SETTLING = 6


def suzanne() -> bpy.types.Object:
    """Suzanne alone in the file."""
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes])
    mesh = bpy.data.meshes.new("Suzanne")
    shape = bmesh.new()
    bmesh.ops.create_monkey(shape)
    shape.to_mesh(mesh)
    shape.free()
    added = bpy.data.objects.new("Suzanne", mesh)
    bpy.context.scene.collection.objects.link(added)
    added.select_set(True)
    bpy.context.view_layer.objects.active = added
    return added


def depth() -> None:
    suzanne()
    bpy.ops.ccdepth.compute()


def adaptive() -> None:
    suzanne().data.shade_smooth()
    bpy.ops.ccdepth.subdivide()


def deviation() -> None:
    suzanne().modifiers.new("Subdivision", "SUBSURF").levels = 2
    bpy.ops.ccdepth.measure()


def invalid() -> None:
    mesh = suzanne().data
    for face in (100, 200, 201):
        first = mesh.polygons[face].loop_start
        mesh.loops[first + 1].vertex_index = mesh.loops[first].vertex_index
    try:
        bpy.ops.ccdepth.compute()
    except RuntimeError as refusal:
        print(refusal)


SCENES: list[Callable[[], None]] = [invalid, depth, adaptive, deviation]


def arrange(scene: Callable[[], None]) -> bool:
    """Show the sidebar's tab, and then the scene from the front; False while there is no tab yet."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    regions = {region.type: region for region in area.regions}
    area.spaces.active.show_region_ui = True
    try:
        regions["UI"].active_panel_category = "CC Depth"
    except AttributeError:
        return False
    overlay = area.spaces.active.overlay
    overlay.show_text = overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = overlay.show_cursor = False
    with bpy.context.temp_override(window=window, area=area, region=regions["WINDOW"]):
        scene()
        bpy.ops.view3d.view_axis(type="FRONT")
        bpy.ops.view3d.view_selected()
        area.spaces.active.region_3d.view_distance *= 1.05
    return True


def steps() -> object:
    """One tick after another."""
    for scene in SCENES:
        while not arrange(scene):
            yield
        for _ in range(SETTLING):
            yield
        ready = FOLDER / f"{scene.__name__}.ready"
        ready.touch()
        while ready.exists():
            yield
    (FOLDER / "end.ready").touch()


def tick() -> float | None:
    return INTERVAL if next(RUN, RUN) is None else None


bpy.context.preferences.view.show_splash = False
RUN = steps()
bpy.app.timers.register(tick, first_interval=2 * INTERVAL)
