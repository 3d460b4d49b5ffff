# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender objects for tests, made and read through bpy.data alone, without the add-on's own reading code."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule, crease_to_sharpness
from tests.meshes import MeshData

# By type: what collections hand out, its dtype, and how many numbers each item has.
VALUES: dict[str, tuple[str, type, int]] = {
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


def clear() -> None:
    """Remove every object and mesh of the file."""
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes])


def open_again(folder: Path) -> None:
    """Save the file and open it, in a folder."""
    path = str(folder / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=True)


def link(path: Path, name: str, kind: str = "objects") -> bpy.types.ID:
    """A data-block of another file, linked."""
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        setattr(wanted, kind, [name])
    return getattr(wanted, kind)[0]


def add_object(data: MeshData, name: str = "Mesh") -> bpy.types.Object:
    """A mesh object of it in the scene, at the origin, with creases, and with its loose edges."""
    mesh = bpy.data.meshes.new(name)
    edges = [tuple(edge) for edge in data.edges.tolist()] + data.loose_edges
    mesh.from_pydata(data.positions.tolist(), edges, data.faces)
    if data.edge_creases:
        by_ends = {tuple(sorted(ends)): crease for ends, crease in data.edge_creases.items()}
        creases = [by_ends.get(tuple(sorted(edge.vertices)), 0.0) for edge in mesh.edges]
        mesh.attributes.new("crease_edge", "FLOAT", "EDGE").data.foreach_set("value", creases)
    if data.vertex_creases:
        creases = [data.vertex_creases.get(vertex, 0.0) for vertex in range(len(data.positions))]
        mesh.attributes.new("crease_vert", "FLOAT", "POINT").data.foreach_set("value", creases)
    return add_mesh(mesh)


def add_suzanne() -> bpy.types.Object:
    import bmesh  # The bpy wheel has it only after bpy, which a sorted list of imports would put second.

    mesh = bpy.data.meshes.new("Suzanne")
    shape = bmesh.new()
    bmesh.ops.create_monkey(shape)
    shape.to_mesh(mesh)
    shape.free()
    return add_mesh(mesh)


def suzanne() -> MeshData:
    """Her positions and faces; nothing is left in the scene."""
    added = add_suzanne()
    data = mesh_data(added.data)
    bpy.data.meshes.remove(added.data)
    return data


def icosphere(subdivisions: int) -> MeshData:
    """Positions and triangles; nothing is left in the scene."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=subdivisions, radius=1)
    added = bpy.context.object
    data = mesh_data(added.data)
    bpy.data.meshes.remove(added.data)
    return data


def add_mesh(mesh: bpy.types.Mesh) -> bpy.types.Object:
    return add(mesh.name, mesh)


def add(name: str, data: bpy.types.ID | None = None) -> bpy.types.Object:
    """An object of any type, an empty one without data."""
    blender_object = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(blender_object)
    return blender_object


def add_light() -> bpy.types.Object:
    return add("Light", bpy.data.lights.new("Light", "POINT"))


def add_collection(name: str, *objects: bpy.types.Object, alone: bool = False) -> bpy.types.Collection:
    """A new collection in the scene with these objects in it; alone: no longer in the scene's own."""
    collection, root = bpy.data.collections.new(name), bpy.context.scene.collection
    root.children.link(collection)
    for each in objects:
        collection.objects.link(each)
        if alone:
            root.objects.unlink(each)
    return collection


def node_tree(*kinds: str) -> bpy.types.NodeTree:
    """A group in which geometry goes through nodes of these kinds, which stand between its input and its output."""
    tree = bpy.data.node_groups.new("Group", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    chain = [tree.nodes.new(kind) for kind in ("NodeGroupInput", *kinds, "NodeGroupOutput")]
    for one, other in pairwise(chain):
        tree.links.new(one.outputs[0], other.inputs[0])
    return tree


def add_rig(name: str = "Bone") -> bpy.types.Object:
    """An armature with one bone."""
    rig = add("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    rig.data.edit_bones.new(name).tail = (0.0, 0.0, 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    return rig


def add_subdivision(blender_object: bpy.types.Object, levels: int, boundary: str = "ALL") -> bpy.types.Modifier:
    """A Subdivision Surface modifier that leaves vertices on the control mesh of its level."""
    modifier = blender_object.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = levels
    modifier.use_limit_surface = False
    modifier.boundary_smooth = boundary
    return modifier


def values_of(items: Any, name: str, dtype: type, width: int = 1) -> NDArray:
    """(N, D): a property of every item of a collection."""
    values = np.zeros(len(items) * width, dtype=dtype)
    if len(items):
        items.foreach_get(name, values)
    return values.reshape(-1, width)


def read(mesh: bpy.types.Mesh, name: str) -> NDArray:
    """(N, D): the values of an attribute."""
    attribute = mesh.attributes[name]
    return values_of(attribute.data, *VALUES[attribute.data_type])


def write(mesh: bpy.types.Mesh, name: str, data_type: str, domain: str, values: NDArray) -> None:
    value, dtype, _ = VALUES[data_type]
    attribute = mesh.attributes.new(name, data_type, domain)
    attribute.data.foreach_set(value, np.asarray(values, dtype=dtype).ravel())


def animate(owner: bpy.types.bpy_struct, name: str, values: dict[int, Any]) -> None:
    """Key a setting, with the values by their frames."""
    for frame, value in values.items():
        setattr(owner, name, value)
        owner.keyframe_insert(name, frame=frame)


def selected_faces(holder: bpy.types.Object) -> list[int]:
    return [face.index for face in holder.data.polygons if face.select]


def put_nowhere(holder: bpy.types.Object, coordinate: int, value: float = float("nan")) -> None:
    """Set one of all coordinates, of every vertex three; Blender's own access makes the largest number of infinity."""
    positions = read(holder.data, "position")
    positions.flat[coordinate] = value
    holder.data.attributes["position"].data.foreach_set("vector", positions.ravel())


def add_key(holder: bpy.types.Object, name: str = "Key", value: float = 0.0) -> bpy.types.ShapeKey:
    """A shape key, mixed in so far; the first one after a basis."""
    if holder.data.shape_keys is None:
        holder.shape_key_add(name="Basis")
    key = holder.shape_key_add(name=name, from_mix=False)
    key.value = value
    return key


def mesh_data(mesh: bpy.types.Mesh) -> MeshData:
    """Positions and faces of a Blender mesh; its loose vertices stay, loose edges and creases are left out."""
    sizes, corners = values_of(mesh.polygons, "loop_total", np.intc), values_of(mesh.loops, "vertex_index", np.intc)
    positions = values_of(mesh.vertices, "co", np.float32, 3).astype(np.float64)
    return MeshData(positions, sizes[:, 0].astype(np.intp), corners[:, 0].astype(np.intp))


def triangles_of(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """(T, 3): the vertices of the triangles Blender draws."""
    mesh.calc_loop_triangles()
    return values_of(mesh.loop_triangles, "vertices", np.int32, 3)


def evaluated_mesh_data(blender_object: bpy.types.Object) -> MeshData:
    """``mesh_data`` of the object as its modifiers make it."""
    evaluated = blender_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    data = mesh_data(evaluated.to_mesh())
    evaluated.to_mesh_clear()
    return data


def polygon_mesh_of(mesh: bpy.types.Mesh, *, smooth_corners: bool = True) -> PolygonMesh:
    """The core's mesh of a Blender mesh, with its edges, loose ones too, creases, and the boundary rule applied."""
    data = mesh_data(mesh)
    found = PolygonMesh(
        positions=data.positions,
        face_starts=np.concatenate([[0], np.cumsum(data.face_sizes)]).astype(np.intp),
        corner_vertices=data.corner_vertices,
        corner_edges=values_of(mesh.loops, "edge_index", np.intc)[:, 0].astype(np.intp),
        edge_vertices=values_of(mesh.edges, "vertices", np.intc, 2).astype(np.intp),
        edge_sharpness=crease_to_sharpness(_creases(mesh, "crease_edge", len(mesh.edges))),
        vertex_sharpness=crease_to_sharpness(_creases(mesh, "crease_vert", len(mesh.vertices))),
    )
    return apply_boundary_rule(found, smooth_corners=smooth_corners)


def _creases(mesh: bpy.types.Mesh, name: str, count: int) -> np.ndarray:
    return read(mesh, name)[:, 0] if name in mesh.attributes else np.zeros(count, dtype=np.float32)
