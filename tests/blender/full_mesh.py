# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh with everything there is to lose, and its subdivision next to what Blender's own modifier makes of it.

The subdivision is the uniform one at the modifier's level. Blender's vertices, edges, faces and corners are found again
by the number of their base face, and by parameters on its corners.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import bpy
import numpy as np
from numpy.typing import NDArray

from ccdepth_addon.core import PolygonMesh, SubdividedMesh
from ccdepth_addon.core.surface.surface_points import interpolate_linearly
from tests import meshes, uniform
from tests.blender import addon, scene
from tests.blender.measuring import corner_parameters
from tests.blender.scene import VALUES, read, write

LEVEL = 2
FACE_NUMBERS = "face_number"
PARAMETERS = "corner_parameters"

DOMAINS = ["POINT", "EDGE", "FACE", "CORNER"]
INTEGERS = {"INT", "INT8", "INT16_2D", "INT32_2D"}

# Parameters of size 2 at most in single precision, where points are a sixteenth apart and more.
SAME_POINT = 1e-5

# Blender interpolates in single precision: a handful of products and sums for each value, all of them of size 1 or so.
ROUNDING = 32 * float(np.finfo(np.float32).eps)
# A level of UVs rounds weights, their products and sums; UVs are of size 4 at most.
UV_ROUNDING = 4 * 3 * LEVEL * float(np.finfo(np.float32).eps)
# Byte colours: one rounds, the other cuts off, by version.
BYTE = 1.001 / 255


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
    return dict(zip(DOMAINS, map(len, (mesh.vertices, mesh.edges, mesh.polygons, mesh.loops)), strict=True))


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


def faces_of_corners(mesh: bpy.types.Mesh) -> NDArray[np.intp]:
    """(C,): the face of each corner."""
    return np.repeat(np.arange(len(mesh.polygons)), [polygon.loop_total for polygon in mesh.polygons])


def add_uv_maps(mesh: bpy.types.Mesh, rng: np.random.Generator) -> None:
    vertices, faces = read(mesh, ".corner_vert")[:, 0], faces_of_corners(mesh)
    x, y, z = read(mesh, "position").T
    projected = np.stack([x + 0.3 * z, y + 0.2 * z], axis=1) / 4 + rng.uniform(0.0, 0.05, (len(x), 2))
    for number, name in enumerate(("First", "Second")):
        uvs = projected[vertices] + 1.5 * (faces % (2 + number) == 0)[:, None]
        mesh.uv_layers.new(name=name).uv.foreach_set("vector", uvs.astype(np.float32).ravel())
    mesh.uv_layers["Second"].active = True
    mesh.uv_layers["Second"].active_render = True
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
    points = read(holder.data, "position").ravel()
    for name in ("Wide", "Tall"):
        moved = points + rng.uniform(-0.5, 0.5, len(points)).astype(np.float32)
        scene.add_key(holder, name).points.foreach_set("co", moved)
    keys = holder.data.shape_keys.key_blocks
    keys["Wide"].value, keys["Wide"].slider_max = 0.75, 2.0
    keys["Tall"].slider_max, keys["Tall"].slider_min = 3.0, 1.25
    keys["Tall"].value, keys["Tall"].mute, keys["Tall"].vertex_group = 1.5, True, "All"
    keys["Tall"].relative_key = keys["Wide"]
    driver = holder.data.shape_keys.driver_add('key_blocks["Wide"].value').driver
    driver.expression = "0.75"


@dataclass(frozen=True)
class Comparison:
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


def with_own_points(subdivided: SubdividedMesh) -> SubdividedMesh:
    """The mesh with points of the installed add-on's class, which takes those of no other."""
    own = addon.module("core.surface.surface_points").SurfacePoints
    finders = {name: getattr(subdivided, name) for name in ("find_vertex_points", "find_corner_points")}
    return replace(subdivided, **{name: lambda find=find: own(**vars(find())) for name, find in finders.items()})


def compare(
    holder: bpy.types.Object, uv_smooth: str = "PRESERVE_BOUNDARIES", *, exact_normals: bool = False
) -> Comparison:
    base = holder.data
    numbers = np.arange(len(base.polygons))
    write(base, FACE_NUMBERS, "INT", "FACE", numbers)
    parameters = np.concatenate([corner_parameters(polygon.loop_total) for polygon in base.polygons])
    flat = np.column_stack([parameters, np.zeros(len(parameters))])
    write(base, PARAMETERS, "FLOAT_VECTOR", "CORNER", flat)
    scene.add_subdivision(holder, LEVEL).uv_smooth = uv_smooth
    control = scene.polygon_mesh_of(base)
    subdivided = uniform.uniform(control, LEVEL)
    module = addon.module("exchange.adaptive_mesh")
    own = with_own_points(subdivided)
    mesh = module.new_mesh(base, control, own, uv_smooth=uv_smooth, exact_normals=exact_normals)
    blenders = holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    return Comparison(base, control, subdivided, mesh, blenders)


def weights_of(mesh: bpy.types.Mesh) -> list[dict[int, float]]:
    return [{entry.group: entry.weight for entry in vertex.groups} for vertex in mesh.vertices]
