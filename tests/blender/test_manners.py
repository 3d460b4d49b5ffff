# SPDX-License-Identifier: GPL-3.0-or-later
"""The manners of every operator: one step of undo, which can be done anew with other settings, as Adjust Last Operation
does it; a run that is stopped, as by Esc, changes nothing; Edit Mode goes on; and what was made is there after the file
was saved and opened again. test_refusals has what is refused."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.subdividing import refuses
from tests.blender.test_refusals import with_repeated_vertices
from tests.blender.updating import made_result

pytestmark = pytest.mark.every_blender


def test_no_operator_that_can_take_long_is_run_again_by_adjust_last_operation() -> None:
    """With it, Blender runs all of an operator at once, and Esc is not heard."""
    long = addon.module("operators.mesh_operators").LongOperator
    found = {name: getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("CCDEPTH_OT_")}
    options = {name: kind.bl_options for name, kind in found.items() if issubclass(kind, long)}
    assert len(options) > 5
    assert not [name for name, each in options.items() if "REGISTER" in each]
    assert [name for name, each in options.items() if "UNDO" not in each] == [
        "CCDEPTH_OT_count_faces",
        "CCDEPTH_OT_export_within",
    ]


def test_other_shortcuts_than_save_do_not_save() -> None:
    asks = addon.module("operators.mesh_operators").asks_to_save
    keys = ("type", "value", "ctrl", "oskey", "shift", "alt")
    for event, wanted in (
        (("S", "PRESS", True, False, False, False), True),
        (("S", "PRESS", False, True, False, False), True),
        (("S", "PRESS", True, False, True, False), False),
        (("S", "PRESS", True, False, False, True), False),
        (("S", "PRESS", False, False, False, False), False),
        (("S", "RELEASE", True, False, False, False), False),
    ):
        assert asks(SimpleNamespace(**dict(zip(keys, event, strict=True)))) == wanted, event


def computed() -> None:
    addon.compute(scene.add_object(meshes.landscape(5, 4)), tolerance=0.1)


def measured() -> None:
    addon.measure(scene.add_object(meshes.creased_cube()), accuracy=0.5, time_limit=30.0)


def edited() -> None:
    holder = scene.add_object(meshes.landscape(5, 4))
    scene.add_subdivision(holder, 1)
    addon.select(holder, mode="EDIT")


def moving() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    scene.animate(holder, "scale", {1: (1.0, 1.0, 1.0), 8: (1.0, 1.0, 3.0)})
    addon.select(holder)
    bpy.context.scene.frame_set(3)


def with_normals() -> None:
    holder = scene.add_object(meshes.creased_cube())
    holder.data.shade_smooth()
    addon.finish("subdivide", holder, tolerance=0.05)


# Every operator that changes something: what it works on, its name, and its settings.
CASES: dict[str, tuple[Callable[[], object], str, dict[str, object]]] = {
    "compute": (lambda: addon.select(scene.add_object(meshes.creased_cube())), "compute", {}),
    "compute again": (computed, "compute", {"tolerance": 0.01}),
    "compute over frames": (moving, "compute", {"frames": "CUSTOM", "frame_list": "1,8"}),
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
    "update": (lambda: addon.select(made_result()[1]), "update", {"tolerance": 0.003, "tolerance_mode": "ABSOLUTE"}),
    "levels of detail": (computed, "lods", {"tolerance": 0.05, "count": 2}),
    "before and after": (lambda: addon.select(made_result()[1]), "before_after", {}),
    "bake": (computed, "bake_colors", {}),
    "find tolerance": (computed, "find_tolerance", {"face_budget": 300}),
    "remove normals": (with_normals, "remove_normals", {}),
    "select invalid": (lambda: addon.select(with_repeated_vertices(0)), "select_invalid", {}),
    "repair": (lambda: addon.select(with_repeated_vertices(0)), "repair", {}),
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
    assert getattr(bpy.types, f"CCDEPTH_OT_{operator}").bl_options >= {"UNDO"}
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


def test_every_operator_is_in_the_table() -> None:
    """But those that change nothing of the file's, or only settings and presets, and what runs by itself."""
    others = {"copy_value", "count_faces", "open_manual", "tolerance_preset_add", "update_kept", "use_preset", "cancel"}
    others.add("export_within")
    assert {operator for _, operator, _ in CASES.values()} == set(dir(bpy.ops.ccdepth)) - others


LONG = [case for case, (_, name, _) in CASES.items() if name in ("compute", "measure", "subdivide", "lods", "update")]


@pytest.mark.parametrize("case", LONG)
def test_a_run_that_is_stopped_changes_nothing(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As by Esc: its work raises, and its steps clean up."""
    prepare, operator, settings = CASES[case]
    prepare()
    job = addon.module("operators.mesh_operators")
    monkeypatch.setattr(job._Thread, "run", lambda thread: setattr(thread, "fault", job.Cancelled()))
    mode = bpy.context.mode
    with snapshot.unchanged():
        refuses(operator, "was stopped, and nothing was changed", **settings)
    assert bpy.context.mode == mode
    if mode == "EDIT_MESH":
        bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize(
    ("operator", "module", "work"),
    [
        ("compute", "compute_depth", "compute_depths"),
        ("measure", "measure_deviation", "measure"),
        ("subdivide", "adaptive_operator", "subdivide"),
    ],
)
def test_an_object_that_has_another_mesh_meanwhile_gets_nothing(
    operator: str, module: str, work: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    holder, other = scene.add_object(meshes.cube()), scene.add_object(meshes.cube())
    run = getattr(addon.module(f"operators.{module}"), work)
    replaced = lambda *given: setattr(holder, "data", other.data) or run(*given)  # noqa: E731
    monkeypatch.setattr(addon.module(f"operators.{module}"), work, replaced)
    addon.select(holder)
    with pytest.raises(RuntimeError, match="changed in the meantime: nothing was written"):
        getattr(bpy.ops.ccdepth, operator)()
    assert addon.is_untouched([holder, other])
    assert len(bpy.data.objects) == 2


@pytest.mark.parametrize("case", [case for case in CASES if "in Edit Mode" in case])
def test_edit_mode_goes_on(case: str) -> None:
    prepare, operator, settings = CASES[case]
    prepare()
    assert getattr(bpy.ops.ccdepth, operator)(**settings) == {"FINISHED"}
    assert bpy.context.mode == "EDIT_MESH"
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("case", ["compute again", "measure", "subdivide", "update", "bake", "set levels"])
def test_what_was_made_is_there_after_saving(case: str, tmp_path: Path) -> None:
    prepare, operator, settings = CASES[case]
    prepare()
    assert getattr(bpy.ops.ccdepth, operator)(**settings) == {"FINISHED"}

    def made() -> dict[str, snapshot.Snapshot]:
        return {mesh.name: dict(snapshot.mesh_paths(mesh)) for mesh in bpy.data.meshes if mesh.users}

    before, names = made(), {each.name: each.ccdepth.source_name for each in bpy.data.objects}
    scene.open_again(tmp_path)
    assert {each.name: each.ccdepth.source_name for each in bpy.data.objects} == names
    for name, content in made().items():
        assert snapshot.differences(before[name], content, lambda path: path[0] == "settings") == []
