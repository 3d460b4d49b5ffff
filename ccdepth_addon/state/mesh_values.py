# SPDX-License-Identifier: GPL-3.0-or-later
"""Depths and deviations on the mesh: attributes and record, written, read and cleared in Object and in Edit Mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from .. import version
from ..core import FloatArray
from ..exchange.face_values import (
    ANGLE_KIND,
    ATTRIBUTES,
    BOUND_KIND,
    DEPTH_KIND,
    DEVIATION_KIND,
    AttributeKind,
    has_values,
    remove_all,
    remove_values,
    rounded_up,
    write_face_values,
)
from ..tasks.adaptive_task import AdaptiveAnswer, AdaptiveSettings
from ..tasks.depth_task import DepthSettings, MeshDepths
from ..tasks.deviation_task import MeasureSettings, MeshDeviation
from ..tasks.surfaces import VariedSettings, naming
from ..tasks.views import seen_from
from .properties import VariationProperties

# The fields of the record about angles.
ANGLE_FIELDS = ("shading_angle", "facet_angle", "largest_shading_angle", "largest_facet_angle", "narrow_leaves")


class AdaptiveFacts(NamedTuple):
    """The facts of an adaptive mesh from its record. tolerance, proved: lengths in the scene. shading, facets: the
    largest angles proved, in radians; None without such angles."""

    faces: int
    deepest: int
    tolerance: float
    proved: float
    shading: float | None
    facets: float | None

    @classmethod
    def of(cls, mesh: bpy.types.Mesh) -> AdaptiveFacts:
        record = mesh.ccdepth
        shading = record.largest_shading_angle if record.shading_angle else None
        facets = record.largest_facet_angle if record.facet_angle else None
        return cls(record.faces, record.deepest, record.world_tolerance, record.largest_bound, shading, facets)


def has_depths(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds our depths; undo in Edit Mode can remove them and leave their record."""
    return mesh.ccdepth.has_result and has_values(mesh, DEPTH_KIND)


def has_deviation(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds measured deviations."""
    return mesh.ccdepth.has_deviation and has_values(mesh, DEVIATION_KIND)


def has_angles(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds proved angles."""
    is_told = bool(mesh.ccdepth.shading_angle or mesh.ccdepth.facet_angle)
    return has_depths(mesh) and is_told and has_values(mesh, ANGLE_KIND)


def has_any(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh holds depths or deviations."""
    return has_depths(mesh) or has_deviation(mesh)


def is_deviation_last(mesh: bpy.types.Mesh) -> bool:
    """Whether the last values still on the mesh are a measurement's."""
    return has_deviation(mesh) and (mesh.ccdepth.shows_deviation or not has_depths(mesh))


def has_traces(mesh: bpy.types.Mesh) -> bool:
    """Whether there is anything of ours on the mesh to clear."""
    return mesh.ccdepth.has_result or mesh.ccdepth.has_deviation or any(has_values(mesh, kind) for kind in ATTRIBUTES)


def write_depths(holders: Sequence[bpy.types.Object], answers: Sequence[MeshDepths], settings: DepthSettings) -> None:
    """Write answers with their records to the meshes of these objects, all or none. Raises ComputeError."""
    shown = [each.bounds if each.ratios is None else each.ratios * each.world_tolerance for each in answers]
    columns = [{DEPTH_KIND: each.depths, BOUND_KIND: rounded_up(b)} for each, b in zip(answers, shown, strict=True)]
    _write_all(holders, columns)
    for holder, answer in zip(holders, answers, strict=True):
        _write_record(holder.data, answer, settings)


def write_deviations(
    holders: Sequence[bpy.types.Object], answers: Sequence[MeshDeviation], settings: MeasureSettings
) -> None:
    """Write answers with their records to the meshes of these objects, all or none. Raises ComputeError."""
    _write_all(holders, [{DEVIATION_KIND: rounded_up(each.deviations)} for each in answers])
    for holder, answer in zip(holders, answers, strict=True):
        _write_measurement(holder.data, answer, settings)


def _write_all(holders: Sequence[bpy.types.Object], columns: Sequence[Mapping[AttributeKind, NDArray[Any]]]) -> None:
    """Write attributes of faces, (F,) each, to the meshes of objects, all or none. Raises ComputeError when Blender
    does not keep them."""
    with ExitStack() as undo:
        for holder, values in zip(holders, columns, strict=True):
            with naming(holder.name):
                write_face_values(holder.data, values, undo)
        undo.pop_all()


def _write_record(mesh: bpy.types.Mesh, answer: MeshDepths, settings: DepthSettings) -> None:
    record = _new_record(mesh, answer.depths, settings, answer.world_tolerance)
    record.largest_bound = float(rounded_up(answer.bounds).max(initial=0.0))
    if answer.ratios is not None:
        record.largest_ratio = float(rounded_up(answer.ratios).max(initial=0.0))
    record.method = settings.method
    record.vertices, record.follows_objects = answer.vertices, settings.follows_objects
    record.use_modifiers = settings.use_modifiers
    record.exact_faces = int(np.count_nonzero(answer.exact))
    record.faces_left = int(np.count_nonzero(answer.might_need_less))
    record.added_deepest = answer.added_deepest
    record.frames, record.deepest_frame = settings.frames, answer.deepest_frame or 0
    record.uniform_level = answer.uniform_level
    record.quality = answer.quality
    record.uniform_faces = str(answer.uniform_faces)


def write_adaptive(
    mesh: bpy.types.Mesh,
    answer: AdaptiveAnswer,
    settings: AdaptiveSettings,
    depths: NDArray[np.int32],
    proved: FloatArray,
    ratios: FloatArray,
    *,
    has_angles: bool = False,
) -> None:
    """Write depths (F,), and proved distances (F,) where the mesh was made, with its record, in Object Mode. ratios:
    (F,), of the distances to the tolerance at their place; where that varies, the attribute has these times the
    tolerance. has_angles: whether to write the answer's angles, which are proved of an unreduced mesh."""
    bounds, largest_ratio = rounded_up(answer.largest_over_users(proved)), 0.0
    largest_bound = float(bounds.max(initial=0.0))
    if answer.task.surface.varies:
        bounds, largest_ratio = rounded_up(ratios * answer.world_tolerance), float(rounded_up(ratios).max(initial=0.0))
    write_face_values(mesh, {DEPTH_KIND: depths, BOUND_KIND: bounds})
    record = _new_record(mesh, depths, settings, answer.world_tolerance)
    record.subdivision = settings.mode
    record.base_faces = answer.task.surface.control.face_count
    record.largest_bound, record.largest_ratio = largest_bound, largest_ratio
    if has_angles:
        _write_angles(mesh, answer, settings)


def _write_angles(mesh: bpy.types.Mesh, answer: AdaptiveAnswer, settings: AdaptiveSettings) -> None:
    """Write the answer's angles, and the largest ones where each of the two angles counts."""
    record, angles = mesh.ccdepth, rounded_up(answer.adaptive.angles)
    write_face_values(mesh, {ANGLE_KIND: angles})
    is_shaded = answer.task.is_smooth[answer.adaptive.mesh.base_faces] & (settings.shading_angle > 0)
    if is_shaded.any():
        record.shading_angle = settings.shading_angle
        record.largest_shading_angle = float(angles[is_shaded].max())
    if settings.facet_angle and not is_shaded.all():
        record.facet_angle = settings.facet_angle
        record.largest_facet_angle = float(angles[~is_shaded].max())
    record.narrow_leaves = answer.adaptive.narrow_count


def forget_angles(mesh: bpy.types.Mesh) -> None:
    """Remove the angles and their record."""
    remove_values(mesh, ANGLE_KIND)
    for name in ANGLE_FIELDS:
        mesh.ccdepth.property_unset(name)


def _new_record(
    mesh: bpy.types.Mesh, depths: NDArray[np.int32], settings: VariedSettings, world_tolerance: float
) -> bpy.types.PropertyGroup:
    """The mesh's record, with the fields that all results share."""
    record = mesh.ccdepth
    record.has_result = True
    record.subdivision = ""
    record.frames = ""
    record.unreduced_triangles = 0
    record.largest_ratio = 0.0
    forget_angles(mesh)
    record.shows_deviation = False
    _write_inputs(record, settings, world_tolerance, len(depths))
    record.deepest = int(depths.max(initial=0))
    record.rows.clear()
    counts = np.bincount(depths)
    for depth in np.flatnonzero(counts).tolist():
        row = record.rows.add()
        row.depth, row.faces = depth, int(counts[depth])
    return record


def _write_measurement(mesh: bpy.types.Mesh, answer: MeshDeviation, settings: MeasureSettings) -> None:
    """Write the record of the answer to its mesh, which has the attribute."""
    record = mesh.ccdepth
    record.has_deviation = record.shows_deviation = True
    record.deviation = float(rounded_up(answer.proved))
    # Rounded down: the distance is really there.
    record.deviation_reached = -float(rounded_up(-answer.reached))
    record.deviation_facet_angle, record.deviation_shading_angle = answer.facet_angle, answer.shading_angle or 0.0
    found = record.measurement
    found.measured = answer.measured
    # Of its own limit surface there is no other name.
    found.against = "" if answer.holders == [answer.against] else answer.against.name
    _write_inputs(found, settings, answer.tolerance, len(answer.deviations))
    found.factors = answer.factors or (0.0, 0.0)
    found.verdict = answer.verdict.name
    found.accuracy, found.accuracy_met = settings.accuracy, answer.accuracy_met
    found.use_modifiers = settings.use_modifiers
    found.worst_face = answer.worst_face
    found.worst_point = answer.worst_point


def _write_inputs(
    record: bpy.types.PropertyGroup, settings: VariedSettings, world_tolerance: float, faces: int
) -> None:
    of_place = "tolerance", "tolerance_mode", "camera", "camera_frames", "off_screen_scale"
    for name in (*of_place, *VariationProperties.__annotations__):
        setattr(record, name, getattr(settings, name))
    record.seen_from = seen_from(bpy.context.scene, settings, getattr(settings, "frames", ""))
    record.world_tolerance = world_tolerance
    record.version = version()
    record.faces = faces


@dataclass(frozen=True)
class TooDeep:
    """A level with all faces within the tolerance that cannot be set, and the reason.

    fitting: the deepest level that can be set. faces_beyond: the number of faces that need more levels than
    ``fitting``.
    """

    reason: str
    fitting: int
    faces_beyond: int


def too_deep(record: bpy.types.PropertyGroup, face_limit: int) -> TooDeep | None:
    """The reason why the level in the record of a mesh cannot be set; None where the level can."""
    needed, faces = record.uniform_level, int(record.uniform_faces)
    most = bpy.types.SubsurfModifier.bl_rna.properties["levels"].hard_max
    if needed > most:
        reason = f"it needs {needed} levels, and a Subdivision Surface modifier has {most} at most"
    elif faces > face_limit:
        reason = f"{needed} levels would make {faces:,} faces, and the Face Limit is {face_limit:,}"
    else:
        return None
    # After the first level each makes four faces of one.
    fitting = [level for level in range(1, min(needed, most + 1)) if faces >> 2 * (needed - level) <= face_limit]
    deepest = max(fitting, default=0)
    return TooDeep(reason, deepest, sum(row.faces for row in record.rows if row.depth > deepest))


def clear(mesh: bpy.types.Mesh) -> None:
    """Remove the attributes and the record."""
    remove_all(mesh)
    mesh.property_unset("ccdepth")
