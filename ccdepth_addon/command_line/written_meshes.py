# SPDX-License-Identifier: GPL-3.0-or-later
"""The written meshes, read back from the file and measured against their limit surfaces."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ..core import InvalidMeshError, no_report
from ..exchange.blender_calls import CommandError
from ..exchange.control_mesh import ControlMeshError
from ..exchange.data_blocks import Identity
from ..exchange.displayed_mesh import ShownMesh, Triangles, read_shown_mesh
from ..exchange.mesh_arrays import mesh_face_count
from ..exchange.mesh_files import BLEND, CUT_OFF, NO_NAME, WITHOUT_REPEATED, read_back, triangles_in
from ..tasks.deviation_task import Measured, MeasureSettings, MeasureTask, MeshDeviation, measure

STL, PLY, GLB = ".stl", ".ply", ".glb"

# The characters that files replace by underscores in names: no format keeps characters that could end a line; .obj
# files have no spaces, .usd files only letters and digits, in Blender 4.2 only ASCII.
KEPT = (NO_NAME, re.compile(r"[\x00-\x20\x7f]"), re.compile(r"[\W_]+"), re.compile(r"[\W_]+", re.ASCII))

# A normal, three corners and two bytes for whatever one likes; before them, a text and the number of triangles.
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
STL_HEADER = 84


@dataclass(frozen=True)
class Edges:
    """The ways in which triangles lie around the edges of a mesh.

    are_closed: whether each edge has two triangles, or another even number, so that the mesh has no border.
    are_oriented: whether adjacent triangles have the same side outside: along each edge the numbers of triangles one
    way and the other differ by one at most.
    """

    are_closed: bool
    are_oriented: bool

    @classmethod
    def of(cls, triangles: Triangles) -> Edges:
        starts, ends = triangles.corners.ravel(), np.roll(triangles.corners, -1, axis=1).ravel()
        # A triangle with two corners at one vertex has an edge there that is none, and passes the other one twice.
        starts, ends = starts[starts != ends], ends[starts != ends]
        pairs = np.minimum(starts, ends) * len(triangles.positions) + np.maximum(starts, ends)
        _, edges = np.unique(pairs, return_inverse=True)
        turns = np.bincount(edges, weights=np.where(starts < ends, 1.0, -1.0))
        return cls(not np.any(np.bincount(edges) % 2), not np.any(np.abs(turns) > 1))


def shown_triangles(blender_object: bpy.types.Object, path: Path) -> int:
    """The least number of the triangles that the object shows and a file gives back. Raises CommandError."""
    return triangles_in(path, _shown(blender_object).triangles)


def read_written(path: Path, scale: float, written: Mapping[str, int]) -> list[Measured]:
    """The objects in the file, opened in place of the open file. scale: the unit of the file in the unit of the
    surfaces. written: the least number of triangles of each object, by its name. Raises CommandError if the file does
    not hold everything written."""
    suffix = path.suffix.lower()
    if suffix == STL:
        parts = _split(_read_stl(path), written)
    else:
        parts = [_as_measured(each) for each in read_back(path, [*written])]
        if suffix == PLY:
            parts = _split(parts[0], written)
        elif suffix != BLEND:
            parts = _matched(parts, written)
        if suffix == GLB:
            # Such a file has a vertex of its own for every normal and every UV.
            parts = [
                replace(part, shown=replace(part.shown, triangles=_joined(part.shown.triangles))) for part in parts
            ]
    for (name, wanted), part in zip(written.items(), parts, strict=True):
        there = len(part.shown.triangles.corners)
        if there < wanted or (there > wanted and suffix not in WITHOUT_REPEATED):
            raise CommandError(f"it holds {there:,} triangles of “{name}”, which has {wanted:,}; {CUT_OFF}")
    return [replace(part, shown=_scaled(part.shown, scale)) for part in parts]


def _read_stl(path: Path) -> Measured:
    """The triangles of a binary STL file. Blender's own reader leaves out repeated triangles."""
    corners = np.fromfile(path, dtype=STL_TRIANGLE, offset=STL_HEADER)["corners"].reshape(-1, 3).astype(np.float64)
    count = len(corners) // 3
    triangles = _joined(Triangles(corners, np.arange(3 * count).reshape(-1, 3), np.arange(count)))
    return Measured(Identity(0, 0, path.name), count, ShownMesh(triangles, np.eye(3), np.zeros(3)))


def _joined(triangles: Triangles) -> Triangles:
    """The triangles with one vertex for all vertices at equal positions, as these are measured faster."""
    positions, vertices = np.unique(triangles.positions, axis=0, return_inverse=True)
    return replace(triangles, positions=positions, corners=vertices.ravel()[triangles.corners])


def _as_measured(blender_object: bpy.types.Object) -> Measured:
    return Measured(Identity.of(blender_object), mesh_face_count(blender_object.data), _shown(blender_object))


def _shown(blender_object: bpy.types.Object) -> ShownMesh:
    try:
        return read_shown_mesh(bpy.context, blender_object)
    except (ControlMeshError, InvalidMeshError) as fault:
        raise CommandError(f"{blender_object.name}: {fault}") from fault


def _scaled(shown: ShownMesh, scale: float) -> ShownMesh:
    return replace(shown, linear=shown.linear * scale, location=shown.location * scale)


def _split(whole: Measured, written: Mapping[str, int]) -> list[Measured]:
    """The triangles of each object from a file with one mesh, object after object."""
    triangles, wanted = whole.shown.triangles, sum(written.values())
    if len(triangles.corners) != wanted:
        raise CommandError(f"it holds {len(triangles.corners):,} triangles, and {wanted:,} were written; {CUT_OFF}")
    parts, end = [], 0
    for own_count in written.values():
        own = slice(end, end + own_count)
        end += own_count
        normals = None if triangles.normals is None else triangles.normals[own]
        part = Triangles(triangles.positions, triangles.corners[own], triangles.faces[own], normals)
        parts.append(replace(whole, shown=replace(whole.shown, triangles=part)))
    return parts


def _matched(found: list[Measured], written: Mapping[str, int]) -> list[Measured]:
    """The objects of a file by their names, as far as the format keeps them."""
    for pattern in KEPT:
        by_name = {_kept(pattern, each.object_name): each for each in found}
        if len(by_name) == len(found) and by_name.keys() == {_kept(pattern, name) for name in written}:
            return [by_name[_kept(pattern, name)] for name in written]
    raise CommandError("its objects are not those that were written, or their names are alike in this format")


def _kept(pattern: re.Pattern[str], name: str) -> str:
    """The part of a name that a format keeps."""
    return pattern.sub("_", name).strip("_")


def measured_distances(target: MeasureTask, part: Measured, settings: MeasureSettings) -> MeshDeviation:
    """The distances of a part of a file from its surface, near enough for the verdict about the tolerance. Raises
    CommandError if the part cannot be measured."""
    try:
        [answer] = measure(replace(target, measured=[part]), settings, no_report, is_tolerance_enough=True)
    except ValueError as fault:
        raise CommandError(f"what was written cannot be measured: {fault}") from fault
    return answer
