# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects → depths of their meshes: what is computed once per mesh, and how several answers are merged.

A mesh used by several objects is measured at the scale of each that no other one dominates, and takes the largest depth
of every face. Nothing here writes to a mesh.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import (
    BoolArray,
    DepthResult,
    FloatArray,
    Progress,
    check_input,
    face_depths,
    needed_quality,
    no_report,
    part_of,
    uniform_level,
)
from ..exchange.control_mesh import (
    NO_ORIGIN,
    ControlMesh,
    SharedMeshes,
    copies_to_measure,
    in_batches,
    mesh_face_count,
    own_mesh,
    read_control_mesh,
)
from ..exchange.mesh_checksums import geometry_checksum
from ..exchange.object_state import KnownDescriptions, ObjectState, object_state
from .stepwise import Stage
from .surfaces import Faults, Surface, SurfaceSettings, control_mesh_key, refuse_bad_tolerance, surface_of, undominated

# The depths' part of the time; the rest is for the level that holds for all faces. Measured: 40 s and 12 s on 90,000
# faces with creases at random.
DEPTHS_SHARE = 0.8


@dataclass(frozen=True)
class DepthSettings(SurfaceSettings):
    """The settings of Compute Depth."""

    method: str
    vertices: str


@dataclass(frozen=True)
class DepthRequest:
    """A surface whose depths are wanted; mesh and tolerance have been checked."""

    surface: Surface
    settings: DepthSettings

    @property
    def face_count(self) -> int:
        """Of the control mesh."""
        return self.surface.control.mesh.face_count

    def depths(self, progress: Progress) -> DepthResult:
        """The depths of its faces."""
        mesh, tolerance, settings = self.surface.control.in_world, self.surface.tolerance, self.settings
        return face_depths(mesh, tolerance, settings.method, settings.vertices, progress, is_checked=True)

    def level(self, result: DepthResult, least: int, progress: Progress) -> int:
        """The first level, from one on, at which all its faces are within the tolerance."""
        mesh, tolerance, settings = self.surface.control.in_world, self.surface.tolerance, self.settings
        return uniform_level(mesh, tolerance, settings.method, settings.vertices, result.depths, least, progress)

    def quality(self, level: int) -> int:
        """The Quality that Use Limit Surface needs at a level, 0 for control vertices."""
        if self.settings.vertices != "LIMIT":
            return 0
        return needed_quality(self.surface.control.in_world, level, self.surface.tolerance)


@dataclass(frozen=True)
class MeshTask:
    """What to compute for one mesh. It keeps no reference to Blender's data, which may move while it runs.

    geometry: the checksum of the mesh, and states: what its objects were like, as they were read. control_meshes: of
    each of the objects. requests: of those that no other dominates, once it is decided.
    """

    mesh_uid: int
    face_count: int
    geometry: int
    object_names: list[str] = field(default_factory=list)
    states: list[ObjectState] = field(default_factory=list)
    control_meshes: list[ControlMesh] = field(default_factory=list)
    requests: list[DepthRequest] = field(default_factory=list)


@dataclass(frozen=True)
class DepthWork:
    """What was read, and with which settings to compute. faults: the objects at fault so far."""

    tasks: list[MeshTask]
    settings: DepthSettings
    faults: Faults

    def decide(self) -> None:
        """Decide which surfaces are measured, and check them. Raises ComputeError, naming every object at fault."""
        for task in self.tasks:
            surfaces: list[Surface] = []
            for name, control in zip(task.object_names, task.control_meshes, strict=True):
                with self.faults.of(name):
                    surfaces.append(surface_of(name, control, self.settings))
            for surface in _undominated(surfaces):
                with self.faults.of(surface.object_name):
                    check_input(surface.control.in_world, surface.tolerance)
                    task.requests.append(DepthRequest(surface, self.settings))
        self.faults.refuse()


@dataclass(frozen=True)
class MeshDepths:
    """The answer for one mesh.

    depths: (F,) int32; bounds: (F,) float64, lengths in the scene. exact: (F,) bool, whether the depth is proved to be
    the least. world_tolerance: the smallest tolerance of its objects, a length. uniform_level: the first level at which
    all faces are within the tolerance; quality: what Use Limit Surface needs there, 0 for control vertices.
    control_faces, control_corners: of the control mesh, the largest one. added_faces: how many faces the modifiers add
    that come from no face of the mesh, and added_deepest, the deepest depth among them. removed_faces: how many of the
    mesh's faces the modifiers take away; their depth and bound are 0.
    """

    task: MeshTask
    depths: NDArray[np.int32]
    bounds: FloatArray
    exact: BoolArray
    world_tolerance: float
    uniform_level: int
    quality: int
    control_faces: int
    control_corners: int
    added_faces: int
    added_deepest: int
    removed_faces: int

    @property
    def deepest(self) -> int:
        return int(self.depths.max(initial=0))

    @property
    def uniform_faces(self) -> int:
        """How many faces the control mesh has when all of it is subdivided to the uniform level."""
        return self.control_faces if self.uniform_level == 0 else self.control_corners * 4 ** (self.uniform_level - 1)


def prepare_depths(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object], settings: DepthSettings
) -> Generator[Stage, None, DepthWork]:
    """Read the objects' meshes: yields the stage, and returns the work to do. Raises ComputeError."""
    refuse_bad_tolerance(settings.tolerance)
    tasks: dict[int, MeshTask] = {}
    shared: SharedMeshes = {}
    faults = Faults(objects)
    modifiers = {"use_modifiers": settings.use_modifiers}
    read = 0
    for batch in in_batches(objects):
        yield Stage(f"Reading objects: {read:,} of {len(objects):,}")
        read += len(batch)
        known: KnownDescriptions = {}
        context.view_layer.update()
        with copies_to_measure(context, batch, **modifiers) as copies:
            for blender_object in batch:
                uid = blender_object.data.session_uid
                with faults.of(blender_object.name):
                    control = read_control_mesh(context, blender_object, **modifiers, shared=shared, copies=copies)
                    if uid not in tasks:
                        tasks[uid] = _new_task(blender_object)
                    tasks[uid].object_names.append(blender_object.name)
                    tasks[uid].control_meshes.append(control)
                    tasks[uid].states.append(object_state(blender_object, **modifiers, known=known))
    return DepthWork(list(tasks.values()), settings, faults)


def _new_task(blender_object: bpy.types.Object) -> MeshTask:
    mesh = blender_object.data
    with own_mesh(blender_object) as own:
        return MeshTask(mesh.session_uid, mesh_face_count(mesh), geometry_checksum(own))


def _undominated(surfaces: list[Surface]) -> list[Surface]:
    """The surfaces of one mesh that no other dominates.

    A dominated surface has the same control mesh, and every vector of it is at most as long, in units of the tolerance:
    its distances are no larger, and neither are its depths.
    """
    alike: dict[bytes, list[Surface]] = {}
    for surface in surfaces:
        alike.setdefault(control_mesh_key(surface.control), []).append(surface)
    return [group[kept] for group in alike.values() for kept in undominated(group)]


def compute_depths(work: DepthWork, progress: Progress = no_report) -> list[MeshDepths]:
    """Measure every surface, without Blender: it may run in a thread.

    progress: is told the fraction done, which only rises, and may raise to stop. Raises ComputeError, naming every
    object at fault.
    """
    work.decide()
    tasks = work.tasks
    total = sum(request.face_count for task in tasks for request in task.requests)
    begun = 0.0
    answers = []
    for task in tasks:
        answer = _Answer(task)
        results = []
        for request in task.requests:
            share = DEPTHS_SHARE * request.face_count / total
            result = request.depths(part_of(progress, begun, share))
            answer.include(request.surface.control, result)
            results.append(result)
            begun += share
        share = (1 - DEPTHS_SHARE) * sum(request.face_count for request in task.requests) / total
        level = _common_level(task.requests, results, part_of(progress, begun, share))
        begun += share
        answers.append(answer.finished(level))
    return answers


def _common_level(requests: list[DepthRequest], results: list[DepthResult], progress: Progress) -> int:
    """The first level at which all faces of all surfaces of a mesh are within the tolerance."""
    level = agreed = 0
    begun = 0.0
    while agreed < len(requests):
        for request, result in zip(requests, results, strict=True):
            # One part is left over for the case that they do not agree.
            share = (1 - begun) / (len(requests) - agreed + 1)
            found = request.level(result, level, part_of(progress, begun, share))
            begun += share
            agreed = agreed + 1 if found == level else 1
            level = found
            if agreed == len(requests):
                break
    return level


class _Answer:
    """The largest depth and bound of every face of a mesh over its surfaces, as they come in."""

    def __init__(self, task: MeshTask) -> None:
        self.task = task
        self.depths = np.zeros(task.face_count, dtype=np.int32)
        self.bounds = np.zeros(task.face_count)
        self.exact = np.ones(task.face_count, dtype=bool)
        self.present = np.zeros(task.face_count, dtype=bool)
        self.control_faces = self.control_corners = self.added_faces = self.added_deepest = 0

    def include(self, control: ControlMesh, result: DepthResult) -> None:
        self.control_faces = max(self.control_faces, control.mesh.face_count)
        self.control_corners = max(self.control_corners, control.mesh.corner_count)
        if control.base_faces is None:
            np.maximum(self.depths, result.depths, out=self.depths)
            np.maximum(self.bounds, result.bounds, out=self.bounds)
            self.exact &= result.exact
            self.present[:] = True
            return
        known = control.base_faces != NO_ORIGIN
        faces = control.base_faces[known]
        np.maximum.at(self.depths, faces, result.depths[known])
        np.maximum.at(self.bounds, faces, result.bounds[known])
        self.exact[faces[~result.exact[known]]] = False
        self.present[faces] = True
        self.added_faces += int(np.count_nonzero(~known))
        self.added_deepest = max(self.added_deepest, int(result.depths[~known].max(initial=0)))

    def finished(self, uniform_level: int) -> MeshDepths:
        return MeshDepths(
            task=self.task,
            depths=self.depths,
            bounds=self.bounds,
            exact=self.exact,
            world_tolerance=min(request.surface.tolerance for request in self.task.requests),
            uniform_level=uniform_level,
            quality=max(request.quality(uniform_level) for request in self.task.requests),
            control_faces=self.control_faces,
            control_corners=self.control_corners,
            added_faces=self.added_faces,
            added_deepest=self.added_deepest,
            removed_faces=int(np.count_nonzero(~self.present)),
        )
