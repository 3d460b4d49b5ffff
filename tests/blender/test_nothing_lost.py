# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything a mesh carries is on its subdivision: by value, next to what Blender's own modifier makes there.

The subdivision is the uniform one at the modifier's level. Blender's vertices, edges, faces and corners are found again
by the number of their base face, and by parameters on its corners.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core.adaptive.subdivided_mesh import SubdividedMesh
from ccdepth_addon.core.attributes.face_varying import UV_SMOOTH, uv_surface
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import apply_boundary_rule
from ccdepth_addon.core.surface.limit_normals import limit_normals
from ccdepth_addon.core.surface.surface_points import interpolate_linearly
from tests import meshes, uniform
from tests.blender import addon, scene
from tests.blender.measuring import corner_parameters

LEVEL = 2
FACE_NUMBERS = "face_number"
PARAMETERS = "corner_parameters"

VALUES = {
    "FLOAT": ("value", np.float32, 1),
    "FLOAT2": ("vector", np.float32, 2),
    "FLOAT_VECTOR": ("vector", np.float32, 3),
    "FLOAT4": ("vector", np.float32, 4),
    "FLOAT_COLOR": ("color", np.float32, 4),
    "BYTE_COLOR": ("color_srgb", np.float32, 4),
    "QUATERNION": ("value", np.float32, 4),
    "FLOAT4X4": ("value", np.float32, 16),
    "BOOLEAN": ("value", np.bool_, 1),
    "INT": ("value", np.int32, 1),
    "INT8": ("value", np.int8, 1),
    "INT16_2D": ("value", np.int16, 2),
    "INT32_2D": ("value", np.int32, 2),
}
INTEGERS = {"INT", "INT8", "INT16_2D", "INT32_2D"}

# Parameters of size 2 at most in single precision, where points are a sixteenth apart and more.
SAME_POINT = 1e-5

# Blender interpolates in single precision: a handful of products and sums for each value, all of them of size 1 or so.
ROUNDING = 32 * float(np.finfo(np.float32).eps)
# It takes rotations apart and puts them together again by functions that lose more.
ROTATION_ROUNDING = 2e-6
# A level of UVs rounds weights, their products and sums; UVs are of size 4 at most.
UV_ROUNDING = 4 * 3 * LEVEL * float(np.finfo(np.float32).eps)
# Byte colours: one rounds, the other cuts off, by version.
BYTE = 1.001 / 255


def read(mesh: bpy.types.Mesh, name: str) -> NDArray:
    """(N, D) of an attribute."""
    attribute = mesh.attributes[name]
    value, dtype, width = VALUES[attribute.data_type]
    values = np.empty(len(attribute.data) * width, dtype=dtype)
    attribute.data.foreach_get(value, values)
    return values.reshape(-1, width)


def write(mesh: bpy.types.Mesh, name: str, data_type: str, domain: str, values: NDArray) -> None:
    value, dtype, _ = VALUES[data_type]
    attribute = mesh.attributes.new(name, data_type, domain)
    attribute.data.foreach_set(value, np.asarray(values, dtype=dtype).ravel())


def known_types() -> list[str]:
    present = bpy.types.Attribute.bl_rna.properties["data_type"].enum_items.keys()
    return [name for name in VALUES if name in present]


def random_values(data_type: str, count: int, rng: np.random.Generator) -> NDArray:
    width = VALUES[data_type][2]
    if data_type == "BOOLEAN":
        return rng.random(count) < 0.4
    if data_type in INTEGERS:
        return rng.integers(-100, 100, (count, width))
    if data_type == "QUATERNION":
        found = rng.normal(size=(count, 4))
        return found / np.linalg.norm(found, axis=1, keepdims=True)
    if data_type == "FLOAT4X4":
        return random_transformations(count, rng)
    return rng.uniform(0.0, 1.0, (count, width))


def random_transformations(count: int, rng: np.random.Generator) -> NDArray:
    """(count, 16) of a location, a rotation and a scale, column by column."""
    from mathutils import Matrix, Quaternion, Vector

    locations, rotations = rng.normal(size=(count, 3)), rng.normal(size=(count, 4))
    parts = zip(locations, rotations, rng.uniform(0.5, 2.0, (count, 3)), strict=True)
    made = [Matrix.LocRotScale(Vector(a), Quaternion(b).normalized(), Vector(c)) for a, b, c in parts]
    return np.array([np.array(matrix).T.ravel() for matrix in made])


def counts(mesh: bpy.types.Mesh) -> dict[str, int]:
    return {
        "POINT": len(mesh.vertices),
        "EDGE": len(mesh.edges),
        "FACE": len(mesh.polygons),
        "CORNER": len(mesh.loops),
    }


def everything(seed: int = 1) -> bpy.types.Object:
    """An object with all there is to lose.

    Two UV maps with seams, three materials, colour attributes, attributes of every type and domain, four vertex groups,
    three shape keys, creases and sharp edges.
    """
    rng = np.random.default_rng(seed)
    data = meshes.with_random_creases(meshes.triangles_and_quads(), seed=2, share=0.3)
    full = {tuple(edge): 1.0 for edge in data.edges[:2].tolist()}
    data = replace(data, edge_creases={**data.edge_creases, **full}, vertex_creases={0: 1.0, 5: 0.5})
    holder = scene.add_object(data, "Everything")
    mesh = holder.data
    numbers = counts(mesh)
    for domain, count in numbers.items():
        for data_type in known_types():
            if (data_type, domain) != ("FLOAT2", "CORNER"):
                write(mesh, f"{domain} {data_type}", data_type, domain, random_values(data_type, count, rng))
        for number, item in enumerate(mesh.attributes.new(f"{domain} STRING", "STRING", domain).data):
            item.value = f"text {number}".encode()
    for number, name in enumerate(("Red", "Green", "Blue")):
        mesh.materials.append(bpy.data.materials.new(name))
        mesh.polygons[number].material_index = number
    sharp = rng.random(numbers["EDGE"]) < 0.3
    write(mesh, "sharp_edge", "BOOLEAN", "EDGE", sharp & (read(mesh, "crease_edge")[:, 0] < 1))
    mesh.edges.foreach_set("use_seam", rng.random(numbers["EDGE"]) < 0.3)
    mesh.polygons.foreach_set("use_smooth", rng.random(numbers["FACE"]) < 0.5)
    add_uv_maps(mesh, rng)
    add_groups(holder, rng)
    add_keys(holder, rng)
    mesh["custom"] = 12.5
    mesh.use_mirror_x = True
    mesh.remesh_voxel_size = 0.125
    return holder


def add_uv_maps(mesh: bpy.types.Mesh, rng: np.random.Generator) -> None:
    vertices = read(mesh, ".corner_vert")[:, 0]
    faces = np.repeat(np.arange(len(mesh.polygons)), [polygon.loop_total for polygon in mesh.polygons])
    x, y, z = read(mesh, "position").T
    projected = np.stack([x + 0.3 * z, y + 0.2 * z], axis=1) / 4 + rng.uniform(0.0, 0.05, (len(x), 2))
    for number, name in enumerate(("First", "Second")):
        uvs = projected[vertices] + 1.5 * (faces % (2 + number) == 0)[:, None]
        mesh.uv_layers.new(name=name).uv.foreach_set("vector", uvs.astype(np.float32).ravel())
    mesh.uv_layers["Second"].active = True
    mesh.uv_layers["First"].active_render = True
    mesh.attributes.active_color_name = "CORNER BYTE_COLOR"
    mesh.attributes.default_color_name = "POINT FLOAT_COLOR"


def add_groups(holder: bpy.types.Object, rng: np.random.Generator) -> None:
    count = len(holder.data.vertices)
    for number, name in enumerate(("All", "Some", "Zero", "Empty")):
        group = holder.vertex_groups.new(name=name)
        for vertex in range(count if number == 0 else 3 if number in {1, 2} else 0):
            group.add([vertex], 0.0 if name == "Zero" else float(rng.random()), "REPLACE")
    holder.vertex_groups["Some"].lock_weight = True
    holder.vertex_groups.active_index = 2


def add_keys(holder: bpy.types.Object, rng: np.random.Generator) -> None:
    for name in ("Basis", "Wide", "Tall"):
        key = holder.shape_key_add(name=name, from_mix=False)
        if name != "Basis":
            points = np.zeros(3 * len(key.points), dtype=np.float32)
            key.points.foreach_get("co", points)
            key.points.foreach_set("co", points + rng.uniform(-0.5, 0.5, len(points)).astype(np.float32))
    keys = holder.data.shape_keys.key_blocks
    keys["Wide"].value, keys["Wide"].slider_max = 0.75, 2.0
    keys["Tall"].value, keys["Tall"].mute, keys["Tall"].vertex_group = 0.5, True, "All"
    keys["Tall"].relative_key = keys["Wide"]
    driver = holder.data.shape_keys.driver_add('key_blocks["Wide"].value').driver
    driver.expression = "0.75"


@dataclass(frozen=True)
class Carried:
    """A mesh, its uniform subdivision by the add-on, and what the modifier makes of it."""

    base: bpy.types.Mesh
    control: PolygonMesh
    subdivided: SubdividedMesh
    mesh: bpy.types.Mesh
    blenders: bpy.types.Mesh

    @cached_property
    def parameters(self) -> NDArray[np.float64]:
        """(C, 2) of the base's corners."""
        return np.concatenate([corner_parameters(size) for size in self.control.face_sizes.tolist()])

    @cached_property
    def faces(self) -> NDArray[np.intp]:
        """For every face of ours, Blender's: the one with the same base face and the same middle."""
        base = np.repeat(self.subdivided.base_faces, 4)
        own = np.column_stack([10.0 * base, self.own_parameters]).reshape(-1, 4, 3).mean(axis=1)
        base = np.repeat(read(self.blenders, FACE_NUMBERS)[:, 0], 4)
        blenders = np.column_stack([10.0 * base, read(self.blenders, PARAMETERS)[:, :2]]).reshape(-1, 4, 3).mean(axis=1)
        distances = np.linalg.norm(own[:, None] - blenders, axis=2)
        assert distances.min(axis=1).max() < SAME_POINT
        return np.argmin(distances, axis=1)

    @cached_property
    def own_parameters(self) -> NDArray[np.float64]:
        """(C, 2) the parameters of our corners."""
        return interpolate_linearly(self.control, self.parameters, self.subdivided.corner_points)

    @cached_property
    def corners(self) -> NDArray[np.intp]:
        """For every corner of ours, Blender's in the same face; both go round the same way."""
        own = self.own_parameters.reshape(-1, 4, 2)
        blenders = read(self.blenders, PARAMETERS)[:, :2].reshape(-1, 4, 2)[self.faces]
        turns = np.argmin(np.linalg.norm(blenders - own[:, :1], axis=2), axis=1)
        found = (4 * self.faces[:, None] + (turns[:, None] + np.arange(4)) % 4).ravel()
        points = read(self.blenders, PARAMETERS)[found, :2]
        np.testing.assert_allclose(points, own.reshape(-1, 2), atol=SAME_POINT)
        return found

    @cached_property
    def vertices(self) -> NDArray[np.intp]:
        found = np.empty(len(self.mesh.vertices), dtype=np.intp)
        found[self.subdivided.corner_vertices] = read(self.blenders, ".corner_vert")[self.corners, 0]
        return found

    @cached_property
    def edges(self) -> NDArray[np.intp]:
        found = np.empty(len(self.mesh.edges), dtype=np.intp)
        found[self.subdivided.corner_edges] = read(self.blenders, ".corner_edge")[self.corners, 0]
        return found

    def matching(self, domain: str) -> NDArray[np.intp]:
        return {"POINT": self.vertices, "EDGE": self.edges, "FACE": self.faces, "CORNER": self.corners}[domain]

    def pair(self, name: str) -> tuple[NDArray, NDArray]:
        """(N, D) of an attribute on our mesh, and Blender's values for the same elements."""
        domain = self.mesh.attributes[name].domain
        assert domain == self.base.attributes[name].domain
        return read(self.mesh, name), read(self.blenders, name)[self.matching(domain)]


def carry(holder: bpy.types.Object, uv_smooth: str = "PRESERVE_BOUNDARIES", *, exact_normals: bool = False) -> Carried:
    base = holder.data
    numbers = np.arange(len(base.polygons))
    write(base, FACE_NUMBERS, "INT", "FACE", numbers)
    parameters = np.concatenate([corner_parameters(polygon.loop_total) for polygon in base.polygons])
    flat = np.column_stack([parameters, np.zeros(len(parameters))])
    write(base, PARAMETERS, "FLOAT_VECTOR", "CORNER", flat)
    scene.add_subdivision(holder, LEVEL).uv_smooth = uv_smooth
    control = apply_boundary_rule(scene.polygon_mesh_of(base), smooth_corners=True)
    subdivided = uniform.uniform(control, LEVEL)
    module = addon.module("exchange.adaptive_mesh")
    mesh = module.new_mesh(base, control, subdivided, module.CarryOptions(uv_smooth, exact_normals))
    blenders = holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    return Carried(base, control, subdivided, mesh, blenders)


@pytest.fixture
def carried() -> Carried:
    return carry(everything())


def test_the_new_mesh_is_sound(carried: Carried) -> None:
    mesh = carried.mesh
    assert not mesh.validate(verbose=True)
    assert counts(mesh) == counts(carried.blenders)
    # The matching itself: edges by their corners, both ways.
    np.testing.assert_array_equal(np.sort(carried.vertices), np.arange(len(mesh.vertices)))
    np.testing.assert_array_equal(np.sort(carried.edges), np.arange(len(mesh.edges)))
    assert len(bpy.data.objects) == 1


def test_no_attribute_is_missing(carried: Carried) -> None:
    names = {attribute.name for attribute in carried.base.attributes} | {"sharp_edge"}
    assert {attribute.name for attribute in carried.mesh.attributes} >= names - {".select_vert", ".select_edge"}


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
@pytest.mark.parametrize("data_type", ["FLOAT", "FLOAT2", "FLOAT_VECTOR", "FLOAT_COLOR", "BYTE_COLOR", "FLOAT4"])
def test_floats_and_colours_are_interpolated_like_the_modifiers(carried: Carried, domain: str, data_type: str) -> None:
    if f"{domain} {data_type}" not in carried.base.attributes:
        pytest.skip("this version of Blender has no such attribute")
    own, blenders = carried.pair(f"{domain} {data_type}")
    np.testing.assert_allclose(own, blenders, atol=BYTE if data_type == "BYTE_COLOR" else ROUNDING, rtol=0)


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
def test_rotations_are_interpolated_as_the_modifier_does(carried: Carried, domain: str) -> None:
    own, blenders = carried.pair(f"{domain} QUATERNION")
    np.testing.assert_allclose(np.linalg.norm(own, axis=1), 1.0, atol=ROUNDING)
    signed = np.sign(np.sum(own * blenders, axis=1, keepdims=True)) * blenders
    # Since 5.2 the middle of a face that is no quad gets an average of another kind.
    compared = in_quads(carried, domain) if bpy.app.version >= (5, 2) else np.ones(len(own), dtype=bool)
    np.testing.assert_allclose(own[compared], signed[compared], atol=ROTATION_ROUNDING, rtol=0)


def in_quads(carried: Carried, domain: str) -> NDArray[np.bool_]:
    """Which vertices or corners of ours touch no base face but quads."""
    corners = np.repeat(carried.control.face_sizes[carried.subdivided.base_faces] == 4, 4)
    if domain == "CORNER":
        return corners
    touched = np.ones(len(carried.mesh.vertices), dtype=bool)
    touched[carried.subdivided.corner_vertices[~corners]] = False
    return touched


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
def test_locations_and_scales_are_interpolated_as_the_modifier_does(carried: Carried, domain: str) -> None:
    own, blenders = (matrices.reshape(-1, 4, 4) for matrices in carried.pair(f"{domain} FLOAT4X4"))
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
def test_a_boolean_is_true_where_the_modifier_has_it(carried: Carried, domain: str) -> None:
    own, blenders = carried.pair(f"{domain} BOOLEAN")
    np.testing.assert_array_equal(own, blenders)


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
def test_integers_are_those_of_the_nearest_vertex_or_corner(carried: Carried, domain: str) -> None:
    control, subdivided = carried.control, carried.subdivided
    points = subdivided.vertex_points if domain == "POINT" else subdivided.corner_points
    sources = control.corner_vertices[points.corners] if domain == "POINT" else points.corners
    staying = np.all(points.parameters == 0, axis=1)
    for data_type in sorted(INTEGERS & set(known_types())):
        own, blenders = carried.pair(f"{domain} {data_type}")
        np.testing.assert_array_equal(own, read(carried.base, f"{domain} {data_type}")[sources])
        # Elsewhere the modifier averages them or leaves zeros; where a vertex stays it agrees.
        if data_type == "INT" or domain == "POINT":
            np.testing.assert_array_equal(own[staying], blenders[staying])


@pytest.mark.parametrize("domain", ["EDGE", "FACE"])
def test_edges_and_faces_copy_every_type(carried: Carried, domain: str) -> None:
    inside = carried.subdivided.base_edges < 0 if domain == "EDGE" else np.zeros(len(carried.mesh.polygons), dtype=bool)
    for data_type in known_types():
        own, blenders = carried.pair(f"{domain} {data_type}")
        np.testing.assert_array_equal(own[~inside], blenders[~inside])
        # What new edges get differs by version for these: black or white, an identity or zeros.
        if data_type not in {"FLOAT_COLOR", "BYTE_COLOR", "FLOAT4X4"}:
            np.testing.assert_array_equal(own[inside], blenders[inside])


def test_texts_are_copied(carried: Carried) -> None:
    sources = {
        "POINT": carried.control.corner_vertices[carried.subdivided.vertex_points.corners],
        "EDGE": carried.subdivided.base_edges,
        "FACE": carried.subdivided.base_faces,
        "CORNER": carried.subdivided.corner_points.corners,
    }
    for domain, numbers in sources.items():
        texts = [item.value for item in carried.mesh.attributes[f"{domain} STRING"].data]
        assert texts == [f"text {number}".encode() if number >= 0 else b"" for number in numbers]


@pytest.mark.parametrize("name", ["crease_edge", "material_index", "sharp_face"])
def test_built_in_values_are_those_of_the_modifier(carried: Carried, name: str) -> None:
    own, blenders = carried.pair(name)
    np.testing.assert_array_equal(own, blenders)
    assert len(np.unique(own)) > 1


def test_seams_are_those_of_the_modifier(carried: Carried) -> None:
    own, blenders = (np.empty(len(carried.mesh.edges), dtype=bool) for _ in range(2))
    carried.mesh.edges.foreach_get("use_seam", own)
    carried.blenders.edges.foreach_get("use_seam", blenders)
    np.testing.assert_array_equal(own, blenders[carried.edges])
    assert 0 < np.count_nonzero(own) < len(own)


def test_sharp_edges_are_those_of_the_modifier_and_full_creases(carried: Carried) -> None:
    own, blenders = carried.pair("sharp_edge")
    creased = read(carried.mesh, "crease_edge") == 1
    np.testing.assert_array_equal(own, blenders | creased)
    assert np.any(creased & ~blenders)


def test_vertex_creases_stay_at_their_vertices(carried: Carried) -> None:
    own = read(carried.mesh, "crease_vert")[:, 0]
    base = carried.subdivided.base_vertices
    expected = read(carried.base, "crease_vert")[:, 0]
    np.testing.assert_array_equal(own, np.where(base >= 0, expected[base], 0))
    assert own.max() > 0


def test_materials_and_settings_stay(carried: Carried) -> None:
    assert [material.name for material in carried.mesh.materials] == ["Red", "Green", "Blue"]
    assert carried.mesh["custom"] == 12.5
    assert carried.mesh.use_mirror_x
    assert carried.mesh.remesh_voxel_size == 0.125


def test_active_and_rendered_layers_stay(carried: Carried) -> None:
    mesh = carried.mesh
    assert [layer.name for layer in mesh.uv_layers] == ["First", "Second"]
    assert mesh.uv_layers.active.name == "Second"
    assert [layer.active_render for layer in mesh.uv_layers] == [True, False]
    assert mesh.attributes.active_color_name == "CORNER BYTE_COLOR"
    assert mesh.attributes.default_color_name == "POINT FLOAT_COLOR"


@pytest.mark.parametrize("uv_smooth", UV_SMOOTH)
def test_uv_maps_are_smoothed_as_the_modifier_does(uv_smooth: str) -> None:
    """The modifier's UVs are those of the control mesh of its level; ours are the limits of the same surface."""
    carried = carry(everything(), uv_smooth)
    for name in ("First", "Second"):
        own, blenders = carried.pair(name)
        if uv_smooth == "NONE":
            np.testing.assert_allclose(own, blenders, atol=UV_ROUNDING, rtol=0)
            continue
        surface = uv_surface(carried.control, read(carried.base, name), uv_smooth)
        flat = surface.positions[:, :2]
        np.testing.assert_allclose(
            uniform.refined_values(surface, flat, LEVEL, limit=False), blenders, atol=UV_ROUNDING, rtol=0
        )
        limits = uniform.refined_values(surface, flat, LEVEL, limit=True)
        np.testing.assert_allclose(own, limits, atol=UV_ROUNDING, rtol=0)
        assert np.abs(limits - blenders).max() > 1e-3


def weights_of(mesh: bpy.types.Mesh) -> list[dict[int, float]]:
    return [{entry.group: entry.weight for entry in vertex.groups} for vertex in mesh.vertices]


def test_vertex_groups_are_those_of_the_modifier(carried: Carried) -> None:
    holder = scene.add_mesh(carried.mesh)
    assert [group.name for group in holder.vertex_groups] == ["All", "Some", "Zero", "Empty"]
    assert [group.lock_weight for group in holder.vertex_groups] == [False, True, False, False]
    assert holder.vertex_groups.active_index == 2
    own, blenders = weights_of(carried.mesh), weights_of(carried.blenders)
    assert 0 < sum(1 in weights for weights in own) < len(own)
    for number, weights in enumerate(own):
        expected = blenders[carried.vertices[number]]
        for group in range(4):
            assert weights.get(group, 0.0) == pytest.approx(expected.get(group, 0.0), abs=ROUNDING)
    # Blender before 5.2 leaves vertices between weights of zero out of a group, and since then it takes in vertices of
    # weight zero with nothing but members of the group across the face.
    members = [{group for group in weights if group != 2 and weights[group] > 0} for weights in own]
    assert members == [{group for group in weights if group != 2} for weights in own]
    assert 3 < sum(2 in weights for weights in own) < len(own)


def test_an_object_being_edited_is_not_in_the_way() -> None:
    holder = everything()
    with addon.edit_mode(scene.add_object(meshes.cube())):
        carried = carry(holder)
    assert sum(0 in weights for weights in weights_of(carried.mesh)) == len(carried.mesh.vertices)


def test_shape_keys_stay_with_their_settings(carried: Carried) -> None:
    old, new = carried.base.shape_keys, carried.mesh.shape_keys
    assert new != old
    assert [key.name for key in new.key_blocks] == ["Basis", "Wide", "Tall"]
    for one, other in zip(old.key_blocks, new.key_blocks, strict=True):
        for name in ("value", "slider_min", "slider_max", "mute", "vertex_group", "interpolation"):
            assert getattr(one, name) == getattr(other, name)
        assert one.relative_key.name == other.relative_key.name
    assert [driver.data_path for driver in new.animation_data.drivers] == ['key_blocks["Wide"].value']


def test_every_key_is_the_limit_surface_of_that_key(carried: Carried) -> None:
    for key in carried.base.shape_keys.key_blocks:
        points = np.zeros(3 * len(key.points), dtype=np.float32)
        key.points.foreach_get("co", points)
        limits = uniform.fine_values(carried.control, points.reshape(-1, 3).astype(np.float64), LEVEL, limit=True)
        found = np.zeros(3 * len(carried.mesh.vertices), dtype=np.float32)
        carried.mesh.shape_keys.key_blocks[key.name].points.foreach_get("co", found)
        np.testing.assert_allclose(found.reshape(-1, 3), limits, atol=ROUNDING, rtol=0)


def test_keys_mix_to_the_surface_of_the_mixed_mesh() -> None:
    holder = everything()
    keys = holder.data.shape_keys.key_blocks
    # A vertex group weighs a key by vertex; its weights are not the surface's.
    keys["Tall"].vertex_group, keys["Tall"].mute = "", False
    carried = carry(holder)
    result = scene.add_mesh(carried.mesh)
    holder.modifiers.clear()
    mixed, expected = (scene.evaluated_mesh_data(one).positions for one in (result, holder))
    limits = uniform.fine_values(carried.control, expected, LEVEL, limit=True)
    np.testing.assert_allclose(mixed, limits, atol=2 * ROUNDING, rtol=0)


def test_the_animation_of_keys_stays() -> None:
    holder = everything()
    keys = holder.data.shape_keys
    keys.key_blocks["Tall"].keyframe_insert("value", frame=3)
    action = keys.animation_data.action
    track = keys.animation_data.nla_tracks.new()
    strip = track.strips.new("Strip", 20, action)
    strip.repeat, strip.blend_type, track.mute = 2.0, "ADD", True
    new = carry(holder).mesh.shape_keys.animation_data
    assert new.action == action
    if hasattr(new, "action_slot"):
        assert new.action_slot == keys.animation_data.action_slot
    copied = new.nla_tracks[0].strips[0]
    assert new.nla_tracks[0].mute
    for name in ("name", "action", "frame_start", "frame_end", "repeat", "blend_type"):
        assert getattr(copied, name) == getattr(strip, name)


def test_freestyle_marks_stay() -> None:
    holder = scene.add_object(meshes.landscape(3, 3))
    mesh = holder.data
    edges = [edge.index % 3 == 0 for edge in mesh.edges]
    if hasattr(mesh.edges[0], "use_freestyle_mark"):
        mesh.edges.foreach_set("use_freestyle_mark", edges)
    else:
        write(mesh, "freestyle_edge", "BOOLEAN", "EDGE", np.array(edges))
    carried = carry(holder)
    if hasattr(mesh.edges[0], "use_freestyle_mark"):
        found = np.empty(len(carried.mesh.edges), dtype=bool)
        carried.mesh.edges.foreach_get("use_freestyle_mark", found)
    else:
        found = read(carried.mesh, "freestyle_edge")[:, 0]
    base = carried.subdivided.base_edges
    np.testing.assert_array_equal(found, (base >= 0) & np.array(edges)[base])


def test_absolute_keys_keep_their_frames() -> None:
    holder = everything()
    keys = holder.data.shape_keys
    keys.use_relative = False
    addon.select(holder)
    bpy.ops.object.shape_key_retime()
    frames = [key.frame for key in keys.key_blocks]
    keys.eval_time = 14.0
    new = carry(holder).mesh.shape_keys
    assert not new.use_relative
    assert new.eval_time == 14.0
    assert [key.frame for key in new.key_blocks] == pytest.approx(frames)


def test_hidden_and_selected_parts_stay_whole() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    mesh = holder.data
    for polygon in mesh.polygons:
        polygon.hide = polygon.index in {5, 6}
        polygon.select = polygon.index in {0, 1}
    flush(mesh, "select", {0, 1})
    carried = carry(holder)
    faces = carried.subdivided.base_faces
    new = carried.mesh
    for name, chosen in ((".hide", {5, 6}), (".select", {0, 1})):
        expected = np.isin(faces, sorted(chosen))
        np.testing.assert_array_equal(read(new, f"{name}_poly")[:, 0], expected)
    selected = read(new, ".select_vert")[:, 0]
    of_selected = carried.subdivided.corner_vertices.reshape(-1, 4)[np.isin(faces, [0, 1])]
    np.testing.assert_array_equal(np.flatnonzero(selected), np.unique(of_selected))


def flush(mesh: bpy.types.Mesh, flag: str, faces: set[int]) -> None:
    """Select the vertices and edges of these faces alone."""
    corners = [corner for face in faces for corner in mesh.polygons[face].loop_indices]
    vertices, edges = {mesh.loops[c].vertex_index for c in corners}, {mesh.loops[c].edge_index for c in corners}
    for items, chosen in ((mesh.vertices, vertices), (mesh.edges, edges)):
        for item in items:
            setattr(item, flag, item.index in chosen)


def corner_normals(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    normals = np.empty(3 * len(mesh.loops), dtype=np.float32)
    mesh.corner_normals.foreach_get("vector", normals)
    return normals.reshape(-1, 3)


def test_custom_normals_are_left_out() -> None:
    holder = scene.add_object(meshes.creased_cube())
    holder.data.normals_split_custom_set([(0.6, 0.0, 0.8)] * len(holder.data.loops))
    assert not carry(holder).mesh.has_custom_normals


@pytest.mark.parametrize("deformable", [False, True])
def test_limit_normals_on_request(deformable: bool) -> None:
    holder = scene.add_object(meshes.creased_cube())
    holder.data.polygons[0].use_smooth = False
    if deformable:
        holder.vertex_groups.new(name="Group")
    carried = carry(holder, exact_normals=True)
    expected = limit_normals(carried.control, carried.subdivided.corner_points)
    # As they are, or as angles in 16 bits: those are up to π, from normals that may be far off.
    free = bpy.app.version >= (4, 5) and not deformable
    tolerance = ROUNDING if free else 1e-3
    np.testing.assert_allclose(corner_normals(carried.mesh), expected, atol=tolerance, rtol=0)
    by_vertex = np.zeros((len(carried.mesh.vertices), 3))
    by_vertex[carried.subdivided.corner_vertices] = expected
    assert np.abs(by_vertex[carried.subdivided.corner_vertices] - expected).max() > 0.5


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
    mesh = carry(holder).mesh
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
