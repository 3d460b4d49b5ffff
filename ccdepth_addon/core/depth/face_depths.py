# SPDX-License-Identifier: GPL-3.0-or-later
"""The depth of every face: the least level proved to lie within a tolerance of the limit surface.

``distance_depth``, ``certified_depth`` and ``norm_depth`` compute depths from a mesh and a tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, IndexArray
from ..bounds.norm_bounds import PATCH_METHODS, Method, Vertices
from ..bounds.rounding import smallest_tolerance
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.validation import has_good_positions, validate
from ..progress import Progress, no_report, part_of
from ..tolerance.variation import ToleranceError, Variation
from .certified_depth import certified_depths, certified_level_bounds
from .distance_depth import Effort, distance_bounds_at, distance_depths, distance_level_bounds
from .level_leaves import mask, rings_around
from .modifier_quality import unmet_corners
from .norm_depth import norm_depths, norm_level_bounds
from .tolerance import FaceDepths, LevelBounds, ToleranceTest, tolerance_groups

METHODS = tuple(method.value for method in Method)
VERTICES = tuple(vertices.value for vertices in Vertices)


def face_depths(
    mesh: PolygonMesh,
    tolerance: float,
    method: str,
    vertices: str,
    progress: Progress = no_report,
    *,
    effort: str = "NORMAL",
    variation: Variation | None = None,
    is_checked: bool = False,
) -> FaceDepths:
    """The depth of every face of a mesh whose sharpness is explicit (``sharpness.apply_boundary_rule``).

    tolerance: the largest distance allowed, in the unit of the positions; variation: how it varies. method,
    vertices: names of ``Method`` and ``Vertices``. progress: receives the rising fraction done, and may raise to stop.
    effort: a name of ``Effort``, for DISTANCE. is_checked: whether ``check_input`` has accepted mesh and tolerance
    already. Raises InvalidMeshError, ToleranceError, and ValueError for an unknown name.
    """
    if not is_checked:
        check_input(mesh, tolerance, variation)
    every = np.arange(mesh.face_count)
    whole = FaceDepths.undecided(every)
    counter = _Counter(progress, mesh.face_count)
    for faces, test in groups_of(mesh, every, tolerance, variation, Method(method)):
        kinds = Method(method), Vertices(vertices)
        for part in depths_in_chunks(mesh, test, *kinds, faces, Effort(effort), counter.tick):
            whole.update(part)
            counter.add(len(part.faces))
    return whole


def groups_of(
    mesh: PolygonMesh, faces: IndexArray, tolerance: float, variation: Variation | None, method: Method
) -> list[tuple[IndexArray, ToleranceTest]]:
    """The groups of ``tolerance_groups``: by distance triangles may be near the surface of the faces around."""
    return tolerance_groups(mesh, faces, tolerance, variation, with_faces_around=method is Method.DISTANCE)


def check_input(mesh: PolygonMesh, tolerance: float, variation: Variation | None = None) -> None:
    """Raise InvalidMeshError for a mesh without depths, and ToleranceError for a tolerance without meaning."""
    validate(mesh)
    _check_least(mesh, tolerance, variation)


def _check_least(mesh: PolygonMesh, tolerance: float, variation: Variation | None) -> None:
    """Raise ToleranceError unless the least tolerance of a face has a meaning."""
    if variation is not None and mesh.face_count:
        tolerance = float(variation.of_faces(mesh, tolerance).min())
    check_tolerance(tolerance, smallest_tolerance(mesh))


def check_pose(mesh: PolygonMesh, tolerance: float, variation: Variation | None = None) -> None:
    """Raise as ``check_input``, in less time, for a mesh accepted with other positions."""
    if not has_good_positions(mesh):
        validate(mesh)
    _check_least(mesh, tolerance, variation)


class _Counter:
    """A counter of finished faces, which reports their fraction."""

    def __init__(self, progress: Progress, total: int) -> None:
        self._progress = progress
        self._total = max(total, 1)
        self._done = 0

    def add(self, faces: int) -> None:
        self._done += faces
        self.tick()

    def tick(self) -> None:
        self._progress(self._done / self._total)


def uniform_level(
    mesh: PolygonMesh,
    tolerance: float,
    method: str,
    vertices: str,
    found: FaceDepths | None = None,
    least: int = 0,
    progress: Progress = no_report,
    *,
    effort: str = "NORMAL",
    variation: Variation | None = None,
) -> int:
    """The first level, from the deepest depth on, at which all faces are proved to be within the tolerance.

    A face can be farther from the surface at a level than at the level before, so the deepest depth is not always
    enough. With limit vertices, corners that Blender shows slightly off the surface keep a margin
    (``modifier_quality``), and level 1 is the first: a modifier at level 0 moves no vertex.

    mesh, tolerance, method, vertices, progress, effort, variation, and errors: as in ``face_depths``. found: the depths
    by the same arguments, if known: a depth is proved at its own level, a lasting depth at all later levels; other
    faces are evaluated. least: the first level to try.
    """
    if found is None:
        found = face_depths(mesh, tolerance, method, vertices, effort=effort, variation=variation)
    depths, lasting, unmet = found.depths, found.lasting, None
    with_margin = np.zeros(mesh.face_count, dtype=bool)
    if Vertices(vertices) is Vertices.LIMIT:
        unmet = unmet_corners(mesh)
        with_margin[mesh.corner_faces[unmet.corners]] = True
        if Method(method) is Method.DISTANCE:
            # Other faces are compared with the triangles at these corners, too.
            with_margin = rings_around(mesh, with_margin, 1)
        least = max(least, 1)
    groups = groups_of(mesh, np.arange(mesh.face_count), tolerance, variation, Method(method))
    level = max(least, int(depths.max(initial=0)))
    # The number of levels is unknown: each level reports half of the remaining fraction.
    begun = 0.0
    while True:
        is_proved = depths == level
        # A depth by distance assumes that the faces around are within the tolerance as well.
        is_open = np.full(len(depths), True) if Method(method) is Method.DISTANCE else ~is_proved
        parts = []
        for faces, test in groups:
            in_group = mask(mesh.face_count, faces)
            chosen = np.flatnonzero(in_group & is_open & ~lasting & ~with_margin)
            parts.append((chosen, test, in_group & is_proved & found.alone))
            if unmet is not None:
                less = replace(test, tolerance=test.tolerance - unmet.margin(test.tolerance))
                parts.append((np.flatnonzero(in_group & with_margin), less, np.zeros_like(is_proved)))
        share = part_of(progress, begun, (1 - begun) / 2)
        if all_within(mesh, parts, Method(method), Vertices(vertices), level, Effort(effort), share):
            return level
        begun += (1 - begun) / 2
        level += 1


def all_within(
    mesh: PolygonMesh,
    parts: list[tuple[IndexArray, ToleranceTest, BoolArray]],
    method: Method,
    vertices: Vertices,
    level: int,
    effort: Effort,
    progress: Progress,
) -> bool:
    """Whether faces are within a tolerance at one level, part by part, each part with a test of its own, and with
    (F,) bool as of ``level_bounds_in_chunks``. Stops at the first face beyond its tolerance."""
    counter = _Counter(progress, sum(len(faces) for faces, _, _ in parts))
    counter.tick()
    for faces, test, is_proved in parts:
        if not len(faces):
            continue
        kinds = method, vertices, level, counter.tick
        for block in level_bounds_in_chunks(mesh, faces, test, *kinds, is_proved, effort):
            counter.add(len(block.faces))
            if not block.all_within:
                return False
    return True


def level_bounds_in_chunks(
    mesh: PolygonMesh,
    faces: IndexArray,
    test: ToleranceTest,
    method: Method,
    vertices: Vertices,
    level: int,
    tick: Callable[[], None],
    is_proved: BoolArray | None = None,
    effort: Effort = Effort.NORMAL,
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces at one level, in chunks. tick: called meanwhile, and may raise to stop.
    is_proved: (F,) bool, whether each face has this level as its depth by the same test, and is ``alone``. By distance
    leaves of these faces without feet are not measured again, and the tolerance is a bound of them. effort: QUICK
    measures no leaf, any other all of them.
    """
    if method is Method.DISTANCE:
        return distance_level_bounds(mesh, test, vertices, faces, level, tick, is_proved, effort)
    if method is Method.CERTIFIED:
        return certified_level_bounds(mesh, faces, test, vertices, level, tick, nearly=False)
    return norm_level_bounds(mesh, test, PATCH_METHODS[method], vertices, faces, level, tick)


def bounds_at_depths(
    mesh: PolygonMesh,
    faces: IndexArray,
    test: ToleranceTest,
    method: Method,
    vertices: Vertices,
    depths: NDArray[np.int32],
    effort: Effort,
    tick: Callable[[], None],
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces, each at its own depth, in the sense of ``depths_in_chunks``, in chunks.

    depths: (F,) int32. effort: as of ``level_bounds_in_chunks``. tick: called meanwhile, and may raise to stop.
    """
    if method is Method.DISTANCE:
        yield from distance_bounds_at(mesh, test, vertices, faces, depths, effort, tick)
        return
    for level in np.unique(depths[faces]).tolist():
        some = faces[depths[faces] == level]
        if method is Method.CERTIFIED:
            yield from certified_level_bounds(mesh, some, test, vertices, level, tick, nearly=True)
        else:
            yield from norm_level_bounds(mesh, test, PATCH_METHODS[method], vertices, some, level, tick)


def depths_in_chunks(
    mesh: PolygonMesh,
    test: ToleranceTest,
    method: Method,
    vertices: Vertices,
    faces: IndexArray,
    effort: Effort,
    tick: Callable[[], None],
) -> Iterator[FaceDepths]:
    """The depths of some faces, in chunks. tick: called meanwhile, and may raise to stop."""
    if method is Method.DISTANCE:
        return distance_depths(mesh, test, vertices, faces, effort, tick)
    if method is Method.CERTIFIED:
        return certified_depths(mesh, faces, test, vertices, tick)
    return norm_depths(mesh, test, PATCH_METHODS[method], vertices, faces, tick)


def check_tolerance(tolerance: float, least: float) -> None:
    """Raise ToleranceError unless the tolerance is a number, greater than zero and at least the least tolerance."""
    if not np.isfinite(tolerance):
        raise ToleranceError("the tolerance is not a finite number")
    if tolerance <= 0:
        raise ToleranceError("the tolerance must be greater than zero")
    if tolerance < least:
        raise ToleranceError(
            f"the tolerance {tolerance:.3g} is finer than the mesh's single-precision coordinates can show; "
            f"the smallest that means anything here is {least:.3g}"
        )
