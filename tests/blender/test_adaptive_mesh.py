# SPDX-License-Identifier: GPL-3.0-or-later
"""The new mesh: its faces, loose parts, materials, settings, custom properties, and what is hidden or selected."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core import SubdividedMesh, apply_boundary_rule
from tests import meshes, uniform
from tests.blender import addon, scene
from tests.blender.full_mesh import LEVEL, Comparison, compare, counts, read, weights_of, write
from tests.blender.subdividing import shape, subdivide

pytestmark = pytest.mark.every_blender


def test_the_new_mesh_is_sound(comparison: Comparison) -> None:
    mesh = comparison.mesh
    assert not mesh.validate(verbose=True)
    assert counts(mesh) == counts(comparison.blenders)
    # The matching itself: edges by their corners, both ways.
    np.testing.assert_array_equal(np.sort(comparison.vertices), np.arange(len(mesh.vertices)))
    np.testing.assert_array_equal(np.sort(comparison.edges), np.arange(len(mesh.edges)))
    assert len(bpy.data.objects) == 1


def test_materials_and_settings_stay(comparison: Comparison) -> None:
    mesh = comparison.mesh
    assert [material.name for material in mesh.materials] == ["Red", "Green", "Blue"]
    assert (mesh["custom"], mesh.use_mirror_x, mesh.remesh_voxel_size) == (12.5, True, 0.125)


def test_hidden_and_selected_parts_stay_whole() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    mesh = holder.data
    for polygon in mesh.polygons:
        polygon.hide = polygon.index in {5, 6}
        polygon.select = polygon.index in {0, 1}
    flush(mesh, "select", {0, 1})
    comparison = compare(holder)
    faces = comparison.subdivided.base_faces
    new = comparison.mesh
    for name, chosen in ((".hide", {5, 6}), (".select", {0, 1})):
        expected = np.isin(faces, sorted(chosen))
        np.testing.assert_array_equal(read(new, f"{name}_poly")[:, 0], expected)
    selected = read(new, ".select_vert")[:, 0]
    of_selected = comparison.subdivided.corner_vertices.reshape(-1, 4)[np.isin(faces, [0, 1])]
    np.testing.assert_array_equal(np.flatnonzero(selected), np.unique(of_selected))


def flush(mesh: bpy.types.Mesh, flag: str, faces: set[int]) -> None:
    """Select the vertices and edges of these faces alone."""
    corners = [corner for face in faces for corner in mesh.polygons[face].loop_indices]
    vertices, edges = {mesh.loops[c].vertex_index for c in corners}, {mesh.loops[c].edge_index for c in corners}
    for items, chosen in ((mesh.vertices, vertices), (mesh.edges, edges)):
        for item in items:
            setattr(item, flag, item.index in chosen)


def test_loose_parts_stay_with_their_values() -> None:
    cube = meshes.cube()
    loose = replace(
        cube,
        positions=np.concatenate([cube.positions, [[3, 0, 0], [4, 0, 0], [5, 0, 0]]]),
        loose_edges=[(8, 9), (0, 8)],
    )
    holder = scene.add_object(loose)
    numbers = np.arange(11)
    for data_type in ("FLOAT", "INT"):
        write(holder.data, f"POINT {data_type}", data_type, "POINT", numbers)
    holder.vertex_groups.new(name="Group").add([8, 10], 0.5, "REPLACE")
    for name in ("Basis", "Key"):
        holder.shape_key_add(name=name, from_mix=False).value = 1.0
    holder.data.shape_keys.key_blocks["Key"].points[10].co = (5, 6, 7)
    module = addon.module("exchange.adaptive_mesh")
    control = apply_boundary_rule(scene.polygon_mesh_of(holder.data), smooth_corners=True)
    subdivided = uniform.uniform(control, LEVEL)
    used = np.unique(subdivided.corner_vertices)
    mesh = module.new_mesh(
        holder.data, control, uniform.with_loose_parts(control, without_loose_parts(subdivided, used))
    )
    assert not mesh.validate()
    assert len(mesh.vertices) == len(used) + 3
    assert len(mesh.edges) == len(np.unique(subdivided.corner_edges)) + 2
    for data_type in ("FLOAT", "INT"):
        np.testing.assert_array_equal(read(mesh, f"POINT {data_type}")[-3:, 0], [8, 9, 10])
    np.testing.assert_array_equal(read(mesh, "position")[-3:], [[3, 0, 0], [4, 0, 0], [5, 0, 0]])
    assert tuple(mesh.shape_keys.key_blocks["Key"].points[len(used) + 2].co) == (5, 6, 7)
    assert weights_of(mesh)[-3:] == [{0: 0.5}, {}, {0: 0.5}]
    ends = {tuple(sorted(edge.vertices)) for edge in list(mesh.edges)[-2:]}
    assert (len(used), len(used) + 1) in ends


def without_loose_parts(subdivided: SubdividedMesh, used: NDArray[np.intp]) -> SubdividedMesh:
    """A subdivision with those vertices and edges alone that have faces."""
    places = np.zeros(len(subdivided.positions), dtype=np.intp)
    places[used] = np.arange(len(used))
    edges, corner_edges = np.unique(subdivided.corner_edges, return_inverse=True)
    return replace(
        subdivided,
        positions=subdivided.positions[used],
        corner_vertices=places[subdivided.corner_vertices],
        corner_edges=corner_edges.reshape(-1),
        edge_vertices=places[subdivided.edge_vertices[edges]],
        base_edges=subdivided.base_edges[edges],
        base_vertices=subdivided.base_vertices[used],
        vertex_edges=subdivided.vertex_edges[used],
    )


def test_results_of_ours_are_not_carried() -> None:
    holder = scene.add_suzanne()
    holder.data.attributes.new("Paint", "FLOAT_COLOR", "CORNER")
    holder.data.attributes.active_color_name = "Paint"
    addon.compute(holder, tolerance=0.05)
    assert holder.data.attributes.active_color_name == "ccdepth_color"
    mesh = compare(holder).mesh
    assert not any(attribute.name.startswith("ccdepth") for attribute in mesh.attributes)
    assert not mesh.ccdepth.has_result
    assert mesh.attributes.active_color_name == "Paint"
    assert holder.data.ccdepth.has_result


def test_custom_properties_stay_where_modifiers_are_counted_in() -> None:
    holder = scene.add_object(meshes.cube())
    holder.data["number"], holder.data["text"], holder.data["list"] = 0.5, "words", [1.0, 2.0]
    holder.data["group"] = {"one": 1, "two": {"three": 3}}
    holder.data["object"] = holder
    holder.data.id_properties_ui("number").update(min=0.0, max=2.0, description="A number")
    holder.modifiers.new("Bevel", "BEVEL")
    addon.select(holder)
    assert bpy.ops.ccdepth.subdivide(tolerance=0.1, tolerance_mode="ABSOLUTE") == {"FINISHED"}
    mesh = bpy.context.object.data
    assert mesh != holder.data
    assert (mesh["number"], mesh["text"], list(mesh["list"])) == (0.5, "words", [1.0, 2.0])
    assert mesh["group"].to_dict() == {"one": 1, "two": {"three": 3}}
    assert mesh["object"] == holder
    shown = mesh.id_properties_ui("number").as_dict()
    assert (shown["max"], shown["description"]) == (2.0, "A number")


def test_loose_vertices_may_be_anywhere() -> None:
    mesh = bpy.data.meshes.new("Mesh")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0.5), (np.nan, 0, 0)], [], [(0, 1, 2, 3)])
    [result] = subdivide(scene.add_mesh(mesh))
    assert np.count_nonzero(np.isnan(shape(result)[:, 0])) == 1
