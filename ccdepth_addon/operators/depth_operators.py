# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Compute Depth, Clear, Select by Depth, and Set Subdivision Levels."""

from collections.abc import Generator
from contextlib import ExitStack
from typing import ClassVar

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty

from ..core import needed_quality
from ..exchange.bulk_writing import WriteError, is_writable
from ..exchange.control_mesh import subdivision_modifier
from ..state import fingerprint, properties, results, staleness
from ..tasks.depth_task import MeshDepths, Settings, compute_stepwise, count_faces, prepare_stepwise
from ..tasks.surfaces import ComputeError, as_typed
from ..ui import heat_map
from ..ui.printable import printable, printable_lines
from . import face_selection
from .long_operator import (
    LongOperator,
    count_text,
    meshes_meant,
    poll_meshes,
    refuse_what_cannot_be_written,
    without_mesh_text,
)
from .stepwise import Stage


class CCDEPTH_OT_compute(LongOperator):
    """Compute how many Catmull-Clark levels each face needs to be within the tolerance of the limit surface"""

    bl_idname = "ccdepth.compute"
    bl_label = "Compute Depth"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    SETTINGS: ClassVar[tuple[str, ...]] = ("tolerance_mode", "method", "vertices", "use_modifiers")

    method: properties.method_property()
    vertices: properties.vertices_property()

    def start(self, context: bpy.types.Context) -> Generator[Stage | float, None, list[MeshDepths]]:
        objects = meshes_meant(context)
        refuse_what_cannot_be_written(objects)
        tasks = yield from prepare_stepwise(context, objects, self._settings())
        return (yield from compute_stepwise(tasks))

    def progress_text(self, progress: float) -> str:
        return f"Computing depth: {progress:.0%}"

    def finish(self, context: bpy.types.Context, answer: list[MeshDepths]) -> set[str]:
        meshes = _meshes_still_there(answer)
        color_depths = min(each.least for each in answer), max(each.deepest for each in answer)
        with ExitStack() as undo:
            for each, mesh in zip(answer, meshes, strict=True):
                try:
                    results.write_depths(mesh, each, *color_depths, undo)
                except WriteError as fault:
                    raise ComputeError(f"{each.task.object_names[0]}: {fault}") from fault
            undo.pop_all()
        for each, mesh in zip(answer, meshes, strict=True):
            results.write_record(mesh, each, self._settings(), *color_depths)
            fingerprint.remember(mesh, each.task.geometry, each.depths, each.task.states)
            staleness.note_write(mesh)
        heat_map.synchronise(context)
        self._report(context, answer)
        return {"FINISHED"}

    def _settings(self) -> Settings:
        return Settings(as_typed(self.tolerance), self.tolerance_mode, self.use_modifiers, self.method, self.vertices)

    def _report(self, context: bpy.types.Context, answers: list[MeshDepths]) -> None:
        skipped = without_mesh_text(context)
        if skipped:
            self.report({"INFO"}, skipped)
        for answer in answers:
            for note in _modifier_notes(answer):
                self.report({"WARNING"}, f"{printable(answer.task.object_names[0])}: {note}")
            for note in _quality_notes(answer):
                self.report({"WARNING"}, printable(note))
        faces = count_text(sum(len(answer.depths) for answer in answers), "face", "faces")
        meshes = f"{len(answers)} meshes, " if len(answers) > 1 else ""
        self.report({"INFO"}, f"{meshes}{faces}, deepest depth {max(answer.deepest for answer in answers)}")


def _meshes_still_there(answers: list[MeshDepths]) -> list[bpy.types.Mesh]:
    """The answers' meshes. Raises ComputeError unless all of them, and their objects, are there as they were."""
    meshes = {mesh.session_uid: mesh for mesh in bpy.data.meshes}
    objects = {obj.name: obj for obj in bpy.data.objects if obj.library is None}
    found = []
    for answer in answers:
        mesh = meshes.get(answer.task.mesh_uid)
        users = [objects.get(name) for name in answer.task.object_names]
        if (
            mesh is None
            or count_faces(mesh) != answer.task.face_count
            or not all(user is not None and user.data == mesh for user in users)
        ):
            raise ComputeError("The meshes were changed in the meantime: nothing was written")
        found.append(mesh)
    return found


def _modifier_notes(answer: MeshDepths) -> list[str]:
    """What the modifiers do to faces that the numbers on the mesh cannot show."""
    notes = []
    if answer.added_faces:
        faces = count_text(answer.added_faces, "face", "faces")
        notes.append(
            f"modifiers add {faces} that come from no face of the mesh; the deepest needs {answer.added_deepest}"
        )
    if answer.taken_faces:
        faces = count_text(answer.taken_faces, "face", "faces")
        notes.append(f"modifiers take {faces} away; their depth is 0")
    return notes


def _quality_notes(answer: MeshDepths) -> list[str]:
    """Which objects' own modifiers show the limit surface at a Quality that is too low for their levels."""
    notes = []
    surfaces = {measurement.surface.object_name: measurement.surface for measurement in answer.task.measurements}
    any_surface = answer.task.measurements[0].surface
    most = bpy.types.SubsurfModifier.bl_rna.properties["quality"].hard_max
    needed_at: dict[tuple[str, int], int] = {}
    for name in answer.task.object_names:
        modifier = subdivision_modifier(bpy.data.objects[name])
        if modifier is None or not modifier.use_limit_surface or modifier.quality == most:
            continue
        # Objects without a surface of their own have the same control mesh as another one.
        surface = surfaces.get(name, any_surface)
        level = max(modifier.levels, modifier.render_levels)
        key = (surface.object_name, level)
        if key not in needed_at:
            needed_at[key] = min(needed_quality(surface.control.in_world, level, surface.tolerance), most)
        if modifier.quality < needed_at[key]:
            notes.append(
                f"{name}: at its {count_text(level, 'level', 'levels')}, Use Limit Surface needs a Quality of "
                f"{needed_at[key]} to show the limit surface; it is {modifier.quality}"
            )
    return notes


class CCDEPTH_OT_clear(bpy.types.Operator):
    """Remove the depths from the mesh, and show it as it was shown before"""

    bl_idname = "ccdepth.clear"
    bl_label = "Clear"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return poll_meshes(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        meshes = {obj.data for obj in meshes_meant(context) if is_writable(obj.data)}
        cleared = [mesh for mesh in meshes if results.has_traces(mesh)]
        if not cleared:
            self.report({"INFO"}, "There is nothing to clear")
            return {"CANCELLED"}
        for mesh in cleared:
            results.clear(mesh)
        heat_map.synchronise(context)
        return {"FINISHED"}


class CCDEPTH_OT_select(bpy.types.Operator):
    """Select the faces of a depth"""

    bl_idname = "ccdepth.select"
    bl_label = "Select by Depth"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    depth: IntProperty(name="Depth", description="The depth to look for; the deepest when left out", default=0, min=0)
    comparison: EnumProperty(
        name="Comparison",
        description="Which depths to select",
        items=(
            ("EQUAL", "Equal To", "Faces of exactly this depth"),
            ("AT_LEAST", "At Least", "Faces of this depth and deeper ones"),
            ("AT_MOST", "At Most", "Faces of this depth and less deep ones"),
        ),
        default="EQUAL",
    )
    extend: BoolProperty(name="Extend", description="Add to the selection", default=False)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not poll_meshes(cls, context):
            return False
        if not any(results.has_result(obj.data) for obj in meshes_meant(context)):
            cls.poll_message_set("Compute Depth first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        meshes = {obj.data for obj in meshes_meant(context) if results.has_result(obj.data)}
        faults = [
            f"{mesh.name}: the mesh has an attribute called “{name}” that is no selection; remove it first"
            for mesh in meshes
            if (name := face_selection.conflict(mesh))
        ]
        if faults:
            self.report({"ERROR"}, "\n".join(sorted(faults)))
            return {"CANCELLED"}
        if not self.properties.is_property_set("depth"):
            self.depth = max(mesh.ccdepth.deepest for mesh in meshes)
        selected = 0
        for mesh in meshes:
            selected += face_selection.select_faces(mesh, self.depth, self.comparison, extend=self.extend)
        # With vertices or edges selected instead, faces between the wanted ones would be selected as well.
        context.tool_settings.mesh_select_mode = (False, False, True)
        self.report({"INFO"}, f"{count_text(selected, 'face', 'faces')} selected")
        return {"FINISHED"}


class CCDEPTH_OT_set_levels(bpy.types.Operator):
    """Set the Subdivision Surface modifiers to the first level at which every face is near enough, and their Quality"""

    bl_idname = "ccdepth.set_levels"
    bl_label = "Set Subdivision Levels"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not poll_meshes(cls, context):
            return False
        if not any(_has_depths(obj) for obj in meshes_meant(context)):
            cls.poll_message_set("Compute Depth first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        objects = meshes_meant(context)
        most_faces = context.scene.ccdepth.max_faces
        stale = set(staleness.out_of_date(context, objects))
        faults = [f"{obj.name}: {fault}" for obj in objects if (fault := _levels_fault(obj, obj in stale, most_faces))]
        if faults:
            self.report({"ERROR"}, printable_lines("\n".join(faults)))
            return {"CANCELLED"}
        for blender_object in objects:
            _set_levels(blender_object)
        levels = ", ".join(sorted({str(obj.data.ccdepth.uniform_level) for obj in objects}))
        self.report({"INFO"}, f"{count_text(len(objects), 'object', 'objects')}, level {levels}")
        return {"FINISHED"}


def _has_depths(blender_object: bpy.types.Object) -> bool:
    mesh = blender_object.data
    return results.has_result(mesh) and not mesh.ccdepth.subdivision


def _levels_fault(blender_object: bpy.types.Object, is_stale: bool, most_faces: int) -> str | None:
    """Why the object's levels cannot be set, if they cannot."""
    if not _has_depths(blender_object):
        return "it has no depths; compute them first"
    if not blender_object.is_editable:
        return "the object is linked from another file; make it local first"
    if is_stale:
        return "its depths are out of date; compute them again"
    record, limits = blender_object.data.ccdepth, bpy.types.SubsurfModifier.bl_rna.properties
    needed, most = record.uniform_level, limits["levels"].hard_max
    if needed < 0:
        return "its depths are from an earlier version of CC Depth; compute them again"
    if needed > most:
        return f"it needs {needed} levels, and a Subdivision Surface modifier has {most} at most"
    if record.quality > limits["quality"].hard_max:
        return (
            f"with Use Limit Surface it needs a higher Quality than the {limits['quality'].hard_max} that a "
            "Subdivision Surface modifier has at most; compute its depths for the Control Mesh"
        )
    faces = int(record.uniform_faces)
    if faces > most_faces:
        return f"{needed} levels would make {faces:,} faces, and the Face Limit is {most_faces:,}"
    return None


def _set_levels(blender_object: bpy.types.Object) -> None:
    record = blender_object.data.ccdepth
    modifier = subdivision_modifier(blender_object)
    if modifier is None:
        modifier = blender_object.modifiers.new("Subdivision", "SUBSURF")
        if not record.use_modifiers:
            blender_object.modifiers.move(len(blender_object.modifiers) - 1, 0)
    modifier.levels = modifier.render_levels = record.uniform_level
    modifier.use_limit_surface = record.vertices == "LIMIT"
    # Without Use Limit Surface it counts for nothing. A higher one is the user's own.
    modifier.quality = max(modifier.quality, record.quality)


CLASSES = (CCDEPTH_OT_compute, CCDEPTH_OT_clear, CCDEPTH_OT_select, CCDEPTH_OT_set_levels)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
