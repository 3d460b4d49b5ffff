# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects → depths of their meshes, computed once per mesh, with merged answers.

A mesh of several objects is measured at the scale of each object that no other dominates, and over frames as on each
frame; every face takes the largest depth. Nothing here writes to a mesh.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import (
    BoolArray,
    FaceDepths,
    FloatArray,
    Progress,
    check_input,
    check_pose,
    common_level,
    deepest_pose,
    no_report,
    part_of,
    pose_depths,
)
from ..exchange.control_mesh import ControlMeshError, SharedMeshes, counted_copies, read_with_origins
from ..exchange.data_blocks import Identity
from ..exchange.dependencies import ObjectState, object_state
from ..exchange.evaluated import in_batches
from ..exchange.mesh_arrays import geometry_checksum, mesh_face_count, own_mesh
from ..exchange.modifiers import OF_OBJECT, shown_vertices
from .frames import frame_restored, typed_frames
from .pose_groups import DepthRequest, PoseGroup, pose_groups
from .surfaces import Faults, VariedSettings
from .views import read_views, surface_of

# The part of the time for depths; the rest is for the level that holds for all faces. Measured: depths take 40 s and
# the rest 12 s on 90,000 faces with creases at random.
DEPTHS_SHARE = 0.8

Part = TypeVar("Part", "MeshTask", PoseGroup)


@dataclass(frozen=True)
class DepthSettings(VariedSettings):
    """The settings of Compute Depth. vertices: CONTROL, LIMIT or OF_OBJECT. frames: as typed; empty for the present
    scene. effort: a name of ``Effort``."""

    method: str
    vertices: str
    frames: str = ""
    effort: str = "NORMAL"

    @property
    def follows_objects(self) -> bool:
        """Whether each object's own modifier decides its vertices."""
        return self.vertices == OF_OBJECT


@dataclass(frozen=True)
class MeshTask:
    """The computation for one mesh, without references to Blender's data, which may move during a run.

    geometry: the checksum of the mesh; holders: its objects; states: of them, when read. read: their surfaces, on each
    frame; groups: once decided, the surfaces that no other dominates.
    """

    mesh_uid: int
    face_count: int
    geometry: int
    holders: list[Identity] = field(default_factory=list)
    states: list[ObjectState] = field(default_factory=list)
    read: list[DepthRequest] = field(default_factory=list)
    groups: list[PoseGroup] = field(default_factory=list)

    @property
    def requests(self) -> list[DepthRequest]:
        """The requests of all groups."""
        return [request for group in self.groups for request in group.requests]

    @property
    def work(self) -> int:
        """The number of faces to compute."""
        return sum(group.work for group in self.groups)

    def largest(self, found: Iterable[FaceDepths]) -> NDArray[np.int32]:
        """(faces of the mesh,): the largest depth of the control faces from each face, over all groups."""
        depths = np.zeros(self.face_count, dtype=np.int32)
        for group, each in zip(self.groups, found, strict=True):
            faces, known = group.origins
            np.maximum.at(depths, faces, each.depths[known])
        return depths


@dataclass(frozen=True)
class DepthWork:
    """The data read, and the settings to compute with. tasks: by the session identifiers of the meshes. faults: the
    objects at fault so far. arrays: of control meshes over frames. seen: by the session identifiers of objects, their
    meshes and numbers of faces."""

    settings: DepthSettings
    faults: Faults
    tasks: dict[int, MeshTask] = field(default_factory=dict)
    arrays: dict[bytes, Any] = field(default_factory=dict)
    seen: dict[int, tuple[int, int]] = field(default_factory=dict)

    def decide(self) -> None:
        """Decide which surfaces are measured, and check them. Raises ComputeError, naming every object at fault."""
        for task in self.tasks.values():
            task.groups.extend(pose_groups(task.read, self.settings.method))
            for group in task.groups:
                for number, request in enumerate(group.requests):
                    check = check_pose if number else check_input
                    with self.faults.of(request.surface.holder.uid, request.frame):
                        check(
                            request.surface.control.in_world,
                            request.surface.tolerance,
                            request.surface.variation_by_face,
                        )
        self.faults.refuse()


@dataclass(frozen=True)
class MeshDepths:
    """The answer for one mesh.

    depths: (F,) int32; bounds: (F,) float64, lengths in the scene; ratios: (F,), of these to the least tolerance of
    each face over objects and frames; None where the tolerance is the same everywhere. exact: (F,) bool, whether the
    depth is proved to be the least; might_need_less: (F,) bool, whether more effort might prove a lesser depth.
    world_tolerance: the smallest tolerance of its objects, a length. uniform_level: the first level at which all faces
    are within the tolerance; quality: the Quality for Use Limit Surface there, 0 for control vertices. uniform_faces:
    the number of faces of the control mesh, the largest one, subdivided to that level. added_faces: the number of faces
    that modifiers add without an origin in the mesh; added_deepest: the deepest depth among them. removed_faces: the
    number of the mesh's faces that modifiers remove, on all frames; their depth and bound are 0. deepest_frame: a frame
    with the deepest depth; None without frames.
    """

    task: MeshTask
    depths: NDArray[np.int32]
    bounds: FloatArray
    ratios: FloatArray | None
    exact: BoolArray
    might_need_less: BoolArray
    world_tolerance: float
    uniform_level: int
    quality: int
    uniform_faces: int
    added_faces: int
    added_deepest: int
    removed_faces: int
    deepest_frame: int | None

    @property
    def deepest(self) -> int:
        return int(self.depths.max(initial=0))

    @property
    def vertices(self) -> str:
        """CONTROL or LIMIT; OF_OBJECT if objects, or frames, have both."""
        kinds = {each.vertices for each in self.task.read}
        return OF_OBJECT if len(kinds) > 1 else kinds.pop()


def prepare_depths(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object], settings: DepthSettings
) -> Generator[str, None, DepthWork]:
    """Read the objects' meshes: yields the stage, and returns the work to do. Raises ComputeError."""
    settings.refuse_bad_numbers()
    work = DepthWork(settings, Faults(objects))
    if not settings.frames:
        yield from _read_objects(context, objects, work, None)
        return work
    scene, frames = context.scene, typed_frames(settings.frames)
    with frame_restored(scene):
        for number, frame in enumerate(frames, start=1):
            yield f"Frame {number:,} of {len(frames):,}"
            scene.frame_set(frame)
            yield from _read_objects(context, objects, work, frame)
    if scene.frame_current not in frames:
        # On this frame changes can be noticed, too.
        for each in objects:
            if each.data.session_uid in work.tasks:
                state = _state(each, settings, scene.frame_current)
                work.tasks[each.data.session_uid].states.append(state)
    return work


def _read_objects(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object], work: DepthWork, frame: int | None
) -> Generator[str, None, None]:
    """Read the present objects, on a frame or without frames."""
    settings, use_modifiers = work.settings, work.settings.use_modifiers
    # Depths with frames of their own are for the camera on each of these.
    views = read_views(context, objects, settings if frame is None else replace(settings, camera_frames="CURRENT"))
    shared: SharedMeshes = {}
    read = 0
    for batch in in_batches(objects):
        if frame is None or read:
            at = "" if frame is None else f"Frame {frame:,}: "
            yield f"{at}Reading objects: {read:,} of {len(objects):,}"
            if frame is not None:
                # Meanwhile the animation may play.
                context.scene.frame_set(frame)
        read += len(batch)
        with counted_copies(context, batch, use_modifiers=use_modifiers) as copies:
            for each in batch:
                with work.faults.of(each.session_uid, frame):
                    control = read_with_origins(each, copies, use_modifiers=use_modifiers, shared=shared)
                    if frame is not None:
                        control = control.with_known_arrays(work.arrays)
                    task = _task_of(each, work)
                    painted = settings.variation_read(each, copies)
                    surface = surface_of(each, control, settings, views, painted)
                    task.read.append(DepthRequest(surface, shown_vertices(each, settings.vertices), frame))
                    task.states.append(_state(each, settings, frame))


def _state(blender_object: bpy.types.Object, settings: DepthSettings, frame: int | None) -> ObjectState:
    """The part of an object's state on a frame on which its depths by these settings depend."""
    with_vertices = settings.follows_objects
    state = object_state(
        blender_object, use_modifiers=settings.use_modifiers, with_vertices=with_vertices, varied=settings
    )
    return replace(state, frame=frame)


def _task_of(blender_object: bpy.types.Object, work: DepthWork) -> MeshTask:
    """The task of the object's mesh. Raises ControlMeshError when the object had another mesh on an earlier frame."""
    holder, count = Identity.of(blender_object), mesh_face_count(blender_object.data)
    is_new = holder.uid not in work.seen
    if work.seen.setdefault(holder.uid, (holder.mesh_uid, count)) != (holder.mesh_uid, count):
        raise ControlMeshError("its mesh changes over the frames, so its faces have no common depths")
    if holder.mesh_uid not in work.tasks:
        with own_mesh(blender_object) as own:
            work.tasks[holder.mesh_uid] = MeshTask(holder.mesh_uid, len(own.polygons), geometry_checksum(own))
    task = work.tasks[holder.mesh_uid]
    if is_new:
        task.holders.append(holder)
    return task


def compute_depths(work: DepthWork, progress: Progress = no_report) -> list[MeshDepths]:
    """Measure every surface, without Blender: it may run in a thread.

    progress: receives the rising fraction done, and may raise to stop. Raises ComputeError, naming every object at
    fault.
    """
    work.decide()
    effort = work.settings.effort
    return [_measured(task, effort, part) for task, part in _with_parts(list(work.tasks.values()), progress)]


def _with_parts(tasks: Sequence[Part], progress: Progress, share: float = 1.0) -> Iterator[tuple[Part, Progress]]:
    """Tasks or groups, each with its part of the progress. share: the part of the time that all of them take, from the
    beginning on."""
    total, begun = sum(each.work for each in tasks), 0.0
    for each in tasks:
        own = share * each.work / total
        yield each, part_of(progress, begun, own)
        begun += own


def _measured(task: MeshTask, effort: str, progress: Progress) -> MeshDepths:
    """Measure the surfaces of a mesh."""
    groups = task.groups
    parts = _with_parts(groups, progress, DEPTHS_SHARE)
    own = [pose_depths(*group.poses, part, effort=effort) for group, part in parts]
    found, before, depths = own, None, task.largest(own)
    # All faces at the largest depth of their base face, raised where that is not enough.
    while before is None or np.any(depths > before):
        raised = zip(groups, found, strict=True)
        found = [group.raised(each, depths, effort, lambda _: progress(DEPTHS_SHARE)) for group, each in raised]
        before, depths = depths, task.largest(found)
    surfaces = [(*group.poses, depths) for group, depths in zip(groups, found, strict=True)]
    level = common_level(surfaces, part_of(progress, DEPTHS_SHARE, 1 - DEPTHS_SHARE), effort=effort)
    return _answer(task, found, level, _deepest_frame(groups, own, effort, progress))


def _deepest_frame(groups: list[PoseGroup], own: list[FaceDepths], effort: str, progress: Progress) -> int | None:
    """The first of the measured frames that has the deepest depth; None without frames."""
    deepest, frames = max(each.depths.max(initial=0) for each in own), []
    for group, found in zip(groups, own, strict=True):
        named = [request.frame for request in group.requests if request.frame is not None]
        if named and found.depths.max(initial=0) == deepest:
            frames.append(named[deepest_pose(*group.poses, found, partial(progress, 1.0), effort=effort)])
    return min(frames, default=None)


def _answer(task: MeshTask, found: list[FaceDepths], level: int, deepest_frame: int | None) -> MeshDepths:
    """The findings for the groups, for the faces of the mesh."""
    bounds, ratios = np.zeros((2, task.face_count))
    exact, might_need_less, present = np.zeros((3, task.face_count), dtype=bool)
    varies = any(each.surface.varies for each in task.read)
    added: dict[int, int] = {}
    added_deepest = 0
    for group, each in zip(task.groups, found, strict=True):
        faces, known = group.origins
        stretch = max(request.stretch for request in group.requests)
        np.maximum.at(bounds, faces, each.bounds[known] * stretch)
        if varies:
            np.maximum.at(ratios, faces, (each.bounds / group.face_tolerances())[known])
        exact[faces[each.exact[known]]] = True
        might_need_less[faces[each.might_need_less[known]]] = True
        present[faces] = True
        for uid in {request.surface.holder.uid for request in group.requests}:
            added[uid] = max(added.get(uid, 0), int(np.count_nonzero(~known)))
        added_deepest = max(added_deepest, int(each.depths[~known].max(initial=0)))
    return MeshDepths(
        task=task,
        depths=task.largest(found),
        bounds=bounds,
        ratios=ratios if varies else None,
        exact=exact | ~present,
        might_need_less=might_need_less & ~exact,
        world_tolerance=min(each.surface.tolerance for each in task.read),
        uniform_level=level,
        quality=max(request.quality(level) for request in task.requests),
        uniform_faces=max(group.control.faces_at(level) for group in task.groups),
        added_faces=sum(added.values()),
        added_deepest=added_deepest,
        removed_faces=int(np.count_nonzero(~present)),
        deepest_frame=deepest_frame,
    )
