# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad input gets a clear report, and changes nothing, not even on the good objects selected with it."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.updating import refuses

pytestmark = pytest.mark.every_blender

each_operator = pytest.mark.parametrize("operator", ["compute", "subdivide", "count_faces"])


def refused(operator: str, *objects: bpy.types.Object, match: str, **settings: object) -> None:
    """The operator on these objects and a good one is refused with this report, and changes nothing."""
    addon.select(scene.add_object(meshes.cube(), "Good"), *objects)
    refuses(operator, match, **settings)


@pytest.mark.parametrize(
    ("tolerance", "match"),
    [
        (0.0, "greater than zero"),
        (-0.1, "greater than zero"),
        (float("nan"), "not a finite number"),
        (1e-12, "Suzanne: the tolerance .* is finer than the mesh's single-precision coordinates can show"),
    ],
)
@each_operator
def test_tolerance(operator: str, tolerance: float, match: str) -> None:
    holder = scene.add_suzanne()
    for mode in ("ABSOLUTE", "RELATIVE"):
        refused(operator, holder, match=match, tolerance=tolerance, tolerance_mode=mode)
    bpy.context.scene.ccdepth.relative_tolerance = tolerance
    if tolerance == 0.0:
        refused(operator, holder, match=match)


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
        (lambda holder: holder.hide_set(True), "Suzanne: the object is hidden; show it first"),
        (lambda holder: setattr(holder, "hide_viewport", True), "Suzanne: the object is hidden|Select a mesh object"),
        (exclude, "Select a mesh object"),
    ],
)
@each_operator
def test_objects_out_of_reach(operator: str, put: Callable[[bpy.types.Object], object], match: str) -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    put(holder)
    refuses(operator, match)


def test_hidden_objects_that_a_script_names() -> None:
    shown, hidden = scene.add_object(meshes.cube(), "Shown"), scene.add_suzanne()
    addon.select(shown)
    hidden.hide_set(True)
    with bpy.context.temp_override(selected_objects=[shown, hidden], active_object=shown):
        refuses("subdivide", "Suzanne: the object is hidden; show it first")


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


def with_odd(name: str, domain: str) -> bpy.types.Object:
    """With a fifth value that is no number."""
    holder = scene.add_suzanne()
    holder.data.attributes.new(name, "FLOAT", domain).data[5].value = np.nan
    return holder


def with_cloth() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.modifiers.new("Cloth", "CLOTH")
    return holder


BAD_MESHES: tuple[tuple[Callable[[], bpy.types.Object], str], ...] = (
    (lambda: scene.add_mesh(bpy.data.meshes.new("Empty")), "Empty: the mesh has no faces"),
    (add_wire, "Wire: the mesh has no faces"),
    (lambda: with_a_vertex_at(float("nan")), "Suzanne: 1 vertex at no finite position"),
    (lambda: with_a_vertex_at(float("inf")), "Suzanne: 1 vertex at no finite position"),
    (with_a_repeated_vertex, "Repeated: 1 face with a repeated vertex"),
    (scaled_to_a_point, "Suzanne: all its faces are at one point"),
    (with_a_group, "Suzanne: .*called “ccdepth”"),
    (lambda: with_odd("ccdepth", "POINT"), "Suzanne: .*called “ccdepth”"),
    (with_cloth, "Suzanne: .*“Cloth” is a simulation"),
    (lambda: with_odd("crease_edge", "EDGE"), r"Suzanne: 1 edge with a crease that is not a number \(first: edge 5\)"),
    (lambda: with_odd("crease_vert", "POINT"), r"Suzanne: 1 vertex .* not a number \(first: vertex 5\)"),
)


@pytest.mark.parametrize(("make", "match"), BAD_MESHES)
@each_operator
def test_bad_meshes(operator: str, make: Callable[[], bpy.types.Object], match: str) -> None:
    refused(operator, make(), match=match)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_shape_keys_are_looked_at_though_they_are_not_mixed_in(value: float) -> None:
    holder = scene.add_suzanne()
    holder.shape_key_add(name="Basis")
    key = holder.shape_key_add(name="Odd")
    key.value = 0.0
    key.data.foreach_set("co", np.full(3 * len(key.data), value, dtype=np.float32))
    refused("subdivide", holder, match="Suzanne: .*the shape key “Odd” has a vertex at no finite position")


def test_every_bad_object_is_named() -> None:
    first, second = with_a_vertex_at(float("nan")), scene.add_mesh(bpy.data.meshes.new("Empty"))
    refused("compute", first, second, match=r"(?s)Suzanne: 1 vertex.*Empty: the mesh has no faces")


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
    refused("compute", holder, match="Suzanne: the mesh is linked from another file")


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
    refused("compute", holder, match="greater than zero", tolerance=0.0)
    assert holder.data.ccdepth.has_result


@each_operator
def test_meshes_without_extent_that_several_objects_use(operator: str) -> None:
    """With a relative tolerance theirs is none at all, and no warning of a division by it is printed."""
    mesh = scene.add_object(meshes.cube(), "Point").data
    mesh.vertices.foreach_set("co", np.ones(3 * len(mesh.vertices), dtype=np.float32))
    addon.select(scene.add_mesh(mesh), scene.add_mesh(mesh))
    refuses(operator, r"Point.*all its faces are at one point", tolerance=0.1, tolerance_mode="RELATIVE")
