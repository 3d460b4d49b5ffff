# SPDX-License-Identifier: GPL-3.0-or-later
"""Every attribute of a mesh is on its subdivision, by value, next to what Blender's own modifier makes there; so are
vertex groups. Custom normals are left out, or made anew."""

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core import limit_normals
from ccdepth_addon.core.attributes.face_varying import UV_SMOOTH, face_varying_surface
from tests import meshes, uniform
from tests.blender import addon, full_mesh, scene
from tests.blender.full_mesh import Comparison, compare, counts, everything, faces_of_corners, known_types, read, write
from tests.blender.subdividing import subdivide

pytestmark = pytest.mark.every_blender

SPREAD = ["POINT", "CORNER"]


@pytest.mark.parametrize("domain", SPREAD)
def test_numbers_are_interpolated_as_the_modifier_does(comparison: Comparison, domain: str) -> None:
    for data_type in ("FLOAT", "FLOAT2", "FLOAT_VECTOR", "FLOAT_COLOR", "BYTE_COLOR", "FLOAT4"):
        # Not every version of Blender has them all, and vectors at corners are UV maps.
        if f"{domain} {data_type}" in comparison.base.attributes:
            own, blenders = comparison.pair(f"{domain} {data_type}")
            tolerance = full_mesh.BYTE if data_type == "BYTE_COLOR" else full_mesh.ROUNDING
            np.testing.assert_allclose(own, blenders, atol=tolerance, rtol=0, err_msg=data_type)
    own, blenders = comparison.pair(f"{domain} BOOLEAN")
    np.testing.assert_array_equal(own, blenders)


@pytest.mark.parametrize("domain", SPREAD)
def test_integers_and_rotations_are_those_of_the_nearest_vertex_or_corner(comparison: Comparison, domain: str) -> None:
    control, subdivided = comparison.control, comparison.subdivided
    points = subdivided.vertex_points if domain == "POINT" else subdivided.corner_points
    sources = control.corner_vertices[points.corners] if domain == "POINT" else points.corners
    staying = np.all(points.parameters == 0, axis=1)
    for data_type in sorted((full_mesh.INTEGERS | {"QUATERNION", "FLOAT4X4"}) & set(known_types())):
        own, blenders = comparison.pair(f"{domain} {data_type}")
        np.testing.assert_array_equal(own, read(comparison.base, f"{domain} {data_type}")[sources])
        # Elsewhere the modifier averages them or leaves zeros; where a vertex stays it agrees.
        if data_type == "INT" or (domain == "POINT" and data_type in full_mesh.INTEGERS):
            np.testing.assert_array_equal(own[staying], blenders[staying])


@pytest.mark.parametrize("domain", ["EDGE", "FACE"])
def test_edges_and_faces_copy_every_type(comparison: Comparison, domain: str) -> None:
    base = comparison.subdivided.base_edges if domain == "EDGE" else comparison.subdivided.base_faces
    for data_type in known_types():
        own, blenders = comparison.pair(f"{domain} {data_type}")
        np.testing.assert_array_equal(own[base >= 0], blenders[base >= 0])
        # What new edges get differs by version for these: black or white, an identity or zeros.
        if data_type not in {"FLOAT_COLOR", "BYTE_COLOR", "FLOAT4X4"}:
            np.testing.assert_array_equal(own[base < 0], blenders[base < 0])


def test_texts_are_copied(comparison: Comparison) -> None:
    sources = {
        "POINT": comparison.control.corner_vertices[comparison.subdivided.vertex_points.corners],
        "EDGE": comparison.subdivided.base_edges,
        "FACE": comparison.subdivided.base_faces,
        "CORNER": comparison.subdivided.corner_points.corners,
    }
    for domain, numbers in sources.items():
        texts = [item.value for item in comparison.mesh.attributes[f"{domain} STRING"].data]
        assert texts == [f"text {number}".encode() if number >= 0 else b"" for number in numbers]


def test_built_in_values_are_those_of_the_modifier(comparison: Comparison) -> None:
    for name in ("crease_edge", "material_index", "sharp_face"):
        own, blenders = comparison.pair(name)
        np.testing.assert_array_equal(own, blenders)
        assert len(np.unique(own)) > 1
    own, blenders = (np.array([e.use_seam for e in each.edges]) for each in (comparison.mesh, comparison.blenders))
    np.testing.assert_array_equal(own, blenders[comparison.edges])
    assert 0 < np.count_nonzero(own) < len(own)
    # Sharp edges are full creases as well, and creases of vertices stay at these alone.
    own, blenders = comparison.pair("sharp_edge")
    creased = read(comparison.mesh, "crease_edge") == 1
    np.testing.assert_array_equal(own, blenders | creased)
    assert np.any(creased & ~blenders)
    own = read(comparison.mesh, "crease_vert")[:, 0]
    base = comparison.subdivided.base_vertices
    expected = read(comparison.base, "crease_vert")[:, 0]
    np.testing.assert_array_equal(own, np.where(base >= 0, expected[base], 0))
    assert own.max() > 0


def test_active_and_rendered_layers_materials_and_settings_stay(comparison: Comparison) -> None:
    mesh = comparison.mesh
    assert [layer.name for layer in mesh.uv_layers] == ["First", "Second"]
    assert mesh.uv_layers.active.name == "Second"
    assert [layer.active_render for layer in mesh.uv_layers] == [False, True]
    assert mesh.attributes.active_color_name == "CORNER BYTE_COLOR"
    assert mesh.attributes.default_color_name == "POINT FLOAT_COLOR"
    assert [material.name for material in mesh.materials] == ["Red", "Green", "Blue"]
    assert (mesh["custom"], mesh.use_mirror_x, mesh.remesh_voxel_size) == (12.5, True, 0.125)


@pytest.mark.parametrize("uv_smooth", UV_SMOOTH)
def test_uv_maps_are_smoothed_as_the_modifier_does(uv_smooth: str) -> None:
    """The modifier's UVs are those of the control mesh of its level; ours are the limits of the same surface."""
    comparison = compare(everything(), uv_smooth)
    for name in ("First", "Second"):
        own, blenders = comparison.pair(name)
        if uv_smooth == "NONE":
            np.testing.assert_allclose(own, blenders, atol=full_mesh.UV_ROUNDING, rtol=0)
            continue
        surface = face_varying_surface(comparison.control, read(comparison.base, name), uv_smooth)
        limits = uniform.refined_values(surface, surface.positions[:, :2], full_mesh.LEVEL, limit=True)
        np.testing.assert_allclose(own, limits, atol=full_mesh.UV_ROUNDING, rtol=0)
        assert np.abs(limits - blenders).max() > 1e-3


def test_freestyle_marks_stay() -> None:
    holder, name = scene.add_object(meshes.landscape(3, 3)), "use_freestyle_mark"
    # The last edge is marked, of which no edge inside a face may be taken to be a part.
    marks = np.arange(len(holder.data.edges))[::-1] % 3 == 0
    if hasattr(holder.data.edges[0], name):
        holder.data.edges.foreach_set(name, marks)
    else:
        write(holder.data, "freestyle_edge", "BOOLEAN", "EDGE", marks)
    comparison = compare(holder)
    edges, base = comparison.mesh.edges, comparison.subdivided.base_edges
    if hasattr(edges[0], name):
        found = np.array([getattr(edge, name) for edge in edges])
    else:
        found = read(comparison.mesh, "freestyle_edge")[:, 0]
    np.testing.assert_array_equal(found, (base >= 0) & marks[base])


@pytest.mark.parametrize("value", [np.nan, np.inf, 3e38])
def test_attributes_may_have_any_values(value: float) -> None:
    """They stay at their vertex or corner, and reach no further than the faces around.

    None of the warnings of numpy are printed, which pytest would take for errors.
    """
    types = ["FLOAT", "FLOAT2", "FLOAT_COLOR"]
    holder = scene.add_object(meshes.triangles_and_quads())
    for domain, count in (("POINT", len(holder.data.vertices)), ("CORNER", len(holder.data.loops))):
        place = np.arange(count) == 3
        write(holder.data, f"{domain} near", "FLOAT", domain, place)
        for data_type in types:
            values = np.where(place[:, None], value, np.zeros(full_mesh.VALUES[data_type][2]))
            write(holder.data, f"{domain} {data_type}", data_type, domain, values)
    [result] = subdivide(holder, tolerance=0.001)
    for domain in SPREAD:
        near = read(result.data, f"{domain} near")[:, 0]
        # Weights are linear along every edge: they are 1 at the place itself alone, where triangles may meet.
        at_place = np.flatnonzero(near == 1.0)
        if domain == "CORNER":
            at_place = np.unique([result.data.loops[corner].vertex_index for corner in at_place.tolist()])
        assert len(at_place) == 1
        far = ~touching(result.data, domain, near)
        assert far.any()
        for data_type in types:
            found = read(result.data, f"{domain} {data_type}")
            # Vertices that stay keep theirs. Corners are interpolated, where infinity times a weight of 0 is no number.
            if domain == "POINT" or np.isfinite(value):
                np.testing.assert_array_equal(found[near == 1.0], np.float32(value))
            else:
                assert not np.isfinite(found[near == 1.0]).any()
            assert np.isfinite(found[far]).all()


def touching(mesh: bpy.types.Mesh, domain: str, near: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which vertices or corners are in a face with a weight at one of its corners."""
    faces, vertices = faces_of_corners(mesh), read(mesh, ".corner_vert")[:, 0]
    weights = near[vertices] if domain == "POINT" else near
    corners = np.isin(faces, faces[weights > 0])
    return corners if domain == "CORNER" else np.isin(np.arange(len(mesh.vertices)), vertices[corners])


def test_vertex_groups_are_those_of_the_modifier(comparison: Comparison) -> None:
    holder = scene.add_mesh(comparison.mesh)
    assert [group.name for group in holder.vertex_groups] == ["All", "Some", "Zero", "Empty"]
    assert [group.lock_weight for group in holder.vertex_groups] == [False, True, False, False]
    assert holder.vertex_groups.active_index == 2
    own, blenders = full_mesh.weights_of(comparison.mesh), full_mesh.weights_of(comparison.blenders)
    assert 0 < sum(1 in weights for weights in own) < len(own)
    for number, weights in enumerate(own):
        expected = blenders[comparison.vertices[number]]
        for group in range(4):
            assert abs(weights.get(group, 0.0) - expected.get(group, 0.0)) <= full_mesh.ROUNDING
    # Blender before 5.2 leaves vertices between weights of zero out of a group, and since then it takes in vertices of
    # weight zero with nothing but members of the group across the face.
    members = [{group for group in weights if group != 2 and weights[group] > 0} for weights in own]
    assert members == [{group for group in weights if group != 2} for weights in own]
    assert 3 < sum(2 in weights for weights in own) < len(own)


def test_an_object_being_edited_is_not_in_the_way() -> None:
    holder = everything()
    with addon.edit_mode(scene.add_object(meshes.cube())):
        comparison = compare(holder)
    assert sum(0 in weights for weights in full_mesh.weights_of(comparison.mesh)) == len(comparison.mesh.vertices)


@pytest.mark.parametrize("deformable", [False, True])
def test_limit_normals_on_request(deformable: bool) -> None:
    holder = scene.add_object(meshes.creased_cube())
    holder.data.shade_smooth()
    holder.data.polygons[0].use_smooth = False
    if deformable:
        holder.vertex_groups.new(name="Group")
    comparison = compare(holder, exact_normals=True)
    mesh, subdivided = comparison.mesh, comparison.subdivided
    is_flat = subdivided.base_faces == 0
    np.testing.assert_array_equal([not polygon.use_smooth for polygon in mesh.polygons], is_flat)
    expected = limit_normals(comparison.control, subdivided.corner_points)
    # What is flat stays flat.
    own = scene.values_of(mesh.polygons, "normal", np.float32, 3)
    expected = np.where(np.repeat(is_flat, 4)[:, None], np.repeat(own, 4, axis=0), expected)
    found = scene.values_of(mesh.corner_normals, "vector", np.float32, 3)
    # As they are, or as angles in 16 bits: those are up to π, from normals that may be far off.
    free = bpy.app.version >= (4, 5) and not deformable
    np.testing.assert_allclose(found, expected, atol=full_mesh.ROUNDING if free else 1e-3, rtol=0)
    # Those that are as they are would not follow what groups move.
    assert bpy.app.version < (4, 5) or (mesh.attributes["custom_normal"].data_type == "FLOAT_VECTOR") == free
    by_vertex = np.zeros((len(mesh.vertices), 3))
    by_vertex[subdivided.corner_vertices] = expected
    assert np.abs(by_vertex[subdivided.corner_vertices] - expected).max() > 0.5


@pytest.mark.parametrize(("data_type", "domain"), [("FLOAT", "FACE"), ("BOOLEAN", "POINT")])
def test_exact_normals_mistake_nothing_else_for_flat_shading(data_type: str, domain: str) -> None:
    holder = scene.add_object(meshes.cube())
    attributes = holder.data.attributes
    if "sharp_face" in attributes:
        attributes.remove(attributes["sharp_face"])
    if attributes.new("sharp_face", data_type, domain) is None:
        pytest.skip("this Blender keeps the name for itself")
    [result] = subdivide(holder, tolerance=0.1, exact_normals=True)
    kept = result.data.attributes["sharp_face"]
    assert (kept.data_type, kept.domain) == (data_type, domain)
    assert result.data.has_custom_normals


@pytest.mark.every_blender
def test_meshes_shaded_flat_store_no_normals() -> None:
    holder = scene.add_object(meshes.cube())
    holder.data.shade_flat()
    [result] = subdivide(holder, tolerance=0.1, exact_normals=True)
    assert not result.data.has_custom_normals
    assert not any(polygon.use_smooth for polygon in result.data.polygons)


def test_the_new_mesh_is_sound(comparison: Comparison) -> None:
    mesh = comparison.mesh
    assert not mesh.validate(verbose=True)
    assert counts(mesh) == counts(comparison.blenders)
    # The matching itself: edges by their corners, both ways.
    np.testing.assert_array_equal(np.sort(comparison.vertices), np.arange(len(mesh.vertices)))
    np.testing.assert_array_equal(np.sort(comparison.edges), np.arange(len(mesh.edges)))
    assert len(bpy.data.objects) == 1


def test_hidden_and_selected_parts_stay_whole() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    mesh, selected = holder.data, [0, 1]
    vertices = {vertex for face in selected for vertex in mesh.polygons[face].vertices}
    for each in (*mesh.vertices, *mesh.edges, *mesh.polygons):
        each.select = vertices >= {*getattr(each, "vertices", [each.index])}
    for face in (5, 6):
        mesh.polygons[face].hide = True
    comparison = compare(holder)
    faces, new = comparison.subdivided.base_faces, comparison.mesh
    for name, chosen in ((".hide_poly", [5, 6]), (".select_poly", selected)):
        np.testing.assert_array_equal(read(new, name)[:, 0], np.isin(faces, chosen))
    of_selected = comparison.subdivided.corner_vertices.reshape(-1, 4)[np.isin(faces, selected)]
    np.testing.assert_array_equal(np.flatnonzero(read(new, ".select_vert")), np.unique(of_selected))


def test_results_of_ours_are_not_carried() -> None:
    holder = scene.add_suzanne()
    for name in ("First", "Second"):
        holder.data.attributes.new(name, "FLOAT_COLOR", "CORNER")
    holder.data.attributes.active_color_name = "Second"
    addon.compute(holder, tolerance=0.05)
    bpy.ops.ccdepth.bake_colors()
    assert holder.data.attributes.active_color_name == "ccdepth_color"
    mesh = compare(holder).mesh
    assert not any(attribute.name.startswith("ccdepth") for attribute in mesh.attributes)
    assert not mesh.ccdepth.has_result
    assert holder.data.ccdepth.has_result


def test_custom_properties_stay_where_modifiers_are_counted_in() -> None:
    holder = scene.add_object(meshes.cube())
    holder.data["number"], holder.data["text"], holder.data["list"] = 0.5, "words", [1.0, 2.0]
    holder.data["group"] = {"one": 1, "two": {"three": 3}}
    holder.data["object"] = holder
    holder.data.id_properties_ui("number").update(min=0.0, max=2.0, description="A number")
    holder.modifiers.new("Bevel", "BEVEL")
    [result] = subdivide(holder, tolerance=0.1)
    mesh = result.data
    assert (mesh["number"], mesh["text"], list(mesh["list"])) == (0.5, "words", [1.0, 2.0])
    assert mesh["group"].to_dict() == {"one": 1, "two": {"three": 3}}
    assert mesh["object"] == holder
    shown = mesh.id_properties_ui("number").as_dict()
    assert (shown["max"], shown["description"]) == (2.0, "A number")
