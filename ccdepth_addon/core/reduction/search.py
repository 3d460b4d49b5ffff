# SPDX-License-Identifier: GPL-3.0-or-later
"""Search for the strongest reduction of a mesh that is proved to be within a limit of the limit surface.

The search drives an external decimator and accepts only proved results: each attempt gives a number of triangles and
the vertices to leave alone. docs/adaptive.md, Reduce.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..deviation import Deviation, KeptProofs, SampledSurface, measure_deviation
from ..deviation.columns import NONE, Table
from ..deviation.mesh_to_surface import factors_near
from ..deviation.triangles import Triangles, places_among
from ..mesh.polygon_mesh import PolygonMesh
from ..progress import Progress
from ..tolerance.variation import Variation
from .sampled_distances import Places, SampledDistances, nearest_of

# The largest and the least part of the mergeable triangles that an attempt is to merge.
LARGEST_SHARE, LEAST_SHARE = 0.75, 0.15

# A failed attempt that merged more than this part shows little of where merging must stop: the next attempt merges this
# part of its share.
LARGE_SHARE, NEXT_SHARE = 0.3, 0.7

# After this many failed attempts with fixed vertices, each attempt merges a part of that share, too.
MOST_REFUSALS = 4

# The search ends when the mergeable triangles are a smaller part of the mesh.
LEAST_GAIN = 0.025

# With samples within this part of the limit, the proof is postponed until needed.
SURELY_WITHIN = 0.6

# Triangles without a proof are to blame if their samples are beyond this part of the limit.
NEARLY_BEYOND = 0.9

# The relative accuracy of a measured deviation beyond the limit.
ACCURACY_BEYOND = 0.05

# A normal of the surface within this of a triangle's is of the triangle's side.
SAME_SIDE = np.radians(10.0)

# Of more turned triangles than this part fewer are to be merged.
LARGE_TURNED = 0.05

# The number of samples of the surface for angles.
SURFACE_SAMPLES = 1 << 17


@dataclass(frozen=True)
class TriangleMesh:
    """A mesh of triangles. positions: (V, 3) float64; corners: (T, 3) intp, the vertices of each triangle;
    is_smooth: (T,), whether they are shaded smooth."""

    positions: FloatArray
    corners: IndexArray
    is_smooth: BoolArray


@dataclass(frozen=True)
class Attempt:
    """The next reduction to try on the current mesh. triangles: the number to leave. is_fixed: (V,) bool, vertices that
    must stay in place, with all edges between two of them."""

    triangles: int
    is_fixed: BoolArray


@dataclass(frozen=True)
class Proof:
    """A reduced mesh that is proved to be within the limit. bounds: (T,) float64, the proved distance of each triangle,
    both ways, reduced where the limit varies. reached: a distance that a point reaches."""

    mesh: TriangleMesh
    bounds: FloatArray
    reached: float


@dataclass(frozen=True)
class _Seen(Table):
    """T triangles with known angles, first the start's. rows: (T, 9), their corners; normals: (T, 3, 3), of the surface
    there; is_turned: (T,) bool, whether samples are beyond an angle."""

    rows: FloatArray
    normals: FloatArray
    is_turned: BoolArray


class Reduction:
    """The search, attempt by attempt. ``attempt`` gives the next reduction to try; ``judge`` decides whether the result
    replaces ``current``. Once ``attempt`` returns None, ``prove`` gives the result.

    control: the control mesh, with explicit sharpness. start: a fine mesh, within a small part of the limit from the
    limit surface. limit: the largest distance allowed, in the unit of the positions. variation: of the limit over the
    control mesh; None for the same everywhere. shading_angle, facet_angle: the largest angles allowed at samples
    (radians), 0 for any.
    """

    def __init__(
        self,
        control: PolygonMesh,
        start: TriangleMesh,
        limit: float,
        progress: Progress,
        *,
        variation: Variation | None = None,
        shading_angle: float = 0.0,
        facet_angle: float = 0.0,
    ) -> None:
        self.current = self._start = start
        self.proof: Proof | None = None
        self._control, self._limit, self._variation = control, limit, variation
        # By whether they are of shading; and the surface with the samples that the start keeps, once needed.
        self._largest_angles = {True: shading_angle if start.is_smooth.any() else 0.0, False: facet_angle}
        self._kept: dict[bool, SampledSurface] = {}
        self._surface: SampledSurface | None = None
        self._seen: _Seen | None = None
        self._is_fixed = np.zeros(len(start.positions), dtype=bool)
        self._share, self._refusals = LARGEST_SHARE, 0
        self._proofs = KeptProofs()
        factors = np.ones(len(start.corners))
        if variation is not None:
            centroids = start.positions[start.corners].mean(axis=1)
            factors = factors_near(control, variation, centroids, lambda: progress(0.0))
        self._samples = SampledDistances(start.positions, start.corners, factors, lambda: progress(0.0))

    @property
    def is_proved(self) -> bool:
        """Whether the current mesh has a proof."""
        return self.proof is not None and self.proof.mesh is self.current

    def begin_with(self, mesh: TriangleMesh, is_fixed: BoolArray) -> None:
        """Make another mesh the current mesh. is_fixed: (V,) bool, its vertices to keep in place in every attempt."""
        self.current, self._is_fixed = mesh, is_fixed

    def beyond(self, mesh: TriangleMesh, progress: Progress) -> BoolArray:
        """(V,) bool: the vertices of the current mesh near faulty triangles of another mesh, with samples hardly within
        the limit or beyond an angle, or with the same vertices as another triangle."""
        triangles = self._triangles(mesh, progress)
        distances = self._distances(mesh, triangles, progress)
        bad = (
            (distances > NEARLY_BEYOND * self._limit)
            | has_double(mesh.corners)
            | self._turned(mesh, triangles, progress)
        )
        return self._around(triangles, bad, progress)

    def attempt(self) -> Attempt | None:
        """The next attempt, or None when too little is left to gain."""
        can_go = ~self._is_fixed[self.current.corners].any(axis=1)
        count = len(self.current.corners)
        fewer = int(self._share * np.count_nonzero(can_go))
        return Attempt(count - fewer, self._is_fixed) if fewer > LEAST_GAIN * count else None

    def judge(self, mesh: TriangleMesh, progress: Progress) -> bool:
        """Whether the result of the attempt becomes the current mesh. progress: receives the fraction done, and may
        raise to stop.
        """
        if len(mesh.corners) > (1 - LEAST_GAIN / 2) * len(self.current.corners):
            # The decimator could not go that far: no remaining triangle can be merged.
            self._share = 0.0
            return False
        triangles = self._triangles(mesh, progress)
        is_double = has_double(mesh.corners)
        if is_double.any():
            self._reject(triangles, is_double, progress)
            return False
        distances = self._distances(mesh, triangles, progress)
        reached = float(distances.max(initial=0.0))
        proof = None
        if reached > self._limit:
            self._reject(triangles, distances > self._limit, progress)
            return False
        turned = self._turned(mesh, triangles, progress)
        if turned.any():
            self._reject(triangles, turned, progress, is_local=turned.mean() <= LARGE_TURNED)
            return False
        if reached > SURELY_WITHIN * self._limit:
            found = self._measured(mesh, progress)
            if found.proved > self._limit:
                self._reject(triangles, self._to_blame(found, distances), progress)
                return False
            proof, reached = Proof(mesh, found.triangle_bounds, found.reached), max(reached, found.reached)
        self._accept(mesh, proof, reached)
        return True

    def prove(self, progress: Progress) -> Proof | None:
        """The last accepted mesh with a proof, or None if no accepted mesh is proved."""
        if not self.is_proved:
            found = self._measured(self.current, progress)
            if found.proved <= self._limit:
                self.proof = Proof(self.current, found.triangle_bounds, found.reached)
        return self.proof

    def places(self, mesh: TriangleMesh, progress: Progress) -> Places:
        """The places of the vertices of a mesh on the start."""
        return self._samples.places_of(mesh.positions, mesh.corners, lambda: progress(1.0))

    def normals(self, mesh: TriangleMesh, progress: Progress) -> FloatArray:
        """(T, 3, 3) float64: the normals of the limit surface for the corners of a mesh's triangles."""
        return self._sampled(progress).normals_of(mesh.positions, mesh.corners, SAME_SIDE, lambda: progress(1.0))

    def _shading(self, mesh: TriangleMesh, progress: Progress) -> FloatArray:
        """As ``normals``, or zeros where no angle of shading counts."""
        return self.normals(mesh, progress) if self._largest_angles[True] else np.zeros((*mesh.corners.shape, 3))

    def _sampled(self, progress: Progress) -> SampledSurface:
        if self._surface is None:
            self._surface = SampledSurface(self._control, self._limit, lambda: progress(0.0), SURFACE_SAMPLES)
        return self._surface

    def _kept_by_start(self, progress: Progress, *, of_shading: bool) -> SampledSurface:
        if of_shading not in self._kept:
            start, angle = self._start, self._largest_angles[of_shading]
            normals = self._seen.normals[: len(start.corners)] if of_shading and self._seen else None
            self._kept[of_shading] = self._sampled(progress).kept_by(
                start.positions, start.corners, normals, angle, lambda: progress(0.0)
            )
        return self._kept[of_shading]

    def _turned(self, mesh: TriangleMesh, triangles: Triangles, progress: Progress) -> BoolArray:
        """(T,) bool: the triangles with samples beyond an angle, as found when each was new. What the start does not
        keep does not count."""
        if not any(self._largest_angles.values()):
            return np.zeros(len(mesh.corners), dtype=bool)
        if self._seen is None:
            start = self._samples.triangles.rows
            self._seen = _Seen(start, self._shading(self._start, progress), np.zeros(len(start), dtype=bool))
        places = places_among(triangles.rows, self._seen.rows)
        is_new = places == NONE
        found = self._seen.at(places)
        found.normals[is_new] = self._shading(replace(mesh, corners=mesh.corners[is_new]), progress)
        found.rows[is_new], found.is_turned[is_new] = triangles.rows[is_new], False
        for of_shading, angle in self._largest_angles.items():
            counts = is_new & mesh.is_smooth if of_shading else is_new
            if angle and counts.any():
                normals = found.normals if of_shading else None
                angles = self._kept_by_start(progress, of_shading=of_shading).largest_angles(
                    mesh.positions, mesh.corners, normals, angle, lambda: progress(0.0), counts
                )
                found.is_turned[angles > angle] = True
        self._seen = self._seen.joined([found.at(is_new)])
        return found.is_turned

    def _triangles(self, mesh: TriangleMesh, progress: Progress) -> Triangles:
        return Triangles.of(mesh.positions, mesh.corners, lambda: progress(0.0))

    def _distances(self, mesh: TriangleMesh, triangles: Triangles, progress: Progress) -> FloatArray:
        return self._samples.of(triangles, mesh.positions, mesh.corners, lambda: progress(0.0))

    def _measured(self, mesh: TriangleMesh, progress: Progress) -> Deviation:
        return measure_deviation(
            self._control,
            mesh.positions,
            mesh.corners,
            accuracy=ACCURACY_BEYOND,
            enough=self._limit,
            variation=self._variation,
            proofs=self._proofs,
            progress=progress,
        )

    def _to_blame(self, found: Deviation, distances: FloatArray) -> BoolArray:
        """(T,) bool: triangles without a proof; if samples of some are nearly beyond the limit, only those."""
        unproved = found.triangle_bounds > self._limit
        nearly = unproved & (distances > NEARLY_BEYOND * self._limit)
        return nearly if nearly.any() else unproved

    def _accept(self, mesh: TriangleMesh, proof: Proof | None, reached: float) -> None:
        self._is_fixed = places_among(mesh.positions, self.current.positions[self._is_fixed]) != NONE
        self.current, self._refusals = mesh, 0
        if proof is not None:
            self.proof = proof
        # Errors grow about as triangles become fewer, and small steps end with fewer triangles.
        largest = max(NEXT_SHARE * self._share, LEAST_SHARE)
        self._share = float(np.clip(1 - reached / self._limit, LEAST_SHARE, largest))

    def _reject(self, triangles: Triangles, bad: BoolArray, progress: Progress, *, is_local: bool = False) -> None:
        """Fix the vertices around bad triangles, or merge fewer. is_local: whether fixing helps after all attempts."""
        if self._share > LARGE_SHARE and not is_local:
            self._share *= NEXT_SHARE
            return
        near = self._around(triangles, bad, progress)
        self._refusals += 1
        if self._refusals > MOST_REFUSALS or not (near & ~self._is_fixed).any():
            self._share *= NEXT_SHARE
        self._is_fixed = self._is_fixed | near

    def _around(self, triangles: Triangles, bad: BoolArray, progress: Progress) -> BoolArray:
        """(V,) bool: the vertices of the current mesh nearest to bad triangles of another mesh, and the corners of the
        triangles with centroids nearest to bad triangles."""
        near = np.zeros(len(self.current.positions), dtype=bool)
        if not bad.any():
            return near
        positions, corners = self.current.positions, self.current.corners
        # Loose vertices may be anywhere.
        used = np.unique(corners)
        near[used] = bad[nearest_of(triangles, positions[used], lambda: progress(1.0))]
        centroids = positions[corners].mean(axis=1)
        near[corners[bad[nearest_of(triangles, centroids, lambda: progress(1.0))]]] = True
        return near


def has_double(corners: IndexArray) -> BoolArray:
    """(T,): whether another triangle has the same vertices, in any order; Blender takes such a mesh for invalid.

    corners: (T, 3) intp.
    """
    vertices = np.sort(corners, axis=1)
    order = np.lexsort(vertices.T)
    is_repeated = (vertices[order[1:]] == vertices[order[:-1]]).all(axis=1)
    found = np.zeros(len(corners), dtype=bool)
    found[order[1:][is_repeated]] = found[order[:-1][is_repeated]] = True
    return found
