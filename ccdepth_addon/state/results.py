# SPDX-License-Identifier: GPL-3.0-or-later
"""The result on the mesh: its attributes and its record, written, read and cleared in Object Mode and in Edit Mode."""

from __future__ import annotations

from contextlib import ExitStack

import bpy
import numpy as np
from numpy.typing import NDArray

from .. import version
from ..core import FloatArray
from ..exchange.result_attributes import (
    ATTRIBUTES,
    BOUND_KIND,
    DEPTH_KIND,
    DEVIATION_KIND,
    has_values,
    remove_all,
    rounded_up,
    write_face_values,
)
from ..tasks.adaptive_task import AdaptiveResult, AdaptiveSettings
from ..tasks.depth_task import DepthSettings, MeshDepths
from ..tasks.reduce_task import ReducedResult, triangle_count
from ..tasks.surfaces import SurfaceSettings


def has_depths(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh has depths, with a record of ours or without."""
    return has_values(mesh, DEPTH_KIND)


def has_result(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds depths of ours; undo in Edit Mode can remove them and leave their record."""
    return mesh.ccdepth.has_result and has_depths(mesh)


def has_deviation(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds measured deviations."""
    return mesh.ccdepth.has_deviation and has_values(mesh, DEVIATION_KIND)


def has_any(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds depths or deviations."""
    return has_result(mesh) or has_deviation(mesh)


def is_deviation_last(mesh: bpy.types.Mesh) -> bool:
    """Whether the last result that is still on the mesh is a measurement."""
    return has_deviation(mesh) and (mesh.ccdepth.shows_deviation or not has_result(mesh))


def has_traces(mesh: bpy.types.Mesh) -> bool:
    """Whether there is anything of ours on the mesh to clear."""
    return mesh.ccdepth.has_result or mesh.ccdepth.has_deviation or any(has_values(mesh, kind) for kind in ATTRIBUTES)


def write_depths(mesh: bpy.types.Mesh, answer: MeshDepths, undo: ExitStack) -> None:
    """Write the answer to its mesh as attributes.

    undo: when it is closed, the mesh has its old attributes again. Raises WriteError, with nothing changed, when
    Blender does not keep them.
    """
    write_face_values(mesh, {DEPTH_KIND: answer.depths, BOUND_KIND: rounded_up(answer.bounds)}, undo)


def write_record(mesh: bpy.types.Mesh, answer: MeshDepths, settings: DepthSettings) -> None:
    """Write the record of the answer to its mesh, which has the attributes."""
    record = _new_record(mesh, answer.depths, settings)
    record.world_tolerance = answer.world_tolerance
    record.largest_bound = float(rounded_up(answer.bounds).max(initial=0.0))
    record.method = settings.method
    record.vertices, record.follows_objects = answer.vertices, settings.follows_objects
    record.use_modifiers = settings.use_modifiers
    record.exact_faces = int(np.count_nonzero(answer.exact))
    record.added_deepest = answer.added_deepest
    record.frames, record.worst_frame = settings.frames, answer.worst_frame or 0
    record.uniform_level = answer.uniform_level
    record.quality = answer.quality
    record.uniform_faces = str(answer.uniform_faces)


def write_adaptive(mesh: bpy.types.Mesh, answer: AdaptiveResult, settings: AdaptiveSettings) -> None:
    """Write depths, bounds and record of an adaptive mesh, in Object Mode."""
    _write_adaptive(mesh, answer, answer.adaptive.depths, answer.bounds, settings)


def write_reduced(mesh: bpy.types.Mesh, reduced: ReducedResult, settings: AdaptiveSettings) -> None:
    """The same for one that was reduced."""
    answer = reduced.unreduced
    _write_adaptive(mesh, answer, reduced.depths, reduced.bounds, settings)
    mesh.ccdepth.unreduced_triangles = triangle_count(answer)


def _write_adaptive(
    mesh: bpy.types.Mesh,
    answer: AdaptiveResult,
    depths: NDArray[np.int32],
    proved: FloatArray,
    settings: AdaptiveSettings,
) -> None:
    bounds = rounded_up(proved)
    write_face_values(mesh, {DEPTH_KIND: depths, BOUND_KIND: bounds})
    record = _new_record(mesh, depths, settings)
    record.subdivision = settings.mode
    record.world_tolerance = answer.world_tolerance
    record.base_faces = answer.task.surface.control.face_count
    record.largest_bound = float(bounds.max(initial=0.0))
    record.uniform_faces = str(answer.uniform_faces)


def _new_record(mesh: bpy.types.Mesh, depths: NDArray[np.int32], settings: SurfaceSettings) -> bpy.types.PropertyGroup:
    """The mesh's record, with what all results have in common."""
    record = mesh.ccdepth
    record.has_result = True
    record.subdivision = ""
    record.frames = ""
    record.unreduced_triangles = 0
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


def clear(mesh: bpy.types.Mesh) -> None:
    """Remove the attributes and the record."""
    remove_all(mesh)
    mesh.property_unset("ccdepth")
