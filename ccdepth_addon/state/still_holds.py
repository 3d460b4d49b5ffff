# SPDX-License-Identifier: GPL-3.0-or-later
"""Checksums of the inputs of depths and measurements in their records, and whether these still hold."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import FloatArray
from ..exchange.dependencies import ObjectState, compared, object_state, shown_checksum
from ..exchange.evaluated import is_placed
from ..exchange.face_values import DEPTH, DEPTH_KIND, DEVIATION_KIND, AttributeKind, has_values, read_face_values
from ..exchange.mesh_arrays import continued, geometry_checksum, mesh_face_count, own_checksum
from ..exchange.modifiers import shown_modifiers
from . import mesh_values

# The change since a measurement that depends on other data, of which nothing is known from before the file was opened.
UNCHECKED = "not checked since opening"

# The largest relative drift of an object's scale by rounding while the object is turned.
SCALE_DRIFT = 1e-5

# Scales nearer to each other than this part of the drift are recorded once.
CELL_SIZE = 0.1

# The largest drift of a placement by rounding while both objects are moved together, in parts of the largest number.
DRIFT = 2e-6


class Examination(NamedTuple):
    """Whether the mesh, or an object of the computation, has changed; the users of the mesh without depths of their
    own: new objects, and objects that changed; and whether other data may have changed before the file was opened."""

    has_changed: bool
    uncovered: list[bpy.types.Object]
    is_unchecked: bool = False


# Of depths that cannot be examined.
STALE = Examination(True, [])


class MeasuredState(NamedTuple):
    """The inputs of a measurement: checksums of the measured object's mesh and of everything else, and the place of the
    object relative to the limit surface."""

    geometry: int
    others: list[str]
    placement: FloatArray


def remember_depths(
    mesh: bpy.types.Mesh, geometry: int, depths: NDArray[np.int32], states: Iterable[ObjectState]
) -> None:
    """Write the inputs of new depths to the mesh's record.

    geometry: the checksum of the computed mesh. depths: (F,) int32, as written. states: of the objects of the
    computation, when read, on each frame.
    """
    record = mesh.ccdepth
    record.fingerprint = f"{continued(geometry, DEPTH, depths):08x}"
    record.contributors.clear()
    # Many objects of one scale make one contributor.
    distinct = {(each.frame, each.checksum, *_cell(each.scale)): each for each in states}
    for each in distinct.values():
        contributor = record.contributors.add()
        contributor.gram, contributor.checksum, contributor.frame = each.scale, each.checksum, each.frame or 0


def _cell(scale: FloatArray) -> tuple[float, ...]:
    """A key for scales (6,), mostly equal for scales that differ by rounding alone."""
    exponent = int(np.frexp(np.abs(scale).max())[1])
    return exponent, *np.rint(np.ldexp(scale, -exponent) / (SCALE_DRIFT * CELL_SIZE)).tolist()


def mesh_checksum(blender_object: bpy.types.Object) -> str:
    """A checksum of the object's own mesh, as far as its surface depends on it, and of the depths."""
    return _with_values(own_checksum(blender_object, geometry_checksum), blender_object.data, DEPTH_KIND)


def _with_values(geometry: int, mesh: bpy.types.Mesh, kind: AttributeKind) -> str:
    """A mesh's checksum with its values of a kind added."""
    values = read_face_values(mesh, kind) if has_values(mesh, kind) else None
    return f"{geometry if values is None else continued(geometry, kind.name, values):08x}"


def examine(mesh: bpy.types.Mesh, users: Sequence[bpy.types.Object]) -> Examination:
    """Compare the mesh's record with the present mesh and all the objects that use it.

    Depths over frames are compared by the states of the objects on the scene's frame; on a frame without known states,
    the mesh alone is compared.
    """
    record = mesh.ccdepth
    contributors = list(_contributors(record))
    if record.frames and not contributors:
        return Examination(not (users and _is_same_mesh(mesh, users[0])), [])
    # A result's own weights and materials change no tolerance.
    varied = None if record.subdivision else record
    states = [
        object_state(user, use_modifiers=record.use_modifiers, with_vertices=record.follows_objects, varied=varied)
        for user in users
    ]
    present = [(state.checksum, state.scale) for state in states]
    recorded = [(each.checksum, np.array(each.gram, dtype=np.float64)) for each in contributors]
    is_intact = bool(users) and _is_same_mesh(mesh, users[0]) and all(_are_among(recorded, present))
    covered = zip(users, _are_among(present, recorded), strict=True)
    unknown = any(compared(one, other) is None for one, _ in recorded for other in {each for each, _ in present})
    return Examination(not is_intact, [user for user, is_covered in covered if not is_covered], unknown)


def _is_same_mesh(mesh: bpy.types.Mesh, user: bpy.types.Object) -> bool:
    """Whether a mesh and its depths are those of its record. user: an object that uses it."""
    record = mesh.ccdepth
    return mesh_face_count(mesh) == record.faces and mesh_checksum(user) == record.fingerprint


def _contributors(record: bpy.types.PropertyGroup) -> Iterator[bpy.types.PropertyGroup]:
    """The objects of the computation; over frames, as they were on the scene's frame."""
    scene = bpy.context.scene
    for each in record.contributors:
        if not record.frames or (each.frame == scene.frame_current and scene.frame_subframe == 0.0):
            yield each


def _are_among(states: Sequence[tuple[str, FloatArray]], others: Sequence[tuple[str, FloatArray]]) -> list[bool]:
    """Whether each of the states, checksums with scales (6,), may be one of the others, or has drifted from it by
    rounding."""
    scales: dict[str, list[FloatArray]] = {}
    for checksum, scale in others:
        scales.setdefault(checksum, []).append(scale)
    known = {checksum: np.array(found) for checksum, found in scales.items()}
    return [
        any(
            np.any(np.abs(found - scale).max(axis=1) <= SCALE_DRIFT * np.abs(scale).max())
            for other, found in known.items()
            if compared(checksum, other) is not False
        )
        for checksum, scale in states
    ]


def measured_state(measured: bpy.types.Object, target: bpy.types.Object, settings: Any) -> MeasuredState:
    """The present inputs of a measurement by settings, or by its record. target: the object of the limit surface."""
    others = [
        shown_checksum(measured, shown_modifiers(measured)),
        object_state(target, use_modifiers=settings.use_modifiers, varied=settings).checksum,
    ]
    if target != measured:
        others.append(f"{own_checksum(target, geometry_checksum):08x}")
    return MeasuredState(own_checksum(measured, geometry_checksum), others, _placement(measured, target))


def remember_measurement(measured: bpy.types.Object, target: bpy.types.Object, state: MeasuredState) -> None:
    """Write the inputs of a new measurement, as they were read, to the records of the object and of its mesh."""
    found = measured.data.ccdepth.measurement
    forget_measured(measured.data)
    measured.ccdepth.is_measured = True
    measured.ccdepth.measured_against = None if target == measured else target
    found.fingerprint = " ".join(_checksums(measured, state))
    found.placement = state.placement


def forget_measured(mesh: bpy.types.Mesh) -> None:
    """Forget which objects with this mesh were measured, and against which others."""
    for each in bpy.data.objects:
        if each.data == mesh and each.ccdepth.is_measured and each.is_editable:
            each.ccdepth.is_measured, each.ccdepth.measured_against = False, None


def measured_object(holder: bpy.types.Object) -> bpy.types.Object:
    """The measured object among the objects that use the holder's mesh; the holder itself if that object is gone."""
    users = [holder, *bpy.data.objects]
    return next((each for each in users if each.data == holder.data and each.ccdepth.is_measured), holder)


def is_own(mesh: bpy.types.Mesh) -> bool:
    """Whether the object was measured against its own limit surface."""
    return not mesh.ccdepth.measurement.against


def target_of(measured: bpy.types.Object) -> bpy.types.Object | None:
    """The object of the limit surface for a measured object; None if it is gone."""
    if is_own(measured.data):
        return measured
    target = measured.ccdepth.measured_against
    return target if target is not None and target.type == "MESH" else None


def measured_to_show(context: bpy.types.Context) -> bpy.types.Object | None:
    """The object whose deviation is shown: the worst selected object measured against the active one; or else the
    active object; or else the worst selected object."""
    active = context.active_object
    measured = [
        each for each in context.selected_objects if each.type == "MESH" and mesh_values.is_deviation_last(each.data)
    ]
    if active is not None and active.type == "MESH":
        others = [each for each in measured if each != active and target_of(each) == active]
        if not others and mesh_values.is_deviation_last(active.data):
            return active
        measured = others or measured
    return max(measured, key=lambda each: each.data.ccdepth.deviation, default=None)


def change_since_measured(mesh: bpy.types.Mesh, users: Sequence[bpy.types.Object]) -> str:
    """The change since the measurement on the mesh; empty where the measurement holds for the measured object. If the
    measured object is gone, any user of the mesh stands for it."""
    measured = [each for each in users if each.ccdepth.is_measured]
    changes = [_change_for(each) for each in measured or users]
    # The empty one comes first.
    return min(changes, default=f"“{mesh.name}” changed")


def _change_for(measured: bpy.types.Object) -> str:
    found, target = measured.data.ccdepth.measurement, target_of(measured)
    # The record keeps an object in the file that was deleted.
    if target is None or not target.users_scene:
        return f"“{found.against}” was removed"
    if not is_placed(bpy.context.view_layer, target):
        return f"“{target.name}” is not shown"
    if mesh_face_count(measured.data) != found.faces:
        return f"“{measured.name}” changed"
    state = measured_state(measured, target, found)
    before, now = found.fingerprint.split(), _checksums(measured, state)
    alike = [compared(*pair) for pair in zip(before, now, strict=True)] if len(before) == len(now) else [False]
    if False in alike:
        return f"“{(measured if False in alike[:2] else target).name}” changed"
    recorded = np.array(found.placement, dtype=np.float64)
    has_moved = np.abs(recorded - state.placement) > DRIFT * np.abs(recorded).max()
    if has_moved[:6].any():
        return f"“{target.name}” was scaled"
    if has_moved.any():
        return "objects were moved"
    return UNCHECKED if None in alike else ""


def _checksums(measured: bpy.types.Object, state: MeasuredState) -> list[str]:
    """Two checksums of the measured object, with its deviations, and one or two of the other object."""
    return [_with_values(state.geometry, measured.data, DEVIATION_KIND), *state.others]


def _placement(measured: bpy.types.Object, against: bpy.types.Object) -> FloatArray:
    """(18,): the scale of the second object, and the place of the first relative to it, which stays when both move
    together."""
    place, other = (np.array(item.matrix_world, dtype=np.float64) for item in (measured, against))
    scale = object_state(against, use_modifiers=False).scale
    relative = np.linalg.pinv(other[:3, :3]) @ (place[:3] - np.column_stack([np.zeros((3, 3)), other[:3, 3]]))
    return np.concatenate([scale, relative.ravel()])
