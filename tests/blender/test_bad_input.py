# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad input gets a clear report, and changes nothing, not even on the good objects selected with it."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene

pytestmark = pytest.mark.every_blender


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


def add_camera() -> bpy.types.Object:
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(camera)
    return camera


def exclude(holder: bpy.types.Object) -> None:
    collection = bpy.data.collections.new("Excluded")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(holder)
    bpy.context.scene.collection.objects.unlink(holder)
    addon.select(holder)
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True


@pytest.mark.parametrize(
    ("put", "match"),
    [
        (lambda holder: addon.select(), "Select a mesh object"),
        (lambda holder: addon.select(add_camera()), "Select a mesh object"),
        (lambda holder: bpy.ops.object.mode_set(mode="SCULPT"), "Object Mode and in Edit Mode"),
        (lambda holder: holder.hide_set(True), "Suzanne: the object is hidden"),
        (lambda holder: setattr(holder, "hide_viewport", True), "Suzanne: the object is hidden|Select a mesh object"),
        (exclude, "Select a mesh object"),
    ],
)
def test_objects_out_of_reach(put: Callable[[bpy.types.Object], object], match: str) -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    put(holder)
    with pytest.raises(RuntimeError, match=match):
        bpy.ops.ccdepth.compute()
    if holder.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    assert addon.is_untouched([holder])


def test_other_objects_among_the_selected_are_skipped() -> None:
    camera, holder = add_camera(), scene.add_suzanne()
    addon.compute(holder, camera)
    assert holder.data.ccdepth.has_result


def add_wire() -> bpy.types.Object:
    mesh = bpy.data.meshes.new("Wire")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
    return scene.add_mesh(mesh)


def with_a_vertex_at(value: float) -> bpy.types.Object:
    holder = scene.add_suzanne()
    # Blender's own access to vertices turns infinity into the largest number.
    positions = holder.data.attributes["position"].data
    values = np.empty(3 * len(positions), dtype=np.float32)
    positions.foreach_get("vector", values)
    values[16] = value
    positions.foreach_set("vector", values)
    return holder


def with_a_repeated_vertex() -> bpy.types.Object:
    holder = scene.add_object(meshes.cube(), "Repeated")
    holder.data.loops[1].vertex_index = holder.data.loops[0].vertex_index
    return holder


def scaled_to_a_point() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.scale = (0.0, 0.0, 0.0)
    return holder


def with_a_group() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.vertex_groups.new(name="ccdepth")
    return holder


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: scene.add_mesh(bpy.data.meshes.new("Empty")), "Empty: the mesh has no faces"),
        (add_wire, "Wire: the mesh has no faces"),
        (lambda: with_a_vertex_at(float("nan")), "Suzanne: 1 vertex at no finite position"),
        (lambda: with_a_vertex_at(float("inf")), "Suzanne: 1 vertex at no finite position"),
        (with_a_repeated_vertex, "Repeated: 1 face with a repeated vertex"),
        (scaled_to_a_point, "Suzanne: all its faces are at one point"),
        (with_a_group, "Suzanne: .*called “ccdepth”"),
    ],
)
def test_bad_meshes(make: Callable[[], bpy.types.Object], match: str) -> None:
    refused(make(), match=match)


def test_every_bad_object_is_named() -> None:
    first, second = with_a_vertex_at(float("nan")), scene.add_mesh(bpy.data.meshes.new("Empty"))
    refused(first, second, match=r"(?s)Suzanne: 1 vertex.*Empty: the mesh has no faces")


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


@pytest.mark.parametrize("override", [False, True])
def test_linked_mesh(tmp_path: object, override: bool) -> None:
    linked = linked_suzanne(tmp_path)
    holder = linked.override_create(remap_local_usages=True) if override else linked
    refused(holder, match="Suzanne: the mesh is linked from another file")


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
    mesh.vertices.foreach_set("co", np.ones(3 * len(mesh.vertices), dtype=np.float32))
    addon.select(scene.add_mesh(mesh), scene.add_mesh(mesh))
    with pytest.raises(RuntimeError, match=r"Point.*all its faces are at one point"):
        getattr(bpy.ops.ccdepth, operator)(tolerance=0.1, tolerance_mode="RELATIVE")
