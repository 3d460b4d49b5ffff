# SPDX-License-Identifier: GPL-3.0-or-later
"""The attributes of a mesh on its subdivision: UV maps, colours, creases, selections, and all others.

Like the Subdivision Surface modifier when it is applied, but for these:

- Integers, texts, quaternions and matrices come from the nearest vertex or corner. The modifier averages integers to
  meaningless numbers, or leaves zeros, by version and type, and drops texts.
- Vertex creases stay at the vertices; the modifier spreads them over the faces around.
- Selected and hidden parts stay whole; the modifier drops the edges inside faces.
- Edges with a crease of 1 are marked sharp, as they are sharp on the surface.
- Custom normals are left out: they belong to the coarse faces.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import (
    BoolArray,
    Evaluate,
    IndexArray,
    PolygonMesh,
    ShortIndexArray,
    SubdividedMesh,
    at_corners,
    at_vertices,
    crease_to_sharpness,
    face_varying_surface,
    interpolated,
    limit_values,
    nearest_vertices,
)
from .blender_arrays import TYPES, ValueType, find_attribute, read_values, write_attribute, write_values
from .face_values import BOUND, COLOR, DEPTH, DEVIATION
from .mesh_arrays import EDGE_CREASE, VERTEX_CREASE, read_creases

Values = NDArray[Any]


TOPOLOGY = {"position", ".edge_verts", ".corner_vert", ".corner_edge"}
LEFT_OUT = TOPOLOGY | {DEPTH, BOUND, DEVIATION, COLOR}
CUSTOM_NORMAL = "custom_normal"
# Since this version normals can be stored as vectors; before, only as two 16-bit angles from Blender's own.
FREE_NORMALS = (4, 5)
# Averages of rotations are none.
ROTATIONS = {"QUATERNION", "FLOAT4X4"}
# Flags of vertices, edges and faces, by the prefix of their names.
FLAGS = (".select", ".hide")
FLAG_DOMAINS = {f"{flag}_{kind}": domain for flag in FLAGS for kind, domain in (("vert", "POINT"), ("edge", "EDGE"))}
# Marks that Blender before 5.0 keeps outside the attributes.
MARKS = "use_freestyle_mark"


class AttributeTransfer:
    """Transfers the attributes of a mesh to its subdivision; ``control`` has the faces and corners of ``base``."""

    def __init__(self, base: bpy.types.Mesh, control: PolygonMesh, subdivided: SubdividedMesh, uv_smooth: str) -> None:
        self.base = base
        self.control = control
        self.subdivided = subdivided
        self.uv_smooth = uv_smooth

    # Values that are not finite stay so where possible.
    @np.errstate(all="ignore")
    def write(self, mesh: bpy.types.Mesh) -> None:
        """Write all attributes to the new mesh, which has its faces, and no other attributes."""
        uv_maps = {layer.name for layer in self.base.uv_layers}
        for attribute in self.base.attributes:
            if is_left_out(attribute) or len(attribute.data) != _count(self.base, attribute.domain):
                continue
            values = self._uv_map(attribute) if attribute.name in uv_maps else self._generic(attribute)
            if values is not None:
                write_attribute(mesh, attribute.name, attribute.data_type, attribute.domain, values)
            elif attribute.data_type == "STRING":
                self._write_texts(mesh, attribute)
        for flag in FLAGS:
            self._write_flags(mesh, flag)
        self._write_marks(mesh)
        self._sharpen_creases(mesh)

    def _generic(self, attribute: bpy.types.Attribute) -> Values | None:
        """The values of an attribute on the new mesh, or None for an unknown type."""
        kind = TYPES.get(attribute.data_type)
        if kind is None:
            return None
        values = _rows(attribute.data, kind)
        if attribute.domain == "FACE":
            return values[self.subdivided.base_faces]
        if attribute.domain == "EDGE":
            return _copied(values, self.subdivided.base_edges, kind)
        if attribute.name == VERTEX_CREASE and attribute.domain == "POINT":
            return _copied(values, self.subdivided.base_vertices, kind)
        if attribute.data_type in ROTATIONS or np.issubdtype(values.dtype, np.integer):
            return values[self._sources(attribute.domain)]
        return self._spread(attribute, values)

    def _spread(self, attribute: bpy.types.Attribute, values: Values) -> Values:
        """Values at the vertices or corners of the base, interpolated at the vertices or corners of the new mesh."""
        if attribute.domain == "CORNER":
            return at_corners(self.subdivided, self._interpolated(values))
        at = self._interpolated(values[self.control.corner_vertices])
        return at_vertices(self.subdivided, values, at, self.subdivided.base_vertices >= 0)

    def _interpolated(self, values: Values) -> Evaluate:
        """The values (C, D) at the base's corners, interpolated to any points; booleans are true if one corner with a
        weight is, as in the modifier."""
        numbers = values.astype(np.float64)
        if values.dtype == np.bool_:
            return lambda points: interpolated(self.control, numbers, points) > 0
        return lambda points: interpolated(self.control, numbers, points)

    def _uv_map(self, attribute: bpy.types.Attribute) -> Values:
        uvs = _rows(attribute.data, TYPES["FLOAT2"])
        if self.uv_smooth == "NONE" or not np.isfinite(uvs).all():
            return at_corners(self.subdivided, self._interpolated(uvs))
        surface = face_varying_surface(self.control, uvs, self.uv_smooth)
        return at_corners(self.subdivided, lambda points: limit_values(surface, surface.positions[:, :2], points))

    def _write_texts(self, mesh: bpy.types.Mesh, attribute: bpy.types.Attribute) -> None:
        texts = [item.value for item in attribute.data]
        sources = self._sources(attribute.domain)
        written = mesh.attributes.new(attribute.name, "STRING", attribute.domain).data
        # Blender writes texts one at a time; new ones are empty.
        filled = np.array([bool(text) for text in texts], dtype=bool)
        for place in np.flatnonzero((sources >= 0) & filled[sources]).tolist():
            written[place].value = texts[sources[place]]

    def _sources(self, domain: str) -> IndexArray | ShortIndexArray:
        """For each element of the new mesh the element of the base with its value, or -1."""
        if domain == "POINT":
            return nearest_vertices(self.control, self.subdivided)
        if domain == "CORNER":
            return self.subdivided.corner_points.corners
        return self.subdivided.base_edges if domain == "EDGE" else self.subdivided.base_faces

    def _write_flags(self, mesh: bpy.types.Mesh, flag: str) -> None:
        """Write a flag: vertices and edges have the flag of the vertex, edge or face of the base that they lie in."""
        vertices, edges, faces = (self._flags(f"{flag}_{kind}") for kind in ("vert", "edge", "poly"))
        if not (vertices.any() or edges.any() or faces.any()):
            return
        made = self.subdivided
        at_vertices = np.full(len(made.positions), faces.any())
        at_edges = np.full(len(made.edge_vertices), faces.any())
        if faces.any() and not faces.all():
            at_vertices = faces[self.control.corner_faces[made.vertex_points.corners]]
            at_edges[made.corner_edges] = np.repeat(faces[made.base_faces], np.diff(made.face_starts))
        for flags, sources, values in (
            (at_vertices, made.vertex_edges, edges),
            (at_vertices, made.base_vertices, vertices),
            (at_edges, made.base_edges, edges),
        ):
            outside = np.flatnonzero(sources >= 0)
            flags[outside] = values[sources[outside]]
        for name, values in ((f"{flag}_vert", at_vertices), (f"{flag}_edge", at_edges)):
            # One of another type is no flag.
            if name not in mesh.attributes:
                write_attribute(mesh, name, "BOOLEAN", FLAG_DOMAINS[name], values)

    def _flags(self, name: str) -> BoolArray:
        domain = {"vert": "POINT", "edge": "EDGE", "poly": "FACE"}[name.rpartition("_")[2]]
        attribute = find_attribute(self.base, name, "BOOLEAN", domain)
        if attribute is None:
            return np.zeros(_count(self.base, domain), dtype=bool)
        return read_values(attribute.data, "value", np.bool_)

    def _write_marks(self, mesh: bpy.types.Mesh) -> None:
        for domain, sources in (("EDGE", self.subdivided.base_edges), ("FACE", self.subdivided.base_faces)):
            items, new_items = _elements(self.base, domain), _elements(mesh, domain)
            if not len(items) or not hasattr(items[0], MARKS):
                continue
            marks = read_values(items, MARKS, np.bool_)
            if marks.any():
                write_values(new_items, MARKS, (sources >= 0) & marks[sources])

    def _sharpen_creases(self, mesh: bpy.types.Mesh) -> None:
        """Shade infinitely sharp creases sharp, unless an attribute of the user has the name."""
        creases = read_creases(self.base, EDGE_CREASE)
        if creases is None:
            return
        creased = np.isinf(crease_to_sharpness(creases))
        creased &= np.isinf(self.control.edge_sharpness)
        base_edges = self.subdivided.base_edges
        sharp = (base_edges >= 0) & creased[base_edges]
        if sharp.any():
            present = find_attribute(mesh, "sharp_edge", "BOOLEAN", "EDGE")
            if present is not None:
                sharp |= read_values(present.data, "value", np.bool_)
            elif "sharp_edge" in mesh.attributes:
                return
            write_attribute(mesh, "sharp_edge", "BOOLEAN", "EDGE", sharp)


def is_left_out(attribute: bpy.types.Attribute) -> bool:
    """Whether an attribute is not transferred unchanged: the mesh itself, our own values, flags, custom normals."""
    if attribute.name == CUSTOM_NORMAL:
        free = attribute.data_type == "FLOAT_VECTOR" and bpy.app.version >= FREE_NORMALS
        return free or (attribute.data_type, attribute.domain) == ("INT16_2D", "CORNER")
    is_flag = (attribute.data_type, attribute.domain) == ("BOOLEAN", FLAG_DOMAINS.get(attribute.name))
    return is_flag or attribute.name in LEFT_OUT


def _rows(data: Any, kind: ValueType) -> Values:
    """(N, D): the values of a collection, with D = 1 for single values."""
    return read_values(data, kind.value, kind.dtype, kind.width).reshape(-1, kind.width)


def _copied(values: Values, sources: ShortIndexArray, kind: ValueType) -> Values:
    """The rows of ``values`` at ``sources``, and the type's default at -1."""
    default: Values = np.resize(np.array(kind.default, dtype=kind.dtype), (1, kind.width))
    return np.concatenate([values, default])[sources]


def _elements(mesh: bpy.types.Mesh, domain: str) -> Any:
    return {"POINT": mesh.vertices, "EDGE": mesh.edges, "FACE": mesh.polygons, "CORNER": mesh.loops}[domain]


def _count(mesh: bpy.types.Mesh, domain: str) -> int:
    return len(_elements(mesh, domain))


def choose_same(base: bpy.types.Mesh, mesh: bpy.types.Mesh) -> None:
    """Make the same UV maps, colours and attribute active and rendered."""
    for layer in base.uv_layers:
        copy = mesh.uv_layers.get(layer.name)
        if copy is not None:
            copy.active, copy.active_render, copy.active_clone = layer.active, layer.active_render, layer.active_clone
    for choice in ("active_color_name", "default_color_name"):
        name = getattr(base.attributes, choice)
        setattr(mesh.attributes, choice, name if name in mesh.attributes else "")
    active = base.attributes.active
    if active is not None and active.name in mesh.attributes:
        mesh.attributes.active = mesh.attributes[active.name]
