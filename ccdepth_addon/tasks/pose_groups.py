# SPDX-License-Identifier: GPL-3.0-or-later
"""The surfaces of a mesh that are measured, in groups of poses of one control mesh."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from ..core import (
    BoolArray,
    FaceDepths,
    FloatArray,
    IndexArray,
    PolygonMesh,
    Pose,
    Progress,
    needed_quality,
    raised_depths,
)
from ..exchange.control_mesh import ControlMesh
from ..exchange.evaluated import NO_ORIGIN
from .surfaces import Surface, surfaces_covering_others


@dataclass(frozen=True)
class DepthRequest:
    """A surface with wanted depths, and vertices CONTROL or LIMIT. frame: the frame of reading; None without frames.

    stretch: the ratio of the longest tolerance among the dominated surfaces to its own; their distances may be longer
    by this factor.
    """

    surface: Surface
    vertices: str
    frame: int | None
    stretch: float = 1.0

    def quality(self, level: int) -> int:
        """The Quality that Use Limit Surface needs at a level, 0 for control vertices."""
        return self.limit_quality(level) if self.vertices == "LIMIT" else 0

    def limit_quality(self, level: int) -> int:
        """The Quality needed to show the limit surface at a level."""
        surface = self.surface
        return needed_quality(surface.control.in_world, level, surface.least_factor * surface.tolerance)


@dataclass(frozen=True)
class PoseGroup:
    """Requests for poses of one control mesh: with the same faces, from the same faces of the mesh."""

    requests: list[DepthRequest]
    method: str

    @property
    def control(self) -> ControlMesh:
        """The first control mesh."""
        return self.requests[0].surface.control

    @property
    def work(self) -> int:
        """The number of faces to compute."""
        return len(self.requests) * self.control.face_count

    @cached_property
    def origins(self) -> tuple[IndexArray, BoolArray]:
        """The origins of the control mesh's faces in the mesh, and (F,) bool, whether each face has one."""
        faces = self.control.base_faces
        if faces is None:
            return np.arange(self.control.face_count), np.ones(self.control.face_count, dtype=bool)
        known = faces != NO_ORIGIN
        return faces[known], known

    @property
    def poses(self) -> tuple[list[Pose], str, str]:
        """The poses, the method and the vertices, as the core takes them."""
        poses = [
            Pose(self._maker(each.control), each.tolerance, each.variation_by_face)
            for each in (request.surface for request in self.requests)
        ]
        return poses, self.method, self.requests[0].vertices

    def face_tolerances(self) -> FloatArray:
        """(F,): the least tolerance of each face of the control mesh, over all requests."""
        return reduce(np.minimum, (request.surface.face_tolerances() for request in self.requests))

    def _maker(self, control: ControlMesh) -> Callable[[], PolygonMesh]:
        # Turned in the same way, like poses have the same bounds.
        return lambda: (control if len(self.requests) == 1 else control.unturned()).in_world

    def raised(self, found: FaceDepths, depths: NDArray[np.int32], effort: str, progress: Progress) -> FaceDepths:
        """The findings with depths raised to at least the depths of the faces of the mesh: (faces of the mesh,)
        int32."""
        faces, known = self.origins
        floors = found.depths.copy()
        floors[known] = depths[faces]
        return raised_depths(*self.poses, found, floors, progress, effort=effort)


def pose_groups(requests: list[DepthRequest], method: str) -> Iterator[PoseGroup]:
    """The requests of one mesh in groups, each for poses of one control mesh with the same kind of vertices, in the
    order of frames."""
    for group in _grouped(_kept(requests), lambda request: (request.vertices, id(request.surface.control.topology))):
        yield PoseGroup(sorted(group, key=lambda request: request.frame or 0), method)


def _kept(requests: list[DepthRequest]) -> list[DepthRequest]:
    """The requests of one mesh that no other dominates.

    A dominated surface has the same control mesh, painted factors and kind of vertices, and every vector of it is at
    most as long, in units of the tolerance: its distances are no larger, and neither are its depths.
    """
    if len(requests) < 2:
        return requests
    kept = []
    for group in _grouped(requests, lambda each: (each.vertices, each.surface.control.key, each.surface.paint)):
        for own, others in surfaces_covering_others([each.surface for each in group]).items():
            surface, dominated = group[own].surface, [group[place].surface for place in others]
            longest = max(each.tolerance for each in (surface, *dominated))
            # Without extent there is none, which is refused later.
            stretch = longest / surface.tolerance if surface.tolerance > 0 else 1.0
            kept.append(replace(group[own], surface=surface.within(dominated), stretch=stretch))
    return kept


def _grouped(requests: list[DepthRequest], kind: Callable[[DepthRequest], Hashable]) -> Iterable[list[DepthRequest]]:
    """The requests in groups of one kind, in the order of the first of each."""
    groups: dict[Hashable, list[DepthRequest]] = {}
    for request in requests:
        groups.setdefault(kind(request), []).append(request)
    return groups.values()
