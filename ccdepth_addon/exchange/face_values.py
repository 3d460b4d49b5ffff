# SPDX-License-Identifier: GPL-3.0-or-later
"""Our values on a mesh, attributes of faces: depths, bounds, angles and deviations, in Object Mode and in Edit Mode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import bmesh
import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .blender_arrays import TYPES, ValueType, find_attribute, read_values, write_attribute

DEPTH = "ccdepth"
BOUND = "ccdepth_bound"
COLOR = "ccdepth_color"
DEVIATION = "ccdepth_deviation"
ANGLE = "ccdepth_angle"

# BMesh's names for the elements of a domain, and for the layers of a type.
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
ANGLE_KIND = AttributeKind(ANGLE, "FLOAT", "FACE")
# Colours are made on request, and were by versions that displayed them.
ATTRIBUTES = (DEPTH_KIND, BOUND_KIND, DEVIATION_KIND, ANGLE_KIND, COLOR_KIND)


def rounded_up(bounds: ArrayLike) -> NDArray[np.float32]:
    """Bounds for attributes and records, rounded up to single precision, so that each stays a bound."""
    exact = np.asarray(bounds, dtype=np.float64)
    single = exact.astype(np.float32)
    return np.where(single < exact, np.nextafter(single, np.float32(np.inf)), single)


def has_values(mesh: bpy.types.Mesh, kind: AttributeKind) -> bool:
    """Whether the mesh has an attribute of this kind, with a record of ours or without."""
    return find_attribute(mesh, kind.name, kind.data_type, kind.domain) is not None


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
    mesh: bpy.types.Mesh, columns: Mapping[AttributeKind, NDArray[Any]], undo: ExitStack | None = None
) -> None:
    """Write attributes in Object Mode or in Edit Mode, all or none.

    columns: (F,), one value for each face, or for colours a row for each corner. undo: restores the old attributes when
    closed; it does nothing in Edit Mode, where Blender keeps written values. Raises WriteError, with nothing changed,
    if Blender does not keep the values.
    """
    if mesh.is_editmode:
        _write_while_editing(mesh, columns)
        return
    before: dict[AttributeKind, NDArray[Any] | None] = {}
    try:
        with _active_kept(mesh):
            for kind, values in columns.items():
                before[kind] = _stored(mesh, kind)
                write_attribute(mesh, kind.name, kind.data_type, kind.domain, values)
    except BaseException:
        _put_back(mesh, before)
        raise
    mesh.update()
    if undo is not None:
        undo.callback(_put_back, mesh, before)


def _stored(mesh: bpy.types.Mesh, kind: AttributeKind) -> NDArray[Any] | None:
    """The present values of an attribute; None without the attribute."""
    attribute = mesh.attributes.get(kind.name)
    if attribute is None:
        return None
    return read_values(attribute.data, kind.values.value, kind.values.dtype, kind.values.width)


def _put_back(mesh: bpy.types.Mesh, columns: dict[AttributeKind, NDArray[Any] | None]) -> None:
    with _active_kept(mesh):
        for kind, values in columns.items():
            if values is not None:
                mesh.attributes[kind.name].data.foreach_set(kind.values.value, values.ravel())
            elif kind.name in mesh.attributes:
                mesh.attributes.remove(mesh.attributes[kind.name])
    mesh.update()


@contextmanager
def _active_kept(mesh: bpy.types.Mesh) -> Iterator[None]:
    """Keep the active attribute, which Blender remembers by a changing index, unless it is removed."""
    attributes = mesh.attributes
    active = None if attributes.active is None else attributes.active.name
    try:
        yield
    finally:
        if active is None or active in attributes:
            attributes.active = None if active is None else attributes[active]


def _write_while_editing(mesh: bpy.types.Mesh, columns: Mapping[AttributeKind, NDArray[Any]]) -> None:
    edited = bmesh.from_edit_mesh(mesh)
    # New layers first: making one moves the others.
    with _active_kept(mesh):
        for kind in columns:
            if kind.layers(edited).get(kind.name) is None:
                kind.layers(edited).new(kind.name)
    # BMesh has no bulk access: a tenth of a second for every hundred thousand faces.
    for kind, values in columns.items():
        layer = kind.layers(edited)[kind.name]
        for face, value in zip(edited.faces, values.tolist(), strict=True):
            face[layer] = value
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)


def read_face_values(mesh: bpy.types.Mesh, kind: AttributeKind) -> NDArray[Any]:
    """(F,): one attribute of faces, in Object Mode or in Edit Mode."""
    if not mesh.is_editmode:
        return read_values(mesh.attributes[kind.name].data, kind.values.value, kind.values.dtype)
    edited = bmesh.from_edit_mesh(mesh)
    layer = kind.layers(edited)[kind.name]
    return np.array([face[layer] for face in edited.faces], dtype=kind.values.dtype)


def remove_values(mesh: bpy.types.Mesh, kind: AttributeKind) -> None:
    """Remove an attribute of ours, if the mesh has it, in Object Mode."""
    if has_values(mesh, kind):
        with _active_kept(mesh):
            mesh.attributes.remove(mesh.attributes[kind.name])
        mesh.update()


def remove_all(mesh: bpy.types.Mesh) -> None:
    """Remove all our attributes from the mesh; other colours are displayed and rendered in place of ours."""
    attributes = mesh.attributes
    with _active_kept(mesh):
        if mesh.is_editmode:
            _remove_layers_while_editing(mesh)
        else:
            for kind in ATTRIBUTES:
                if has_values(mesh, kind):
                    attributes.remove(attributes[kind.name])
            mesh.update()
    others = [attribute.name for attribute in mesh.color_attributes if attribute.name != COLOR]
    for choice in ("active_color_name", "default_color_name"):
        if getattr(attributes, choice) == COLOR:
            setattr(attributes, choice, next(iter(others), ""))


def _remove_layers_while_editing(mesh: bpy.types.Mesh) -> None:
    edited = bmesh.from_edit_mesh(mesh)
    for kind in ATTRIBUTES:
        layers = kind.layers(edited)
        layer = layers.get(kind.name)
        if layer is not None:
            layers.remove(layer)
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)
