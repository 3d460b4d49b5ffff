# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad input gets a clear report, and changes nothing, not even on the good objects selected with it."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene


def refused(*objects: bpy.types.Object, match: str, **settings: object) -> None:
    """Compute Depth on these objects and a good one is refused with this report, and leaves no trace."""
    good = scene.add_object(meshes.cube(), "Good")
    addon.select(good, *objects)
    with pytest.raises(RuntimeError, match=match):
        bpy.ops.ccdepth.compute(**settings)
    assert addon.is_untouched([good, *objects])


@pytest.mark.parametrize("mode", ["ABSOLUTE", "RELATIVE"])
@pytest.mark.parametrize(
    ("tolerance", "match"),
    [
        (0.0, "greater than zero"),
        (-0.1, "greater than zero"),
        (float("nan"), "not a finite number"),
        (1e-9, "Suzanne.*finer than the mesh's single-precision coordinates"),
    ],
)
def test_tolerance(mode: str, tolerance: float, match: str) -> None:
    refused(scene.add_suzanne(), match=match, tolerance=tolerance, tolerance_mode=mode)


def test_tolerance_of_the_scene() -> None:
    bpy.context.scene.ccdepth.relative_tolerance = 0.0
    refused(scene.add_suzanne(), match="greater than zero")


def test_nothing_selected() -> None:
    addon.select()
    with pytest.raises(RuntimeError, match="Select a mesh object"):
        bpy.ops.ccdepth.compute()


def test_only_other_objects_selected() -> None:
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(camera)
    addon.select(camera)
    with pytest.raises(RuntimeError, match="Select a mesh object"):
        bpy.ops.ccdepth.compute()


def test_other_objects_among_the_selected_are_skipped() -> None:
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(camera)
    holder = scene.add_suzanne()
    addon.compute(holder, camera)
    assert holder.data.ccdepth.has_result


def test_other_modes() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    bpy.ops.object.mode_set(mode="SCULPT")
    with pytest.raises(RuntimeError, match="Object Mode and in Edit Mode"):
        bpy.ops.ccdepth.compute()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert addon.is_untouched([holder])


def test_empty_mesh() -> None:
    refused(scene.add_mesh(bpy.data.meshes.new("Empty")), match="Empty: the mesh has no faces")


def test_mesh_without_faces() -> None:
    mesh = bpy.data.meshes.new("Wire")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
    refused(scene.add_mesh(mesh), match="Wire: the mesh has no faces")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_vertices_nowhere(value: float) -> None:
    holder = scene.add_suzanne()
    # Blender's own access to vertices turns infinity into the largest number.
    positions = holder.data.attributes["position"].data
    values = np.empty(3 * len(positions), dtype=np.float32)
    positions.foreach_get("vector", values)
    values[16] = value
    positions.foreach_set("vector", values)
    refused(holder, match="Suzanne: 1 vertex at no finite position")


def test_faces_with_repeated_vertices() -> None:
    mesh = scene.add_object(meshes.cube()).data
    mesh.name = "Repeated"
    holder = scene.add_mesh(mesh)
    corner = mesh.loops[1]
    corner.vertex_index = mesh.loops[0].vertex_index
    refused(holder, match="Repeated: 1 face with a repeated vertex")


def test_object_without_extent_by_its_scale() -> None:
    holder = scene.add_suzanne()
    holder.scale = (0.0, 0.0, 0.0)
    refused(holder, match="Suzanne: all its faces are at one point")


def test_hidden_object() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    holder.hide_set(True)
    with pytest.raises(RuntimeError, match="Suzanne: the object is hidden"):
        bpy.ops.ccdepth.compute()
    assert addon.is_untouched([holder])


def test_object_disabled_in_viewports() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    holder.hide_viewport = True
    with pytest.raises(RuntimeError, match=r"Suzanne: the object is hidden|Select a mesh object"):
        bpy.ops.ccdepth.compute()
    assert addon.is_untouched([holder])


def test_object_in_an_excluded_collection() -> None:
    holder = scene.add_suzanne()
    collection = bpy.data.collections.new("Excluded")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(holder)
    bpy.context.scene.collection.objects.unlink(holder)
    addon.select(holder)
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True
    with pytest.raises(RuntimeError, match="Select a mesh object"):
        bpy.ops.ccdepth.compute()
    assert addon.is_untouched([holder])


def linked_suzanne(tmp_path: object) -> bpy.types.Object:
    name = scene.add_suzanne().name
    path = f"{tmp_path}/library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = [name]
    (linked,) = wanted.objects
    bpy.context.scene.collection.objects.link(linked)
    return linked


def test_linked_mesh(tmp_path: object) -> None:
    refused(linked_suzanne(tmp_path), match="Suzanne: the mesh is linked from another file")


def test_library_override_of_the_object_alone(tmp_path: object) -> None:
    override = linked_suzanne(tmp_path).override_create(remap_local_usages=True)
    refused(override, match="Suzanne: the mesh is linked from another file")


@pytest.mark.parametrize(
    ("name", "data_type", "domain"),
    [("ccdepth", "FLOAT", "FACE"), ("ccdepth_bound", "FLOAT", "POINT"), ("ccdepth_color", "BYTE_COLOR", "CORNER")],
)
@pytest.mark.parametrize("editing", [False, True])
def test_attributes_of_the_same_name(name: str, data_type: str, domain: str, editing: bool) -> None:
    holder = scene.add_suzanne()
    holder.data.attributes.new(name, data_type, domain)
    addon.select(holder)
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match=f"Suzanne: .*called “{name}”"):
        bpy.ops.ccdepth.compute()
    if editing:
        bpy.ops.object.mode_set(mode="OBJECT")
    assert [kept for kept in addon.ATTRIBUTES if kept in holder.data.attributes] == [name]
    kept = holder.data.attributes[name]
    assert (kept.data_type, kept.domain) == (data_type, domain)
    assert not holder.data.ccdepth.has_result


def test_vertex_group_of_the_same_name() -> None:
    holder = scene.add_suzanne()
    holder.vertex_groups.new(name="ccdepth")
    refused(holder, match="Suzanne: .*called “ccdepth”")


def test_every_bad_object_is_named() -> None:
    first, second = scene.add_suzanne(), scene.add_mesh(bpy.data.meshes.new("Empty"))
    first.data.vertices[0].co.x = np.nan
    refused(first, second, match=r"(?s)Suzanne: 1 vertex.*Empty: the mesh has no faces")


def test_bad_mesh_in_edit_mode() -> None:
    import bmesh

    holder = scene.add_suzanne()
    with addon.edit_mode(holder):
        edited = bmesh.from_edit_mesh(holder.data)
        bmesh.ops.delete(edited, geom=edited.faces[:], context="FACES_ONLY")
        with pytest.raises(RuntimeError, match="Suzanne: the mesh has no faces"):
            bpy.ops.ccdepth.compute()
    assert addon.is_untouched([holder])


def test_a_bad_run_leaves_an_earlier_result_alone() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    before = addon.depths(holder)
    with pytest.raises(RuntimeError, match="greater than zero"):
        bpy.ops.ccdepth.compute(tolerance=0.0)
    np.testing.assert_array_equal(addon.depths(holder), before)
    assert holder.data.ccdepth.has_result


@pytest.mark.parametrize("operator", ["compute", "subdivide", "count_faces"])
def test_meshes_without_extent_that_several_objects_use(operator: str) -> None:
    """With a relative tolerance theirs is none at all, and no warning of a division by it is printed."""
    mesh = scene.add_object(meshes.cube(), "Point").data
    for vertex in mesh.vertices:
        vertex.co = (1.0, 1.0, 1.0)
    addon.select(scene.add_mesh(mesh), scene.add_mesh(mesh))
    with pytest.raises(RuntimeError, match=r"Point.*all its faces are at one point"):
        getattr(bpy.ops.ccdepth, operator)(tolerance=0.1, tolerance_mode="RELATIVE")
