# SPDX-License-Identifier: GPL-3.0-or-later
"""The heat map: what it shows and in which colours; and that meshes, viewports and exports stay as they are."""

import json
from pathlib import Path
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.subdividing import subdivide

pytestmark = pytest.mark.every_blender

colors = addon.module("state.colors")
heat_map = addon.module("state.heat_map")
overlay_items = addon.module("ui.overlay_items")
Shown = heat_map.Shown


def views() -> list[bpy.types.SpaceView3D]:
    spaces = [space for screen in bpy.data.screens for area in screen.areas for space in area.spaces]
    return [space for space in spaces if space.type == "VIEW_3D"]


def appearances() -> snapshot.Snapshot:
    """Of every 3D View, all settings of its shading and of its overlays."""
    return {path: value for path, value in snapshot.take().items() if path[0] == "viewports"}


def test_viewports_stay_as_they_are_and_so_does_a_file_that_is_opened_again(tmp_path: Path) -> None:
    before = appearances()
    assert len({path[1:3] for path in before}) > 4
    [result] = subdivide(scene.add_suzanne(), tolerance=0.1)
    addon.compute(result)
    addon.measure(result, time_limit=0.1)
    for shown in ("DEPTH", "DISTANCE", "NONE", "DEVIATION"):
        bpy.context.scene.ccdepth.heat_map = shown
        assert appearances() == before
    scene.open_again(tmp_path)
    assert appearances() == before
    assert bpy.context.scene.ccdepth.heat_map == "DEVIATION"
    bpy.ops.ccdepth.clear()
    assert appearances() == before


def exported(path: Path) -> bytes:
    if path.suffix == ".glb":
        bpy.ops.export_scene.gltf(filepath=str(path), use_selection=True)
    else:
        bpy.ops.wm.ply_export(filepath=str(path), export_selected_objects=True)
    return path.read_bytes()


@pytest.mark.parametrize("suffix", [".glb", ".ply"])
def test_exports_are_the_same_with_and_without_a_heat_map_and_have_no_colours(tmp_path: Path, suffix: str) -> None:
    [result] = subdivide(scene.add_suzanne(), tolerance=0.1)
    bpy.context.scene.ccdepth.heat_map = "DISTANCE"
    shown = exported(tmp_path / f"mesh{suffix}")
    bpy.context.scene.ccdepth.heat_map = "NONE"
    assert exported(tmp_path / f"mesh{suffix}") == shown
    vertices = len(result.data.vertices)
    if suffix == ".ply":
        assert f"element vertex {vertices}\n".encode() in shown
        assert b"red" not in shown[:1000]
        return
    length = int.from_bytes(shown[12:16], "little")
    content = json.loads(shown[20 : 20 + length])
    [[primitive]] = [mesh["primitives"] for mesh in content["meshes"]]
    assert not any(name.startswith("COLOR") for name in primitive["attributes"])
    # Blender splits vertices along seams of the UV map, as it does without a result.
    bpy.ops.ccdepth.clear()
    assert exported(tmp_path / "cleared.glb") == shown
    assert content["accessors"][primitive["attributes"]["POSITION"]]["count"] >= vertices


def test_update_result_does_not_bring_back_what_was_cleared() -> None:
    [result] = subdivide(scene.add_object(meshes.cube()), tolerance=0.1)
    bpy.ops.ccdepth.clear()
    faces = len(result.data.polygons)
    assert bpy.ops.ccdepth.update(tolerance=0.02, tolerance_mode="ABSOLUTE") == {"FINISHED"}
    assert len(result.data.polygons) > faces
    assert addon.is_untouched([result])


def oklab(srgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3): colours as they are seen, where distances are differences (Björn Ottosson, 2020)."""
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    cones = linear @ np.array(
        [[0.4122214708, 0.2119034982, 0.0883024619], [0.5363325363, 0.6806995451, 0.2817188376],
         [0.0514459929, 0.1073969566, 0.6299787005]]
    )  # fmt: skip
    return np.cbrt(cones) @ np.array(
        [[0.2104542553, 1.9779984951, 0.0259040371], [0.7936177850, -2.4285922050, 0.7827717662],
         [-0.0040720468, 0.4505937099, -0.8086757660]]
    )  # fmt: skip


# What those see who lack one kind of cones, on linear colours (Machado, Oliveira and Fernandes, 2009).
COLOUR_BLIND = (
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
)


def test_depths_have_colours_that_are_clearly_apart_and_ever_lighter() -> None:
    """Viridis without its darkest quarter, which was used before, has steps of 0.07: three depths were like blues."""
    ramp = colors.depth_colors(range(9))
    seen = oklab(ramp)
    assert (np.diff(seen[:, 0]) > 0.03).all()
    steps = np.linalg.norm(np.diff(seen, axis=0), axis=1)
    assert steps.min() > 0.075
    assert steps[:3].min() > 0.11
    for matrix in COLOUR_BLIND:
        linear = (colors.to_linear(ramp) @ np.array(matrix).T).clip(0.0, 1.0)
        encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        # No less than the least of viridis, 0.044, which is made for them.
        assert np.linalg.norm(np.diff(oklab(encoded), axis=0), axis=1).min() > 0.044
    np.testing.assert_array_equal(colors.depth_colors([8, 9, 30]), np.tile(ramp[-1], (3, 1)))
    assert np.linalg.norm(seen - oklab(np.array([colors.BEYOND])), axis=1).min() > 0.25


def expected_srgb(fractions: NDArray[np.float64]) -> NDArray[np.float64]:
    ramp = np.array([[*bytes.fromhex(color)] for color in colors.RAMP.split()]) / 255
    found = np.stack([np.interp(fractions, np.linspace(0, 1, 9), channel) for channel in ramp.T], axis=1)
    found[fractions > 1] = colors.BEYOND
    return found


def test_baked_colours_are_those_of_what_is_shown() -> None:
    [result] = subdivide(scene.add_suzanne(), tolerance=0.1)
    settings, mesh = bpy.context.scene.ccdepth, result.data
    sizes, bounds = [polygon.loop_total for polygon in mesh.polygons], addon.bounds(result).astype(np.float64)
    settings.distance_top = 0.4 * float(bounds.max())
    cases = (
        ("DISTANCE", "TOLERANCE", bounds / np.float32(mesh.ccdepth.world_tolerance)),
        ("DISTANCE", "FIXED", bounds / np.float32(settings.distance_top)),
        # Off, or where there is none of it, as of depths on a result, it is the last result.
        ("DEPTH", "FIXED", bounds / np.float32(settings.distance_top)),
        ("NONE", "TOLERANCE", bounds / np.float32(mesh.ccdepth.world_tolerance)),
        ("DEVIATION", "TOLERANCE", bounds / np.float32(mesh.ccdepth.world_tolerance)),
    )
    for shown, color_range, fractions in cases:
        settings.heat_map, settings.distance_range = shown, color_range
        assert bpy.ops.ccdepth.bake_colors() == {"FINISHED"}
        found = addon.colors(result)
        expected = colors.to_linear(expected_srgb(np.repeat(fractions, sizes)))
        # Colours, and fractions between those of the ramp, are in single precision.
        np.testing.assert_allclose(found[:, :3], expected, atol=1e-5)
        assert (found[:, 3] == 1.0).all()
    assert (bounds > settings.distance_top).any()


def test_a_result_shows_depths_once_they_are_its_own() -> None:
    [result] = subdivide(scene.add_suzanne(), tolerance=0.1)
    assert items(Shown.DISTANCE) == [result.name]
    assert items(Shown.DEPTH) == []
    addon.compute(result, tolerance=0.01)
    assert items(Shown.DEPTH) == [result.name]
    bpy.context.scene.ccdepth.heat_map = "DEPTH"
    assert bpy.ops.ccdepth.bake_colors() == {"FINISHED"}
    sizes = [polygon.loop_total for polygon in result.data.polygons]
    expected = colors.to_linear(expected_srgb(np.repeat(addon.depths(result) / 8, sizes)))
    # Colours, and fractions between those of the ramp, are in single precision.
    np.testing.assert_allclose(addon.colors(result)[:, :3], expected, atol=1e-5)


def test_colours_are_baked_in_edit_mode() -> None:
    holder = scene.add_object(meshes.cube(), "Cube")
    addon.compute(holder)
    with addon.edit_mode(holder):
        assert bpy.ops.ccdepth.bake_colors() == {"FINISHED"}
        assert holder.mode == "EDIT"
    assert addon.colors(holder).shape == (24, 4)
    assert holder.data.attributes.active_color_name == "ccdepth_color"
    assert not addon.module("state.out_of_date").noted(holder.data).is_stale


def drawn(kind: Shown) -> list[Any]:
    """What the overlay draws."""
    bpy.context.view_layer.update()
    return list(overlay_items.items(bpy.context.evaluated_depsgraph_get(), views()[0], kind))


def items(kind: Shown) -> list[str]:
    """The names of what is drawn."""
    return [evaluated.name for evaluated, _ in drawn(kind)]


def read(kind: Shown) -> list[Any]:
    return [overlay_items.read_item(evaluated, kind) for evaluated, _ in drawn(kind)]


def test_the_map_goes_and_comes_with_its_object() -> None:
    first, second = scene.add_object(meshes.cube(), "First"), scene.add_object(meshes.cube(), "Second")
    addon.compute(first, second)
    scene.add_object(meshes.cube(), "Without")
    assert items(Shown.DEPTH) == items(Shown.DISTANCE) == ["First", "Second"]
    assert items(Shown.DEVIATION) == []
    for hide in (first.hide_set, lambda state: setattr(first, "hide_viewport", state)):
        for state, names in ((True, ["Second"]), (False, ["First", "Second"])):
            hide(state)
            assert items(Shown.DEPTH) == names
    first.display_type = "WIRE"
    assert items(Shown.DEPTH) == ["Second"]
    # Of a measurement against another object only what was measured.
    addon.measure(scene.add_object(meshes.cube(), "Measured"), second, time_limit=0.1)
    assert items(Shown[bpy.context.scene.ccdepth.heat_map]) == ["Measured"]


def test_modifiers_instances_and_shape_keys_are_shown_as_they_are_drawn() -> None:
    holder = scene.add_object(meshes.landscape(3, 2), "Land")
    addon.compute(holder, tolerance=1e-3)
    assert len(np.unique(addon.depths(holder))) > 1
    holder.modifiers.new("Array", "ARRAY").count = 2
    scene.add_subdivision(holder, 1)
    scene.add_key(holder, value=1.0).data[0].co.z += 1.0
    collection = bpy.data.collections.new("Instanced")
    collection.objects.link(holder)
    instance = scene.add("Instance")
    instance.instance_type, instance.instance_collection = "COLLECTION", collection
    instance.location.x = 10.0
    found = [
        (each.key, each.matrix.translation.x, overlay_items.read_item(evaluated, Shown.DEPTH))
        for evaluated, each in drawn(Shown.DEPTH)
    ]
    (key, _, mesh), (other, _, _) = found
    assert key == other
    assert sorted(x for _, x, _ in found) == [0.0, 10.0]
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    evaluated.calc_loop_triangles()
    assert mesh.triangles.tolist() == [list(triangle.loops) for triangle in evaluated.loop_triangles]
    places = [tuple(evaluated.vertices[loop.vertex_index].co) for loop in evaluated.loops]
    np.testing.assert_array_equal(mesh.corners, np.array(places, dtype=np.float32))
    assert len(mesh.edges) == len(evaluated.edges)
    depths = addon.depths(holder)
    assert len(evaluated.polygons) == 2 * 4 * len(depths)
    np.testing.assert_array_equal(np.unique(mesh.values, return_counts=True)[1] % (2 * 4 * 4), 0)


def test_objects_that_look_alike_are_kept_once() -> None:
    first, other = scene.add_object(meshes.cube()), scene.add_object(meshes.cube())
    addon.compute(first, other)
    duplicate, bent = scene.add_mesh(first.data), scene.add_mesh(first.data)
    bent.modifiers.new("Bend", "SIMPLE_DEFORM")
    keys = {evaluated.name: item.key for evaluated, item in drawn(Shown.DEPTH)}
    assert keys[first.name] == keys[duplicate.name]
    assert len({keys[each.name] for each in (first, other, bent)}) == 3


def test_edit_mode_shows_what_is_edited_without_hidden_faces() -> None:
    holder = scene.add_object(meshes.cube(), "Cube")
    addon.compute(holder)
    with addon.edit_mode(holder):
        edited = bmesh.from_edit_mesh(holder.data)
        edited.faces.ensure_lookup_table()
        edited.faces[0].hide_set(True)
        bmesh.update_edit_mesh(holder.data)
        [mesh] = read(Shown.DEPTH)
        assert (len(mesh.triangles), len(mesh.values)) == (10, 24)
    [mesh] = read(Shown.DEPTH)
    assert len(mesh.triangles) == 12


def test_attributes_that_are_not_ours_are_not_shown() -> None:
    holder = scene.add_object(meshes.cube())
    holder.data.attributes.new("ccdepth", "FLOAT", "POINT")
    assert read(Shown.DEPTH) == [None]
    holder.data.attributes.remove(holder.data.attributes["ccdepth"])
    holder.data.attributes.new("ccdepth", "INT", "FACE")
    [mesh] = read(Shown.DEPTH)
    assert mesh.values.tolist() == 24 * [0]


@pytest.mark.parametrize("operator", ["select", "select_worst"])
def test_what_an_operator_selects_in_object_mode_is_shown_until_it_is_edited(operator: str) -> None:
    holder = scene.add_object(meshes.landscape(3, 2), "Land")
    addon.compute(holder, tolerance=1e-3)
    addon.measure(holder, time_limit=0.1)
    # What somebody has selected in Edit Mode is not.
    assert [len(mesh.chosen) for mesh in read(Shown.DEPTH)] == [0]
    mode = tuple(bpy.context.scene.tool_settings.mesh_select_mode)
    assert getattr(bpy.ops.ccdepth, operator)() == {"FINISHED"}
    assert tuple(bpy.context.scene.tool_settings.mesh_select_mode) == mode
    [mesh] = read(Shown.DEPTH)
    chosen = [face for face in holder.data.polygons if face.select]
    assert 0 < len(chosen) < len(holder.data.polygons)
    corners = {corner for face in chosen for corner in face.loop_indices}
    assert {*mesh.chosen.ravel().tolist()} == corners
    bpy.context.scene.tool_settings.mesh_select_mode = (False, False, True)
    bpy.ops.object.mode_set(mode="EDIT")
    edited = bmesh.from_edit_mesh(holder.data)
    assert sum(face.select for face in edited.faces) == len(chosen)
    assert [len(mesh.chosen) for mesh in read(Shown.DEPTH)] == [0]
    bpy.ops.object.mode_set(mode="OBJECT")
    assert [len(mesh.chosen) for mesh in read(Shown.DEPTH)] == [0]
