# SPDX-License-Identifier: GPL-3.0-or-later
"""The results on a mesh as attributes: depths, bounds, deviations and colours, in Object Mode and in Edit Mode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import IndexArray
from .bulk_reading import read_values
from .bulk_writing import TYPES, ValueType, write_attribute

DEPTH = "ccdepth"
BOUND = "ccdepth_bound"
COLOR = "ccdepth_color"
DEVIATION = "ccdepth_deviation"

# What BMesh calls the elements of a domain, and the layers of a type.
ELEMENTS = {"FACE": "faces", "CORNER": "loops"}
LAYERS = {"INT": "int", "FLOAT": "float", "FLOAT_COLOR": "float_color"}


@dataclass(frozen=True)
class AttributeKind:
    """The name, type and domain of an attribute of ours."""

    name: str
    data_type: str
    domain: str

    @property
    def values(self) -> ValueType:
        return TYPES[self.data_type]

    def layers(self, edited: Any) -> Any:
        """The layers of its type in a BMesh."""
        return getattr(getattr(edited, ELEMENTS[self.domain]).layers, LAYERS[self.data_type])


DEPTH_KIND = AttributeKind(DEPTH, "INT", "FACE")
BOUND_KIND = AttributeKind(BOUND, "FLOAT", "FACE")
COLOR_KIND = AttributeKind(COLOR, "FLOAT_COLOR", "CORNER")
DEVIATION_KIND = AttributeKind(DEVIATION, "FLOAT", "FACE")
ATTRIBUTES = (DEPTH_KIND, BOUND_KIND, COLOR_KIND, DEVIATION_KIND)


def rounded_up(bounds: ArrayLike) -> NDArray[np.float32]:
    """Bounds as attributes and records hold them, in single precision, rounded up: a bound stays a bound."""
    exact = np.asarray(bounds, dtype=np.float64)
    single = exact.astype(np.float32)
    return np.where(single < exact, np.nextafter(single, np.float32(np.inf)), single)


def has_values(mesh: bpy.types.Mesh, kind: AttributeKind) -> bool:
    """Whether the mesh has an attribute like this one, with a record of ours or without."""
    attribute = mesh.attributes.get(kind.name)
    return attribute is not None and (attribute.data_type, attribute.domain) == (kind.data_type, kind.domain)


def conflict(blender_object: bpy.types.Object) -> str | None:
    """The name of an attribute or vertex group that our attributes need, if there is one."""
    mesh = blender_object.data
    for kind in ATTRIBUTES:
        if kind.name in blender_object.vertex_groups:
            return kind.name
        if kind.name in mesh.attributes and not has_values(mesh, kind):
            return kind.name
    return None


def write_face_values(
    mesh: bpy.types.Mesh,
    columns: Mapping[AttributeKind, NDArray[Any]],
    undo: ExitStack | None = None,
    face_starts: IndexArray | None = None,
) -> None:
    """Write attributes in Object Mode or in Edit Mode, all or none.

    columns: (F,) or (F, 4), one value for each face; on CORNER, for all corners of the face alike. undo: when it is
    closed, the mesh has its old attributes again; in Edit Mode, where Blender keeps what is written, it does nothing.
    face_starts: (F + 1,) the first corners of the faces, and the number of corners, as they were read, as it takes long
    to read them again.
    Raises WriteError, with nothing changed, when Blender does not keep them.
    """
    if mesh.is_editmode:
        _write_while_editing(mesh, columns)
        return
    before: dict[AttributeKind, NDArray[Any] | None] = {}
    try:
        with _choices_kept(mesh):
            for kind, values in columns.items():
                before[kind] = _stored(mesh, kind)
                write_attribute(
                    mesh, kind.name, kind.data_type, kind.domain, _at_elements(mesh, kind, values, face_starts)
                )
    except BaseException:
        _put_back(mesh, before)
        raise
    mesh.update()
    if undo is not None:
        undo.callback(_put_back, mesh, before)


def _at_elements(
    mesh: bpy.types.Mesh, kind: AttributeKind, values: NDArray[Any], face_starts: IndexArray | None
) -> NDArray[Any]:
    """Values of faces at the elements of the attribute's domain."""
    if kind.domain == "FACE":
        return values
    # The mesh may have changed since they were read.
    if face_starts is None or face_starts[-1] != len(mesh.loops):
        face_starts = np.append(read_values(mesh.polygons, "loop_start", np.int32), len(mesh.loops))
    return np.repeat(values, np.diff(face_starts), axis=0)


def _stored(mesh: bpy.types.Mesh, kind: AttributeKind) -> NDArray[Any] | None:
    """The values of an attribute as they are now; None when there is none."""
    attribute = mesh.attributes.get(kind.name)
    if attribute is None:
        return None
    return read_values(attribute.data, kind.values.value, kind.values.dtype, kind.values.width)


def _put_back(mesh: bpy.types.Mesh, columns: dict[AttributeKind, NDArray[Any] | None]) -> None:
    with _choices_kept(mesh):
        for kind, values in columns.items():
            if values is not None:
                mesh.attributes[kind.name].data.foreach_set(kind.values.value, values.ravel())
            elif kind.name in mesh.attributes:
                mesh.attributes.remove(mesh.attributes[kind.name])
    mesh.update()


@contextmanager
def _choices_kept(mesh: bpy.types.Mesh) -> Iterator[None]:
    """Keep the active attribute and the colours displayed and rendered, unless they are removed.

    Blender remembers the active attribute by its index, which changes. It makes the first colour attribute of a mesh
    the one displayed and the one rendered: that is for the user to choose.
    """
    attributes = mesh.attributes
    colors = {name: getattr(attributes, name) for name in ("active_color_name", "default_color_name")}
    present = set(attributes.keys())
    active = None if attributes.active is None else attributes.active.name
    try:
        yield
    finally:
        for name, chosen in colors.items():
            setattr(attributes, name, "" if chosen in present and chosen not in attributes else chosen)
        if active is None or active in attributes:
            attributes.active = None if active is None else attributes[active]


def _write_while_editing(mesh: bpy.types.Mesh, columns: Mapping[AttributeKind, NDArray[Any]]) -> None:
    import bmesh

    edited = bmesh.from_edit_mesh(mesh)
    # New layers first: making one moves the others.
    with _choices_kept(mesh):
        for kind in columns:
            if kind.layers(edited).get(kind.name) is None:
                kind.layers(edited).new(kind.name)
    # BMesh has no bulk access: a tenth of a second for every hundred thousand faces.
    for kind, values in columns.items():
        layer = kind.layers(edited)[kind.name]
        for face, value in zip(edited.faces, values.tolist(), strict=True):
            for element in face.loops if kind.domain == "CORNER" else (face,):
                element[layer] = value
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)


def read_face_values(mesh: bpy.types.Mesh, kind: AttributeKind) -> NDArray[Any]:
    """(F,): one attribute of faces, in Object Mode or in Edit Mode."""
    if not mesh.is_editmode:
        return read_values(mesh.attributes[kind.name].data, kind.values.value, kind.values.dtype)
    import bmesh

    edited = bmesh.from_edit_mesh(mesh)
    layer = kind.layers(edited)[kind.name]
    return np.array([face[layer] for face in edited.faces], dtype=kind.values.dtype)


def remove_all(mesh: bpy.types.Mesh) -> None:
    """Remove all our attributes from the mesh."""
    with _choices_kept(mesh):
        if mesh.is_editmode:
            _remove_layers_while_editing(mesh)
            return
        for kind in ATTRIBUTES:
            if has_values(mesh, kind):
                mesh.attributes.remove(mesh.attributes[kind.name])
        mesh.update()


def _remove_layers_while_editing(mesh: bpy.types.Mesh) -> None:
    import bmesh

    edited = bmesh.from_edit_mesh(mesh)
    for kind in ATTRIBUTES:
        layers = kind.layers(edited)
        layer = layers.get(kind.name)
        if layer is not None:
            layers.remove(layer)
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)


def color_of_user(mesh: bpy.types.Mesh, name: str) -> str:
    """The user's colours for a name: those themselves; for ours, those displayed before; where there are none of the
    name, the first ones, which Blender chooses too when colours are removed."""
    if name == COLOR and mesh.ccdepth.active_color_taken:
        name = mesh.ccdepth.previous_active_color
    # Blender also displays colours of faces and edges, though it does not list them among the colours.
    if not name or (name != COLOR and name in mesh.attributes):
        return name
    return next((attribute.name for attribute in mesh.color_attributes if attribute.name != COLOR), "")
