# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects → deviations, both ways, between their shown meshes and a limit surface.

One object is measured against its own limit surface; several objects each against the limit surface of the active
object. Nothing here writes to a mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from time import perf_counter

import bpy
import numpy as np

from ..core import (
    Deviation,
    FloatArray,
    IndexArray,
    InvalidMeshError,
    Progress,
    SampledSurface,
    measure_deviation,
    part_of,
    validate,
)
from ..exchange.control_mesh import ControlMeshError, counted_copies, read_with_origins
from ..exchange.data_blocks import Identity
from ..exchange.displayed_mesh import ShownMesh, read_shown_mesh
from ..exchange.evaluated import NO_ORIGIN, is_placed
from ..exchange.mesh_arrays import mesh_face_count
from ..exchange.modifiers import subdivision_modifier
from .surfaces import NOT_PLACED, ComputeError, Faults, Surface, VariedSettings
from .views import Views, read_views, surface_of

# The share of the progress that angles take.
SHARE_OF_ANGLES = 0.2

# The relative rounding of a tolerance less its rounding.
ROUNDED = 1e-15


@dataclass(frozen=True)
class MeasureSettings(VariedSettings):
    """The settings of Measure Deviation. time_limit: in seconds, 0 for none."""

    accuracy: float
    time_limit: float


@dataclass(frozen=True)
class Measured:
    """An object to measure, without references to Blender's data, which may move during a run."""

    holder: Identity
    face_count: int
    shown: ShownMesh

    @property
    def object_name(self) -> str:
        return self.holder.name


@dataclass(frozen=True)
class MeasureTask:
    """A measurement. surface: the limit surface to measure against. location: (3,), of its object. own: whether the
    only measured object is the object of the surface."""

    surface: Surface
    location: FloatArray
    own: bool
    measured: list[Measured]


class Verdict(Enum):
    """Whether a tolerance is met."""

    MET = "within the tolerance"
    NOT_MET = "not within the tolerance"
    UNDECIDED = "whether that is within the tolerance is not decided"


def verdict_of(proved: float, reached: float, tolerance: float) -> Verdict:
    """Whether a tolerance is met, from a proved and a reached distance."""
    if proved <= tolerance:
        return Verdict.MET
    return Verdict.NOT_MET if reached > tolerance else Verdict.UNDECIDED


@dataclass(frozen=True)
class MeshDeviation:
    """The answer for one mesh; distances are lengths in the scene. Where the tolerance varies, each is divided by the
    factor at the point of the surface.

    holders: the measured objects of the mesh, the worst first. against: the object of the limit surface.
    tolerance: as a length. deviations: (F,) float64, proved for each face of the mesh; 0 for a face without shown
    parts. proved: for the whole, with the surface itself and faces added by modifiers. reached: a distance really
    there. out_of_time: whether the time limit ended the measurement. worst_face: the face of the reached distance, or
    ``NO_ORIGIN``. worst_point: (3,), in the scene. facet_angle, shading_angle: the largest angles found at samples
    between triangles, and between their shading, and the limit surface, in radians; None without normals. factors: the
    least and the greatest on the tolerance; None for the same everywhere.
    """

    holders: list[Identity]
    against: Identity
    tolerance: float
    deviations: FloatArray
    proved: float
    reached: float
    accuracy_met: bool
    out_of_time: bool
    worst_face: int
    worst_point: FloatArray
    facet_angle: float
    shading_angle: float | None
    factors: tuple[float, float] | None = None

    @property
    def measured(self) -> str:
        """The name of the worst object."""
        return self.holders[0].name

    @property
    def verdict(self) -> Verdict:
        return verdict_of(self.proved, self.reached, self.tolerance)


def prepare_measurement(
    context: bpy.types.Context,
    objects: list[bpy.types.Object],
    target: bpy.types.Object,
    settings: MeasureSettings,
) -> MeasureTask:
    """Read the shown meshes of the objects, and the control mesh of the target.

    Raises ComputeError, naming every object at fault.
    """
    _refuse_bad_settings(settings)
    own, views = objects == [target], read_views(context, [target], settings)
    faults = Faults(objects if own else [target, *objects])
    with faults.of(target.session_uid):
        task = _read_target(context, target, settings, views, own=own)
    measured = []
    for blender_object in objects:
        with faults.of(blender_object.session_uid):
            if own:
                _refuse_adaptive_mesh(blender_object)
            shown = read_shown_mesh(context, blender_object)
            count = mesh_face_count(blender_object.data)
            measured.append(Measured(Identity.of(blender_object), count, shown))
    faults.refuse()
    return replace(task, measured=measured)


def prepare_targets(
    context: bpy.types.Context, targets: list[bpy.types.Object], settings: MeasureSettings
) -> list[MeasureTask]:
    """Read the control meshes of objects for measurements against their limit surfaces: for each a task without
    measured objects.

    Raises ComputeError, naming every object at fault.
    """
    _refuse_bad_settings(settings)
    faults, views = Faults(targets), read_views(context, targets, settings)
    tasks = []
    for target in targets:
        with faults.of(target.session_uid):
            tasks.append(_read_target(context, target, settings, views, own=False))
    faults.refuse()
    return tasks


def _read_target(
    context: bpy.types.Context, target: bpy.types.Object, settings: MeasureSettings, views: Views, *, own: bool
) -> MeasureTask:
    if not is_placed(context.view_layer, target):
        raise ControlMeshError(f"{NOT_PLACED}, so its place in the scene is not known; show it first")
    with counted_copies(context, [target], use_modifiers=settings.use_modifiers) as copies:
        control = read_with_origins(target, copies, use_modifiers=settings.use_modifiers)
        painted = settings.variation_read(target, copies)
    validate(control.in_world)
    surface = surface_of(target, control, settings, views, painted)
    place = np.array(target.evaluated_get(context.evaluated_depsgraph_get()).matrix_world, dtype=np.float64)
    return MeasureTask(surface, place[:3, 3], own, [])


def _refuse_bad_settings(settings: MeasureSettings) -> None:
    settings.refuse_bad_numbers()
    if not np.isfinite(settings.accuracy) or settings.accuracy <= 0:
        raise ComputeError("The accuracy must be a number greater than zero")


def _refuse_adaptive_mesh(blender_object: bpy.types.Object) -> None:
    """Raise InvalidMeshError for an adaptive mesh, which is no control mesh."""
    if blender_object.data.ccdepth.subdivision and subdivision_modifier(blender_object) is None:
        raise InvalidMeshError(
            "it was made by adaptive subdivision; select the object it was made from as well, as the active one"
        )


def measure(
    task: MeasureTask, settings: MeasureSettings, progress: Progress, *, is_tolerance_enough: bool = False
) -> list[MeshDeviation]:
    """Measure every object of the task, without Blender: it may run in a thread.

    progress: receives the fraction done, and may raise to stop. is_tolerance_enough: whether the verdict about the
    tolerance is enough, which takes far less time than near distances. Raises InvalidMeshError and MemoryError.
    """
    until = perf_counter() + settings.time_limit
    answers: dict[int, MeshDeviation] = {}
    for index, measured in enumerate(task.measured):
        left = None
        if settings.time_limit:
            # Time that one leaves unused goes to the others.
            left = max(0.0, until - perf_counter()) / (len(task.measured) - index)
        share = 1 / len(task.measured)
        part = part_of(progress, index * share, share)
        answer = _measure_one(task, measured, settings, left, part, is_tolerance_enough)
        known = answers.get(measured.holder.mesh_uid)
        answers[measured.holder.mesh_uid] = answer if known is None else _joined(known, answer)
    return list(answers.values())


def _measure_one(
    task: MeasureTask,
    measured: Measured,
    settings: MeasureSettings,
    seconds: float | None,
    progress: Progress,
    is_tolerance_enough: bool,
) -> MeshDeviation:
    shown, control = measured.shown, task.surface.control
    positions, rounding = shown.positions_from(task.location), shown.rounding_from(task.location)
    rounding /= task.surface.least_factor
    # With the rounding the distance is still within the tolerance.
    limit = max(0.0, (1 - ROUNDED) * task.surface.tolerance - rounding)
    found = measure_deviation(
        control.in_world,
        positions,
        shown.triangles.corners,
        accuracy=settings.accuracy,
        time_limit=seconds,
        tolerance=task.surface.tolerance,
        enough=limit if is_tolerance_enough else 0.0,
        limit=limit,
        variation=task.surface.variation(control),
        progress=part_of(progress, 0.0, 1 - SHARE_OF_ANGLES),
    )
    facet_angle, shading_angle = _largest_angles(task, shown, positions, lambda: progress(1 - SHARE_OF_ANGLES))
    sources = [(shown.triangles.faces, found.triangle_bounds)]
    if task.own:
        faces = np.arange(measured.face_count) if control.base_faces is None else control.base_faces
        sources.append((faces, found.face_bounds))
    return MeshDeviation(
        holders=[measured.holder],
        against=task.surface.holder,
        tolerance=task.surface.tolerance,
        deviations=_largest_of_faces(measured.face_count, sources, rounding),
        proved=found.proved + rounding,
        reached=max(0.0, found.reached - rounding),
        accuracy_met=found.accuracy_met,
        out_of_time=found.out_of_time,
        worst_face=_worst_face(task, measured, found),
        worst_point=found.worst_point + task.location,
        facet_angle=facet_angle,
        shading_angle=shading_angle,
        factors=task.surface.factors,
    )


def _largest_angles(
    task: MeasureTask, shown: ShownMesh, positions: FloatArray, tick: Callable[[], None]
) -> tuple[float, float | None]:
    """The largest angles of facets and of shading at samples; None without normals."""
    surface = SampledSurface(task.surface.control.in_world, task.surface.tolerance, tick)
    corners, normals = shown.triangles.corners, shown.normals()
    if normals is None:
        return surface.largest_of_all(positions, corners, [None], tick)[0], None
    facets, shading = surface.largest_of_all(positions, corners, [None, normals], tick)
    return facets, shading


def _largest_of_faces(count: int, sources: list[tuple[IndexArray, FloatArray]], rounding: float) -> FloatArray:
    """(count,): the largest bound of the parts from each face, with the rounding; 0 for a face without parts."""
    largest = np.zeros(count)
    for faces, bounds in sources:
        known = faces != NO_ORIGIN
        np.maximum.at(largest, faces[known], bounds[known] + rounding)
    return largest


def _worst_face(task: MeasureTask, measured: Measured, found: Deviation) -> int:
    """The face of the measured object's mesh at the worst place, or ``NO_ORIGIN``."""
    if not (task.own and found.surface_to_mesh):
        return int(measured.shown.triangles.faces[found.worst_triangle])
    base_faces = task.surface.control.base_faces
    return found.worst_face if base_faces is None else int(base_faces[found.worst_face])


def _joined(one: MeshDeviation, other: MeshDeviation) -> MeshDeviation:
    """The deviations of two objects with one mesh, merged."""
    worst, better = (one, other) if one.reached >= other.reached else (other, one)
    return replace(
        worst,
        holders=worst.holders + better.holders,
        deviations=np.maximum(one.deviations, other.deviations),
        proved=max(one.proved, other.proved),
        accuracy_met=one.accuracy_met and other.accuracy_met,
        out_of_time=one.out_of_time or other.out_of_time,
        facet_angle=max(one.facet_angle, other.facet_angle),
        shading_angle=max(filter(None, (one.shading_angle, other.shading_angle)), default=one.shading_angle),
    )
