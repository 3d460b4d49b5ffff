# SPDX-License-Identifier: GPL-3.0-or-later
"""Every operator that changes something is one step of undo, which takes all of it back, and redo brings it again.

What is undone can be done anew, with other settings as well, as Adjust Last Operation does it.
"""

from __future__ import annotations

from collections.abc import Callable

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.updating import made_result

pytestmark = pytest.mark.every_blender


def computed() -> None:
    addon.compute(scene.add_suzanne(), tolerance=0.1)


def measured() -> None:
    addon.measure(scene.add_object(meshes.creased_cube()), accuracy=0.5, time_limit=30.0)


def edited() -> None:
    holder = scene.add_object(meshes.landscape(5, 4))
    scene.add_subdivision(holder, 1)
    addon.select(holder)
    bpy.ops.object.mode_set(mode="EDIT")


def moving() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    for frame, holder.scale.z in ((1, 1.0), (8, 3.0)):
        holder.keyframe_insert("scale", frame=frame)
    addon.select(holder)
    bpy.context.scene.frame_set(3)


def source_and_result() -> None:
    addon.select(made_result()[1])


def invalid() -> None:
    holder = scene.add_object(meshes.landscape(4, 3))
    holder.data.loops[1].vertex_index = holder.data.loops[0].vertex_index
    addon.select(holder)


CASES: dict[str, tuple[Callable[[], object], str, dict[str, object]]] = {
    "compute": (lambda: addon.select(scene.add_suzanne()), "compute", {}),
    "compute again": (computed, "compute", {"tolerance": 0.01}),
    "compute over frames": (moving, "compute", {"frames": "CUSTOM", "frame_list": "1-8"}),
    "measure": (measured, "measure", {"accuracy": 0.1, "time_limit": 30.0}),
    "clear": (computed, "clear", {}),
    "clear a measurement": (measured, "clear", {}),
    "select by depth": (computed, "select", {}),
    "select worst": (measured, "select_worst", {}),
    "set levels": (computed, "set_levels", {}),
    "subdivide": (computed, "subdivide", {"tolerance": 0.05}),
    "subdivide in place": (computed, "subdivide", {"tolerance": 0.05, "output": "IN_PLACE"}),
    "compute in Edit Mode": (edited, "compute", {"tolerance": 0.05}),
    "subdivide in Edit Mode": (edited, "subdivide", {"tolerance": 0.05}),
    "subdivide in place in Edit Mode": (edited, "subdivide", {"tolerance": 0.05, "output": "IN_PLACE"}),
    "update": (source_and_result, "update", {"tolerance": 0.003, "tolerance_mode": "ABSOLUTE"}),
    "select invalid": (invalid, "select_invalid", {}),
    "repair": (invalid, "repair", {}),
}


def state() -> snapshot.Snapshot:
    """The whole file, and which source each object has. Blender does not undo how elements are selected."""
    for mesh in bpy.data.meshes:
        # What is stored once it is asked for.
        mesh.ccdepth.measurement  # noqa: B018
    sources = {holder.name: holder.ccdepth.source and holder.ccdepth.source.name for holder in bpy.data.objects}
    found = {path: value for path, value in snapshot.take().items() if path[-1] != "select mode"}
    return found | {("sources",): sources}


@pytest.mark.parametrize("case", CASES)
def test_it_is_undone_and_redone(case: str) -> None:
    prepare, operator, settings = CASES[case]
    assert getattr(bpy.types, f"CCDEPTH_OT_{operator}").bl_options >= {"REGISTER", "UNDO"}
    prepare()
    bpy.ops.ed.undo_push(message="before")
    before = state()
    assert getattr(bpy.ops.ccdepth, operator)("EXEC_DEFAULT", True, **settings) == {"FINISHED"}
    after = state()
    assert snapshot.differences(before, after)
    bpy.ops.ed.undo()
    assert snapshot.differences(before, state()) == []
    bpy.ops.ed.redo()
    assert snapshot.differences(after, state()) == []
    bpy.ops.ed.undo()
    if "tolerance" in settings:
        assert getattr(bpy.ops.ccdepth, operator)("EXEC_DEFAULT", True, **settings | {"tolerance": 0.2}) == {"FINISHED"}
        assert snapshot.differences(after, state())
        bpy.ops.ed.undo()
    assert getattr(bpy.ops.ccdepth, operator)("EXEC_DEFAULT", True, **settings) == {"FINISHED"}
    assert snapshot.differences(after, state()) == []
    if bpy.context.mode == "EDIT_MESH":
        bpy.ops.object.mode_set(mode="OBJECT")


def test_counting_faces_is_no_step_of_undo() -> None:
    assert "UNDO" not in bpy.types.CCDEPTH_OT_count_faces.bl_options
