# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Measure Deviation, and Select Worst Face."""

from __future__ import annotations

from collections.abc import Generator
from typing import ClassVar

import bpy
import numpy as np
from bpy.props import BoolProperty
from mathutils import Vector

from ..core import InvalidMeshError
from ..exchange.bulk_writing import WriteError
from ..state import deviation_results, measured_state, properties, results, staleness
from ..state.deviation_results import Verdict
from ..tasks.depth_task import count_faces
from ..tasks.deviation_task import MeasureSettings, MeasureTask, MeshDeviation, measure, prepare_measurement
from ..tasks.surfaces import ComputeError, as_typed
from ..ui import heat_map
from ..ui.lengths import Rounding, length_text
from ..ui.printable import printable
from . import face_selection, worker
from .long_operator import LongOperator, meshes_meant, poll_meshes, refuse_what_cannot_be_written, without_mesh_text

CHANGED = "The objects were changed in the meantime: nothing was written"

# How much of its surroundings a framed face is shown with, in parts of its own size.
SURROUNDINGS = 6.0


class CCDEPTH_OT_measure(LongOperator):
    """Measure how far what the object shows is from the limit surface of its control mesh, with a proof.
    Of several selected objects, the others are measured against the limit surface of the active one"""

    bl_idname = "ccdepth.measure"
    bl_label = "Measure Deviation"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    SETTINGS: ClassVar[tuple[str, ...]] = ("tolerance_mode", "accuracy", "time_limit", "use_modifiers")

    # The work has a thread of its own, and the window can have nearly all the time of this one.
    PATIENCE: ClassVar[float] = worker.SECONDS_TO_WAIT

    accuracy: properties.accuracy_property()
    time_limit: properties.time_limit_property()

    def start(self, context: bpy.types.Context) -> Generator[float, None, list[MeshDeviation]]:
        target, objects = _meant(context)
        refuse_what_cannot_be_written(objects)
        settings = self._settings()
        task = prepare_measurement(context, objects, target, settings)
        self._is_own = task.own
        waiting = self.options.is_invoke and not bpy.app.background
        return _measured(task, settings, in_thread=waiting)

    def progress_text(self, progress: float) -> str:
        return f"Measuring deviation: {progress:.0%}"

    def finish(self, context: bpy.types.Context, answer: list[MeshDeviation]) -> set[str]:
        settings, color_range = self._settings(), context.scene.ccdepth.deviation_range
        objects = [_still_there(each) for each in answer]
        largest = max(each.proved for each in answer)
        for each, measured in zip(answer, objects, strict=True):
            try:
                deviation_results.write_deviation(measured.data, each, settings, color_range, largest)
            except WriteError as fault:
                raise ComputeError(f"{measured.name}: {fault}") from fault
            measured_state.remember(measured)
            staleness.note_deviation(measured.data)
        heat_map.synchronise(context)
        self._report(context, answer)
        return {"FINISHED"}

    def _settings(self) -> MeasureSettings:
        return MeasureSettings(
            as_typed(self.tolerance),
            self.tolerance_mode,
            self.use_modifiers,
            as_typed(self.accuracy),
            as_typed(self.time_limit),
        )

    def _report(self, context: bpy.types.Context, answer: list[MeshDeviation]) -> None:
        skipped = without_mesh_text(context)
        if skipped:
            self.report({"INFO"}, skipped)
        for each in answer:
            name = "" if self._is_own or len(answer) == 1 else f"{printable(each.measured)}: "
            if not each.accuracy_met:
                self.report(
                    {"WARNING"}, f"{name}stopped before the accuracy was reached; this is what is proved so far"
                )
            self.report({"INFO"}, f"{name}{deviation_text(context.scene, each)}")


def _meant(context: bpy.types.Context) -> tuple[bpy.types.Object, list[bpy.types.Object]]:
    """The object whose limit surface is meant, and those to measure. Raises ComputeError."""
    objects = meshes_meant(context)
    if len(objects) == 1:
        return objects[0], objects
    target = context.active_object
    if target not in objects:
        raise ComputeError(
            "Several objects are selected, and none of them is the active one: make that one active to whose limit "
            "surface the others are to be measured"
        )
    return target, [each for each in objects if each != target]


def _measured(
    task: MeasureTask, settings: MeasureSettings, *, in_thread: bool
) -> Generator[float, None, list[MeshDeviation]]:
    run = worker.in_thread if in_thread else worker.at_once
    try:
        return (yield from run(lambda progress: measure(task, settings, progress)))
    except InvalidMeshError as fault:
        raise ComputeError(f"{task.surface.object_name}: {fault}") from fault
    except worker.Cancelled as stopped:
        raise ComputeError("The measuring was stopped, and nothing was changed") from stopped


def _still_there(answer: MeshDeviation) -> bpy.types.Object:
    """The object to write the answer to. Raises ComputeError when the objects are no longer what they were."""
    objects = [bpy.data.objects.get(name) for name in [*answer.object_names, answer.against]]
    if any(each is None or each.type != "MESH" for each in objects):
        raise ComputeError(CHANGED)
    mesh = objects[0].data
    if mesh.session_uid != answer.mesh_uid or count_faces(mesh) != len(answer.deviations):
        raise ComputeError(CHANGED)
    return objects[0]


def deviation_text(scene: bpy.types.Scene, answer: MeshDeviation) -> str:
    """What was found, as a modeller says it."""
    verdict = deviation_results.verdict(answer.proved, answer.reached, answer.tolerance)
    most = length_text(scene, answer.proved, Rounding.UP)
    least = length_text(scene, answer.reached, Rounding.DOWN)
    tolerance = length_text(scene, answer.tolerance)
    text = f"Deviation at most {most}, at least {least}: {verdict.value}"
    return text if verdict is Verdict.UNDECIDED else f"{text} of {tolerance}"


class CCDEPTH_OT_select_worst(bpy.types.Operator):
    """Select the face where the measured deviation is largest"""

    bl_idname = "ccdepth.select_worst"
    bl_label = "Select Worst Face"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    frame: BoolProperty(name="Frame", description="Move the 3D View to the face", default=False)

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{cls.__doc__}, and move the 3D View there" if properties.frame else ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not poll_meshes(cls, context):
            return False
        if not _measured_objects(context):
            cls.poll_message_set("Measure Deviation first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        worst = max(_measured_objects(context), key=lambda each: each.data.ccdepth.deviation_reached)
        mesh, found = worst.data, worst.data.ccdepth.measurement
        if self.frame:
            _frame(context, worst)
        if found.worst_face < 0:
            self.report(
                {"WARNING"},
                f"{printable(worst.name)}: it is worst on a face that modifiers add, which no face stands for",
            )
            return {"FINISHED"} if self.frame else {"CANCELLED"}
        if count_faces(mesh) != found.faces:
            self.report({"ERROR"}, f"{printable(worst.name)}: the mesh has changed; measure it again")
            return {"CANCELLED"}
        if not face_selection.select_face(mesh, found.worst_face):
            self.report({"WARNING"}, f"{printable(worst.name)}: the face where it is worst is hidden")
            return {"FINISHED"} if self.frame else {"CANCELLED"}
        context.tool_settings.mesh_select_mode = (False, False, True)
        self.report({"INFO"}, f"{printable(worst.name)}: face {found.worst_face} selected")
        return {"FINISHED"}


def _measured_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    return [each for each in meshes_meant(context) if results.has_deviation(each.data)]


def _frame(context: bpy.types.Context, worst: bpy.types.Object) -> None:
    """Move the 3D View that is being used, or else all of them, to the worst place of an object."""
    found = worst.data.ccdepth.measurement
    place = Vector(found.worst_point)
    size = SURROUNDINGS * _face_size(worst, found.worst_face)
    for region in _regions(context):
        region.view_location = place
        region.view_distance = max(size, 1e-4)
        if region.view_perspective == "CAMERA":
            region.view_perspective = "PERSP"


def _regions(context: bpy.types.Context) -> list[bpy.types.RegionView3D]:
    space = context.space_data
    if space is not None and space.type == "VIEW_3D":
        return [space.region_3d]
    screens = [window.screen for window in context.window_manager.windows]
    return [area.spaces.active.region_3d for screen in screens for area in screen.areas if area.type == "VIEW_3D"]


def _face_size(worst: bpy.types.Object, face: int) -> float:
    """The size in the scene of a face of the object's mesh, or of the object where there is no such face."""
    box = np.array(worst.bound_box)
    if 0 <= face < count_faces(worst.data):
        box = face_selection.face_points(worst.data, face)
    place = np.array(worst.matrix_world, dtype=np.float64)[:3, :3]
    return float(np.linalg.norm(np.ptp(box @ place.T, axis=0)))


CLASSES = (CCDEPTH_OT_measure, CCDEPTH_OT_select_worst)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    worker.stop_all()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
