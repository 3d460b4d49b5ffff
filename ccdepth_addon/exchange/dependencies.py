# SPDX-License-Identifier: GPL-3.0-or-later
"""The dependencies of depths beside the mesh: the object's scale, its modifiers, and the data these refer to.

Modifiers of every type and Blender version are described by all their RNA properties: no property is left out by its
name, except the display settings of modifiers and nodes. Only modifiers with a hidden state are evaluated: animated and
driven values are those of Blender's last evaluation.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from zlib import crc32

import bpy
import numpy as np

from ..core import FloatArray
from .control_mesh import gram_matrix
from .evaluated import evaluated
from .mesh_arrays import (
    CREASE_DOMAINS,
    attributes_checksum,
    checksum_of_points,
    content_checksum,
    geometry_checksum,
    own_mesh,
)
from .modifiers import (
    NOT_SHAPING,
    OF_OBJECT,
    SIMULATIONS,
    counted_modifiers,
    shown_vertices,
    simplified_levels,
    surface_rule,
)
from .rna_settings import read_setting, settings_of
from .vertex_groups import read_weights

# Places of other objects are rounded: objects that are turned together keep them but for rounding.
DECIMALS = 5

# No settings of modifiers are nested deeper.
DEEPEST = 5

# Modifiers that depend on the frame even without animated settings.
AT_FRAMES = {"BUILD", "DYNAMIC_PAINT", "PARTICLE_INSTANCE", "WAVE"}
NODES_AT_FRAMES = {"GeometryNodeBake", "GeometryNodeInputSceneTime", "GeometryNodeSimulationOutput"}

# Parts of the descriptions of modifiers that read weights, other attributes of meshes, or the object's own place.
READS_WEIGHTS = re.compile(
    r"""(vertex_group\w*|attribute_name)=("|'[^'])|type='ARMATURE'|InputNamedAttribute|VGROUP_WEIGHTS"""
)
READS_ATTRIBUTES = re.compile(
    r"""(uv_layer|attribute_name)=("|'[^'])|(texture_coords|mask_tex_mapping)='UV'|limit_method='WEIGHT'|"""
    r"use_edge_sharp=True|Input(NamedAttribute|MaterialIndex|ShadeSmooth|EdgeSmooth|ID)\b|MaterialSelection"
)
READS_PLACE = re.compile(r"(texture_coords|mask_tex_mapping|space)='GLOBAL'|\bORIGINAL\b|InputActiveCamera|SelfObject")

# Modifiers with a part that Blender hands out only as the mesh they make: sculpted levels, bound meshes, radii, files.
HIDDEN_STATE = {
    "CORRECTIVE_SMOOTH", "LAPLACIANDEFORM", "MESH_CACHE", "MESH_DEFORM", "MESH_SEQUENCE_CACHE", "MULTIRES", "SKIN",
    "SURFACE_DEFORM",
}  # fmt: skip


class Description(NamedTuple):
    """A text, and the objects it mentions; their places are not in it."""

    text: str
    mentioned: tuple[bpy.types.Object, ...] = ()


# Descriptions by the session identifier of the described data-block.
KnownDescriptions = dict[int, Description]


@dataclass(frozen=True)
class ObjectState:
    """An object's scale, as AᵀA (6,), and a checksum of everything else that shapes its surface. frame: the frame of
    reading; None for the present scene."""

    scale: FloatArray
    checksum: str
    frame: int | None = None


def object_state(
    blender_object: bpy.types.Object,
    *,
    use_modifiers: bool,
    with_vertices: bool = False,
    known: KnownDescriptions | None = None,
) -> ObjectState:
    """The present state of an object.

    with_vertices: whether the vertices of the object's own Subdivision Surface modifier matter. known: descriptions
    made for other objects at the same time, so that nothing is read twice.
    """
    describer = _Describer(blender_object, {} if known is None else known)
    world = np.array(blender_object.matrix_world, dtype=np.float64)[:3, :3]
    counted = counted_modifiers(blender_object, use_modifiers=use_modifiers)
    rule = surface_rule(blender_object)
    texts = [repr(rule), *describer.shape_keys(), *describer.modifiers(counted), *describer.places()]
    if rule.use_creases:
        texts += describer.crease_groups()
    if with_vertices:
        texts.append(shown_vertices(blender_object, OF_OBJECT))
    checksum = crc32("\n".join(texts).encode(errors="backslashreplace"))
    return ObjectState(gram_matrix(world)[np.triu_indices(3)], f"{checksum:08x}")


def shown_checksum(blender_object: bpy.types.Object, shown: Iterable[bpy.types.Modifier]) -> str:
    """A checksum of all that these modifiers, and shape keys, depend on."""
    describer = _Describer(blender_object, {})
    texts = [*describer.shape_keys(), *describer.modifiers(list(shown)), *describer.places()]
    texts += describer.crease_groups()
    return f"{crc32(chr(10).join(texts).encode(errors='backslashreplace')):08x}"


@dataclass(frozen=True)
class _Describer:
    """A description of everything an object depends on, as text."""

    viewer: bpy.types.Object
    known: KnownDescriptions
    mentioned: list[bpy.types.Object] = field(default_factory=list)

    def shape_keys(self) -> Iterator[str]:
        keys = getattr(self.viewer.data, "shape_keys", None)
        if keys is not None:
            shown = self.viewer.active_shape_key_index if self.viewer.show_only_shape_key else None
            yield f"{shown} {self._once(keys, _shape_keys_text)}"
            if self.viewer.type == "MESH" and any(key.vertex_group for key in keys.key_blocks):
                yield self._weights(self.viewer)

    def modifiers(self, modifiers: list[bpy.types.Modifier]) -> Iterator[str]:
        texts = [self._modifier(modifier) for modifier in modifiers if modifier.type not in NOT_SHAPING]
        yield from texts
        hiding = [number for number, modifier in enumerate(modifiers, start=1) if modifier.type in HIDDEN_STATE]
        if hiding and self.viewer.type == "MESH":
            yield from self._made_by(modifiers[: hiding[-1]])
        text = " ".join(texts)
        meshes = [each for each in (self.viewer, *dict.fromkeys(self.mentioned)) if each.type == "MESH"]
        if READS_WEIGHTS.search(text):
            yield from map(self._weights, meshes)
        if READS_ATTRIBUTES.search(text):
            yield from map(_attributes_text, meshes)
        if READS_PLACE.search(text):
            yield repr(np.array(self.viewer.matrix_world).round(DECIMALS).tolist())

    def _made_by(self, modifiers: list[bpy.types.Modifier]) -> Iterator[str]:
        """A checksum of the mesh that these modifiers make, if they make one."""
        with evaluated(bpy.context, {self.viewer: modifiers}) as copies:
            if self.viewer in copies:
                yield str(geometry_checksum(copies.made(self.viewer)[0]))

    def _weights(self, holder: bpy.types.Object) -> str:
        return self._once(holder.data, lambda _: _weights_text(holder))

    def crease_groups(self) -> Iterator[str]:
        """The vertex groups that the Subdivision Surface modifier takes for creases, mostly none."""
        groups = self.viewer.vertex_groups
        yield from (f"group {name}" for name in CREASE_DOMAINS if name in groups)

    def places(self) -> Iterator[str]:
        """The places of the objects mentioned so far, relative to the viewer."""
        for other in self.mentioned:
            relative = self.viewer.matrix_world.inverted_safe() @ other.matrix_world
            yield repr(np.array(relative).round(DECIMALS).tolist())

    def _modifier(self, modifier: bpy.types.Modifier) -> str:
        if modifier.type in SIMULATIONS:
            # Simulations are refused, and their settings hold whole grids of their state.
            return str(modifier.type)
        text = self._settings(modifier)
        if modifier.type == "NODES" and not hasattr(modifier, "properties"):
            # Since Blender 5.2 the inputs are ordinary properties; before, custom properties.
            text += " ".join(f"{key}={self._value(modifier[key])}" for key in modifier.keys())  # noqa: SIM118
        if modifier.type == "SUBSURF":
            text += _simplified_text(modifier.levels)
        return f"{text} {_frame_text()}" if modifier.type in AT_FRAMES else text

    def _settings(self, holder: bpy.types.bpy_struct, depth: int = 0) -> str:
        """All settings of a modifier, a node, an input or a curve that do more than display it."""
        values = ((name, self._value(read_setting(holder, name), depth)) for name in settings_of(holder))
        return " ".join(f"{name}={value}" for name, value in values)

    def _value(self, value: Any, depth: int = 0) -> str:
        """A setting as text; another object as its description."""
        if isinstance(value, bpy.types.ID):
            return self._data_block(value)
        if isinstance(value, bpy.types.bpy_struct):
            return f"({self._settings(value, depth + 1)})" if depth < DEEPEST else type(value).__name__
        if isinstance(value, bpy.types.bpy_prop_collection):
            return f"[{', '.join(self._value(item, depth) for item in value)}]"
        if isinstance(value, set):
            return repr(sorted(value))
        if hasattr(value, "to_dict"):
            return repr(value.to_dict())
        # Blender's arrays are sequences that do not print their values.
        return repr(list(value)) if hasattr(value, "__len__") and not isinstance(value, str) else repr(value)

    def _data_block(self, block: bpy.types.ID) -> str:
        if isinstance(block, bpy.types.Object):
            self.mentioned.append(block)
            return self._once(block, self._content)
        if isinstance(block, bpy.types.Collection):
            members = [self._data_block(member) for member in block.all_objects]
            return f"{members} {block.instance_offset[:]}"
        if isinstance(block, bpy.types.NodeTree):
            return self._once(block, self._tree)
        if isinstance(block, bpy.types.Texture):
            return f"{block.name_full} {self._once(block, self._settings)}"
        if isinstance(block, bpy.types.Image):
            return f"{block.name_full} {self._once(block, _image_text)}"
        return str(block.name_full)

    def _once(self, block: bpy.types.ID, describe: Callable[[Any], str]) -> str:
        if block.session_uid not in self.known:
            # Ends cycles: a data-block that refers to itself is described once.
            self.known[block.session_uid] = Description("")
            before = len(self.mentioned)
            text = describe(block)
            self.known[block.session_uid] = Description(text, tuple(self.mentioned[before:]))
        else:
            self.mentioned.extend(self.known[block.session_uid].mentioned)
        return self.known[block.session_uid].text

    def _content(self, other: bpy.types.Object) -> str:
        """Another object apart from its place: its data, and its own modifiers."""
        there = _Describer(other, self.known)
        shown = [modifier for modifier in other.modifiers if modifier.show_viewport]
        texts = [other.type, there._own_data(other), there._value(other.instance_collection)]
        return " ".join([*texts, *there.shape_keys(), *there.modifiers(shown), *there.places()])

    def _own_data(self, other: bpy.types.Object) -> str:
        data = other.data
        if other.type == "MESH":
            with own_mesh(other) as mesh:
                return str(geometry_checksum(mesh))
        if other.type == "ARMATURE":
            bones = [(bone.name, np.array(bone.matrix).round(DECIMALS).tolist()) for bone in other.pose.bones]
            return f"{data.pose_position} {bones}"
        if other.type == "LATTICE":
            return f"{data.points_u} {data.points_v} {data.points_w} {checksum_of_points(data.points, 'co_deform')}"
        if other.type in {"CURVE", "FONT", "SURFACE"}:
            return self._curve(data)
        if other.type == "META":
            return self._settings(data)
        if other.type in {"CURVES", "POINTCLOUD"}:
            return str(attributes_checksum(data))
        return "" if data is None else str(data.name_full)

    def _curve(self, curve: bpy.types.Curve) -> str:
        texts = [f"{name}={self._value(read_setting(curve, name))}" for name in settings_of(curve) if name != "splines"]
        for spline in curve.splines:
            texts += [f"{name}={read_setting(spline, name)!r}" for name in settings_of(spline) if "points" not in name]
            texts.append(str(checksum_of_points(spline.points, width=4)))
            texts += [str(checksum_of_points(spline.bezier_points, name)) for name in BEZIER_POINT_VECTORS]
            for points in (spline.points, spline.bezier_points):
                texts += [str(checksum_of_points(points, name, 1)) for name in ("radius", "tilt")]
        return " ".join(texts)

    def _tree(self, tree: bpy.types.NodeTree) -> str:
        nodes = []
        for node in tree.nodes:
            values = [self._value(read_setting(socket, "default_value")) for socket in node.inputs]
            if node.bl_idname == "GeometryNodeInputActiveCamera":
                values.append(self._value(bpy.context.scene.camera))
            frame = _frame_text() if node.bl_idname in NODES_AT_FRAMES else ""
            nodes.append(f"{node.name} {self._settings(node)} {values} {frame}")
        links = [
            (link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
            for link in tree.links
            if not link.is_muted
        ]
        return f"{nodes} {links}"


BEZIER_POINT_VECTORS = ("co", "handle_left", "handle_right")


def _shape_keys_text(keys: bpy.types.Key) -> str:
    blocks = [
        (key.value, key.mute, key.vertex_group, key.relative_key.name, key.name, checksum_of_points(key.data))
        for key in keys.key_blocks
    ]
    return repr((keys.use_relative, keys.use_relative or keys.eval_time, blocks))


def _weights_text(holder: bpy.types.Object) -> str:
    """The vertex groups of an object's mesh; Blender reads weights one by one."""
    with own_mesh(holder) as mesh:
        weights = [crc32(column.tobytes()) for column in read_weights(mesh)] if holder.vertex_groups else []
    return f"{holder.vertex_groups.keys()} {weights}"


def _attributes_text(holder: bpy.types.Object) -> str:
    """The attributes of an object's mesh, and the lists that attributes and modifiers refer to."""
    with own_mesh(holder) as mesh:
        active = mesh.uv_layers.active
        return f"{content_checksum(mesh)} {active and active.name} {holder.material_slots.keys()}"


def _image_text(image: bpy.types.Image) -> str:
    """The settings of an image, and its pixels or its frame. Pixels are read each time: Blender does not report every
    change of them."""
    settings = f"{image.filepath} {image.source} {image.alpha_mode} {image.colorspace_settings.name}"
    if image.source in {"MOVIE", "SEQUENCE"}:
        return f"{settings} {_frame_text()}"
    pixels = np.empty(len(image.pixels), dtype=np.float32)
    image.pixels.foreach_get(pixels)
    return f"{settings} {image.size[:]} {crc32(pixels.data)}"


def _simplified_text(levels: int) -> str:
    """The levels that Simplify leaves of a modifier's levels in the viewport; empty where it leaves all."""
    limits = simplified_levels(bpy.context.scene)
    return f" simplified to {limits[0]}" if limits is not None and limits[0] < levels else ""


def _frame_text() -> str:
    return f"at {bpy.context.scene.frame_current_final}"
