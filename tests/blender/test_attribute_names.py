# SPDX-License-Identifier: GPL-3.0-or-later
"""Attributes may have any name that Blender lets them have, on any domain and of any type.

Those named like Blender's own mean to us what they mean to its Subdivision Surface modifier: it reads creases from
attributes of any kind, and even from vertex groups. Those named like ours are the user's unless they are of our kind.
"""

from itertools import product

import bpy
import numpy as np
import pytest

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from tests import meshes
from tests.blender import addon, scene
from tests.blender.full_mesh import DOMAINS, VALUES, counts, known_types, random_values, read
from tests.blender.subdividing import refused, refuses, subdivide
from tests.thorough import each

pytestmark = pytest.mark.every_blender

TOLERANCE = 0.5

# Names that stand for something in Blender, or here, some of them for a while.
NAMES = [
    "crease_vert", "crease_edge", "custom_normal", "uv_seam", ".select_vert", ".select_poly", ".hide_edge",
    ".hide_poly", "sharp_edge", "sharp_face", "material_index", "freestyle_edge", ".sculpt_face_set",
    "ccdepth_origin_0", "ccdepth_weights_0",
]  # fmt: skip
# Those that Blender's own modifiers do not take for something else.
NAMES_BEHIND_MODIFIERS = ["crease_vert", "crease_edge", "ccdepth_origin_0", "custom_normal"]
CREASES = {"crease_vert": "POINT", "crease_edge": "EDGE"}


def uneven() -> bpy.types.Object:
    """A grid of 3 × 3 quads, one of them divided into triangles, not in a plane."""
    data = meshes.grid(3, 3)
    positions = data.positions.copy()
    positions[:, 2] = np.arange(len(positions)) * 7 % 5 * 0.3
    *quads, [a, b, c, d] = data.corner_vertices.reshape(-1, 4).tolist()
    return scene.add_object(meshes.from_faces(positions.tolist(), [*quads, [a, b, c], [a, c, d]]), "Mesh")


def add(holder: bpy.types.Object, name: str, data_type: str, domain: str) -> list | None:
    """The values of a new attribute; None where Blender allows none of the kind."""
    if name in holder.data.attributes:
        holder.data.attributes.remove(holder.data.attributes[name])
    attribute = holder.data.attributes.new(name, data_type, domain)
    if attribute is None or attribute.name != name:
        return None
    if data_type == "STRING":
        attribute.data[0].value = b"text"
        return values_of(holder, name)
    value, dtype, _ = VALUES[data_type]
    values = random_values(data_type, counts(holder.data)[domain], np.random.default_rng(5))
    if name in CREASES and np.issubdtype(dtype, np.integer):
        values = values % 2
    attribute.data.foreach_set(value, np.ascontiguousarray(values, dtype=dtype).ravel())
    return values_of(holder, name)


def values_of(holder: bpy.types.Object, name: str) -> list:
    attribute = holder.data.attributes[name]
    if attribute.data_type == "STRING":
        return [item.value for item in attribute.data]
    return read(holder.data, name).tolist()


def read_arrays(holder: bpy.types.Object, *, use_modifiers: bool = False) -> PolygonMesh:
    module = addon.module("exchange.control_mesh")
    return module.read_alone(bpy.context, holder, use_modifiers=use_modifiers).topology.arrays


TURNS = list(product(range(len(DOMAINS)), (False, True)))


@pytest.mark.parametrize("case", each(TURNS, short=[(0, False), (1, True)]))
def test_every_kind_of_attribute_is_carried_over(case: tuple[int, bool]) -> None:
    """All names are on one mesh, of types and domains that differ. They change until each name has had each type, and
    in all turns each kind."""
    (turn, modifiers), types = case, [*known_types(), "STRING"]
    for first in range(len(types)):
        scene.clear()
        holder = uneven()
        kinds = {
            name: (types[(first + number) % len(types)], DOMAINS[(turn + first + number) % len(DOMAINS)])
            for number, name in enumerate(NAMES_BEHIND_MODIFIERS if modifiers else NAMES)
        }
        held = {name: values for name, chosen in kinds.items() if (values := add(holder, name, *chosen)) is not None}
        if modifiers:
            holder.modifiers.new("Triangulate", "TRIANGULATE")
            addon.compute(holder, tolerance=TOLERANCE)
        # Attributes of the name of exact normals would be refused.
        [result] = subdivide(holder, tolerance=TOLERANCE, shading_angle=0.0)
        for name, values in held.items():
            assert values_of(holder, name) == values
            if is_kept_to_itself(name, *kinds[name]):
                continue
            made = result.data.attributes[name]
            assert (made.data_type, made.domain) == kinds[name], name
            if kinds[name][1] == "POINT":
                # The control mesh's vertices come first, and keep their values.
                assert values_of(result, name)[: len(values)] == values, (name, kinds[name])
            elif kinds[name][0] == "STRING":
                assert b"text" in values_of(result, name)
        others = {name for name in result.data.attributes.keys() if name.startswith("ccdepth_")}  # noqa: SIM118
        assert others <= {*held, *addon.ATTRIBUTES}


@pytest.mark.parametrize("domain", DOMAINS)
def test_an_attribute_with_the_name_of_exact_normals_gets_another(domain: str) -> None:
    holder = uneven()
    holder.data.shade_smooth()
    if add(holder, "custom_normal", "FLOAT", domain) is None:
        pytest.skip("this Blender keeps the name for itself")
    kept = scene.read(holder.data, "custom_normal")
    [result] = subdivide(holder, tolerance=TOLERANCE, exact_normals=True)
    assert result.data.has_custom_normals
    made = result.data.attributes["custom_normal_0"]
    assert (made.data_type, made.domain) == ("FLOAT", domain)
    assert kept[0] in scene.read(result.data, "custom_normal_0")


def is_kept_to_itself(name: str, data_type: str, domain: str) -> bool:
    """What belongs to the coarse faces: custom normals, and parts that are hidden or selected, by their own rules."""
    if name == "custom_normal":
        free = data_type == "FLOAT_VECTOR" and bpy.app.version >= (4, 5)
        return free or (data_type, domain) == ("INT16_2D", "CORNER")
    kinds = {"vert": "POINT", "edge": "EDGE", "poly": "FACE"}
    flag, _, element = name.rpartition("_")
    return flag in {".select", ".hide"} and (data_type, kinds[element]) == ("BOOLEAN", domain)


def modified(holder: bpy.types.Object) -> np.ndarray:
    """(3V,): the vertices of Blender's own subdivision."""
    modifier = scene.add_subdivision(holder, 2)
    positions = scene.evaluated_mesh_data(holder).positions
    holder.modifiers.remove(modifier)
    return positions


def with_creases_of(arrays: PolygonMesh) -> bpy.types.Object:
    """The grid with the creases that were read, as Blender itself stores them."""
    copy = uneven()
    for name, sharpness in (("crease_edge", arrays.edge_sharpness), ("crease_vert", arrays.vertex_sharpness)):
        creases = np.where(np.isinf(sharpness), 1.0, np.sqrt(np.minimum(sharpness, 10.0) / 10.0))
        copy.data.attributes.new(name, "FLOAT", CREASES[name]).data.foreach_set("value", creases.astype(np.float32))
    return copy


# A crease goes through a square root here and a square there: single precision, on a mesh of size 3.
SAME_SURFACE = 2e-6


@pytest.mark.parametrize("domain", DOMAINS)
@pytest.mark.parametrize("name", CREASES)
def test_creases_of_every_kind_are_those_of_the_modifier(name: str, domain: str) -> None:
    """In Object Mode and in Edit Mode; behind modifiers as well."""
    plain = modified(uneven())
    effects = 0
    for data_type in known_types():
        scene.clear()
        holder = uneven()
        add(holder, name, data_type, domain)
        expected = modified(holder)
        names = {item.name_full for item in bpy.data.user_map()}
        found = read_arrays(holder)
        with addon.edit_mode(holder):
            edited = read_arrays(holder)
        assert {item.name_full for item in bpy.data.user_map()} == names
        holder.modifiers.new("Weld", "WELD").merge_threshold = 0.0
        holder.shape_key_add(name="Basis")
        evaluated = read_arrays(holder, use_modifiers=True)
        for other in (edited, evaluated):
            np.testing.assert_array_equal(other.edge_sharpness, found.edge_sharpness, err_msg=data_type)
            np.testing.assert_array_equal(other.vertex_sharpness, found.vertex_sharpness, err_msg=data_type)
        copy = with_creases_of(found)
        np.testing.assert_allclose(modified(copy), expected, atol=SAME_SURFACE, rtol=0, err_msg=data_type)
        effects += not np.allclose(expected, plain, atol=1e-3)
    assert effects >= 5


@pytest.mark.parametrize("name", CREASES)
def test_vertex_groups_that_the_modifier_takes_for_creases_are_refused(name: str) -> None:
    holder = uneven()
    plain = modified(holder)
    holder.vertex_groups.new(name=name).add([0, 1, 5, 6], 1.0, "REPLACE")
    assert not np.allclose(modified(holder), plain, atol=1e-3)
    message = f"Mesh: .*vertex group called “{name}”.*rename it"
    refused(holder, match=message)
    for operator in ("compute", "count_faces"):
        refuses(operator, message, tolerance=TOLERANCE)
    scene.add_subdivision(holder, 1).use_creases = False
    [result] = subdivide(holder, tolerance=TOLERANCE)
    assert [group.name for group in result.vertex_groups] == [name]


@pytest.mark.parametrize("modifier", [False, True])
def test_groups_may_have_the_names_of_attributes_and_those_that_are_used_for_a_while(modifier: bool) -> None:
    holder = uneven()
    holder.data.uv_layers.new(name="UVMap")
    holder.data.attributes.active = holder.data.attributes.new("Paint", "FLOAT_COLOR", "CORNER")
    names = ["UVMap", "Paint", "sharp_face", "ccdepth_origin_0", "ccdepth_origin_1", "ccdepth_weights_0", "Other"]
    for name in names:
        holder.vertex_groups.new(name=name).add([0, 1, 5], 0.5, "REPLACE")
    if modifier:
        holder.modifiers.new("Triangulate", "TRIANGULATE")
    addon.compute(holder, tolerance=TOLERANCE)
    [result] = subdivide(holder, tolerance=TOLERANCE)
    assert [group.name for group in result.vertex_groups] == names
    assert {"UVMap", "Paint"} <= {*result.data.attributes.keys()}
    assert modifier or result.data.attributes.active.name == "Paint"
    assert [round(entry.weight, 5) for entry in result.data.vertices[0].groups] == [0.5] * len(names)
    assert not any("ccdepth_origin" in other or "weights" in other for other in result.data.attributes.keys())  # noqa: SIM118


# Each differs from ours by its type or by its domain alone.
OTHERS = [("ccdepth", "FLOAT", "FACE"), ("ccdepth_bound", "FLOAT", "POINT"), ("ccdepth_color", "BYTE_COLOR", "CORNER")]


@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("editing", [False, True])
def test_attributes_that_have_taken_our_names_are_named_and_kept(other: tuple[str, str, str], editing: bool) -> None:
    """Where they come before a result it is refused; those that come after are not taken for ours."""
    holder = uneven()
    addon.compute(holder, tolerance=TOLERANCE)
    bpy.ops.ccdepth.bake_colors()
    holder.data.attributes.remove(holder.data.attributes[other[0]])
    values = add(holder, *other)
    with addon.edit_mode(holder, editing=editing):
        holder.update_tag()
        addon.examine_touched()
        for operator in (bpy.ops.ccdepth.select, bpy.ops.ccdepth.set_levels):
            if operator.poll():
                operator()
        assert bpy.ops.ccdepth.clear() == {"FINISHED"}
        for name in ("compute", "subdivide"):
            refuses(name, f"Mesh: .*called “{other[0]}”; rename it first", tolerance=TOLERANCE)
    assert values_of(holder, other[0]) == values
    assert [name for name, *_ in OTHERS if name in holder.data.attributes] == [other[0]]
