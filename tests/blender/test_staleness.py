# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel shows that a result is out of date when its mesh or the settings have changed, and only then."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene

MESH_LINE = "Out of date: mesh changed"
SETTINGS_LINE = "Out of date: settings changed"


def stale_line(holder: bpy.types.Object) -> str:
    """What the panel shows, once Blender has passed on its updates and the timer has run."""
    bpy.context.view_layer.update()
    addon.module("state.staleness").check_touched()
    return addon.module("ui.panels").stale_line(bpy.context.scene.ccdepth, holder.data)


def computed() -> bpy.types.Object:
    holder = scene.add_object(meshes.creased_cube())
    scene.add_subdivision(holder, 2)
    mirror = holder.modifiers.new("Mirror", "MIRROR")
    holder.modifiers.move(1, 0)
    mirror.use_mirror_merge = False
    holder.vertex_groups.new(name="Group")
    addon.compute(holder)
    assert stale_line(holder) == ""
    return holder


def move_a_vertex(holder: bpy.types.Object) -> None:
    holder.data.vertices[0].co.x += 0.01
    holder.data.update()


def change_a_crease(holder: bpy.types.Object) -> None:
    holder.data.attributes["crease_edge"].data[0].value = 0.9
    holder.data.update()


def add_a_crease_group(holder: bpy.types.Object) -> None:
    """Of no weights, as with the button: Blender tells nobody of groups that scripts make."""
    with bpy.context.temp_override(object=holder, active_object=holder):
        bpy.ops.object.vertex_group_add()
    holder.vertex_groups[-1].name = "crease_edge"


def name_a_group_like_creases(holder: bpy.types.Object) -> None:
    holder.vertex_groups["Group"].name = "crease_vert"


def add_vertex_creases(holder: bpy.types.Object) -> None:
    creases = holder.data.attributes.new("crease_vert", "FLOAT", "POINT")
    creases.data.foreach_set("value", np.full(len(holder.data.vertices), 0.5, dtype=np.float32))
    holder.data.update()


def add_creases_of_another_kind(holder: bpy.types.Object) -> None:
    creases = holder.data.attributes.new("crease_vert", "INT", "FACE")
    creases.data.foreach_set("value", np.ones(len(holder.data.polygons), dtype=np.int32))
    holder.data.update()


@pytest.mark.parametrize("change", [add_a_crease_group, name_a_group_like_creases])
def test_groups_that_are_taken_for_creases_are_noticed(change: Callable[[bpy.types.Object], None]) -> None:
    """Compute Depth refuses them, so that what it found before does not hold either."""
    holder = computed()
    change(holder)
    assert stale_line(holder) == MESH_LINE
    with pytest.raises(RuntimeError, match="takes for creases"):
        bpy.ops.ccdepth.compute()
    with pytest.raises(RuntimeError, match="out of date"):
        bpy.ops.ccdepth.set_levels()
    for name in {"crease_edge", "crease_vert"} & {*holder.vertex_groups.keys()}:
        holder.vertex_groups[name].name = "Other"
    assert stale_line(holder) == ""


def test_set_levels_notices_a_group_that_a_script_has_made() -> None:
    """Although Blender tells nobody of it: results that are relied on are examined."""
    holder = computed()
    holder.vertex_groups.new(name="crease_edge")
    with pytest.raises(RuntimeError, match="out of date"):
        bpy.ops.ccdepth.set_levels()


def test_without_creases_groups_of_their_names_do_not_matter() -> None:
    holder = scene.add_object(meshes.creased_cube())
    scene.add_subdivision(holder, 2).use_creases = False
    addon.compute(holder)
    add_a_crease_group(holder)
    assert stale_line(holder) == ""


def test_what_is_measured_notices_groups_that_are_taken_for_creases() -> None:
    holder = scene.add_object(meshes.creased_cube())
    scene.add_subdivision(holder, 2)
    addon.measure(holder)
    staleness = addon.module("state.staleness")
    for groups, is_stale in (([], False), (["crease_vert"], True)):
        for name in groups:
            holder.vertex_groups.new(name="Group").name = name
        bpy.context.view_layer.update()
        staleness.check_touched()
        assert staleness.is_deviation_stale(holder.data) == is_stale


def flip_the_faces(holder: bpy.types.Object) -> None:
    holder.data.flip_normals()


def scale_the_object(holder: bpy.types.Object) -> None:
    holder.scale.x = 1.5


def change_the_modifier(holder: bpy.types.Object) -> None:
    holder.modifiers["Mirror"].use_axis[1] = True


def remove_the_modifier(holder: bpy.types.Object) -> None:
    holder.modifiers.remove(holder.modifiers["Mirror"])


def turn_creases_off(holder: bpy.types.Object) -> None:
    holder.modifiers["Subdivision"].use_creases = False


def subdivide_in_edit_mode(holder: bpy.types.Object) -> None:
    with addon.edit_mode(holder):
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.mesh.subdivide()


def change_the_depths(holder: bpy.types.Object) -> None:
    holder.data.attributes["ccdepth"].data[0].value += 1
    holder.data.update()


@pytest.mark.parametrize(
    "change",
    [
        move_a_vertex,
        change_a_crease,
        add_vertex_creases,
        add_creases_of_another_kind,
        flip_the_faces,
        scale_the_object,
        change_the_modifier,
        remove_the_modifier,
        turn_creases_off,
        subdivide_in_edit_mode,
        change_the_depths,
    ],
)
def test_changes_of_the_mesh_are_noticed(change: Callable[[bpy.types.Object], None]) -> None:
    holder = computed()
    change(holder)
    assert stale_line(holder) == MESH_LINE
    bpy.ops.ccdepth.compute()
    assert stale_line(holder) == ""


def test_depths_of_zero_that_are_taken_away_are_noticed() -> None:
    holder = scene.add_object(meshes.torus(6, 6))
    addon.compute(holder, tolerance=100.0, tolerance_mode="ABSOLUTE")
    assert addon.depths(holder).max() == 0
    checksum = addon.module("state.fingerprint").mesh_checksum(holder)
    holder.data.attributes.remove(holder.data.attributes["ccdepth"])
    assert addon.module("state.fingerprint").mesh_checksum(holder) != checksum


def move_and_turn(holder: bpy.types.Object) -> None:
    holder.location = (5.0, 1.0, 2.0)
    holder.rotation_euler = (0.4, 1.0, -0.3)


def change_the_levels(holder: bpy.types.Object) -> None:
    holder.modifiers["Subdivision"].levels = 1


def select_in_edit_mode(holder: bpy.types.Object) -> None:
    with addon.edit_mode(holder):
        bpy.ops.mesh.select_all(action="INVERT")
        bpy.ops.mesh.hide()


def paint(holder: bpy.types.Object) -> None:
    holder.data.attributes.new("Paint", "BYTE_COLOR", "CORNER")
    holder.data.update()


def move_and_move_back(holder: bpy.types.Object) -> None:
    x = holder.data.vertices[0].co.x
    move_a_vertex(holder)
    assert stale_line(holder) == MESH_LINE
    holder.data.vertices[0].co.x = x
    holder.data.update()


@pytest.mark.parametrize("change", [move_and_turn, change_the_levels, select_in_edit_mode, paint, move_and_move_back])
def test_changes_that_do_not_matter_are_not_reported(change: Callable[[bpy.types.Object], None]) -> None:
    holder = computed()
    change(holder)
    assert stale_line(holder) == ""


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("tolerance_mode", "ABSOLUTE"),
        ("relative_tolerance", 0.01),
        ("method", "FIRST_ORDER"),
        ("vertices", "LIMIT"),
        ("use_modifiers", False),
    ],
)
def test_changes_of_the_settings_are_noticed(name: str, value: object) -> None:
    holder = computed()
    settings = bpy.context.scene.ccdepth
    before = getattr(settings, name)
    setattr(settings, name, value)
    assert stale_line(holder) == SETTINGS_LINE
    setattr(settings, name, before)
    assert stale_line(holder) == ""


def test_a_distance_does_not_matter_to_a_relative_tolerance() -> None:
    holder = computed()
    bpy.context.scene.ccdepth.tolerance = 0.5
    assert stale_line(holder) == ""


def test_an_object_a_modifier_depends_on() -> None:
    holder = scene.add_suzanne()
    target = bpy.data.objects.new("Axis", None)
    bpy.context.scene.collection.objects.link(target)
    holder.modifiers.new("Mirror", "MIRROR").mirror_object = target
    addon.compute(holder)
    assert stale_line(holder) == ""
    target.location.x = 0.5
    assert stale_line(holder) == MESH_LINE


def test_a_pose_a_modifier_depends_on() -> None:
    armature = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(armature)
    with addon.edit_mode(armature):
        bone = armature.data.edit_bones.new("Bone")
        bone.tail = (0.0, 0.0, 1.0)
    holder = scene.add_suzanne()
    group = holder.vertex_groups.new(name="Bone")
    group.add(range(100), 1.0, "REPLACE")
    holder.modifiers.new("Armature", "ARMATURE").object = armature
    addon.compute(holder)
    assert stale_line(holder) == ""
    armature.pose.bones["Bone"].location.x = 0.5
    assert stale_line(holder) == MESH_LINE


@pytest.fixture
def stretched() -> bpy.types.Object:
    """Suzanne with Geometry Nodes that scale it by their input, within a node group of its own."""
    inner = bpy.data.node_groups.new("Inner", "GeometryNodeTree")
    outer = bpy.data.node_groups.new("Outer", "GeometryNodeTree")
    for tree, make in ((inner, "GeometryNodeTransform"), (outer, "GeometryNodeGroup")):
        tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
        tree.interface.new_socket("Scale", in_out="INPUT", socket_type="NodeSocketVector").default_value = (1, 1, 1)
        tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        start, node, end = (tree.nodes.new(kind) for kind in ("NodeGroupInput", make, "NodeGroupOutput"))
        if tree is outer:
            node.node_tree = inner
        tree.links.new(start.outputs["Geometry"], node.inputs["Geometry"])
        tree.links.new(start.outputs["Scale"], node.inputs["Scale"])
        tree.links.new(node.outputs["Geometry"], end.inputs["Geometry"])
    holder = scene.add_suzanne()
    holder.modifiers.new("Nodes", "NODES").node_group = outer
    addon.compute(holder)
    assert stale_line(holder) == ""
    return holder


def test_inputs_of_geometry_nodes(stretched: bpy.types.Object) -> None:
    modifier = stretched.modifiers["Nodes"]
    if hasattr(modifier, "properties"):
        modifier.properties.inputs.Socket_1.value = (1.0, 2.0, 1.0)
    else:
        modifier["Socket_1"] = (1.0, 2.0, 1.0)
    stretched.update_tag()
    assert stale_line(stretched) == MESH_LINE


def test_geometry_nodes_within_a_group(stretched: bpy.types.Object) -> None:
    inner = bpy.data.node_groups["Inner"]
    transform = next(node for node in inner.nodes if node.bl_idname == "GeometryNodeTransform")
    transform.location.x += 100.0
    assert stale_line(stretched) == ""
    transform.inputs["Translation"].default_value = (0.0, 0.0, 1.0)
    assert stale_line(stretched) == MESH_LINE


def test_shape_keys() -> None:
    holder = scene.add_suzanne()
    holder.shape_key_add(name="Basis")
    key = holder.shape_key_add(name="Key")
    key.data[0].co.x += 1.0
    addon.compute(holder)
    assert stale_line(holder) == ""
    key.value = 0.5
    assert stale_line(holder) == MESH_LINE


def test_edit_mode_is_followed() -> None:
    import bmesh

    holder = scene.add_suzanne()
    with addon.edit_mode(holder):
        bpy.ops.ccdepth.compute()
        assert stale_line(holder) == ""
        edited = bmesh.from_edit_mesh(holder.data)
        edited.verts.ensure_lookup_table()
        edited.verts[0].co.x += 0.1
        bmesh.update_edit_mesh(holder.data)
        assert stale_line(holder) == MESH_LINE
    assert stale_line(holder) == MESH_LINE


def test_large_meshes_in_edit_mode_are_not_read_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(addon.module("state.staleness"), "LARGEST_EDITED_FACE_COUNT", 100)
    holder = scene.add_suzanne()
    with addon.edit_mode(holder):
        bpy.context.view_layer.update()
        bpy.ops.ccdepth.compute()
        assert stale_line(holder) == ""
        bpy.ops.mesh.select_all(action="SELECT")
        assert stale_line(holder) == ""
        bpy.ops.transform.translate(value=(1.0, 0.0, 0.0))
        assert stale_line(holder) == MESH_LINE


def test_a_duplicate_that_goes_away() -> None:
    first = scene.add_suzanne()
    second = scene.add_mesh(first.data)
    second.scale = (2.0, 2.0, 2.0)
    addon.compute(first, second)
    assert stale_line(first) == ""
    bpy.data.objects.remove(second)
    move_and_turn(first)
    assert stale_line(first) == MESH_LINE


def test_a_result_loaded_from_a_file_is_checked(tmp_path: object) -> None:
    holder = computed()
    name = holder.name
    path = f"{tmp_path}/saved.blend"
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert stale_line(bpy.data.objects[name]) == ""
    move_a_vertex(bpy.data.objects[name])
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert stale_line(bpy.data.objects[name]) == MESH_LINE


def test_undo_is_followed() -> None:
    holder = computed()
    name = holder.name
    bpy.ops.ed.undo_push(message="before")
    move_a_vertex(holder)
    bpy.ops.ed.undo_push(message="moved")
    assert stale_line(holder) == MESH_LINE
    bpy.ops.ed.undo()
    assert stale_line(bpy.data.objects[name]) == ""


def test_undo_in_edit_mode_is_followed() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.ed.undo_push(message="Edit Mode")
    bpy.ops.ccdepth.compute(vertices="LIMIT")
    first = addon.histogram(holder)
    bpy.ops.ed.undo_push(message="Compute Depth")
    bpy.ops.ccdepth.compute(tolerance=0.1, tolerance_mode="ABSOLUTE")
    assert addon.histogram(holder) != first
    bpy.ops.ed.undo_push(message="Compute Depth")
    bpy.ops.ed.undo()
    stale_line(bpy.context.object)
    assert addon.histogram(bpy.context.object) == first
    bpy.ops.ed.undo()
    assert not addon.module("state.results").has_result(bpy.context.object.data)
    bpy.ops.object.mode_set(mode="OBJECT")


def test_nothing_is_left_running() -> None:
    staleness = addon.module("state.staleness")
    holder = computed()
    move_a_vertex(holder)
    bpy.context.view_layer.update()
    assert bpy.app.timers.is_registered(staleness.check_touched)
    np.testing.assert_equal(staleness.check_touched(), None)
