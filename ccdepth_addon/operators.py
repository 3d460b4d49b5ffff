# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Compute Depth, Clear, and Select by Depth."""

from typing import Any, ClassVar

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty

from . import fingerprint, heat_map, properties, results, selection, staleness
from .computation import Calculation, ComputeError, MeshDepths, Settings, as_typed, count_faces, prepare
from .object_state import object_state

# Seconds of work before the interface gets control back: once at the start, and then again and again.
PATIENCE_AT_START = 0.5
PATIENCE_AT_EACH_TICK = 0.1
SECONDS_BETWEEN_TICKS = 0.01

# Looking around is allowed while depths are being computed.
NAVIGATION_EVENTS = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "MOUSEMOVE", "TRACKPADPAN", "TRACKPADZOOM"}


def meshes_meant(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The mesh objects an operator works on: the selected ones, or the active one when nothing is selected.

    In Edit Mode they are those in it, and selected ones that share a mesh with them: undo covers no others there.
    """
    if context.mode == "EDIT_MESH":
        edited = dict.fromkeys([*context.objects_in_mode, *context.selected_objects])
        return [obj for obj in edited if obj.type == "MESH" and obj.data.is_editmode]
    active = context.active_object
    candidates = context.selected_objects or ([] if active is None else [active])
    return [obj for obj in candidates if obj.type == "MESH"]


def _poll_meshes(cls: Any, context: bpy.types.Context) -> bool:
    if context.mode not in {"OBJECT", "EDIT_MESH"}:
        cls.poll_message_set("Works in Object Mode and in Edit Mode")
        return False
    if not meshes_meant(context):
        cls.poll_message_set("Select a mesh object")
        return False
    return True


class CCDEPTH_OT_compute(bpy.types.Operator):
    """Compute how many Catmull-Clark levels each face needs to be within the tolerance of the limit surface"""

    bl_idname = "ccdepth.compute"
    bl_label = "Compute Depth"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    tolerance: properties.absolute_tolerance_property()
    tolerance_mode: properties.tolerance_mode_property()
    method: properties.method_property()
    vertices: properties.vertices_property()
    use_modifiers: properties.use_modifiers_property()
    # The same number for the redo panel, where a part of a diagonal must not be shown in metres.
    relative_tolerance: FloatProperty(
        name="Tolerance",
        description=properties.RELATIVE_DESCRIPTION,
        precision=5,
        step=0.01,
        soft_min=1e-6,
        soft_max=0.1,
        get=lambda self: self.tolerance,
        set=lambda self, value: setattr(self, "tolerance", value),
        options={"HIDDEN", "SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _poll_meshes(cls, context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        calculation = self._start(context)
        if calculation is None:
            return {"CANCELLED"}
        if bpy.app.background:
            calculation.work()
        if calculation.work(PATIENCE_AT_START):
            return self._finish(context, calculation)
        self._calculation = calculation
        self._timer = context.window_manager.event_timer_add(SECONDS_BETWEEN_TICKS, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self.cancel(context)
            self.report({"INFO"}, "Compute Depth was cancelled, and nothing was changed")
            return {"CANCELLED"}
        if event.type == "TIMER":
            if self._calculation.work(PATIENCE_AT_EACH_TICK):
                self.cancel(context)
                return self._finish(context, self._calculation)
            context.workspace.status_text_set(f"Computing depth: {self._calculation.fraction:.0%}    Esc: Cancel")
        return {"PASS_THROUGH"} if event.type in NAVIGATION_EVENTS else {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)

    def execute(self, context: bpy.types.Context) -> set[str]:
        calculation = self._start(context)
        if calculation is None:
            return {"CANCELLED"}
        calculation.work()
        return self._finish(context, calculation)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "tolerance_mode")
        layout.prop(self, "relative_tolerance" if self.tolerance_mode == "RELATIVE" else "tolerance")
        for name in ("method", "vertices", "use_modifiers"):
            layout.prop(self, name)

    def _start(self, context: bpy.types.Context) -> Calculation | None:
        """Read everything; None, with a report, when something stands in the way."""
        self._take_settings(context.scene.ccdepth)
        objects = meshes_meant(context)
        try:
            _refuse_what_cannot_be_written(objects)
            tasks = prepare(context, objects, self._settings())
        except ComputeError as fault:
            self.report({"ERROR"}, str(fault))
            return None
        return Calculation(tasks, self._settings())

    def _take_settings(self, settings: bpy.types.PropertyGroup) -> None:
        """Fill in from the scene what the caller left open."""
        for name in ("tolerance_mode", "method", "vertices", "use_modifiers"):
            if not self.properties.is_property_set(name):
                setattr(self, name, getattr(settings, name))
        if not self.properties.is_property_set("tolerance"):
            self.tolerance = getattr(settings, _tolerance_name(self.tolerance_mode))

    def _keep_settings(self, settings: bpy.types.PropertyGroup) -> None:
        """Let the panel show what was chosen in the redo panel."""
        for name in ("tolerance_mode", "method", "vertices", "use_modifiers"):
            setattr(settings, name, getattr(self, name))
        setattr(settings, _tolerance_name(self.tolerance_mode), self.tolerance)

    def _settings(self) -> Settings:
        return Settings(as_typed(self.tolerance), self.tolerance_mode, self.method, self.vertices, self.use_modifiers)

    def _finish(self, context: bpy.types.Context, calculation: Calculation) -> set[str]:
        """Write the answers, all of them or none."""
        answers = calculation.answers
        meshes = {mesh.session_uid: mesh for mesh in bpy.data.meshes}
        if not all(_is_still_there(meshes, answer) for answer in answers):
            self.report({"ERROR"}, "The meshes were changed in the meantime: nothing was written")
            return {"CANCELLED"}
        color_depths = [depth for answer in answers for depth in (answer.least, answer.deepest)]
        objects = [[bpy.data.objects[name] for name in answer.task.object_names] for answer in answers]
        states = [[object_state(user, use_modifiers=self.use_modifiers) for user in users] for users in objects]
        for answer, users, described in zip(answers, objects, states, strict=True):
            mesh = users[0].data
            results.write_result(mesh, answer, calculation.settings, min(color_depths), max(color_depths))
            fingerprint.remember(users[0], described)
            staleness.note_write(mesh)
        if self.options.is_repeat:
            self._keep_settings(context.scene.ccdepth)
        heat_map.synchronise(context)
        self._report(context, answers)
        return {"FINISHED"}

    def _report(self, context: bpy.types.Context, answers: list[MeshDepths]) -> None:
        skipped = sum(obj.type != "MESH" for obj in context.selected_objects)
        if skipped:
            self.report({"INFO"}, f"Skipped {_count(skipped, 'selected object', 'selected objects')} without a mesh")
        for answer in answers:
            for note in _modifier_notes(answer):
                self.report({"WARNING"}, f"{answer.task.object_names[0]}: {note}")
        faces = _count(sum(len(answer.depths) for answer in answers), "face", "faces")
        meshes = f"{len(answers)} meshes, " if len(answers) > 1 else ""
        self.report({"INFO"}, f"{meshes}{faces}, deepest depth {max(answer.deepest for answer in answers)}")


def _tolerance_name(tolerance_mode: str) -> str:
    return "relative_tolerance" if tolerance_mode == "RELATIVE" else "tolerance"


def _count(number: int, one: str, many: str) -> str:
    return f"{number:,} {one if number == 1 else many}"


def _is_still_there(meshes: dict[int, bpy.types.Mesh], answer: MeshDepths) -> bool:
    mesh = meshes.get(answer.task.mesh_uid)
    objects = [bpy.data.objects.get(name) for name in answer.task.object_names]
    return (
        mesh is not None
        and count_faces(mesh) == answer.task.face_count
        and all(obj is not None and obj.data == mesh for obj in objects)
    )


def _modifier_notes(answer: MeshDepths) -> list[str]:
    """What the modifiers do to faces that the numbers on the mesh cannot show."""
    notes = []
    if answer.added_faces:
        faces = _count(answer.added_faces, "face", "faces")
        notes.append(
            f"modifiers add {faces} that come from no face of the mesh; the deepest needs {answer.added_deepest}"
        )
    if answer.taken_faces:
        faces = _count(answer.taken_faces, "face", "faces")
        notes.append(f"modifiers take {faces} away; their depth is 0")
    return notes


def _refuse_what_cannot_be_written(objects: list[bpy.types.Object]) -> None:
    """Raise ComputeError naming every object that is hidden, or whose mesh cannot hold a result."""
    faults = [f"{obj.name}: {fault}" for obj in objects if (fault := _writing_fault(obj))]
    if faults:
        raise ComputeError("\n".join(faults))


def _writing_fault(blender_object: bpy.types.Object) -> str | None:
    mesh = blender_object.data
    if not blender_object.visible_get():
        return "the object is hidden; show it first"
    if not mesh.is_editable:
        return "the mesh is linked from another file and cannot be written to; make it local first"
    name = results.conflict(blender_object)
    if name is not None:
        return f"the mesh has an attribute or a vertex group of its own called “{name}”; rename it first"
    return None


class CCDEPTH_OT_clear(bpy.types.Operator):
    """Remove the depths from the mesh, and show it as it was shown before"""

    bl_idname = "ccdepth.clear"
    bl_label = "Clear"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _poll_meshes(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        meshes = {obj.data for obj in meshes_meant(context) if obj.data.is_editable}
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
        if not _poll_meshes(cls, context):
            return False
        if not any(results.has_result(obj.data) for obj in meshes_meant(context)):
            cls.poll_message_set("Compute Depth first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        meshes = {obj.data for obj in meshes_meant(context) if results.has_result(obj.data)}
        if not self.properties.is_property_set("depth"):
            self.depth = max(mesh.ccdepth.deepest for mesh in meshes)
        selected = 0
        for mesh in meshes:
            selected += selection.select_faces(mesh, self.depth, self.comparison, extend=self.extend)
        # With vertices or edges selected instead, faces between the wanted ones would be selected as well.
        context.tool_settings.mesh_select_mode = (False, False, True)
        self.report({"INFO"}, f"{_count(selected, 'face', 'faces')} selected")
        return {"FINISHED"}


CLASSES = (CCDEPTH_OT_compute, CCDEPTH_OT_clear, CCDEPTH_OT_select)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
