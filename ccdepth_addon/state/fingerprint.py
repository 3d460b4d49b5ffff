# SPDX-License-Identifier: GPL-3.0-or-later
"""What a result was computed from, as checksums in its record, and whether that has changed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import BoolArray, FloatArray
from ..exchange.bulk_reading import read_values
from ..exchange.mesh_arrays import mesh_face_count, own_mesh
from ..exchange.mesh_checksums import continued, geometry_checksum
from ..exchange.object_state import KnownDescriptions, ObjectState, StateAtFrame, object_state
from ..exchange.result_attributes import DEPTH
from . import results

# How far, relatively, an object's scale may drift by rounding while it is turned.
SCALE_DRIFT = 1e-5

# Scales nearer to each other than this fraction of it count as one.
CELL_SIZE = 0.1

# The trace of AᵀA, as a product with its upper triangle.
TRACE = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])


@dataclass(frozen=True)
class Examination:
    """Whether a result's mesh, or an object it was computed for, has changed; and which objects use the mesh that the
    result was not computed for, or that have changed since."""

    has_changed: bool
    uncovered: list[bpy.types.Object]


def remember(mesh: bpy.types.Mesh, geometry: int, depths: NDArray[np.int32], states: Iterable[StateAtFrame]) -> None:
    """Write to the mesh's record what the result just written to it depends on.

    geometry: the checksum of the mesh it was computed from. depths: (F,) int32, those written. states: of the objects
    it was computed for, as they were read, on each frame.
    """
    record = mesh.ccdepth
    record.fingerprint = _text(continued(geometry, DEPTH, depths))
    record.contributors.clear()
    by_frame: dict[int, list[ObjectState]] = {}
    for state, frame in states:
        by_frame.setdefault(frame or 0, []).append(state)
    for at_frame, found in by_frame.items():
        for checksum, scales in _by_checksum((state.checksum, state.scale) for state in found).items():
            for scale in _without_repetitions(scales)[0]:
                contributor = record.contributors.add()
                contributor.gram, contributor.checksum, contributor.frame = scale, checksum, at_frame


def mesh_checksum(blender_object: bpy.types.Object) -> str:
    """A checksum of the object's own mesh, as far as its surface depends on it, and of the depths on it."""
    with own_mesh(blender_object) as mesh:
        checksum = geometry_checksum(mesh)
        if results.has_depths(mesh):
            depths = read_values(mesh.attributes[DEPTH].data, "value", np.int32)
            checksum = continued(checksum, DEPTH, depths)
    return _text(checksum)


def _text(checksum: int) -> str:
    return f"{checksum:08x}"


def examine(mesh: bpy.types.Mesh, users: Sequence[bpy.types.Object], known: KnownDescriptions) -> Examination:
    """Compare the mesh's record with the mesh and all the objects that use it, as they are now.

    A result over frames is compared with what the objects were like on the scene's frame. On a frame for which that is
    not known, the mesh alone is compared.
    known: what was described of other objects at the same time, to be read once only.
    """
    record = mesh.ccdepth
    contributors = list(_contributors(record))
    if record.frames and not contributors:
        return Examination(not (users and _is_same_mesh(mesh, users[0])), [])
    states = [
        object_state(user, use_modifiers=record.use_modifiers, with_vertices=record.follows_objects, known=known)
        for user in users
    ]
    present = _by_checksum((state.checksum, state.scale) for state in states)
    recorded = _by_checksum((each.checksum, each.gram) for each in contributors)
    is_intact = (
        bool(users)
        and _is_same_mesh(mesh, users[0])
        and all(_are_among(scales, present.get(checksum)).all() for checksum, scales in recorded.items())
    )
    covered = {checksum: iter(_are_among(scales, recorded.get(checksum))) for checksum, scales in present.items()}
    uncovered = [user for user, state in zip(users, states, strict=True) if not next(covered[state.checksum])]
    return Examination(not is_intact, uncovered)


def _is_same_mesh(mesh: bpy.types.Mesh, user: bpy.types.Object) -> bool:
    """Whether a mesh and its depths are those of its record. user: an object that uses it."""
    record = mesh.ccdepth
    return mesh_face_count(mesh) == record.faces and mesh_checksum(user) == record.fingerprint


def _contributors(record: bpy.types.PropertyGroup) -> Iterator[bpy.types.PropertyGroup]:
    """What the result was computed for: over frames, on the scene's frame."""
    scene = bpy.context.scene
    for each in record.contributors:
        if not record.frames or (each.frame == scene.frame_current and scene.frame_subframe == 0.0):
            yield each


def _by_checksum(states: Iterable[tuple[str, Sequence[float] | FloatArray]]) -> dict[str, FloatArray]:
    """The scales of all states with the same checksum, in their order: (N, 6) float64."""
    scales: dict[str, list[Sequence[float] | FloatArray]] = {}
    for checksum, scale in states:
        scales.setdefault(checksum, []).append(scale)
    return {checksum: np.array(found, dtype=np.float64).reshape(-1, 6) for checksum, found in scales.items()}


def _are_among(scales: FloatArray, others: FloatArray | None) -> BoolArray:
    """(N,): whether each of the scales (N, 6) is one of the others (M, 6), or has drifted from it by rounding."""
    if others is None:
        return np.zeros(len(scales), dtype=bool)
    distinct, places = _without_repetitions(scales)
    others, _ = _without_repetitions(others)
    traces, slack = distinct @ TRACE, SCALE_DRIFT * np.abs(distinct).max(axis=1)
    # Only those of nearly the same trace are compared; sorted, they stand beside each other.
    others = others[np.argsort(others @ TRACE)]
    first = np.searchsorted(others @ TRACE, traces - 3 * slack, "left")
    last = np.searchsorted(others @ TRACE, traces + 3 * slack, "right")
    found = [
        bool(np.any(np.abs(others[start:end] - scale).max(axis=1) <= most))
        for scale, most, start, end in zip(distinct, slack, first, last, strict=True)
    ]
    return np.array(found, dtype=bool)[places]


def _without_repetitions(scales: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """One of each group that differs by rounding alone (M, 6), and for each of all (N, 6), its index among them."""
    exponents = np.frexp(np.abs(scales).max(axis=1))[1]
    cells = np.rint(np.ldexp(scales, -exponents[:, None]) / (SCALE_DRIFT * CELL_SIZE))
    _, first, places = np.unique(np.column_stack([cells, exponents]), axis=0, return_index=True, return_inverse=True)
    # numpy 2.0 alone gives the inverse a second axis.
    return scales[first], places.reshape(-1)
