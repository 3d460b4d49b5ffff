# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects → subdivisions of their surfaces: what has to be made once for several objects, how far from the surface its
drawing may be, and how many faces it has. Nothing here writes to a mesh.

Objects that use one mesh get one result together, made for the one that no other outdoes by its scale and tolerance.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, log10
from typing import Any

import bpy
import numpy as np

from .control_mesh import (
    ControlMesh,
    SharedMeshes,
    applied_modifiers,
    base_mesh,
    read_values,
    subdivision_modifier,
)
from .core.adaptive import AdaptiveMesh, Mode, Request, TooManyFacesError, count_faces, subdivide_adaptively
from .core.depth import check_tolerance, rounding_allowance, smallest_tolerance
from .core.mesh import FloatArray, validate
from .core.templates import Transitions
from .surfaces import (
    ComputeError,
    Faults,
    Surface,
    SurfaceSettings,
    as_typed,
    is_outdone,
    refuse_bad_tolerance,
    same_control_mesh,
    surface_of,
)

# Rounding to single precision changes a number by this part of it at most.
SINGLE_ROUNDING = 2.0**-24

# A tolerance said to fit is tried first: this many times what the core estimates, and then so much more each time.
FIRST_TRY, NEXT_TRY = 2.0, 1.4

# Results with more faces than this, and than this many times those of the control mesh, take too long to be tried.
FACES_TRIED, CONTROL_FACES_TRIED = 50_000, 8


@dataclass(frozen=True)
class SubdivisionSettings(SurfaceSettings):
    """What is asked of a subdivision; ``max_faces`` of all results together."""

    mode: str
    transitions: str
    max_faces: int


def subdivision_settings(holder: Any, tolerance: float) -> SubdivisionSettings:
    """The settings that an operator or the scene holds, but for the tolerance."""
    return SubdivisionSettings(
        as_typed(tolerance),
        holder.tolerance_mode,
        holder.use_modifiers,
        holder.mode,
        holder.transitions,
        holder.max_faces,
    )


@dataclass(frozen=True)
class SubdivisionTask:
    """A mesh to make. It keeps no reference to Blender's data, which may move meanwhile.

    object_names: the objects that get it, beginning with the one it is made for. tolerances: of each, lengths in the
    scene. mesh_uid: of their own mesh. carried: what else of the objects the result depends on. surface: the one it is
    made for. allowance: what rounding may add to distances there, a length in the scene.
    """

    object_names: list[str]
    tolerances: list[float]
    mesh_uid: int
    carried: tuple[Any, ...]
    surface: Surface
    allowance: float

    @cached_property
    def control(self) -> ControlMesh:
        """The control mesh where it is proved."""
        return self.surface.control.thickened()

    def request(self, settings: SubdivisionSettings, tolerance: float, most_faces: int) -> Request:
        limit = tolerance - self.allowance
        transitions = Transitions(settings.transitions)
        return Request(limit, Mode(settings.mode), transitions, most_faces, axes=self.control.world)


@dataclass(frozen=True)
class Subdivision:
    """The answer to a task."""

    task: SubdivisionTask
    adaptive: AdaptiveMesh

    @property
    def world_tolerance(self) -> float:
        """The largest of the tolerances in force, a length in the scene."""
        return max(self.task.tolerances)

    @property
    def bounds(self) -> FloatArray:
        """(F,) the proved distances, lengths in the scene, with all rounding, wherever the result is used."""
        # An object that is outdone has no larger distances, in parts of its tolerance.
        return (self.adaptive.bounds + self.task.allowance) * (self.world_tolerance / self.task.surface.tolerance)

    @property
    def uniform_faces(self) -> int:
        """How many faces the control mesh has when all of it is subdivided to the deepest depth."""
        mesh, deepest = self.task.surface.control.mesh, int(self.adaptive.depths.max(initial=0))
        return mesh.face_count if deepest == 0 else mesh.corner_count * 4 ** (deepest - 1)


@dataclass(frozen=True)
class FaceCount:
    """How many faces a result would have, or about how many if they are too many; then ``fitting`` is a tolerance, as
    it is typed, that does not make too many: inf when there is none."""

    faces: int
    fitting: float | None


def prepare_subdivision(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object], settings: SubdivisionSettings
) -> list[SubdivisionTask]:
    """Read the objects, in Object Mode, and decide what to make. Raises ComputeError, naming every object at fault."""
    refuse_bad_tolerance(settings.tolerance)
    tasks: list[SubdivisionTask] = []
    shared: SharedMeshes = {}
    faults = Faults(objects)
    for blender_object in objects:
        with faults.of(blender_object.name):
            tasks.append(_read_task(context, blender_object, settings, shared))
    faults.refuse()
    return _united(tasks)


def _united(tasks: list[SubdivisionTask]) -> list[SubdivisionTask]:
    """The tasks that have to be carried out, each for the objects of those it outdoes as well."""
    kept: list[SubdivisionTask] = []
    for task in sorted(tasks, key=lambda task: -np.trace(task.surface.weighed_gram())):
        better = next((other for other in kept if _outdoes(other, task)), None)
        if better is None:
            kept.append(task)
        else:
            better.object_names.extend(task.object_names)
            better.tolerances.extend(task.tolerances)
    return [task for task in tasks if any(task is other for other in kept)]


def _outdoes(one: SubdivisionTask, other: SubdivisionTask) -> bool:
    """Whether the result of the one serves the objects of the other."""
    return (
        (one.mesh_uid, one.carried) == (other.mesh_uid, other.carried)
        and same_control_mesh(one.surface.control, other.surface.control)
        and is_outdone(other.surface.weighed_gram(), one.surface.weighed_gram())
    )


def _read_task(
    context: bpy.types.Context,
    blender_object: bpy.types.Object,
    settings: SubdivisionSettings,
    shared: SharedMeshes,
) -> SubdivisionTask:
    with base_mesh(context, blender_object, use_modifiers=settings.use_modifiers, shared=shared) as (base, control):
        surface = surface_of(blender_object, control, settings)
        steps = _mixing_steps(base.shape_keys)
        largest = _largest_coordinates(control, base.shape_keys)
    in_world = control.in_world
    validate(in_world)
    stored = float(np.linalg.norm(np.abs(control.world) @ largest)) * SINGLE_ROUNDING * steps
    allowance = rounding_allowance(in_world) + stored
    check_tolerance(surface.tolerance, max(smallest_tolerance(in_world), 2 * allowance))
    modifiers = applied_modifiers(blender_object, use_modifiers=settings.use_modifiers)
    subdivision = subdivision_modifier(blender_object)
    carried = (
        getattr(subdivision, "uv_smooth", None),
        # Modifiers may give each object's mesh other values to carry.
        blender_object.name if any(modifier != subdivision for modifier in modifiers) else "",
    )
    return SubdivisionTask(
        [blender_object.name], [surface.tolerance], blender_object.data.session_uid, carried, surface, allowance
    )


def _largest_coordinates(control: ControlMesh, keys: bpy.types.Key | None) -> FloatArray:
    """(3,): the largest absolute coordinate along each axis of what the result stores; no point of the surface leaves
    the box of its control points."""
    stored = [control.mesh.positions[control.mesh.vertex_face_counts > 0]]
    if keys is not None:
        stored += [read_values(key.points, "co", np.float32, 3) for key in keys.key_blocks]
    return np.max([np.abs(positions).max(axis=0, initial=0.0) for positions in stored], axis=0)


def _mixing_steps(keys: bpy.types.Key | None) -> float:
    """How many times the largest coordinate is rounded, at most, on the way from exact positions to those shown.

    Once, where they are stored. With shape keys, Blender adds v(k − r) to the mix for each key k, its value v and what
    it is relative to, r: it rounds k, r, their difference twice as large, and the product, all times |v|, and then the
    sum, which is at most 1 + 2Σ|v| as large; on the control mesh, and on the result.
    """
    if keys is None:
        return 1.0
    values = sum(abs(key.value) for key in keys.key_blocks if not key.mute)
    return 2 * (1 + 6 * values + len(keys.key_blocks) * (1 + 2 * values))


def subdivide_stepwise(
    tasks: list[SubdivisionTask], settings: SubdivisionSettings
) -> Generator[int, None, list[Subdivision]]:
    """Make every mesh in small steps: yields about how many faces there are so far. Raises ComputeError when they
    become too many."""
    answers: list[Subdivision] = []
    made = 0
    for task in tasks:
        control = task.control
        room = settings.max_faces - made
        request = task.request(settings, task.surface.tolerance, room)
        try:
            adaptive = yield from _raised(subdivide_adaptively(control.in_world, request, control.mesh.positions), made)
            _refuse_too_many(len(adaptive.mesh.base_faces), request)
        except TooManyFacesError as fault:
            fitting = yield from _fitting_tolerance(task, settings, room, fault)
            count = FaceCount(made + fault.faces, fitting)
            raise ComputeError(f"{task.object_names[0]}: {too_many_text(count, settings)}") from fault
        answers.append(Subdivision(task, adaptive))
        made += len(adaptive.mesh.base_faces)
    return answers


def count_stepwise(
    tasks: list[SubdivisionTask], settings: SubdivisionSettings
) -> Generator[int, None, list[FaceCount]]:
    """How many faces every mesh would have, in small steps like ``subdivide_stepwise``."""
    counts: list[FaceCount] = []
    for task in tasks:
        request = task.request(settings, task.surface.tolerance, settings.max_faces)
        try:
            steps = count_faces(task.control.in_world, request)
            faces = yield from _raised(steps, sum(count.faces for count in counts))
            _refuse_too_many(faces, request)
            counts.append(FaceCount(faces, None))
        except TooManyFacesError as fault:
            fitting = yield from _fitting_tolerance(task, settings, settings.max_faces, fault)
            counts.append(FaceCount(fault.faces, fitting))
    return counts


def _raised(steps: Generator[int, None, Any], by: int) -> Generator[int, None, Any]:
    """The same steps, with a number added to what they yield."""
    while True:
        try:
            number = next(steps)
        except StopIteration as finished:
            return finished.value
        yield by + number


def _refuse_too_many(faces: int, request: Request) -> None:
    """The core counts leaves on its way; their faces may turn out to be more than are allowed."""
    if faces > request.most_faces:
        raise TooManyFacesError(faces, request.limit * faces / max(request.most_faces, 1))


def _fitting_tolerance(
    task: SubdivisionTask, settings: SubdivisionSettings, room: int, fault: TooManyFacesError
) -> Generator[int, None, float]:
    """A tolerance, as it is typed, with which the result does not have too many faces; inf if there is none.

    It is found by trying, where that does not take long. Else coarser results are counted, and as many more faces
    expected as the tolerance is finer. Where all faces are split at the same tolerance, their number keeps to that
    within a factor of four, and is on its old course again at a quarter of the tolerance: so it is looked for at what
    lies between, by steps of √2, and is not missed by more than another √2.
    """
    control = task.surface.control
    if control.mesh.face_count > room or not np.isfinite(fault.tolerance):
        return float("inf")
    unit = task.surface.tolerance / settings.tolerance
    tried = min(room, max(FACES_TRIED, CONTROL_FACES_TRIED * control.mesh.face_count))
    fitting = max(fault.tolerance, task.surface.tolerance) * FIRST_TRY * room / tried
    while (yield from _count(task, settings, _with_two_digits(fitting / unit) * unit, tried)) is None:
        fitting *= NEXT_TRY
    if tried < room:
        products = []
        for step in np.sqrt(2.0) ** np.arange(4):
            faces = yield from _count(task, settings, fitting * step, tried)
            products.append(fitting * step * (faces or tried))
        fitting = np.sqrt(2.0) * max(products) / room
    return _with_two_digits(fitting / unit)


def _count(
    task: SubdivisionTask, settings: SubdivisionSettings, tolerance: float, most_faces: int
) -> Generator[int, None, int | None]:
    """How many faces the result would have with another tolerance, None when they are too many."""
    request = task.request(settings, tolerance, most_faces)
    try:
        faces = yield from count_faces(task.control.in_world, request)
    except TooManyFacesError:
        return None
    return faces if faces <= most_faces else None


def _with_two_digits(number: float) -> float:
    """The next larger decimal with two digits."""
    step = floor(log10(number)) - 1
    return float(f"{ceil(number * 10.0**-step)}e{step}")


def too_many_text(count: FaceCount, settings: SubdivisionSettings) -> str:
    """What to tell of a result that has too many faces."""
    assert count.fitting is not None
    text = f"the result would have about {count.faces:,} faces, and {settings.max_faces:,} are allowed"
    if not np.isfinite(count.fitting):
        return f"{text}; no tolerance would fit"
    unit = " of the diagonal" if settings.tolerance_mode == "RELATIVE" else ""
    return f"{text}; a tolerance of {count.fitting:.2g}{unit} would fit"
