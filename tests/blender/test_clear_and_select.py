# SPDX-License-Identifier: GPL-3.0-or-later
"""Clear leaves a mesh as it was; Select by Depth finds the faces of a depth in both modes; what a user chose stays.

Every operator that changes something is one step of undo. What is undone can be done anew, with other settings as well,
as Adjust Last Operation does it.
"""

from collections.abc import Callable
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.full_mesh import DOMAINS
from tests.blender.subdividing import refuses
from tests.blender.test_refusals import with_repeated_vertices
from tests.blender.updating import made_result

pytestmark = pytest.mark.every_blender


# The heat map, and after our colours were displayed the colours that Blender displays and renders.
def is_unlike(path: tuple[str, ...]) -> bool:
    return path[-1] in ("heat_map", "displayed color", "rendered color")


DISPLAYED = [((), ""), *((("Paint",), domain) for domain in DOMAINS), (("Base", "Paint"), "CORNER")]


@pytest.mark.parametrize(("colors", "domain"), DISPLAYED)
@pytest.mark.parametrize("editing", [False, True])
def test_clear_leaves_the_mesh_as_it_was(colors: tuple[str, ...], domain: str, editing: bool) -> None:
    """Blender displays the first colours that are made, also where it does not list them among the colours."""
    holder = scene.add_object(meshes.creased_cube())
    attributes = holder.data.attributes
    for name in colors:
        attributes.new(name, "BYTE_COLOR", domain)
    if colors:
        attributes.active_color_name, attributes.default_color_name = colors[-1], colors[0]
    with addon.edit_mode(holder, editing=editing), snapshot.unchanged(is_unlike):
        assert bpy.ops.ccdepth.compute() == bpy.ops.ccdepth.measure(time_limit=0.1) == {"FINISHED"}
        assert attributes.active_color_name == (colors[-1] if colors else "")
        assert bpy.ops.ccdepth.bake_colors() == {"FINISHED"}
        assert attributes.active_color_name == "ccdepth_color"
        assert attributes.default_color_name == (colors[0] if colors else "ccdepth_color")
        assert bpy.ops.ccdepth.clear() == {"FINISHED"}
        assert {attributes.active_color_name, attributes.default_color_name} <= {"", *colors}
    assert addon.is_untouched([holder])


def test_clear_works_on_all_selected() -> None:
    first, second, other = scene.add_suzanne(), scene.add_object(meshes.cube()), scene.add_object(meshes.cube())
    addon.compute(first, second, other)
    # Attributes without a record are cleared as well.
    second.data.property_unset("ccdepth")
    addon.finish("clear", first, second, scene.add_light())
    assert addon.is_untouched([first, second])
    assert other.data.ccdepth.has_result
    assert bpy.ops.ccdepth.clear() == {"CANCELLED"}


@pytest.mark.parametrize("editing", [False, True])
def test_select(editing: bool) -> None:
    """Each time what was selected before is no longer, unless it is extended."""
    holder = scene.add_suzanne()
    addon.compute(holder)
    depths = addon.depths(holder)
    least, middle, deepest = int(depths.min()), int(np.median(depths)), int(depths.max())
    assert least < middle < deepest

    def faces() -> np.ndarray:
        return np.array([face.select for face in holder.data.polygons])

    def selected(*calls: dict[str, object]) -> np.ndarray:
        with addon.edit_mode(holder, editing=editing):
            for call in calls:
                assert bpy.ops.ccdepth.select(**call) == {"FINISHED"}
        at_once = faces()
        # Whatever mode it ran in, Edit Mode must show this selection and no more.
        bpy.context.scene.tool_settings.mesh_select_mode = (False, False, True)
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.object.mode_set(mode="OBJECT")
        assert_equal(faces(), at_once)
        return at_once

    assert_equal, visible = np.testing.assert_array_equal, np.arange(len(depths)) % 2 == 1
    for comparison, compare in (("EQUAL", np.equal), ("AT_LEAST", np.greater_equal), ("AT_MOST", np.less_equal)):
        assert_equal(selected({"depth": middle, "comparison": comparison}), compare(depths, middle))
    # It starts from the deepest.
    assert_equal(selected({}), depths == deepest)
    extended = selected({"depth": least}, {"depth": deepest, "extend": True})
    assert_equal(extended, (depths == least) | (depths == deepest))
    holder.data.polygons.foreach_set("hide", ~visible)
    assert_equal(selected({"depth": 0, "comparison": "AT_LEAST"}), visible)


def test_select_by_depth_enters_edit_mode_from_the_window_alone() -> None:
    """With the faces of the depth selected, whatever the select mode was."""
    holder = scene.add_object(meshes.landscape(5, 4))
    addon.compute(holder)
    bpy.context.scene.tool_settings.mesh_select_mode = (True, False, False)
    bpy.ops.ccdepth.select()
    assert bpy.context.mode == "OBJECT"
    wanted = scene.selected_faces(holder)
    # As set when it is invoked.
    bpy.ops.ccdepth.select(edit=True)
    assert bpy.context.mode == "EDIT_MESH"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert scene.selected_faces(holder) == wanted


@pytest.mark.parametrize("name", ["select", "select_worst"])
def test_buttons_that_select_take_nothing_from_the_last_press(name: str) -> None:
    """Blender remembers the settings of an operator for the next button, except those that are not to be saved."""
    settings = getattr(bpy.ops.ccdepth, name).get_rna_type().properties
    assert all(each.is_skip_save for each in settings if each.identifier != "rna_type")


@pytest.mark.parametrize("name", [".select_vert", ".select_edge", ".select_poly"])
def test_attribute_where_blender_keeps_the_selection(name: str) -> None:
    """It is named and kept: Blender itself crashes when a selection is written over it."""
    for data_type, domain in (("BOOLEAN", "CORNER"), ("FLOAT", "FACE")):
        holder = scene.add_object(meshes.cube(), "Cube")
        addon.compute(holder)
        if name in holder.data.attributes:
            holder.data.attributes.remove(holder.data.attributes[name])
        holder.data.attributes.new(name, data_type, domain)
        refuses("select", f"Cube.*: .* “{name}” that is not a selection; enter Edit Mode and leave it", depth=0)
        with addon.edit_mode(holder):
            pass
        assert bpy.ops.ccdepth.select(depth=0) == {"FINISHED"}


# In the order in which Blender lists attributes some come before ours and some after.
NAMES = (None, "point", "face", "corner", "UVMap")


@pytest.mark.parametrize("editing", [False, True])
def test_active_attribute_and_rendered_colour(editing: bool) -> None:
    holder = scene.add_object(meshes.cube())
    attributes = holder.data.attributes
    for name, domain in (("point", "POINT"), ("face", "FACE"), ("corner", "CORNER")):
        attributes.new(name, "FLOAT", domain)
    holder.data.uv_layers.new(name="UVMap")
    with addon.edit_mode(holder, editing=editing):
        for name in NAMES:
            attributes.active = None if name is None else attributes[name]
            for operator in (bpy.ops.ccdepth.compute, bpy.ops.ccdepth.compute, bpy.ops.ccdepth.clear):
                assert operator() == {"FINISHED"}
                assert (attributes.active and attributes.active.name) == name
        # Colours that are chosen since are not left without an attribute.
        assert bpy.ops.ccdepth.compute() == bpy.ops.ccdepth.bake_colors() == {"FINISHED"}
        attributes.default_color_name = "ccdepth_color"
        assert bpy.ops.ccdepth.clear() == {"FINISHED"}
        assert attributes.default_color_name == ""


def edit_others_than_selected() -> tuple[bpy.types.Object, bpy.types.Object, bpy.types.Object]:
    """Two objects in Edit Mode, only the second of them selected, and another one, which is selected as well.

    Objects are chosen when Edit Mode begins; in it the Outliner and scripts may select others.
    """
    first, second, other = (scene.add_object(meshes.cube(), text) for text in ("First", "Second", "Other"))
    addon.select(first, second, mode="EDIT")
    first.select_set(False)
    other.select_set(True)
    return first, second, other


@pytest.mark.parametrize("refused", [False, True])
def test_objects_that_are_edited_without_being_selected(refused: bool) -> None:
    _, second, _ = edit_others_than_selected()
    if refused:
        refuses("subdivide", "would have about", tolerance=0.001, max_faces=1)
    else:
        assert bpy.ops.ccdepth.count_faces(tolerance=0.1) == {"FINISHED"}
    assert {each.name for each in bpy.context.objects_in_mode} == {"First", "Second"}
    assert {each.name for each in bpy.context.selected_objects} == {"Second", "Other"}
    assert bpy.context.view_layer.objects.active == second
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize(("output", "suffix"), [("NEW_OBJECT", " Adaptive"), ("IN_PLACE", "")])
def test_results_are_edited_in_their_stead(output: str, suffix: str) -> None:
    _, _, other = edit_others_than_selected()
    assert bpy.ops.ccdepth.subdivide(tolerance=0.5, tolerance_mode="ABSOLUTE", output=output) == {"FINISHED"}
    assert {each.name for each in bpy.context.objects_in_mode} == {f"First{suffix}", f"Second{suffix}"}
    assert other.mode == "OBJECT"
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("output", ["NEW_OBJECT", "IN_PLACE"])
@pytest.mark.parametrize("hidden", [False, True])
def test_an_object_that_is_edited_while_another_is_active(output: str, hidden: bool) -> None:
    """With Lock Object Modes off, another object may become the active one while one is edited, which may be hidden."""
    edited, active = (scene.add_object(meshes.cube(), text) for text in ("Edited", "Active"))
    other_user = scene.add_mesh(edited.data)
    edited.data.attributes.new("Paint", "FLOAT_COLOR", "POINT")
    edited.data.attributes.active_color_name = "Paint"
    addon.select(edited, mode="EDIT")
    bpy.context.view_layer.objects.active = active
    active.select_set(True)
    if hidden:
        other_user.select_set(True)
        edited.hide_set(True)
    assert bpy.ops.ccdepth.subdivide(tolerance=0.5, tolerance_mode="ABSOLUTE", output=output) == {"FINISHED"}
    user = other_user if hidden else edited
    result = user if output == "IN_PLACE" else bpy.data.objects[f"{user.name} Adaptive"]
    assert "Paint" in result.data.attributes
    assert result.data.attributes.active_color_name == "Paint"
    assert [each.name for each in bpy.data.objects if each.mode == "EDIT"] == ["Edited"]
    assert edited.hide_get() or not hidden
    edited.hide_set(False)
    bpy.context.view_layer.objects.active = edited
    bpy.ops.object.mode_set(mode="OBJECT")


def test_no_operator_that_can_take_long_is_run_again_by_adjust_last_operation() -> None:
    """With it, Blender runs all of an operator at once, and Esc is not heard."""
    long = addon.module("operators.long_operator").LongOperator
    found = {name: getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("CCDEPTH_OT_")}
    options = {name: kind.bl_options for name, kind in found.items() if issubclass(kind, long)}
    assert len(options) > 5
    assert not [name for name, each in options.items() if "REGISTER" in each]
    assert [name for name, each in options.items() if "UNDO" not in each] == ["CCDEPTH_OT_count_faces"]


def test_other_shortcuts_than_save_do_not_save() -> None:
    asks = addon.module("operators.long_operator").asks_to_save
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
