# SPDX-License-Identifier: GPL-3.0-or-later
"""The result on the mesh: its attributes and its record, written, read and cleared in Object Mode and in Edit Mode."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .. import version
from ..core import FloatArray
from ..exchange.bulk_writing import write_values
from ..exchange.control_mesh import read_values
from ..tasks.adaptive_task import Subdivision, SubdivisionSettings
from ..tasks.depth_task import MeshDepths, Settings
from ..tasks.surfaces import SurfaceSettings
from ..ui.colors import depth_colors, to_linear

DEPTH = "ccdepth"
BOUND = "ccdepth_bound"
COLOR = "ccdepth_color"
DEVIATION = "ccdepth_deviation"


@dataclass(frozen=True)
class AttributeKind:
    """How an attribute of ours is called by Blender's meshes, and by BMesh."""

    name: str
    data_type: str
    domain: str
    value: str
    elements: str
    layers: str


DEPTH_KIND = AttributeKind(DEPTH, "INT", "FACE", "value", "faces", "int")
COLOR_KIND = AttributeKind(COLOR, "FLOAT_COLOR", "CORNER", "color", "loops", "float_color")
DEVIATION_KIND = AttributeKind(DEVIATION, "FLOAT", "FACE", "value", "faces", "float")
DEPTH_ATTRIBUTES = (
    DEPTH_KIND,
    AttributeKind(BOUND, "FLOAT", "FACE", "value", "faces", "float"),
    COLOR_KIND,
)
ATTRIBUTES = (*DEPTH_ATTRIBUTES, DEVIATION_KIND)

# The values of attributes, flat, None where there is no such attribute.
Columns = dict[AttributeKind, NDArray[Any] | None]


def has_depths(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh has depths, with a record of ours or without."""
    return has_values(mesh, DEPTH_KIND)


def has_result(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds depths of ours; undo in Edit Mode can take them away from under their record."""
    return mesh.ccdepth.has_result and has_depths(mesh)


def has_deviation(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds measured deviations."""
    return mesh.ccdepth.has_deviation and has_values(mesh, DEVIATION_KIND)


def has_any(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds depths or deviations."""
    return has_result(mesh) or has_deviation(mesh)


def has_heat_map(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds our colours; a subdivision has depths, and none of them."""
    return has_any(mesh) and has_values(mesh, COLOR_KIND)


def shows_heat_map(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds our colours, and they are the ones displayed."""
    return has_heat_map(mesh) and mesh.ccdepth.active_color_taken


def shows_deviation(mesh: bpy.types.Mesh) -> bool:
    """Whether our colours are those of deviations, and not of depths: of what was done last, and is still there."""
    return has_deviation(mesh) and (mesh.ccdepth.shows_deviation or not has_result(mesh))


def has_traces(mesh: bpy.types.Mesh) -> bool:
    """Whether there is anything of ours on the mesh to clear."""
    return mesh.ccdepth.has_result or mesh.ccdepth.has_deviation or any(has_values(mesh, kind) for kind in ATTRIBUTES)


def has_values(mesh: bpy.types.Mesh, kind: AttributeKind) -> bool:
    """Whether the mesh has an attribute like this one, with a record of ours or without."""
    attribute = mesh.attributes.get(kind.name)
    return attribute is not None and (attribute.data_type, attribute.domain) == (kind.data_type, kind.domain)


def conflict(blender_object: bpy.types.Object) -> str | None:
    """The name of an attribute or vertex group that stands where one of ours must go, if there is one."""
    mesh = blender_object.data
    for kind in ATTRIBUTES:
        if kind.name in blender_object.vertex_groups:
            return kind.name
        if kind.name in mesh.attributes and not has_values(mesh, kind):
            return kind.name
    return None


def write_depths(
    mesh: bpy.types.Mesh, answer: MeshDepths, least_color_depth: int, deepest_color_depth: int, undo: ExitStack
) -> None:
    """Put the answer on its mesh as attributes, with the heat map's colours between these two depths.

    undo: puts back what stood there when it is closed. Raises WriteError, with nothing changed, when Blender does not
    keep them; in Edit Mode it does.
    """
    color_depths = range(least_color_depth, deepest_color_depth + 1)
    palette = to_linear(depth_colors(color_depths, least_color_depth, deepest_color_depth))
    opaque = np.concatenate([palette, np.ones((len(palette), 1))], axis=1).astype(np.float32)
    colors = opaque.take(answer.depths - least_color_depth, axis=0)
    _write_attributes(mesh, answer.depths, rounded_up(answer.bounds), colors, undo)


def write_record(
    mesh: bpy.types.Mesh, answer: MeshDepths, settings: Settings, least_color_depth: int, deepest_color_depth: int
) -> None:
    """Put the answer into the record of its mesh, which has the attributes."""
    record = _new_record(mesh, answer.depths, settings)
    record.world_tolerance = answer.world_tolerance
    record.method = settings.method
    record.vertices = settings.vertices
    record.use_modifiers = settings.use_modifiers
    record.exact_faces = int(np.count_nonzero(answer.exact))
    record.added_deepest = answer.added_deepest
    record.least_color_depth = least_color_depth
    record.deepest_color_depth = deepest_color_depth
    record.uniform_level = answer.uniform_level
    record.quality = answer.quality
    record.uniform_faces = str(answer.uniform_faces)


def write_subdivision(mesh: bpy.types.Mesh, answer: Subdivision, settings: SubdivisionSettings) -> None:
    """Put what is known of a subdivision on its mesh, in Object Mode: attributes and record, and no colours: the mesh
    is there to be used."""
    depths, bounds = answer.adaptive.depths, rounded_up(answer.bounds)
    _write_columns(mesh, zip(DEPTH_ATTRIBUTES[:2], (depths, bounds), strict=True))
    record = _new_record(mesh, depths, settings)
    record.subdivision = settings.mode
    record.world_tolerance = answer.world_tolerance
    record.base_faces = answer.task.surface.control.mesh.face_count
    record.largest_bound = float(bounds.max(initial=0.0))
    record.uniform_faces = str(answer.uniform_faces)


def _new_record(mesh: bpy.types.Mesh, depths: NDArray[np.int32], settings: SurfaceSettings) -> bpy.types.PropertyGroup:
    """The mesh's record, with what is known of any result."""
    record = mesh.ccdepth
    record.has_result = True
    record.subdivision = ""
    record.shows_deviation = False
    record.tolerance = settings.tolerance
    record.tolerance_mode = settings.tolerance_mode
    record.version = version()
    record.faces = len(depths)
    record.deepest = int(depths.max(initial=0))
    record.rows.clear()
    counts = np.bincount(depths)
    for depth in np.flatnonzero(counts).tolist():
        row = record.rows.add()
        row.depth, row.faces = depth, int(counts[depth])
    return record


def rounded_up(bounds: FloatArray) -> NDArray[np.float32]:
    """In single precision, and not below: a bound has to stay one."""
    single = bounds.astype(np.float32)
    return np.nextafter(single, np.float32(np.inf), out=single, where=single < bounds)


def _write_attributes(
    mesh: bpy.types.Mesh,
    depths: NDArray[np.int32],
    bounds: NDArray[np.float32],
    colors: NDArray[np.float32],
    undo: ExitStack,
) -> None:
    """Write the attributes: depths and bounds (F,), and one linear colour (F, 4) for all corners of each face."""
    if mesh.is_editmode:
        _write_while_editing(mesh, depths.tolist(), bounds.tolist(), colors.tolist())
        return
    sizes = np.diff(read_values(mesh.polygons, "loop_start", np.int32), append=len(mesh.loops))
    columns = (depths, bounds, np.repeat(colors, sizes, axis=0).ravel())
    before = _write_columns(mesh, zip(DEPTH_ATTRIBUTES, columns, strict=True))
    undo.callback(_put_back, mesh, before)


def _write_columns(mesh: bpy.types.Mesh, columns: Iterable[tuple[AttributeKind, NDArray[Any]]]) -> Columns:
    """Write attributes in Object Mode, all or none; returns what stood there."""
    attributes = mesh.attributes
    before: Columns = {}
    try:
        with _choices_kept(mesh):
            for kind, values in columns:
                before[kind] = _column(mesh, kind, values)
                attribute = attributes.get(kind.name) or attributes.new(kind.name, kind.data_type, kind.domain)
                write_values(attribute.data, kind.value, values)
    except BaseException:
        _put_back(mesh, before)
        raise
    mesh.update()
    return before


def _column(mesh: bpy.types.Mesh, kind: AttributeKind, like: NDArray[Any]) -> NDArray[Any] | None:
    """The values of an attribute as they are now, flat like others of it; None when there is none."""
    attribute = mesh.attributes.get(kind.name)
    if attribute is None:
        return None
    values = np.empty_like(like)
    attribute.data.foreach_get(kind.value, values)
    return values


def _put_back(mesh: bpy.types.Mesh, columns: Columns) -> None:
    with _choices_kept(mesh):
        for kind, values in columns.items():
            if values is not None:
                mesh.attributes[kind.name].data.foreach_set(kind.value, values)
            elif kind.name in mesh.attributes:
                mesh.attributes.remove(mesh.attributes[kind.name])
    mesh.update()


@contextmanager
def _choices_kept(mesh: bpy.types.Mesh) -> Iterator[None]:
    """The active attribute, and the colours displayed and rendered, are the same afterwards, unless they are gone.

    Blender remembers the active one by its place, which others take. The first colour attribute of a mesh becomes the
    one displayed and the one rendered: not without being asked.
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


def _write_while_editing(
    mesh: bpy.types.Mesh, depths: list[int], bounds: list[float], colors: list[list[float]]
) -> None:
    import bmesh

    edited = bmesh.from_edit_mesh(mesh)
    # New layers first: making one moves the others.
    with _choices_kept(mesh):
        for kind in DEPTH_ATTRIBUTES:
            layers = _layers(edited, kind)
            if layers.get(kind.name) is None:
                layers.new(kind.name)
    depth_layer, bound_layer, color_layer = (_layers(edited, kind)[kind.name] for kind in DEPTH_ATTRIBUTES)
    # BMesh has no bulk access: a tenth of a second for every hundred thousand faces.
    for face, depth, bound, color in zip(edited.faces, depths, bounds, colors, strict=True):
        face[depth_layer] = depth
        face[bound_layer] = bound
        for corner in face.loops:
            corner[color_layer] = color
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)


def _layers(edited: Any, kind: AttributeKind) -> Any:
    return getattr(getattr(edited, kind.elements).layers, kind.layers)


def write_face_values(mesh: bpy.types.Mesh, columns: dict[AttributeKind, NDArray[np.float32]]) -> None:
    """Write attributes in Object Mode or in Edit Mode.

    columns: (F,) or (F, 4), one value for each face; on CORNER, for all corners of the face alike. Raises WriteError,
    with nothing changed, when Blender does not keep them.
    """
    if mesh.is_editmode:
        for kind, values in columns.items():
            _write_face_values_while_editing(mesh, kind, values.tolist())
        return
    sizes = np.diff(read_values(mesh.polygons, "loop_start", np.int32), append=len(mesh.loops))
    _write_columns(
        mesh,
        [
            (kind, np.repeat(values, sizes, axis=0).ravel() if kind.domain == "CORNER" else values)
            for kind, values in columns.items()
        ],
    )


def _write_face_values_while_editing(mesh: bpy.types.Mesh, kind: AttributeKind, values: list[Any]) -> None:
    import bmesh

    edited = bmesh.from_edit_mesh(mesh)
    with _choices_kept(mesh):
        layers = _layers(edited, kind)
        layer = layers.get(kind.name) or layers.new(kind.name)
    for face, value in zip(edited.faces, values, strict=True):
        for element in face.loops if kind.domain == "CORNER" else (face,):
            element[layer] = value
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)


def read_face_values(mesh: bpy.types.Mesh, kind: AttributeKind) -> NDArray[np.float32]:
    """(F,) float32: one attribute of faces, in Object Mode or in Edit Mode."""
    if not mesh.is_editmode:
        return read_values(mesh.attributes[kind.name].data, kind.value, np.float32)
    import bmesh

    edited = bmesh.from_edit_mesh(mesh)
    layer = _layers(edited, kind)[kind.name]
    return np.array([face[layer] for face in edited.faces], dtype=np.float32)


def show_color(mesh: bpy.types.Mesh, show: bool) -> None:
    """Make our colours the ones displayed, and remember which were; or put those back, if ours are still displayed."""
    record = mesh.ccdepth
    if show == record.active_color_taken:
        return
    attributes = mesh.attributes
    displayed = attributes.active_color_name
    if show:
        record.previous_active_color = "" if displayed == COLOR else displayed
        attributes.active_color_name = COLOR
    elif displayed == COLOR:
        attributes.active_color_name = color_of_user(mesh, displayed)
    record.active_color_taken = show


def keep_from_painting(mesh: bpy.types.Mesh) -> None:
    """See to it that our colours are not the active ones, which are painted on, whoever has made them that."""
    attributes = mesh.attributes
    if attributes.active_color_name == COLOR:
        attributes.active_color_name = color_of_user(mesh, COLOR)
    mesh.ccdepth.active_color_taken = False


def remember_same_colors(source: bpy.types.Mesh, mesh: bpy.types.Mesh) -> None:
    """Let a mesh that modifiers have made of another know which colours were displayed before ours."""
    mesh.ccdepth.active_color_taken = source.ccdepth.active_color_taken
    mesh.ccdepth.previous_active_color = source.ccdepth.previous_active_color


def color_of_user(mesh: bpy.types.Mesh, name: str) -> str:
    """The colours of a mesh without ours that this name stands for: those itself, or if they are ours, those displayed
    before; the first ones when there are none of that name, as with Blender when colours are removed."""
    if name == COLOR and mesh.ccdepth.active_color_taken:
        name = mesh.ccdepth.previous_active_color
    colors = [attribute.name for attribute in mesh.color_attributes if attribute.name != COLOR]
    return name if name in colors or not name else next(iter(colors), "")


def clear(mesh: bpy.types.Mesh) -> None:
    """Remove the attributes and the record, and put the displayed colours back."""
    show_color(mesh, False)
    with _choices_kept(mesh):
        if mesh.is_editmode:
            _remove_layers_while_editing(mesh)
        else:
            for kind in ATTRIBUTES:
                if has_values(mesh, kind):
                    mesh.attributes.remove(mesh.attributes[kind.name])
            mesh.update()
    mesh.property_unset("ccdepth")


def _remove_layers_while_editing(mesh: bpy.types.Mesh) -> None:
    import bmesh

    edited = bmesh.from_edit_mesh(mesh)
    for kind in ATTRIBUTES:
        layers = _layers(edited, kind)
        layer = layers.get(kind.name)
        if layer is not None:
            layers.remove(layer)
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)
