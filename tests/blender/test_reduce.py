# SPDX-License-Identifier: GPL-3.0-or-later
"""Reduce: the fewest triangles, within the tolerance both ways, with all lines where they were.

The guarantee is checked without anything of the add-on's: the surface is that of Blender's own Subdivision Surface
modifier, Use Limit Surface on at the highest Quality, and distances are found by Blender's BVH trees.
"""

from collections.abc import Callable
from itertools import product

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.named_meshes import NAMED
from tests.blender.subdividing import faces, refused, shape, subdivide
from tests.blender.test_adaptive_guarantee import nearest, points_of_triangles, some
from tests.blender.test_measure_guarantee import Shown, limit_surface, shown
from tests.thorough import cases, each

# The level of the modifier that stands for the surface, by the tolerance; its most quads, and the most points of it and
# triangles of the result that are measured.
LEVELS, MOST_QUADS, MOST_POINTS, MOST_TRIANGLES = {1e-2: 5, 1e-3: 6}, 100_000, 10_000, 1_500

# The facets of that level are nearer to the surface than this part of the tolerance: a level takes three quarters off
# what the one before is off, and where that is not so, at poles, the facets are small. Along creases the surface bends
# so sharply that it takes a level more.
FACETS = 0.05


def bevelled(kind: str) -> meshes.MeshData:
    """The primitives as people model them."""
    if kind == "cube":
        bpy.ops.mesh.primitive_cube_add(size=2)
    else:
        bpy.ops.mesh.primitive_cylinder_add(vertices=16)
    added = bpy.context.object
    bevel = added.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments = 0.1, 2
    bevel.limit_method = "NONE" if kind == "cube" else "ANGLE"
    scene.add_subdivision(added, 1)
    data = scene.evaluated_mesh_data(added)
    bpy.data.meshes.remove(added.data)
    return data


def surface_of(original: bpy.types.Object, relative: float) -> Shown:
    """The limit surface of an object in the scene, as fine as ``MOST_QUADS`` allow."""
    level = LEVELS[relative] + ("crease_edge" in original.data.attributes)
    while len(original.data.polygons) * 4**level > MOST_QUADS:
        level -= 1
    return limit_surface(original, level)


CASES: dict[str, Callable[[], meshes.MeshData]] = {
    "bevelled cube": lambda: bevelled("cube"),
    "bevelled cylinder": lambda: bevelled("cylinder"),
    "Suzanne": scene.suzanne,
    "cube": meshes.cube,
    "landscape with boundary": lambda: meshes.landscape(4, 3),
    "plane": lambda: meshes.grid(6, 5),
    "triangles": lambda: meshes.bumpy(meshes.sphere(6, 2), 0.05),
    "torus": lambda: meshes.torus(6, 4),
    "valence 12": NAMED["valence 12"],
    "not manifold": meshes.three_faces_on_an_edge,
    "Möbius strip": meshes.mobius_strip,
    "creases": meshes.creased_cube,
}


# A part of the meshes with the larger tolerance; and a result that uses the smaller one up to single precision.
LONG = {"Suzanne", "bevelled cylinder", "torus", "valence 12", "Möbius strip"}
SHORT = [*((name, 1e-2) for name in CASES if name not in LONG), ("landscape with boundary", 1e-3)]

# Decimate and triangulation are another version's elsewhere: there these are measured as well.
EVERYWHERE = {("bevelled cube", 1e-2), ("landscape with boundary", 1e-2), ("triangles", 1e-2)}


@pytest.mark.parametrize(("name", "relative"), cases(product(CASES, LEVELS), SHORT, EVERYWHERE))
def test_results_are_within_the_tolerance_both_ways(name: str, relative: float) -> None:
    original = scene.add_object(CASES[name]())
    if name in ("torus", "Suzanne"):
        original.scale, original.rotation_euler = (1.0, 2.0, 0.5), (0.3, 0.2, 0.1)
    (result,) = subdivide(original, tolerance=relative, tolerance_mode="RELATIVE", reduce=True)
    tolerance = result.data.ccdepth.world_tolerance
    bounds = addon.bounds(result)
    assert bounds.max() <= tolerance * (1 + 1e-6)  # Stored in single precision, rounded up.
    surface, drawn = surface_of(original, relative), shown(result)
    points = surface.positions[some(len(surface.positions), MOST_POINTS)]
    assert nearest(drawn.tree(), points)[0].max() <= tolerance
    chosen = some(len(drawn.triangles), MOST_TRIANGLES)
    # Its corners may lie off the surface, unlike those of an adaptive mesh.
    corners = drawn.positions[drawn.triangles[chosen]]
    samples = np.concatenate([corners, points_of_triangles(corners)], axis=1)
    back = nearest(surface.tree(), samples.reshape(-1, 3))[0].reshape(len(chosen), -1).max(axis=1)
    assert back.max() <= (1 + FACETS) * tolerance
    if len(drawn.triangles) == faces(result):
        # A triangle's bound is that of its own points; points of the surface may count for a triangle beside.
        assert np.all(back <= bounds[chosen] + FACETS * tolerance)


def with_uvs(kind: str) -> bpy.types.Object:
    """An object of a primitive, each side of which is an island of its UV map."""
    original = scene.add_object(bevelled(kind))
    original.data.uv_layers.new(name="UVMap")
    with addon.edit_mode(original):
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.uv.cube_project()
    return original


@pytest.mark.parametrize(("kind", "tolerance"), [("cylinder", 1.8e-2), ("cylinder", 4e-2), ("cube", 2e-2)])
def test_uvs_are_those_of_their_own_island(kind: str, tolerance: float) -> None:
    """The map has half the size of the mesh. Between islands it is six times as large and more."""
    (result,) = subdivide(with_uvs(kind), tolerance=tolerance, tolerance_mode="RELATIVE", reduce=True)
    sides = [values - np.roll(values, 1, axis=1) for values in (
        scene.read(result.data, "UVMap").reshape(-1, 3, 2), shape(result)[scene.triangles_of(result.data)],
    )]  # fmt: skip
    flat, real = (np.linalg.norm(each, axis=2) for each in sides)
    # Merged faces are not quite in the plane of the map.
    assert np.all(flat <= 0.5 * 1.1 * real)


PRIMITIVES = [(name, has_uvs) for name in ("cube", "cylinder") for has_uvs in (True, False)]


@pytest.mark.parametrize("primitive", each(PRIMITIVES, short=[("cube", True)]))
def test_bevelled_primitives_get_few_triangles(primitive: tuple[str, bool]) -> None:
    name, has_uvs = primitive
    most = {"cube": 630, "cylinder": 1330}[name]
    original = with_uvs(name) if has_uvs else scene.add_object(bevelled(name))
    (result,) = subdivide(original, tolerance=1e-3, tolerance_mode="RELATIVE", reduce=True)
    # The borders of UV islands stay, which takes up to a tenth more.
    assert faces(result) <= (1.1 * most if has_uvs else most)
    # The mesh of the cube without Reduce has few triangles too: with these borders up to three in four of them stay.
    assert faces(result) <= 0.75 * result.data.ccdepth.unreduced_triangles


# Vertices are stored in single precision after a way there and back; the tolerance is for lines as well.
SLACK = 0.03


def dented_grid() -> bpy.types.Object:
    """A grid in the xy plane with a dent in its middle, two materials, and two UV islands that are its own x and y."""
    original = scene.add_object(meshes.grid(12, 12))
    mesh = original.data
    for vertex in mesh.vertices:
        x, y, _ = vertex.co
        vertex.co.z = -np.exp(-((x - 6) ** 2 + (y - 6) ** 2) / 8)
    uvs = mesh.uv_layers.new(name="Map").uv
    for face in mesh.polygons:
        right = face.center.x > 5
        face.material_index = int(right)
        for loop in face.loop_indices:
            x, y, _ = mesh.vertices[mesh.loops[loop].vertex_index].co
            uvs[loop].vector = (x + 20 * right, y)
    for name in ("Left", "Right"):
        mesh.materials.append(bpy.data.materials.new(name))
    for edge in mesh.edges:
        ends = [mesh.vertices[vertex].co for vertex in edge.vertices]
        if all(end.x == 5 for end in ends):
            edge.use_seam = True
        if all(end.y == 4 for end in ends):
            edge.use_edge_sharp = True
    return original


@pytest.mark.every_blender
def test_lines_and_everything_else_of_the_mesh_are_there() -> None:
    original = dented_grid()
    mesh = original.data
    mesh["note"] = 3
    mesh.color_attributes.new("Color", "BYTE_COLOR", "CORNER")
    for name, place in (("Left", 0.0), ("Half", 6.0)):
        group = original.vertex_groups.new(name=name)
        group.add([vertex.index for vertex in mesh.vertices if vertex.co.x > place], 0.5, "REPLACE")
    original.vertex_groups["Half"].lock_weight = True
    before = snapshot.take()
    (result,) = subdivide(original, tolerance=SLACK, reduce=True)
    new = {path[1:3] for path in snapshot.take().keys() - before if path[0] == "blocks"}
    assert new == {("objects", result.name), ("meshes", result.data.name)}
    assert faces(result) < result.data.ccdepth.unreduced_triangles
    assert_lines_are_where_they_were(result)
    mesh = result.data
    assert result.vertex_groups.keys() == ["Left", "Half"]
    assert result.vertex_groups["Half"].lock_weight
    weights = [entry.weight for vertex in mesh.vertices for entry in vertex.groups]
    assert 0 < max(weights) <= 0.5
    assert mesh["note"] == 3
    assert mesh.attributes.active_color_name == "Color"
    assert mesh.uv_layers.active.name == "Map"
    known = {*addon.ATTRIBUTES, "custom_normal", *original.data.attributes.keys()}
    assert {name for name in mesh.attributes.keys() if not name.startswith(".")} <= known  # noqa: SIM118
    assert addon.depths(result).max() == mesh.ccdepth.deepest
    found = uvs_off(result)
    bpy.data.objects.remove(result)
    (plain,) = subdivide(original, tolerance=SLACK)
    # The surface has its own corners, which UVs do not follow. Beyond that, a vertex is within the tolerance of where
    # its UVs are from.
    assert found.max() <= uvs_off(plain).max() + SLACK
    assert np.median(found) < SLACK


def assert_lines_are_where_they_were(result: bpy.types.Object) -> None:
    mesh = result.data
    assert not mesh.validate(verbose=True)
    assert [material.name for material in mesh.materials] == ["Left", "Right"]
    corners = scene.triangles_of(mesh)
    assert len(corners) == faces(result)
    x = shape(result)[:, 0]
    for face, triangle in zip(mesh.polygons, corners, strict=True):
        if face.material_index:
            assert x[triangle].min() > 5 - SLACK
        else:
            assert x[triangle].max() < 5 + SLACK
    for mark, axis, place in (("use_seam", 0, 5), ("use_edge_sharp", 1, 4)):
        marked = [edge for edge in mesh.edges if getattr(edge, mark)]
        ends = np.array([[mesh.vertices[vertex].co for vertex in edge.vertices] for edge in marked])
        assert np.all(np.abs(ends[:, :, axis] - place) < SLACK)
        length = np.linalg.norm((ends[:, 1] - ends[:, 0])[:, :2], axis=1).sum()
        # From border to border; the corners of the grid are rounded, its sides are straight.
        assert abs(length - 12) < 0.05


def uvs_off(holder: bpy.types.Object) -> np.ndarray:
    """(C,): how far UVs are from the places of their corners, in the plane."""
    mesh = holder.data
    right = np.repeat([face.material_index for face in mesh.polygons], [face.loop_total for face in mesh.polygons])
    places = shape(holder)[scene.read(mesh, ".corner_vert")[:, 0], :2] + np.stack([20.0 * right, 0.0 * right], axis=1)
    return np.linalg.norm(scene.read(mesh, "Map") - places, axis=1)


@pytest.mark.every_blender
@pytest.mark.parametrize("has_groups", [False, True])
def test_exact_normals_are_those_of_the_surface(has_groups: bool) -> None:
    original = scene.add_object(meshes.cube())
    original.data.shade_smooth()
    if has_groups:
        original.vertex_groups.new(name="Group").add([0], 1.0, "REPLACE")
    (result,) = subdivide(original, reduce=True, exact_normals=True)
    mesh = result.data
    assert mesh.has_custom_normals
    normals = scene.values_of(mesh.corner_normals, "vector", np.float32, 3)
    flat = scene.values_of(mesh.polygons, "normal", np.float32, 3)
    cosines = (normals * np.repeat(flat, 3, axis=0)).sum(axis=1)
    # The faces are within a hundredth of a surface whose radii are about one; needles may tilt, as their vertices need
    # not lie on it.
    positions, triangles = shape(result), scene.triangles_of(mesh)
    sides = positions[triangles] - positions[np.roll(triangles, -1, axis=1)]
    heights = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / np.linalg.norm(sides, axis=2).max(axis=1)
    is_wide = np.repeat(heights > 5 * mesh.ccdepth.world_tolerance, 3)
    assert np.mean(is_wide) > 0.9
    assert cosines[is_wide].min() > 0.9
    assert cosines.min() > 0


@pytest.mark.every_blender
def test_loose_parts_stay() -> None:
    data = bevelled("cube")
    original = scene.add_object(data)
    mesh = original.data
    mesh.vertices.add(2)
    mesh.vertices[-1].co = (float("nan"), 0.0, 0.0)
    mesh.vertices[-2].co = (9.0, 9.0, 9.0)
    (result,) = subdivide(original, reduce=True)
    assert len(result.data.vertices) - len(np.unique(scene.triangles_of(result.data))) == 2
    assert faces(result) < result.data.ccdepth.unreduced_triangles


def pyramid(corners: int) -> meshes.MeshData:
    around = np.arange(corners) * (2 * np.pi / corners)
    base = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    sides = [[i, (i + 1) % corners, corners] for i in range(corners)]
    return meshes.from_faces([*base, [0.1, 0.2, 0.8]], [list(range(corners))[::-1], *sides])


def cube_with_a_vertex_in_an_edge() -> meshes.MeshData:
    """Two pentagons share the vertex, and no other face does."""
    cube = meshes.cube()
    others = [face for face in cube.faces if not {0, 1} <= set(face)]
    return meshes.from_faces([*cube.positions, [-1, -1, 0]], [[0, 8, 1, 3, 2], [0, 4, 5, 1, 8], *others])


@pytest.mark.parametrize(
    ("data", "tolerance"), [(pyramid(3), 1.0), (pyramid(4), 1.0), (cube_with_a_vertex_in_an_edge(), 0.35)]
)
def test_small_closed_meshes_stay_closed(data: meshes.MeshData, tolerance: float) -> None:
    """Neither do they collapse to a doubled triangle, nor is one of two triangles lost."""
    original = scene.add_object(data)
    (result,) = subdivide(original, tolerance=tolerance, reduce=True)
    assert not result.data.validate()
    triangles = scene.triangles_of(result.data)
    edges = np.sort(np.stack([triangles, np.roll(triangles, 1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2)


def test_several_objects_and_shared_meshes() -> None:
    one = scene.add_object(meshes.cube(), "One")
    other = scene.add_mesh(one.data)
    other.scale = (0.5, 0.5, 0.5)
    third = scene.add_object(CASES["triangles"](), "Third")
    results = subdivide(one, other, third, reduce=True)
    assert len(results) == 3
    assert len({result.data.name for result in results}) == 2
    for result in results:
        assert result.data.ccdepth.unreduced_triangles > 0
        assert addon.bounds(result).max() <= result.data.ccdepth.world_tolerance * (1 + 1e-6)


@pytest.mark.every_blender
@pytest.mark.parametrize("editing", [False, True])
def test_in_place_in_both_modes_with_the_scenes_setting(editing: bool) -> None:
    original = scene.add_object(bevelled("cube"))
    bpy.context.scene.ccdepth.reduce = True
    with addon.edit_mode(original, editing=editing):
        settings = {"tolerance": 0.01, "tolerance_mode": "ABSOLUTE", "output": "IN_PLACE"}
        assert bpy.ops.ccdepth.subdivide(**settings) == {"FINISHED"}
        assert original.mode == ("EDIT" if editing else "OBJECT")
    record = original.data.ccdepth
    assert record.unreduced_triangles > record.faces == faces(original)
    assert not addon.module("state.out_of_date").is_stale(original.data)


def test_where_nothing_is_gained_the_adaptive_mesh_is_made() -> None:
    original = scene.add_object(meshes.grid(1, 1))
    (plain,) = subdivide(original, tolerance=0.2)
    (result,) = subdivide(original, tolerance=0.2, reduce=True)
    assert faces(result) == faces(plain)
    assert result.data.ccdepth.unreduced_triangles == 0
    assert {*bpy.data.meshes} == {original.data, plain.data, result.data}


@pytest.mark.every_blender
def test_shape_keys_are_refused_unless_modifiers_are_applied_with_them() -> None:
    original = scene.add_object(bevelled("cube"))
    scene.add_key(original)
    refused(original, reduce=True, match="cannot keep its shape keys")
    original.modifiers.new("Displace", "DISPLACE").strength = 0.0
    (result,) = subdivide(original, reduce=True)
    assert result.data.shape_keys is None
    assert result.data.ccdepth.unreduced_triangles > 0


def test_the_face_limit_counts_before_reducing() -> None:
    original = scene.add_object(bevelled("cube"))
    (plain,) = subdivide(original)
    most = faces(plain)
    original.hide_set(False)
    refused(original, reduce=True, max_faces=most - 1, match=f"{most - 1} are allowed")
    (result,) = subdivide(original, reduce=True, max_faces=most)
    assert faces(result) <= most
    # Reduce begins with more faces than the tolerance takes.
    (result,) = subdivide(original, reduce=True, max_faces=4 * most)
    assert faces(result) < result.data.ccdepth.unreduced_triangles == len(scene.triangles_of(plain.data))
