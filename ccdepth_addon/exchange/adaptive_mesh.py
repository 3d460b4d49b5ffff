# SPDX-License-Identifier: GPL-3.0-or-later
"""A subdivision as arrays → a new Blender mesh, with all data of the base mesh.

Shape keys are the same points of the surface for every key. The limit surface depends linearly on the control points,
so keys mixed on the subdivision give the limit surface of the mixed control mesh.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import FloatArray, PolygonMesh, SubdividedMesh, SurfacePoints, at_vertices, limit_values
from .attributes import AttributeTransfer, choose_same
from .blender_arrays import read_values, write_values
from .custom_normals import normals_of_surface, smooth_faces, write_normals
from .data_blocks import held, own_copy, remove_shape_keys, removed_on_failure
from .vertex_groups import write_groups

# The modifier's default.
UV_SMOOTH = "PRESERVE_BOUNDARIES"


def new_mesh(
    base: bpy.types.Mesh,
    control: PolygonMesh,
    subdivided: SubdividedMesh,
    *,
    uv_smooth: str = UV_SMOOTH,
    exact_normals: bool = False,
    normals: FloatArray | None = None,
) -> bpy.types.Mesh:
    """The subdivision as a mesh of its own, with the materials, attributes, groups, keys and settings of ``base``.

    base: in Object Mode. control: its control mesh, with the same vertices, edges, faces and corners, and explicit
    sharpness. uv_smooth: the modifier's UV Smooth. exact_normals: shade smooth faces with the normals of the limit
    surface. normals: (C, 3), to store in their place; with shape keys the normals are those of the basis.
    ``base`` is not changed. Vertices and edges without faces stay unchanged. Our own values are left out.
    """
    mesh = own_copy(base)
    with removed_on_failure([mesh.session_uid]), held(mesh) as holder:
        groups = [(group.name, group.lock_weight) for group in holder.vertex_groups]
        active = holder.vertex_groups.active_index
        remove_shape_keys(holder)
        mesh.clear_geometry()
        mesh.property_unset("ccdepth")
        _write_faces(mesh, subdivided)
        # A group and an attribute can share a name only if the attribute is made first.
        holder.vertex_groups.clear()
        AttributeTransfer(base, control, subdivided, uv_smooth).write(mesh)
        write_groups(holder, groups, base, control, subdivided)
        if groups:
            holder.vertex_groups.active_index = active
        choose_same(base, mesh)
        write_shape_keys(holder, base, control, subdivided)
        if exact_normals and smooth_faces(mesh).any():
            deformable = base.shape_keys is not None or bool(groups)
            if normals is None or base.shape_keys is not None:
                normals = normals_of_surface(basis_mesh(base, control), subdivided)
            write_normals(mesh, normals, deformable=deformable)
    mesh.update()
    return mesh


def _write_faces(mesh: bpy.types.Mesh, subdivided: SubdividedMesh) -> None:
    """Give an empty mesh its vertices, edges and faces."""
    mesh.vertices.add(len(subdivided.positions))
    mesh.edges.add(len(subdivided.edge_vertices))
    mesh.loops.add(len(subdivided.corner_vertices))
    mesh.polygons.add(len(subdivided.base_faces))
    data = mesh.attributes
    write_values(data["position"].data, "vector", subdivided.positions.astype(np.float32))
    write_values(data[".edge_verts"].data, "value", subdivided.edge_vertices)
    write_values(mesh.polygons, "loop_start", subdivided.face_starts[:-1].astype(np.int32))
    write_values(data[".corner_vert"].data, "value", subdivided.corner_vertices)
    write_values(data[".corner_edge"].data, "value", subdivided.corner_edges)
    # Blender selects new elements.
    for name in (".select_vert", ".select_edge", ".select_poly"):
        if name in data:
            data.remove(data[name])


# Each end of the range stops at the present other one, so the first end that is set is set again.
KEY_SETTINGS = (
    *("slider_max", "slider_min", "slider_max"),
    *("value", "mute", "vertex_group", "interpolation", "lock_shape"),
)
ANIMATION_SETTINGS = (
    "action",
    "action_slot",
    "action_blend_type",
    "action_extrapolation",
    "action_influence",
    "use_nla",
)
TRACK_SETTINGS = ("name", "mute", "lock")
# The order matters: the end of a strip follows from the other values.
STRIP_SETTINGS = (
    "action_slot",
    "action_frame_start",
    "action_frame_end",
    "repeat",
    "scale",
    "frame_start",
    "frame_end",
    "blend_in",
    "blend_out",
    "blend_type",
    "extrapolation",
    "influence",
    "mute",
    "use_reverse",
)


def write_shape_keys(
    holder: bpy.types.Object, base: bpy.types.Mesh, control: PolygonMesh, subdivided: SubdividedMesh
) -> None:
    """Give the mesh of ``holder``, which has none, the shape keys of ``base``, with their settings and animation.

    The vertices move to where the basis has them, as always on a mesh with keys.
    """
    keys = base.shape_keys
    if keys is None:
        return
    blocks = list(keys.key_blocks)
    for key in blocks:
        copy = _add_key(holder, key, keys.use_relative)
        positions = _positions(key, control, subdivided)
        write_values(copy.points, "co", positions)
        if key == keys.reference_key:
            write_values(holder.data.attributes["position"].data, "vector", positions)
    copies = holder.data.shape_keys
    for key, copy in zip(blocks, copies.key_blocks, strict=True):
        copy.relative_key = copies.key_blocks[blocks.index(key.relative_key)]
        _copy_settings(key, copy, KEY_SETTINGS)
    copies.eval_time = keys.eval_time
    _copy_animation(keys, copies)


def _positions(key: bpy.types.ShapeKey, control: PolygonMesh, subdivided: SubdividedMesh) -> NDArray[np.float32]:
    """(V, 3): the vertices of the subdivision in a key of the base; loose ones keep their positions."""
    coordinates = read_values(key.points, "co", np.float32, 3).astype(np.float64)

    def on_surface(points: SurfacePoints) -> FloatArray:
        return limit_values(control, coordinates, points)

    return at_vertices(subdivided, coordinates, on_surface, subdivided.is_loose).astype(np.float32)


def basis_mesh(base: bpy.types.Mesh, control: PolygonMesh) -> PolygonMesh:
    """The control mesh in the basis key, or unchanged without keys."""
    if base.shape_keys is None:
        return control
    coordinates = read_values(base.shape_keys.reference_key.points, "co", np.float32, 3)
    return control.changed(positions=coordinates.astype(np.float64))


def _add_key(holder: bpy.types.Object, key: bpy.types.ShapeKey, relative: bool) -> bpy.types.ShapeKey:
    """A key of the same name; absolute keys have the same frame, which Blender sets by the evaluation time."""
    if not relative and holder.data.shape_keys is not None:
        holder.data.shape_keys.use_relative = False
        holder.data.shape_keys.eval_time = key.frame
    return holder.shape_key_add(name=key.name, from_mix=False)


def _copy_settings(source: Any, target: Any, names: tuple[str, ...]) -> None:
    for name in names:
        # Some exist only in some versions of Blender.
        if hasattr(source, name) and not target.is_property_readonly(name):
            setattr(target, name, getattr(source, name))


def _copy_animation(source: bpy.types.Key, target: bpy.types.Key) -> None:
    animation = source.animation_data
    if animation is None:
        return
    copy = target.animation_data_create()
    if animation.action is not None:
        _copy_settings(animation, copy, ANIMATION_SETTINGS)
    for driver in animation.drivers:
        copy.drivers.from_existing(src_driver=driver)
    for track in animation.nla_tracks:
        copied = copy.nla_tracks.new(prev=copy.nla_tracks[-1] if len(copy.nla_tracks) else None)
        _copy_settings(track, copied, TRACK_SETTINGS)
        for strip in track.strips:
            if strip.type == "CLIP":
                new_strip = copied.strips.new(strip.name, int(strip.frame_start), strip.action)
                _copy_settings(strip, new_strip, STRIP_SETTINGS)
