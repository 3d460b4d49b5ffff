# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Select Worst Face."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.props import BoolProperty
from mathutils import Vector
from numpy.typing import NDArray

from ..exchange.mesh_arrays import mesh_face_count
from ..state import mesh_values
from ..state.still_holds import measured_to_show
from ..tasks.surfaces import ComputeError
from ..ui.printable import printable
from . import face_selection
from .selected_meshes import QuickOperator, refuse, selected_meshes

# The size of a framed view, with the face's surroundings, in sizes of the face.
SURROUNDINGS = 6.0

# A view is turned when it shows less than this part of a face's area: it is seen from behind, or nearly edge-on.
LEAST_SHOWN = 0.2


class CCDEPTH_OT_select_worst(QuickOperator):
    """Select the face with the largest deviation in the measurement shown"""

    bl_idname = "ccdepth.select_worst"
    bl_label = "Select Worst Face"

    # Without SKIP_SAVE the plain button would frame as well, once the one beside was pressed.
    frame: BoolProperty(
        name="Frame", description="Move the 3D View to the front of the face", default=False, options={"SKIP_SAVE"}
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{cls.__doc__}, and move the 3D View to the front of the face" if properties.frame else ""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        return None if _measured_objects(context) else "Measure Deviation first"

    def act(self, context: bpy.types.Context) -> set[str]:
        worst = _worst(context)
        mesh, found = worst.data, worst.data.ccdepth.measurement
        if self.frame:
            _frame(context, worst)
        if found.worst_face < 0:
            self.report(
                {"WARNING"},
                f"{printable(worst.name)}: the largest deviation is on a face that modifiers added",
            )
            return {"FINISHED"} if self.frame else {"CANCELLED"}
        if mesh_face_count(mesh) != found.faces:
            raise ComputeError(f"{worst.name}: the mesh has changed; measure it again")
        refuse([mesh], face_selection.selection_fault)
        if not face_selection.select_these(mesh, np.array([found.worst_face])):
            self.report({"WARNING"}, f"{printable(worst.name)}: the face with the largest deviation is hidden")
            return {"FINISHED"} if self.frame else {"CANCELLED"}
        face_selection.choose_face_mode(context)
        self.report({"INFO"}, f"{printable(worst.name)}: face {found.worst_face} selected")
        return {"FINISHED"}


def _measured_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    return [each for each in selected_meshes(context) if mesh_values.has_deviation(each.data)]


def _worst(context: bpy.types.Context) -> bpy.types.Object:
    """The object whose deviation panel and label show; without one, the worst."""
    measured, shown = _measured_objects(context), measured_to_show(context)
    if shown is not None and shown in measured:
        return shown
    return max(measured, key=lambda each: each.data.ccdepth.deviation_reached)


def _frame(context: bpy.types.Context, worst: bpy.types.Object) -> None:
    """Move the operator's 3D View, or else all 3D Views, to the worst place of an object, and turn a view that would
    not show the face."""
    found = worst.data.ccdepth.measurement
    corners, normal = _corners_and_normal(worst, found.worst_face)
    size = SURROUNDINGS * float(np.linalg.norm(np.ptp(corners, axis=0)))
    for region in _regions(context):
        region.view_location = Vector(found.worst_point)
        region.view_distance = max(size, 1e-4)
        if region.view_perspective == "CAMERA":
            region.view_perspective = "PERSP"
        _turn_towards(region, normal)


def _turn_towards(region: bpy.types.RegionView3D, normal: Vector) -> None:
    """Turn a view to the front of a face, except views already facing it, or locked. normal: zero if unknown."""
    shown = normal.dot(region.view_rotation @ Vector((0.0, 0.0, 1.0)))
    if normal.length and shown < LEAST_SHOWN and not region.lock_rotation:
        region.view_rotation = normal.to_track_quat("Z", "Y")


def _regions(context: bpy.types.Context) -> list[bpy.types.RegionView3D]:
    space = context.space_data
    if space is not None and space.type == "VIEW_3D":
        return [space.region_3d]
    screens = [window.screen for window in context.window_manager.windows]
    return [area.spaces.active.region_3d for screen in screens for area in screen.areas if area.type == "VIEW_3D"]


def _corners_and_normal(worst: bpy.types.Object, face: int) -> tuple[NDArray[np.float64], Vector]:
    """The corners (n, 3) of a face, with the scene's scale and rotation but around the object's origin, and its unit
    normal; without such a face, the corners of the box around the object, and zero."""
    place = np.array(worst.matrix_world, dtype=np.float64)[:3, :3]
    if not 0 <= face < mesh_face_count(worst.data):
        return np.array(worst.bound_box) @ place.T, Vector((0.0, 0.0, 0.0))
    corners = face_selection.face_points(worst.data, face) @ place.T
    spokes = corners - corners.mean(axis=0)
    # Twice the area, as a vector; a mirrored object has its corners the other way round.
    area = np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0) * np.sign(np.linalg.det(place))
    return corners, Vector(area).normalized()
