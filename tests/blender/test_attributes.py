# SPDX-License-Identifier: GPL-3.0-or-later
"""Every attribute of a mesh is on its subdivision: by value, next to what Blender's own modifier makes there."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core.attributes.face_varying import UV_SMOOTH, face_varying_surface
from tests import meshes, uniform
from tests.blender import addon, scene
from tests.blender.full_mesh import (
    BYTE,
    INTEGERS,
    LEVEL,
    ROTATION_ROUNDING,
    ROUNDING,
    UV_ROUNDING,
    VALUES,
    Comparison,
    compare,
    everything,
    known_types,
    random_transformations,
    random_values,
    read,
    write,
)
from tests.blender.subdividing import subdivide


def test_no_attribute_is_missing(comparison: Comparison) -> None:
    names = {attribute.name for attribute in comparison.base.attributes} | {"sharp_edge"}
    assert {attribute.name for attribute in comparison.mesh.attributes} >= names - {".select_vert", ".select_edge"}


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
@pytest.mark.parametrize("data_type", ["FLOAT", "FLOAT2", "FLOAT_VECTOR", "FLOAT_COLOR", "BYTE_COLOR", "FLOAT4"])
def test_floats_and_colours_are_interpolated_like_the_modifiers(
    comparison: Comparison, domain: str, data_type: str
) -> None:
    if f"{domain} {data_type}" not in comparison.base.attributes:
        pytest.skip("this version of Blender has no such attribute")
    own, blenders = comparison.pair(f"{domain} {data_type}")
    np.testing.assert_allclose(own, blenders, atol=BYTE if data_type == "BYTE_COLOR" else ROUNDING, rtol=0)


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
def test_rotations_are_interpolated_as_the_modifier_does(comparison: Comparison, domain: str) -> None:
    own, blenders = comparison.pair(f"{domain} QUATERNION")
    np.testing.assert_allclose(np.linalg.norm(own, axis=1), 1.0, atol=ROUNDING)
    signed = np.sign(np.sum(own * blenders, axis=1, keepdims=True)) * blenders
    # Since 5.2 the middle of a face that is no quad gets an average of another kind.
    compared = in_quads(comparison, domain) if bpy.app.version >= (5, 2) else np.ones(len(own), dtype=bool)
    np.testing.assert_allclose(own[compared], signed[compared], atol=ROTATION_ROUNDING, rtol=0)


def in_quads(comparison: Comparison, domain: str) -> NDArray[np.bool_]:
    """Which vertices or corners of ours touch no base face but quads."""
    corners = np.repeat(comparison.control.face_sizes[comparison.subdivided.base_faces] == 4, 4)
    if domain == "CORNER":
        return corners
    touched = np.ones(len(comparison.mesh.vertices), dtype=bool)
    touched[comparison.subdivided.corner_vertices[~corners]] = False
    return touched


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
def test_locations_and_scales_are_interpolated_as_the_modifier_does(comparison: Comparison, domain: str) -> None:
    own, blenders = (matrices.reshape(-1, 4, 4) for matrices in comparison.pair(f"{domain} FLOAT4X4"))
    if np.all(blenders[own[:, 3, 0] != blenders[:, 3, 0]] == np.eye(4)):
        pytest.skip("the modifier of this version makes identities of transformations")
    np.testing.assert_allclose(own[:, 3], blenders[:, 3], atol=ROUNDING, rtol=0)
    # Its way to average rotations is another one; both keep them free of shear.
    scales, blender_scales = (np.linalg.norm(matrices[:, :3, :3], axis=2) for matrices in (own, blenders))
    np.testing.assert_allclose(scales, blender_scales, atol=ROTATION_ROUNDING, rtol=0)


def test_rotations_in_transformations_are_interpolated_like_rotations() -> None:
    values = addon.module("core.attributes.interpolation")
    rng = np.random.default_rng(3)
    matrices = random_transformations(200, rng)
    parts = values.split_transformations(matrices)
    np.testing.assert_allclose(values.join_transformations(parts), matrices, atol=1e-6)
    quaternions = random_values("QUATERNION", 200, rng)
    again = values.to_quaternions(values.to_rotation_vectors(quaternions))
    np.testing.assert_allclose(again, quaternions, atol=1e-12)


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
def test_a_boolean_is_true_where_the_modifier_has_it(comparison: Comparison, domain: str) -> None:
    own, blenders = comparison.pair(f"{domain} BOOLEAN")
    np.testing.assert_array_equal(own, blenders)


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
def test_integers_are_those_of_the_nearest_vertex_or_corner(comparison: Comparison, domain: str) -> None:
    control, subdivided = comparison.control, comparison.subdivided
    points = subdivided.vertex_points if domain == "POINT" else subdivided.corner_points
    sources = control.corner_vertices[points.corners] if domain == "POINT" else points.corners
    staying = np.all(points.parameters == 0, axis=1)
    for data_type in sorted(INTEGERS & set(known_types())):
        own, blenders = comparison.pair(f"{domain} {data_type}")
        np.testing.assert_array_equal(own, read(comparison.base, f"{domain} {data_type}")[sources])
        # Elsewhere the modifier averages them or leaves zeros; where a vertex stays it agrees.
        if data_type == "INT" or domain == "POINT":
            np.testing.assert_array_equal(own[staying], blenders[staying])


@pytest.mark.parametrize("domain", ["EDGE", "FACE"])
def test_edges_and_faces_copy_every_type(comparison: Comparison, domain: str) -> None:
    inside = (
        comparison.subdivided.base_edges < 0
        if domain == "EDGE"
        else np.zeros(len(comparison.mesh.polygons), dtype=bool)
    )
    for data_type in known_types():
        own, blenders = comparison.pair(f"{domain} {data_type}")
        np.testing.assert_array_equal(own[~inside], blenders[~inside])
        # What new edges get differs by version for these: black or white, an identity or zeros.
        if data_type not in {"FLOAT_COLOR", "BYTE_COLOR", "FLOAT4X4"}:
            np.testing.assert_array_equal(own[inside], blenders[inside])


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


@pytest.mark.parametrize("name", ["crease_edge", "material_index", "sharp_face"])
def test_built_in_values_are_those_of_the_modifier(comparison: Comparison, name: str) -> None:
    own, blenders = comparison.pair(name)
    np.testing.assert_array_equal(own, blenders)
    assert len(np.unique(own)) > 1


def test_seams_are_those_of_the_modifier(comparison: Comparison) -> None:
    own, blenders = (np.empty(len(comparison.mesh.edges), dtype=bool) for _ in range(2))
    comparison.mesh.edges.foreach_get("use_seam", own)
    comparison.blenders.edges.foreach_get("use_seam", blenders)
    np.testing.assert_array_equal(own, blenders[comparison.edges])
    assert 0 < np.count_nonzero(own) < len(own)


def test_sharp_edges_are_those_of_the_modifier_and_full_creases(comparison: Comparison) -> None:
    own, blenders = comparison.pair("sharp_edge")
    creased = read(comparison.mesh, "crease_edge") == 1
    np.testing.assert_array_equal(own, blenders | creased)
    assert np.any(creased & ~blenders)


def test_vertex_creases_stay_at_their_vertices(comparison: Comparison) -> None:
    own = read(comparison.mesh, "crease_vert")[:, 0]
    base = comparison.subdivided.base_vertices
    expected = read(comparison.base, "crease_vert")[:, 0]
    np.testing.assert_array_equal(own, np.where(base >= 0, expected[base], 0))
    assert own.max() > 0


def test_active_and_rendered_layers_stay(comparison: Comparison) -> None:
    mesh = comparison.mesh
    assert [layer.name for layer in mesh.uv_layers] == ["First", "Second"]
    assert mesh.uv_layers.active.name == "Second"
    assert [layer.active_render for layer in mesh.uv_layers] == [True, False]
    assert mesh.attributes.active_color_name == "CORNER BYTE_COLOR"
    assert mesh.attributes.default_color_name == "POINT FLOAT_COLOR"


@pytest.mark.parametrize("uv_smooth", UV_SMOOTH)
def test_uv_maps_are_smoothed_as_the_modifier_does(uv_smooth: str) -> None:
    """The modifier's UVs are those of the control mesh of its level; ours are the limits of the same surface."""
    comparison = compare(everything(), uv_smooth)
    for name in ("First", "Second"):
        own, blenders = comparison.pair(name)
        if uv_smooth == "NONE":
            np.testing.assert_allclose(own, blenders, atol=UV_ROUNDING, rtol=0)
            continue
        surface = face_varying_surface(comparison.control, read(comparison.base, name), uv_smooth)
        flat = surface.positions[:, :2]
        np.testing.assert_allclose(
            uniform.refined_values(surface, flat, LEVEL, limit=False), blenders, atol=UV_ROUNDING, rtol=0
        )
        limits = uniform.refined_values(surface, flat, LEVEL, limit=True)
        np.testing.assert_allclose(own, limits, atol=UV_ROUNDING, rtol=0)
        assert np.abs(limits - blenders).max() > 1e-3


def test_freestyle_marks_stay() -> None:
    holder = scene.add_object(meshes.landscape(3, 3))
    mesh = holder.data
    edges = [edge.index % 3 == 0 for edge in mesh.edges]
    if hasattr(mesh.edges[0], "use_freestyle_mark"):
        mesh.edges.foreach_set("use_freestyle_mark", edges)
    else:
        write(mesh, "freestyle_edge", "BOOLEAN", "EDGE", np.array(edges))
    comparison = compare(holder)
    if hasattr(mesh.edges[0], "use_freestyle_mark"):
        found = np.empty(len(comparison.mesh.edges), dtype=bool)
        comparison.mesh.edges.foreach_get("use_freestyle_mark", found)
    else:
        found = read(comparison.mesh, "freestyle_edge")[:, 0]
    base = comparison.subdivided.base_edges
    np.testing.assert_array_equal(found, (base >= 0) & np.array(edges)[base])


@pytest.mark.parametrize("value", [np.nan, np.inf, 3e38])
@pytest.mark.parametrize("data_type", ["FLOAT", "FLOAT2", "FLOAT_COLOR", "QUATERNION", "FLOAT4X4"])
def test_attributes_may_have_any_values(data_type: str, value: float) -> None:
    """They stay at their vertex or corner, and reach no further than the faces around.

    None of the warnings of numpy are printed, which pytest would take for errors.
    """
    holder = scene.add_suzanne()
    width = VALUES[data_type][2]
    for domain, count in (("POINT", len(holder.data.vertices)), ("CORNER", len(holder.data.loops))):
        values, near = np.zeros((count, width)), np.zeros(count)
        values[3], near[3] = value, 1.0
        write(holder.data, f"{domain} {data_type}", data_type, domain, values)
        write(holder.data, f"{domain} near", "FLOAT", domain, near)
    [result] = subdivide(holder)
    for domain in ("POINT", "CORNER"):
        found, near = read(result.data, f"{domain} {data_type}"), read(result.data, f"{domain} near")[:, 0]
        # Weights are linear along every edge: they are 1 at the place itself alone.
        assert np.count_nonzero(near == 1.0) == 1
        # Vertices that stay keep theirs. Corners are interpolated, where infinity times a weight of 0 is no number;
        # rotations and transformations are taken apart for it and come back as something else.
        if domain == "POINT" or (np.isfinite(value) and data_type not in {"QUATERNION", "FLOAT4X4"}):
            np.testing.assert_array_equal(found[near == 1.0], np.float32(value))
        elif data_type not in {"QUATERNION", "FLOAT4X4"}:
            assert not np.isfinite(found[near == 1.0]).any()
        assert np.isfinite(found[~touching(result.data, domain, near)]).all()


def touching(mesh: bpy.types.Mesh, domain: str, near: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which vertices or corners are in a face with a weight at one of its corners."""
    faces = np.repeat(np.arange(len(mesh.polygons)), [polygon.loop_total for polygon in mesh.polygons])
    vertices = read(mesh, ".corner_vert")[:, 0]
    weights = near[vertices] if domain == "POINT" else near
    corners = np.isin(faces, faces[weights > 0])
    if domain == "CORNER":
        return corners
    found = np.zeros(len(mesh.vertices), dtype=bool)
    found[vertices[corners]] = True
    return found
