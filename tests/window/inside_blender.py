# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs inside the Blender whose window is tested: sets the scene, then tells again and again what it sees.

The window is the test's to use; nothing here presses a button. The report goes to the file named in
``CCDEPTH_WINDOW_REPORT``. Of the scene to begin with, ``CCDEPTH_WINDOW_TOLERANCE`` is the relative tolerance and
``CCDEPTH_WINDOW_FACE_LIMIT`` the Face Limit; with ``CCDEPTH_WINDOW_LAST_FRAME`` Suzanne moves until that frame, one of
the first frames is shown, and depths are those of all of them.

Files beside the report ask for more: one whose name ends in ``.change`` holds a relative tolerance for the scene, and
has all results kept updated; one that ends in ``.state`` holds the name of a state of the 3D View.
"""

import json
import os
from pathlib import Path
from typing import Any

import bmesh
import bpy
from mathutils import Euler

REPORT = Path(os.environ["CCDEPTH_WINDOW_REPORT"])
CHANGE = REPORT.with_suffix(".change")
STATE = REPORT.with_suffix(".state")
TOLERANCE = os.environ.get("CCDEPTH_WINDOW_TOLERANCE", "")
FACE_LIMIT = os.environ.get("CCDEPTH_WINDOW_FACE_LIMIT", "")
LAST_FRAME = os.environ.get("CCDEPTH_WINDOW_LAST_FRAME", "")
SHOWN_FRAME = 7
INTERVAL = 0.1
CATEGORY = "CC Depth"


def set_scene() -> None:
    """Suzanne, subdivided once so that all her faces are quads, seen from the front and a little to the side."""
    bpy.context.preferences.view.show_splash = False
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes])
    mesh = bpy.data.meshes.new("Suzanne")
    shape = bmesh.new()
    bmesh.ops.create_monkey(shape)
    shape.to_mesh(mesh)
    shape.free()
    suzanne = bpy.data.objects.new("Suzanne", mesh)
    bpy.context.scene.collection.objects.link(suzanne)
    suzanne.modifiers.new("Subdivision", "SUBSURF").levels = 1
    evaluated = suzanne.evaluated_get(bpy.context.evaluated_depsgraph_get())
    suzanne.data = bpy.data.meshes.new_from_object(evaluated)
    suzanne.modifiers.clear()
    bpy.context.view_layer.objects.active = suzanne
    suzanne.select_set(True)
    if TOLERANCE:
        bpy.context.scene.ccdepth.relative_tolerance = float(TOLERANCE)
    if FACE_LIMIT:
        bpy.context.scene.ccdepth.max_faces = int(FACE_LIMIT)
    if LAST_FRAME:
        animate(suzanne, int(LAST_FRAME))


def animate(suzanne: bpy.types.Object, last: int) -> None:
    """Twist her and move her, ever farther."""
    twist = suzanne.modifiers.new("Twist", "SIMPLE_DEFORM")
    for frame, angle, place in ((1, 0.1, 0.0), (last, 3.0, 1.0)):
        twist.angle, suzanne.location.x = angle, place
        twist.keyframe_insert("angle", frame=frame)
        suzanne.keyframe_insert("location", frame=frame)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.ccdepth.frames = 1, last, "SCENE"
    scene.frame_set(SHOWN_FRAME)


def viewport() -> tuple[Any, Any, dict[str, Any]]:
    """The window, the 3D View's area, and its regions by type."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    return window, area, {region.type: region for region in area.regions}


def arrange() -> None:
    window, area, regions = viewport()
    with bpy.context.temp_override(window=window):
        # What a script makes is no step that undo could return to.
        bpy.ops.ed.undo_push(message="The scene is set")
    space = area.spaces.active
    space.show_region_ui = True
    overlay = space.overlay
    overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = overlay.show_cursor = False
    space.region_3d.view_rotation = Euler((1.35, 0.0, 0.5)).to_quaternion()
    space.region_3d.view_location = (0.42, 0.2, 0.0)
    space.region_3d.view_distance = 4.6
    try:
        regions["UI"].active_panel_category = CATEGORY
    except AttributeError:
        return  # The sidebar has not been drawn yet.


def hovered_command(window: Any, area: Any, region: Any) -> str:
    """The command of the button under the mouse or the data path of the field, as its context menu would copy it; empty
    when there is none."""
    with bpy.context.temp_override(window=window, area=area, region=region):
        if bpy.ops.ui.copy_python_command_button.poll():
            bpy.ops.ui.copy_python_command_button()
        elif bpy.ops.ui.copy_data_path_button.poll():
            bpy.ops.ui.copy_data_path_button()
        else:
            return ""
    return str(bpy.context.window_manager.clipboard)


def rectangle(region: Any, window_height: int) -> list[int]:
    """Left, top, right and bottom on the screen, counted from the top."""
    top = window_height - region.y - region.height
    return [region.x, top, region.x + region.width, top + region.height]


def describe(holder: bpy.types.Object) -> dict[str, Any]:
    return {
        "faces": len(holder.data.polygons),
        "visible": holder.visible_get(),
        "selected": holder.select_get(),
        "mode": holder.mode,
        "top": max(vertex.co.z for vertex in holder.data.vertices),
        "attributes": [item.name for item in holder.data.attributes if "ccdepth" in item.name],
        "place": list(holder.matrix_world.translation),
        "shown_at": shown_at(holder),
    }


def shown_at(holder: bpy.types.Object) -> list[float]:
    """The corners of the box around what the object shows, with its modifiers, in its own space."""
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return [number for corner in evaluated.bound_box for number in corner]


def observe() -> dict[str, Any]:
    window, area, regions = viewport()
    running = [operator.bl_idname for operator in window.modal_operators]
    with bpy.context.temp_override(window=window, area=area, region=regions["WINDOW"]):
        can_measure = bpy.ops.ccdepth.measure.poll()
    if "Suzanne" not in bpy.data.objects:
        return {"objects": {}, "running": running}
    mesh = bpy.data.objects["Suzanne"].data
    record, attributes = mesh.ccdepth, mesh.attributes
    return {
        "category": getattr(regions["UI"], "active_panel_category", ""),
        "sidebar": rectangle(regions["UI"], window.height),
        "viewport": rectangle(regions["WINDOW"], window.height),
        "hovered": hovered_command(window, area, regions["UI"]),
        "tolerance": bpy.context.scene.ccdepth.relative_tolerance,
        "face_budget": bpy.context.scene.ccdepth.face_budget,
        "frame": bpy.context.scene.frame_current,
        "has_result": record.has_result,
        "deviation": [record.deviation_reached, record.deviation],
        "rows": {row.depth: row.faces for row in record.rows},
        "attributes": {item.name: [item.data_type, item.domain] for item in attributes if "ccdepth" in item.name},
        "depths": [item.value for item in attributes["ccdepth"].data] if "ccdepth" in attributes else [],
        "viewports": appearances(),
        "objects": {holder.name: describe(holder) for holder in bpy.data.objects if holder.type == "MESH"},
        "running": running,
        "can_measure": can_measure,
    }


def appearances() -> list[list[str]]:
    """Of every 3D View of the file, what shows of its shading and its overlays."""
    spaces = [space for screen in bpy.data.screens for area in screen.areas for space in area.spaces]
    views = [(space.shading, space.overlay) for space in spaces if space.type == "VIEW_3D"]
    return [[seen.type, seen.light, seen.color_type, str(overlay.show_wireframes)] for seen, overlay in views]


def show(state: str) -> None:
    """Put the 3D View into a state, by its name; each of the shadings follows the one before."""
    window, area, regions = viewport()
    space, suzanne = area.spaces.active, bpy.data.objects["Suzanne"]
    with bpy.context.temp_override(window=window, area=area, region=regions["WINDOW"]):
        if state == "saved":
            bpy.ops.wm.save_as_mainfile(filepath=str(REPORT.with_suffix(".blend")))
        elif state == "deleted":
            bpy.data.objects.remove(suzanne)
        elif state == "run in second window":
            run_in_second_window()
        elif state == "second window closed":
            with bpy.context.temp_override(window=bpy.context.window_manager.windows[-1]):
                bpy.ops.wm.window_close()
        elif state == "cleared":
            bpy.ops.ccdepth.clear()
        elif state in {"hidden", "shown"}:
            suzanne.hide_set(state == "hidden")
        elif state in {"overlays", "no overlays"}:
            space.overlay.show_overlays = state == "overlays"
        elif state == "material":
            space.shading.type = "MATERIAL"
        elif state == "in front":
            space.shading.type, suzanne.show_in_front = "SOLID", True
        elif state == "edit":
            bpy.context.view_layer.objects.active = suzanne
            # What is selected tints the heat map, so nothing may be when Edit Mode is first drawn.
            for each in (suzanne.data.vertices, suzanne.data.edges, suzanne.data.polygons):
                each.foreach_set("select", [False] * len(each))
            bpy.ops.object.mode_set(mode="EDIT")
        elif state == "quad":
            bpy.ops.object.mode_set(mode="OBJECT")
            bpy.ops.screen.region_quadview()
        elif state == "x-ray":
            bpy.ops.screen.region_quadview()
            space.shading.show_xray = True
        elif state == "wireframe":
            space.shading.type, space.shading.show_xray_wireframe = "WIREFRAME", False
        elif state == "none":
            bpy.context.scene.ccdepth.heat_map = "NONE"
    area.tag_redraw()


def run_in_second_window() -> None:
    """Open a window of a 3D View alone, and press the button there."""
    bpy.ops.wm.window_new()
    window = bpy.context.window_manager.windows[-1]
    area = window.screen.areas[0]
    area.type = "VIEW_3D"
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.ccdepth.subdivide("INVOKE_DEFAULT")


def change(tolerance: float) -> None:
    """What someone would type and tick in the sidebar, whose fields have no commands by which to find them."""
    bpy.context.scene.ccdepth.relative_tolerance = tolerance
    for holder in bpy.data.objects:
        holder.ccdepth.keep_updated = bool(holder.ccdepth.source_name)
    with bpy.context.temp_override(window=viewport()[0]):
        bpy.ops.ed.undo_push(message="Settings are changed")


def tell() -> float:
    """Write the report in one go, so that no half of it is ever read."""
    if CHANGE.exists():
        tolerance = float(CHANGE.read_text())
        CHANGE.unlink()
        change(tolerance)
    if STATE.exists():
        state = STATE.read_text()
        STATE.unlink()
        show(state)
    if viewport()[2]["UI"].width <= 1 or getattr(viewport()[2]["UI"], "active_panel_category", "") != CATEGORY:
        arrange()
    unfinished = REPORT.with_suffix(".unfinished")
    unfinished.write_text(json.dumps(observe()))
    unfinished.replace(REPORT)
    return INTERVAL


set_scene()
bpy.app.timers.register(tell, first_interval=1.0)
