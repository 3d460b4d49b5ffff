# SPDX-License-Identifier: GPL-3.0-or-later
"""Clear leaves a mesh as it was; Select by Depth finds the faces of a depth in both modes; what a user chose stays."""

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.full_mesh import DOMAINS
from tests.blender.subdividing import refuses

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
