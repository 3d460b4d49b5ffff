# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects → depths of their meshes: what is computed once per mesh, and how several answers are merged.

A mesh used by several objects is measured at the scale of each that no other one dominates, and over frames as it is on
each of them; every face takes the largest depth. Nothing here writes to a mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import (
    BoolArray,
    FloatArray,
    IndexArray,
    PolygonMesh,
    Pose,
    PoseDepths,
    Progress,
    check_input,
    check_pose,
    common_level,
    needed_quality,
    no_report,
    part_of,
    pose_depths,
    raised_depths,
    worst_pose,
)
from ..exchange.control_mesh import (
    ControlMesh,
    ControlMeshError,
    MeshAsRead,
    MovedMesh,
    SharedMeshes,
    moved_mesh,
    read_control_mesh,
)
from ..exchange.frozen_copies import NO_ORIGIN, frozen_copies, in_batches
from ..exchange.mesh_arrays import mesh_face_count, own_mesh
from ..exchange.mesh_checksums import Topology, geometry_checksum
from ..exchange.modifiers import OF_OBJECT, counted_modifiers, shown_vertices
from ..exchange.object_state import KnownDescriptions, ObjectState, StateAtFrame, object_state
from .frames import frame_restored, typed_frames
from .surfaces import (
    Faults,
    Surface,
    SurfaceSettings,
    control_mesh_key,
    refuse_bad_tolerance,
    surface_of,
    undominated,
)

# The depths' part of the time; the rest is for the level that holds for all faces. Measured: 40 s and 12 s on 90,000
# faces with creases at random.
DEPTHS_SHARE = 0.8

# Of the rest, the level's part; what is left is for the worst frame.
LEVEL_SHARE = 0.7


@dataclass(frozen=True)
class DepthSettings(SurfaceSettings):
    """The settings of Compute Depth. vertices: CONTROL, LIMIT or OF_OBJECT. frames: as they are typed; empty for the
    scene as it is."""

    method: str
    vertices: str
    frames: str = ""

    @property
    def follows_objects(self) -> bool:
        """Whether each object's own modifier says where the vertices are."""
        return self.vertices == OF_OBJECT


@dataclass(frozen=True)
class DepthRequest:
    """A surface whose depths are wanted; mesh and tolerance have been checked.

    settings: with vertices CONTROL or LIMIT. frame: None for the scene as it is. stretch: how many times as long as its
    own the longest tolerance of the surfaces is that it dominates: their distances may be so much longer.
    """

    surface: Surface
    settings: DepthSettings
    frame: int | None = None
    stretch: float = 1.0

    @property
    def face_count(self) -> int:
        """Of the control mesh."""
        return self.surface.control.face_count

    def quality(self, level: int) -> int:
        """The Quality that Use Limit Surface needs at a level, 0 for control vertices."""
        if self.settings.vertices != "LIMIT":
            return 0
        return needed_quality(self.surface.control.in_world, level, self.surface.tolerance)


@dataclass(frozen=True)
class PoseGroup:
    """Requests whose control meshes have the same faces, which come from the same faces of the mesh: poses of one."""

    requests: list[DepthRequest]

    @property
    def control(self) -> ControlMesh:
        """The first one."""
        return self.requests[0].surface.control

    @property
    def work(self) -> int:
        """How many faces there are to compute."""
        return sum(request.face_count for request in self.requests)

    def poses(self) -> list[Pose]:
        return [Pose(self._maker(request.surface.control), request.surface.tolerance) for request in self.requests]

    def _maker(self, control: ControlMesh) -> Callable[[], PolygonMesh]:
        # Turned in the same way, poses that are alike have the same bounds.
        return lambda: (control if len(self.requests) == 1 else control.unturned()).in_world

    def depths(self, progress: Progress) -> PoseDepths:
        return pose_depths(self.poses(), *self._kinds(), progress)

    def raised(self, found: PoseDepths, floors: NDArray[np.int32], progress: Progress) -> PoseDepths:
        """For no lesser depths than those of the faces of the mesh: (faces of the mesh,) int32."""
        return raised_depths(self.poses(), *self._kinds(), found, self.floors(floors, found), progress)

    def floors(self, floors: NDArray[np.int32], found: PoseDepths) -> NDArray[np.int32]:
        """(F,): the depths of the faces that the control mesh's come from, or their own."""
        faces = self.control.base_faces
        if faces is None:
            return floors
        return np.where(faces == NO_ORIGIN, found.depths, floors[faces])

    def level(self, found: PoseDepths, least: int, progress: Progress) -> int:
        """The first level, from one on, at which all faces are within the tolerance in all poses."""
        return common_level(self.poses(), *self._kinds(), found, least, progress)

    def worst(self, found: PoseDepths, progress: Progress) -> WorstFrame | None:
        """The worst frame, None without frames."""
        if self.requests[0].frame is None:
            return None
        worst = worst_pose(self.poses(), *self._kinds(), found, progress)
        return WorstFrame(worst.depth, worst.share, -(self.requests[worst.pose].frame or 0))

    def _kinds(self) -> tuple[str, str]:
        settings = self.requests[0].settings
        return settings.method, settings.vertices


class WorstFrame(NamedTuple):
    """The depth and the distance as a part of the tolerance by which a frame is the worst; the frame with its sign
    turned, so that of several alike the largest of these tuples is that of the first frame."""

    depth: int
    share: float
    turned_frame: int

    @property
    def frame(self) -> int:
        return -self.turned_frame


class ReadMesh(NamedTuple):
    """The control mesh of an object and its vertices, CONTROL or LIMIT, as they were read on a frame; None for the
    scene as it is."""

    object_name: str
    frame: int | None
    control: ControlMesh
    vertices: str


@dataclass(frozen=True)
class MeshTask:
    """What to compute for one mesh. It keeps no reference to Blender's data, which may move while it runs.

    geometry: the checksum of the mesh, arrays: the mesh itself, where it is the control mesh, and states: what its
    objects were like, as they were read. read: the control meshes of the objects, on each frame. tolerances: of all of
    them, and groups: of those that no other dominates, once it is decided.
    """

    mesh_uid: int
    face_count: int
    geometry: int
    arrays: PolygonMesh | None = None
    object_names: list[str] = field(default_factory=list)
    states: list[StateAtFrame] = field(default_factory=list)
    read: list[ReadMesh] = field(default_factory=list)
    tolerances: list[float] = field(default_factory=list)
    groups: list[PoseGroup] = field(default_factory=list)

    @property
    def requests(self) -> list[DepthRequest]:
        """What is computed: of all groups."""
        return [request for group in self.groups for request in group.requests]

    def add(self, read: ReadMesh) -> None:
        """Add a control mesh; one that is like an earlier one of the object shares its arrays."""
        tried: set[tuple[int, int]] = set()
        for earlier in reversed(self.read):
            kind = _kind(earlier.control)
            if earlier.object_name != read.object_name or kind in tried:
                continue
            tried.add(kind)
            control = _like(earlier.control, read.control)
            if control is not None:
                read = read._replace(control=control)
                break
        self.read.append(read)


@dataclass(frozen=True)
class DepthWork:
    """What was read, and with which settings to compute. faults: the objects at fault so far."""

    tasks: list[MeshTask]
    settings: DepthSettings
    faults: Faults

    def decide(self) -> None:
        """Decide which surfaces are measured, and check them. Raises ComputeError, naming every object at fault."""
        for task in self.tasks:
            requests: list[DepthRequest] = []
            for read in task.read:
                with self.faults.of(read.object_name, read.frame):
                    surface = surface_of(read.object_name, read.control, self.settings)
                    settings = replace(self.settings, vertices=read.vertices)
                    requests.append(DepthRequest(surface, settings, read.frame))
                    task.tolerances.append(surface.tolerance)
            task.groups.extend(PoseGroup(group) for group in _poses_of_one(_undominated(requests)))
            for group in task.groups:
                for number, request in enumerate(group.requests):
                    check = check_pose if number else check_input
                    with self.faults.of(request.surface.object_name, request.frame):
                        check(request.surface.control.in_world, request.surface.tolerance)
        self.faults.refuse()


@dataclass(frozen=True)
class MeshDepths:
    """The answer for one mesh.

    depths: (F,) int32; bounds: (F,) float64, lengths in the scene. exact: (F,) bool, whether the depth is proved to be
    the least. world_tolerance: the smallest tolerance of its objects, a length. uniform_level: the first level at which
    all faces are within the tolerance; quality: what Use Limit Surface needs there, 0 for control vertices.
    control_faces, control_corners: of the control mesh, the largest one. added_faces: how many faces the modifiers add
    that come from no face of the mesh, and added_deepest, the deepest depth among them. removed_faces: how many of the
    mesh's faces the modifiers take away, on all frames; their depth and bound are 0. worst_frame: the one with the
    deepest depth, or where several have it, in which such a face is the farthest off; None without frames.
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
    worst_frame: int | None = None

    @property
    def deepest(self) -> int:
        return int(self.depths.max(initial=0))

    @property
    def vertices(self) -> str:
        """CONTROL or LIMIT; OF_OBJECT where objects, or frames, have both."""
        kinds = {read.vertices for read in self.task.read}
        return OF_OBJECT if len(kinds) > 1 else kinds.pop()

    @property
    def uniform_faces(self) -> int:
        """How many faces the control mesh has when all of it is subdivided to the uniform level."""
        return self.control_faces if self.uniform_level == 0 else self.control_corners * 4 ** (self.uniform_level - 1)


def prepare_depths(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object], settings: DepthSettings
) -> Generator[str, None, DepthWork]:
    """Read the objects' meshes: yields the stage, and returns the work to do. Raises ComputeError."""
    refuse_bad_tolerance(settings.tolerance)
    tasks: dict[int, MeshTask] = {}
    faults = Faults(objects)
    if not settings.frames:
        yield from _read_objects(context, objects, settings, tasks, faults, None)
        return DepthWork(list(tasks.values()), settings, faults)
    scene, frames = context.scene, typed_frames(settings.frames)
    with frame_restored(scene):
        for number, frame in enumerate(frames, start=1):
            yield f"Frame {number:,} of {len(frames):,}"
            scene.frame_set(frame)
            yield from _read_objects(context, objects, settings, tasks, faults, frame)
    if scene.frame_current not in frames:
        _note_states(tasks, objects, settings, scene.frame_current)
    return DepthWork(list(tasks.values()), settings, faults)


def _read_objects(
    context: bpy.types.Context,
    objects: Sequence[bpy.types.Object],
    settings: DepthSettings,
    tasks: dict[int, MeshTask],
    faults: Faults,
    frame: int | None,
) -> Generator[str, None, None]:
    """Read the objects as they are now, on a frame or without any."""
    modifiers = {"use_modifiers": settings.use_modifiers}
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
        known: KnownDescriptions = {}
        context.view_layer.update()
        with frozen_copies(context, {each: counted_modifiers(each, **modifiers) for each in batch}) as copies:
            for blender_object in batch:
                with faults.of(blender_object.name, frame):
                    control = read_control_mesh(context, blender_object, **modifiers, shared=shared, copies=copies)
                    task = _task_of(blender_object, control, tasks)
                    vertices = shown_vertices(blender_object, settings.vertices)
                    task.add(ReadMesh(blender_object.name, frame, control, vertices))
                    task.states.append(StateAtFrame(_state(blender_object, settings, known), frame))


def _note_states(
    tasks: dict[int, MeshTask], objects: Sequence[bpy.types.Object], settings: DepthSettings, frame: int
) -> None:
    """Note what the objects are like on a frame that was not computed, so that changes can be told there."""
    known: KnownDescriptions = {}
    for blender_object in objects:
        if blender_object.data.session_uid in tasks:
            state = _state(blender_object, settings, known)
            tasks[blender_object.data.session_uid].states.append(StateAtFrame(state, frame))


def _state(blender_object: bpy.types.Object, settings: DepthSettings, known: KnownDescriptions) -> ObjectState:
    """The state of an object, as far as its depths by these settings depend on it."""
    return object_state(
        blender_object, use_modifiers=settings.use_modifiers, with_vertices=settings.follows_objects, known=known
    )


def _task_of(blender_object: bpy.types.Object, control: ControlMesh, tasks: dict[int, MeshTask]) -> MeshTask:
    """The task of the object's mesh, of which a control mesh was just read.

    Raises ControlMeshError when the object had another mesh on an earlier frame.
    """
    mesh = blender_object.data
    for task in tasks.values():
        if blender_object.name in task.object_names and (
            task.mesh_uid != mesh.session_uid or task.face_count != mesh_face_count(mesh)
        ):
            raise ControlMeshError("it does not keep its mesh over the frames, so depths of its faces cannot be told")
    if mesh.session_uid not in tasks:
        arrays = control.own_arrays
        with own_mesh(blender_object) as own:
            geometry = geometry_checksum(own, None if arrays is None else Topology.of(arrays))
        tasks[mesh.session_uid] = MeshTask(mesh.session_uid, mesh_face_count(mesh), geometry, arrays)
    task = tasks[mesh.session_uid]
    if blender_object.name not in task.object_names:
        task.object_names.append(blender_object.name)
    return task


def _like(earlier: ControlMesh, later: ControlMesh) -> ControlMesh | None:
    """The later control mesh with the arrays of an earlier one, if it is like it but for its positions."""
    faces, others = earlier.base_faces, later.base_faces
    if (faces is None) != (others is None):
        return None
    if faces is not None and others is not None and not np.array_equal(faces, others):
        return None
    if earlier.read is later.read:
        return replace(later, base_faces=faces)
    first = _first(earlier)
    assert isinstance(later.read, MeshAsRead)
    moved = moved_mesh(first, later.read)
    if moved is None:
        return None
    for same, positions in ((first, first.arrays.positions), (earlier.read, _positions(earlier.read))):
        if np.array_equal(positions, moved.positions):
            return replace(later, read=same, base_faces=faces)
    return replace(later, read=moved, base_faces=faces)


def _first(control: ControlMesh) -> MeshAsRead:
    return control.read if isinstance(control.read, MeshAsRead) else control.read.first


def _kind(control: ControlMesh) -> tuple[int, int]:
    """Equal for poses of one control mesh."""
    return id(_first(control)), id(control.base_faces)


def _positions(read: MeshAsRead | MovedMesh) -> NDArray[Any]:
    return read.arrays.positions if isinstance(read, MeshAsRead) else read.positions


def _undominated(requests: list[DepthRequest]) -> list[DepthRequest]:
    """The requests of one mesh that no other dominates.

    A dominated surface has the same control mesh and kind of vertices, and every vector of it is at most as long, in
    units of the tolerance: its distances are no larger, and neither are its depths.
    """
    if len(requests) < 2:
        return requests
    kept = []
    for group in _with_equal_meshes(requests):
        for own, others in undominated([each.surface for each in group]).items():
            tolerance = group[own].surface.tolerance
            longest = max([tolerance, *(group[place].surface.tolerance for place in others)])
            # Without extent there is none, which is refused later.
            kept.append(replace(group[own], stretch=longest / tolerance if tolerance > 0 else 1.0))
    return kept


def _with_equal_meshes(requests: list[DepthRequest]) -> Iterator[list[DepthRequest]]:
    """The requests in groups with equal control meshes and vertices. Mostly sums of coordinates tell meshes apart, in
    less time than keys."""
    for some in _grouped(
        requests, lambda request: (request.settings.vertices, _sum_of_coordinates(request.surface.control.read))
    ):
        if len(some) == 1:
            yield some
        else:
            yield from _grouped(some, lambda request: control_mesh_key(request.surface.control))


def _grouped(requests: list[DepthRequest], kind: Callable[[DepthRequest], Hashable]) -> Iterable[list[DepthRequest]]:
    """The requests in groups of one kind, in the order of the first of each."""
    groups: dict[Hashable, list[DepthRequest]] = {}
    for request in requests:
        groups.setdefault(kind(request), []).append(request)
    return groups.values()


# Positions that are not finite are found and refused later.
@np.errstate(all="ignore")
def _sum_of_coordinates(read: MeshAsRead | MovedMesh) -> float:
    return float(_positions(read).sum(dtype=np.float64))


def _poses_of_one(requests: list[DepthRequest]) -> list[list[DepthRequest]]:
    """The requests in groups whose control meshes are poses of one, with the same kind of vertices, in the order of
    their frames."""
    groups = _grouped(requests, lambda request: (request.settings.vertices, _kind(request.surface.control)))
    return [sorted(group, key=lambda request: request.frame or 0) for group in groups]


def compute_depths(work: DepthWork, progress: Progress = no_report) -> list[MeshDepths]:
    """Measure every surface, without Blender: it may run in a thread.

    progress: is told the fraction done, which only rises, and may raise to stop. Raises ComputeError, naming every
    object at fault.
    """
    work.decide()
    total = sum(group.work for task in work.tasks for group in task.groups)
    begun = 0.0
    answers = []
    for task in work.tasks:
        share = sum(group.work for group in task.groups) / total
        answers.append(_answer(task, part_of(progress, begun, share)))
        begun += share
    return answers


def _answer(task: MeshTask, progress: Progress) -> MeshDepths:
    """Measure the surfaces of a mesh."""
    answer = _Answer(task)
    begun, total = 0.0, sum(group.work for group in task.groups)
    for group in task.groups:
        share = DEPTHS_SHARE * group.work / total
        answer.include(group.depths(part_of(progress, begun, share)))
        begun += share
    answer.raise_all(partial(_stay, progress, begun))
    level_share = LEVEL_SHARE * (1 - DEPTHS_SHARE)
    level = _common_level(task.groups, answer.found, part_of(progress, DEPTHS_SHARE, level_share))
    begun = DEPTHS_SHARE + level_share
    worst = []
    for group, found in zip(task.groups, answer.own, strict=True):
        share = (1 - DEPTHS_SHARE - level_share) * group.work / total
        worst.append(group.worst(found, part_of(progress, begun, share)))
        begun += share
    return answer.finished(level, max(filter(None, worst), default=None))


def _stay(progress: Progress, done: float, _fraction: float) -> None:
    """Progress of what mostly takes no time."""
    progress(done)


def _common_level(groups: list[PoseGroup], found: list[PoseDepths], progress: Progress) -> int:
    """The first level at which all faces of all surfaces of a mesh are within the tolerance."""
    level = agreed = 0
    begun = 0.0
    while agreed < len(groups):
        for group, depths in zip(groups, found, strict=True):
            # One part is left over for the case that they do not agree.
            share = (1 - begun) / (len(groups) - agreed + 1)
            needed = group.level(depths, level, part_of(progress, begun, share))
            begun += share
            agreed = agreed + 1 if needed == level else 1
            level = needed
            if agreed == len(groups):
                break
    return level


class _Answer:
    """The depths of the faces of a mesh over its surfaces, as they come in.

    own: what the groups need; found: the same, raised to what the faces need that theirs come from.
    """

    def __init__(self, task: MeshTask) -> None:
        self.task = task
        self.own: list[PoseDepths] = []
        self.found: list[PoseDepths] = []
        self.depths = np.zeros(task.face_count, dtype=np.int32)

    def include(self, found: PoseDepths) -> None:
        group = self.task.groups[len(self.found)]
        self.own.append(found)
        self.found.append(found)
        faces, known = _origins(group)
        np.maximum.at(self.depths, faces, found.depths[known])

    def raise_all(self, progress: Progress) -> None:
        """Find what is proved of all faces at the largest depth of the face they come from, raised where it is not
        enough."""
        before = None
        while before is None or np.any(self.depths > before):
            before = self.depths.copy()
            for number, group in enumerate(self.task.groups):
                found = self.found[number] = group.raised(self.found[number], self.depths, progress)
                faces, known = _origins(group)
                np.maximum.at(self.depths, faces, found.depths[known])

    def finished(self, uniform_level: int, worst: WorstFrame | None) -> MeshDepths:
        task = self.task
        bounds, exact = np.zeros(task.face_count), np.zeros(task.face_count, dtype=bool)
        present = np.zeros(task.face_count, dtype=bool)
        added: dict[str, int] = {}
        added_deepest = 0
        for group, found in zip(task.groups, self.found, strict=True):
            faces, known = _origins(group)
            stretch = max(request.stretch for request in group.requests)
            np.maximum.at(bounds, faces, found.bounds[known] * stretch)
            exact[faces[found.exact[known]]] = True
            present[faces] = True
            for name in {request.surface.object_name for request in group.requests}:
                added[name] = max(added.get(name, 0), int(np.count_nonzero(~known)))
            added_deepest = max(added_deepest, int(found.depths[~known].max(initial=0)))
        controls = [group.control for group in task.groups]
        return MeshDepths(
            task=task,
            depths=self.depths,
            bounds=bounds,
            exact=exact | ~present,
            world_tolerance=min(task.tolerances),
            uniform_level=uniform_level,
            quality=max(request.quality(uniform_level) for request in task.requests),
            control_faces=max(control.face_count for control in controls),
            control_corners=max(control.corner_count for control in controls),
            added_faces=sum(added.values()),
            added_deepest=added_deepest,
            removed_faces=int(np.count_nonzero(~present)),
            worst_frame=None if worst is None else worst.frame,
        )


def _origins(group: PoseGroup) -> tuple[IndexArray, BoolArray]:
    """The faces of the mesh that those of a control mesh come from, and (F,) bool which come from one."""
    faces = group.control.base_faces
    if faces is None:
        return np.arange(group.control.face_count), np.ones(group.control.face_count, dtype=bool)
    known = faces != NO_ORIGIN
    return faces[known], known
