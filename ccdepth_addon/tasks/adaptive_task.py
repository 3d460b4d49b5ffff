# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects → the adaptive meshes to make, and their tolerances with all rounding.

Objects with one mesh get one result together, made for the object that no other dominates by scale and tolerance.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from math import radians, sqrt
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import (
    AdaptiveMesh,
    AdaptiveRequest,
    FloatArray,
    Mode,
    Variation,
    check_tolerance,
    largest_coordinates,
    rounding_allowance,
    smallest_step,
    validate,
)
from ..exchange.blender_arrays import read_values
from ..exchange.control_mesh import (
    ControlMesh,
    ControlMeshError,
    SharedMeshes,
    base_mesh,
    counted_copies,
    gram_matrix,
    read,
)
from ..exchange.custom_normals import smooth_faces
from ..exchange.data_blocks import Identity
from ..exchange.evaluated import Evaluated, in_batches
from ..exchange.modifiers import counted_modifiers, subdivision_modifier
from .surfaces import (
    LARGEST_TOLERANCE,
    ComputeError,
    Faults,
    Surface,
    VariedSettings,
    refuse_bad_angles,
    shortest_decimal,
    surfaces_covering_others,
)
from .views import Views, read_views, surface_of

# The largest relative change of a number by rounding to single precision.
SINGLE_ROUNDING = 2.0**-24

SHAPE_DECIMALS = 6

# The largest angle, in radians, that goes with another tolerance.
LARGEST_ANGLE = radians(89)

# The largest angle, in radians, that a coarser level of detail comes to.
LARGEST_LEVEL_ANGLE = radians(30)


class Level(NamedTuple):
    """A level of detail: its tolerance is that of level 0 times the step to the power of its number."""

    number: int = 0
    step: float = 1.0

    @property
    def factor(self) -> float:
        return self.step**self.number

    def tolerance(self, finest: float) -> float:
        """The tolerance of the level, as typed, from that of level 0."""
        return shortest_decimal(min(finest * self.factor, LARGEST_TOLERANCE))


# The level with the settings as they are.
FINEST = Level()


@dataclass(frozen=True)
class AdaptiveSettings(VariedSettings):
    """The settings of Apply Adaptive Subdivision; ``max_faces`` is for all results together, angles are in radians, and
    longest_edge is a length in the scene, 0 for none."""

    mode: str
    max_faces: int
    shading_angle: float = 0.0
    facet_angle: float = 0.0
    longest_edge: float = 0.0

    def with_angles_times(self, factor: float) -> AdaptiveSettings:
        """The settings with angles times a factor, but less than a right angle."""
        shading, facets = (
            shortest_decimal(min(angle * factor, LARGEST_ANGLE)) for angle in (self.shading_angle, self.facet_angle)
        )
        return replace(self, shading_angle=shading, facet_angle=facets)

    def with_tolerance(self, tolerance: float) -> AdaptiveSettings:
        """The settings with another tolerance, and with angles that go with it: where the tolerance is the height of an
        arc over its chord, the square of the angle is proportional to the tolerance."""
        return replace(self.with_angles_times(sqrt(tolerance / self.tolerance)), tolerance=tolerance)

    def at_level(self, level: Level) -> AdaptiveSettings:
        """The settings of a level of detail. Angles go with the tolerance up to 30°; larger angles stay."""
        if not level.number:
            return self
        coarser = self.with_angles_times(sqrt(level.factor))
        shading, facets = (
            min(angle, max(finest, LARGEST_LEVEL_ANGLE))
            for angle, finest in (
                (coarser.shading_angle, self.shading_angle),
                (coarser.facet_angle, self.facet_angle),
            )
        )
        tolerance = level.tolerance(self.tolerance)
        return replace(coarser, tolerance=tolerance, shading_angle=shading, facet_angle=facets)


class Target(NamedTuple):
    """The object that gets a result. surface: in its place. source: the object to make the result from; the same
    object, unless results are made anew."""

    surface: Surface
    source: Identity

    @property
    def user(self) -> Identity:
        """The object."""
        return self.surface.holder

    @property
    def scale(self) -> FloatArray:
        """(6,): its scale, as AᵀA."""
        return gram_matrix(self.surface.control.world)[np.triu_indices(3)]


@dataclass(frozen=True)
class AdaptiveTask:
    """An adaptive mesh to make, without references to Blender's data, which may move during a run.

    targets: the objects that get it, first the object it is made for; their sources have one mesh.
    dependencies: further data of the objects that the result depends on. surface: of the first target. allowance: the
    rounding of distances there, a length in the scene; stored: its part from storing positions. is_smooth: (F,) whether
    faces of the control mesh are shaded smooth.
    """

    targets: list[Target]
    dependencies: tuple[Any, ...]
    surface: Surface
    allowance: float
    stored: float
    is_smooth: NDArray[np.bool_]

    @property
    def object_names(self) -> list[str]:
        """The names of the objects that get the result."""
        return [target.user.name for target in self.targets]

    @property
    def control(self) -> ControlMesh:
        """The control mesh of the proof."""
        return self.surface.control.thickened()

    def has_angles(self, settings: AdaptiveSettings) -> bool:
        """Whether any angle counts: without smooth faces the shading angle does not."""
        return settings.facet_angle > 0 or (settings.shading_angle > 0 and bool(self.is_smooth.any()))

    @property
    def shape_of_scale(self) -> tuple[float, ...]:
        """The scale of its object but for a factor, rounded; equal scales that round apart make a mesh each."""
        gram = gram_matrix(self.surface.control.world)
        return tuple((gram / max(np.trace(gram), np.finfo(float).tiny)).ravel().round(SHAPE_DECIMALS).tolist())

    @property
    def least_tolerance(self) -> float:
        """The least tolerance accepted, a length in the scene."""
        return max(smallest_step(self.surface.control.in_world), 2 * self.allowance) / self.surface.least_factor

    def longest_edge(self, settings: AdaptiveSettings) -> float:
        """The longest edge where the mesh is made, that its edges are short enough for all of its objects: a length in
        the scene; 0 for any."""
        if not settings.longest_edge:
            return 0.0
        # In an object that is dominated, vectors are no longer, in parts of its tolerance.
        shortest = settings.longest_edge * self.surface.tolerance / max(each.surface.tolerance for each in self.targets)
        rest = shortest - 2 * self.stored
        if rest <= 0:
            raise ComputeError(f"{self.object_names[0]}: the Longest Edge is finer than the mesh's single precision")
        return rest

    def request(self, settings: AdaptiveSettings, tolerance: float, most_faces: int) -> AdaptiveRequest:
        largest = float(np.abs(self.control.mesh.positions).max(initial=0.0))
        return AdaptiveRequest(
            tolerance,
            Mode(settings.mode),
            most_faces,
            self.control.world,
            largest,
            shading=settings.shading_angle if self.is_smooth.any() else 0.0,
            facets=settings.facet_angle,
            is_smooth=self.is_smooth,
            stored=self.stored,
            longest_edge=self.longest_edge(settings),
            rounding=self.allowance,
            variation=self.surface.variation(self.control),
        )


@dataclass(frozen=True)
class AdaptiveAnswer:
    """The answer to a task."""

    task: AdaptiveTask
    adaptive: AdaptiveMesh

    @property
    def world_tolerance(self) -> float:
        """The largest tolerance of its objects, a length in the scene."""
        return max(target.surface.tolerance for target in self.task.targets)

    def largest_over_users(self, bounds: FloatArray) -> FloatArray:
        """(N,) proved distances as lengths in the scene, with all rounding, wherever the result is used."""
        # An object that is dominated has no larger distances, in parts of its tolerance.
        return (bounds + self.task.allowance) * (self.world_tolerance / self.task.surface.tolerance)


def prepare_adaptive(
    context: bpy.types.Context,
    objects: Sequence[bpy.types.Object],
    settings: AdaptiveSettings,
    users: Sequence[bpy.types.Object] | None = None,
) -> Generator[str, None, list[AdaptiveTask]]:
    """Read the objects, in Object Mode, and decide what to make.

    users: for each object the object that gets its result, if another: an object may then come several times, and the
    tolerance holds in the place of its user. Yields the stage, and returns the tasks. Raises ComputeError, naming every
    object at fault.
    """
    settings.refuse_bad_numbers()
    refuse_bad_angles(settings.shading_angle, settings.facet_angle)
    if not 0 <= settings.longest_edge < LARGEST_TOLERANCE:
        raise ComputeError("The Longest Edge must be 0 or more")
    users_of: dict[bpy.types.Object, list[bpy.types.Object]] = {}
    for blender_object, user in zip(objects, users or objects, strict=True):
        users_of.setdefault(blender_object, []).append(user)
    views = read_views(context, list(users or objects), settings)
    tasks: list[AdaptiveTask] = []
    shared: SharedMeshes = {}
    faults = Faults(list(users_of))
    read = 0
    for batch in in_batches(list(users_of)):
        yield f"Reading objects: {read:,} of {len(users_of):,}"
        read += len(batch)
        with counted_copies(context, batch, use_modifiers=settings.use_modifiers) as copies:
            for blender_object in batch:
                with faults.of(blender_object.session_uid):
                    tasks += _read_tasks(blender_object, users_of[blender_object], settings, views, shared, copies)
    faults.refuse()
    return _united(tasks, settings)


def _united(tasks: list[AdaptiveTask], settings: AdaptiveSettings) -> list[AdaptiveTask]:
    """The tasks that no other dominates, each with the objects of its dominated tasks."""
    alike: dict[Any, list[AdaptiveTask]] = {}
    for task in tasks:
        # Another scale that is not even keeps no angles.
        shape = task.shape_of_scale if task.has_angles(settings) else None
        key = task.targets[0].source.mesh_uid, task.dependencies, task.surface.control.key, shape
        alike.setdefault(key, []).append(task)
    kept: dict[int, AdaptiveTask] = {}
    for group in alike.values():
        for better, dominated in surfaces_covering_others([task.surface for task in group]).items():
            task, others = group[better], [group[other] for other in dominated]
            targets = [target for each in (task, *others) for target in each.targets]
            surface = task.surface.within(other.surface for other in others)
            kept[id(task)] = replace(task, targets=targets, surface=surface)
    return [kept[id(task)] for task in tasks if id(task) in kept]


def _read_tasks(
    blender_object: bpy.types.Object,
    users: Sequence[bpy.types.Object],
    settings: AdaptiveSettings,
    views: Views,
    shared: SharedMeshes,
    copies: Evaluated,
) -> list[AdaptiveTask]:
    """The tasks of an object, one for each object that gets the result."""
    control = read(blender_object, copies, use_modifiers=settings.use_modifiers, shared=shared)
    base = base_mesh(blender_object, copies, use_modifiers=settings.use_modifiers)
    steps = _mixing_steps(base.shape_keys)
    largest = _largest_coordinates(control, base.shape_keys)
    painted = settings.variation(blender_object, base, is_own=base == blender_object.data)
    is_smooth = smooth_faces(base)
    return [_task(blender_object, user, control, settings, views, largest, steps, is_smooth, painted) for user in users]


def _task(
    blender_object: bpy.types.Object,
    user: bpy.types.Object,
    control: ControlMesh,
    settings: AdaptiveSettings,
    views: Views,
    largest: FloatArray,
    steps: float,
    is_smooth: NDArray[np.bool_],
    painted: Variation | None,
) -> AdaptiveTask:
    """The task of an object for an object that gets the result. largest: (3,) the largest coordinates; steps: the
    number of roundings of each; is_smooth: (F,) of the control mesh."""
    if user != blender_object:
        control = replace(control, world=np.array(user.matrix_world, dtype=np.float64)[:3, :3])
    surface = surface_of(user, control, settings, views, painted)
    in_world = control.in_world
    validate(in_world)
    stored = float(np.linalg.norm(np.abs(control.world) @ largest)) * SINGLE_ROUNDING * steps
    allowance = rounding_allowance(in_world) + stored
    dependencies = (
        getattr(subdivision_modifier(blender_object), "uv_smooth", None),
        # Modifiers may give each object's mesh other attributes.
        blender_object.session_uid if counted_modifiers(blender_object, use_modifiers=settings.use_modifiers) else 0,
        # Results that do not share a mesh stay apart.
        None if user == blender_object else user.data.session_uid,
        # Objects of one mesh may have materials of their own.
        surface.paint,
    )
    task = AdaptiveTask(
        targets=[Target(surface, Identity.of(blender_object))],
        dependencies=dependencies,
        surface=surface,
        allowance=allowance,
        stored=stored,
        is_smooth=is_smooth,
    )
    check_tolerance(surface.tolerance, task.least_tolerance)
    return task


def _largest_coordinates(control: ControlMesh, keys: bpy.types.Key | None) -> FloatArray:
    """(3,): the largest absolute coordinate along each axis of what the result stores; no point of the surface leaves
    the box of its control points. Raises ControlMeshError for a shape key without such a coordinate."""
    largest = [largest_coordinates(control.mesh)]
    for key in () if keys is None else keys.key_blocks:
        largest.append(np.abs(read_values(key.points, "co", np.float32, 3)).max(axis=0, initial=0.0))
        if not np.isfinite(largest[-1]).all():
            raise ControlMeshError(f"the shape key “{key.name}” has a vertex at no finite position")
    return np.max(largest, axis=0)


def _mixing_steps(keys: bpy.types.Key | None) -> float:
    """The largest number of roundings of the largest coordinate on the way from exact positions to the shown ones.

    Storing rounds once. With shape keys, Blender adds v(k − r) to the mix for each key k, its value v and what it is
    relative to, r: it rounds k, r, their difference twice as large, and the product, all times |v|, and then the sum,
    which is at most 1 + 2Σ|v| as large; on the control mesh, and on the result.
    """
    if keys is None:
        return 1.0
    values = sum(abs(key.value) for key in keys.key_blocks if not key.mute)
    return 2 * (1 + 6 * values + len(keys.key_blocks) * (1 + 2 * values))
