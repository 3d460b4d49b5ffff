# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes and objects of other files: what cannot be written to is refused, and a result is always this file's own.

Blender drops what is written in bulk to a library override, and says nothing.
"""

from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.subdividing import TOLERANCE, refused, refuses, shape, subdivide
from tests.thorough import combinations

pytestmark = pytest.mark.every_blender


def filled_cube(name: str, keys: bool, modifiers: tuple[str, ...]) -> bpy.types.Object:
    """With something of everything that a mesh carries."""
    holder = scene.add_object(meshes.cube(), name)
    mesh = holder.data
    mesh.materials.append(bpy.data.materials.new("Material"))
    mesh.attributes.new("Number", "FLOAT", "POINT").data.foreach_set("value", np.arange(8, dtype=np.float32))
    mesh.attributes.new("Paint", "BYTE_COLOR", "CORNER")
    mesh.uv_layers.new(name="UVMap")
    mesh["own"] = 7
    holder.vertex_groups.new(name="Group").add([0, 1, 2], 0.5, "REPLACE")
    if keys:
        scene.add_key(holder, value=0.5).points[0].co.x -= 1.0
    for kind in modifiers:
        holder.modifiers.new(kind.title(), kind)
    return holder


def link(tmp_path: Path, block: bpy.types.ID, kind: str = "objects") -> bpy.types.ID:
    """The same in a new file, linked from a file with this alone."""
    name = block.name
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {block})
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene.clear()
    return scene.link(tmp_path / "library.blend", name, kind)


KINDS = ["override", "override with overridden mesh", "local", "local with overridden mesh"]


def linked(
    tmp_path: Path, kind: str = "", *, keys: bool = False, modifiers: tuple[str, ...] = (), computed: bool = False
) -> bpy.types.Object:
    """A cube linked from another file, an override of it, or an object of this file's own with its mesh."""
    holder = filled_cube("Cube", keys, modifiers)
    if computed:
        addon.compute(holder)
    source = made = link(tmp_path, holder)
    if not kind.startswith("local"):
        bpy.context.scene.collection.objects.link(source)
    else:
        made = scene.add_mesh(source.data)
        for modifier in source.modifiers:
            made.modifiers.new(modifier.name, modifier.type)
    if kind.startswith("override"):
        made = source.override_create(remap_local_usages=True)
    if kind.endswith("overridden mesh"):
        made.data = made.data.override_create()
    return made


def content(result: bpy.types.Object) -> snapshot.Snapshot:
    """What the mesh of a result has, but for the names of others in the file."""
    found = dict(snapshot.mesh_paths(result.data))
    return {path: value for path, value in found.items() if path[0] not in ("materials", "record", "settings")}


def expected(*, keys: bool) -> snapshot.Snapshot:
    """Of the result of a cube of this file's own."""
    [result] = subdivide(filled_cube("Own", keys, ()))
    return content(result)


def check_result(result: bpy.types.Object, wanted: snapshot.Snapshot, *, keys: bool) -> None:
    """The result is this file's own, sound, and what it is for a mesh of this file's own."""
    mesh = result.data
    assert {(data.library, data.override_library) for data in (result, mesh)} == {(None, None)}
    assert snapshot.differences(content(result), wanted) == []
    assert not mesh.validate()
    assert [material.name.partition(".")[0] for material in mesh.materials] == ["Material"]
    assert mesh["own"] == 7
    assert (mesh.shape_keys is not None) == keys


def count_faces(holder: bpy.types.Object) -> None:
    addon.finish("count_faces", holder, tolerance=TOLERANCE)
    assert addon.is_untouched([holder])


@pytest.mark.parametrize("keys", [False, True])
@pytest.mark.parametrize(
    ("kind", "output"), [*((kind, "NEW_OBJECT") for kind in KINDS), *((kind, "IN_PLACE") for kind in KINDS[2:])]
)
def test_a_result_is_of_this_file_and_stays_in_it(tmp_path: Path, kind: str, output: str, keys: bool) -> None:
    wanted = expected(keys=keys)
    holder = linked(tmp_path, kind, keys=keys)
    before = shape(holder)
    count_faces(holder)
    [result] = subdivide(holder, output=output)
    check_result(result, wanted, keys=keys)
    if output == "NEW_OBJECT":
        np.testing.assert_array_equal(shape(holder), before)
        assert addon.is_untouched([holder])
    name = result.name
    scene.open_again(tmp_path)
    check_result(bpy.data.objects[name], wanted, keys=keys)
    own = {mesh for mesh in bpy.data.meshes if not mesh.library and mesh.shape_keys}
    assert {key.user for key in bpy.data.shape_keys if not key.library} == own


@pytest.mark.parametrize(("kind", "modifiers"), combinations(KINDS, [("SUBSURF",), ("BEVEL",), ("BEVEL", "SUBSURF")]))
def test_modifiers_of_libraries_are_counted_in_and_taken_off(
    tmp_path: Path, kind: str, modifiers: tuple[str, ...]
) -> None:
    """Blender's Bevel merges UVs in an order that depends on memory addresses, so their last bit varies."""
    holder = linked(tmp_path, kind, modifiers=modifiers)
    count_faces(holder)
    [result] = subdivide(holder)
    assert not result.modifiers
    assert len(holder.modifiers) == len(modifiers)
    assert result.data.override_library is None
    [own] = subdivide(filled_cube("Own", keys=False, modifiers=modifiers))
    varying = {("attribute", "UVMap")} if "BEVEL" in modifiers else set()
    assert snapshot.differences(content(result), content(own), but=varying.__contains__) == []
    uvs, wanted = (scene.values_of(each.data.uv_layers["UVMap"].data, "uv", np.float32, 2) for each in (result, own))
    np.testing.assert_allclose(uvs, wanted, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "output"), [(KINDS[0], "IN_PLACE"), (KINDS[1], "IN_PLACE"), ("", "NEW_OBJECT"), ("", "IN_PLACE")]
)
def test_objects_that_get_no_result(tmp_path: Path, kind: str, output: str) -> None:
    match = "is a library override; choose New Object" if kind else "is linked from another file"
    refused(linked(tmp_path, kind, modifiers=("SUBSURF",)), match=f"Cube: the object {match}", output=output)


def test_an_override_in_an_overridden_collection_gets_its_result_beside_it(tmp_path: Path) -> None:
    collection = link(tmp_path, scene.add_collection("Cubes", scene.add_object(meshes.cube(), "Cube")), "collections")
    bpy.context.scene.collection.children.link(collection)
    collection.override_hierarchy_create(bpy.context.scene, bpy.context.view_layer)
    [found] = [obj for obj in bpy.context.scene.objects if obj.override_library]
    [result] = subdivide(found)
    assert result.override_library is None
    assert len(result.data.polygons) > 6


def test_the_source_of_a_result_is_rendered_again_after_loading(tmp_path: Path) -> None:
    """Which keeps nothing of ours on an override."""
    holder = linked(tmp_path, KINDS[0])
    [result] = subdivide(holder)
    names = holder.name, result.name
    assert (holder.hide_render, result.hide_render) == (True, False)
    scene.open_again(tmp_path)
    result = bpy.data.objects[names[1]]
    source = result.ccdepth.source
    addon.finish("before_after", result)
    assert (source.hide_render, result.hide_render) == (False, True)
    addon.finish("before_after", source)
    assert (source.hide_render, result.hide_render) == (True, False)


OVERRIDDEN = "the mesh is a library override, on which Blender keeps no attributes"
LINKED = "the mesh is linked from another file"


@pytest.mark.parametrize("operator", ["compute", "measure"])
@pytest.mark.parametrize(
    ("kind", "match"),
    [("", LINKED), (KINDS[0], LINKED), (KINDS[1], OVERRIDDEN), (KINDS[2], LINKED), (KINDS[3], OVERRIDDEN)],
)
def test_meshes_of_other_files_get_no_values(tmp_path: Path, kind: str, match: str, operator: str) -> None:
    """Blender would neither take them nor keep them in the file. Measured against, such a mesh is as good as any."""
    holder = linked(tmp_path, kind)
    refuses(operator, match, holder)
    own = scene.add_object(meshes.cube(), "Own")
    addon.measure(own, holder, time_limit=0.1)
    assert own.data.ccdepth.measurement.against == holder.name


def test_the_object_measured_against_is_not_another_of_its_name(tmp_path: Path) -> None:
    """A local and a linked object may have the same."""
    holder = linked(tmp_path)
    local = scene.add_object(meshes.torus(4, 3), holder.name)
    assert (local.name, local.library) == (holder.name, None)
    own = scene.add_object(meshes.cube(), "Own")
    addon.measure(own, holder, time_limit=0.1)
    assert own.ccdepth.measured_against == holder
    local.location.x += 1.0
    addon.examine_touched()
    line = addon.module("ui.deviation_panel").stale_line
    assert line(bpy.context.scene.ccdepth, own.data) == ""


@pytest.mark.parametrize("kind", ["", *KINDS])
def test_a_result_in_a_library_is_left_alone(tmp_path: Path, kind: str) -> None:
    holder = linked(tmp_path, kind, computed=True)
    addon.compute(scene.add_suzanne(), method="CERTIFIED")
    addon.select(holder)
    assert bpy.ops.ccdepth.clear() == {"CANCELLED"}
    assert {*addon.ATTRIBUTES} <= {*holder.data.attributes.keys()}


@pytest.mark.parametrize("operator", ["compute", "subdivide"])
def test_results_that_are_not_kept_are_an_error(tmp_path: Path, operator: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Overrides are neither refused nor made local here, so that Blender drops what is written to them."""
    monkeypatch.setattr(addon.module("operators.refusals"), "mesh_fault", lambda mesh: None)
    monkeypatch.setattr(addon.module("exchange.adaptive_mesh"), "own_copy", lambda data: data.copy())
    holder = linked(tmp_path, KINDS[1], keys=True)
    names = {item.name_full for item in bpy.data.user_map()}
    message = "Cube: Blender did not keep what was written"
    refuses(operator, message, holder, tolerance=TOLERANCE, tolerance_mode="ABSOLUTE")
    assert addon.is_untouched([holder])
    assert {item.name_full for item in bpy.data.user_map()} == names


@pytest.mark.parametrize(("operator", "dropped"), [("compute", 0), ("compute", 2), ("measure", 1)])
def test_values_that_are_not_kept_leave_all_alone(monkeypatch: pytest.MonkeyPatch, operator: str, dropped: int) -> None:
    """One mesh with earlier depths and two without any: Blender drops what is written last to the first of them, or to
    a later one."""
    holders = [scene.add_object(meshes.cube(), name) for name in ("First", "Second", "Third")]
    holders[0].data.color_attributes.new("Own", "BYTE_COLOR", "CORNER")
    addon.compute(holders[0], tolerance=0.5)
    writes, module = [], addon.module("exchange.blender_arrays")
    # Depths and their bounds, or deviations.
    last = {"compute": 2, "measure": 1}[operator]

    def forget(items: bpy.types.bpy_prop_collection, name: str, values: np.ndarray, _step: float) -> None:
        writes.append(items.id_data)
        if writes.count(holders[dropped].data) == last:
            raise module.WriteError("Blender did not keep what was written to the mesh")
        items.foreach_set(name, values.ravel())

    monkeypatch.setattr(module, "write_values", forget)
    message = f"{holders[dropped].name}: Blender did not keep what was written"
    refuses(operator, message, *holders, tolerance=0.01, tolerance_mode="ABSOLUTE")
    assert holders[dropped].data in writes
