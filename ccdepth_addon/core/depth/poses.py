# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses of a mesh: positions of its vertices, what all of them have in common, and their bounds by norms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.mesh_norms import MeshNorms
from ..bounds.norm_bounds import PATCH_METHODS, Method, PatchBounds, PatchMethod, Vertices
from ..bounds.rounding import rounded_size, rounding_allowance
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import corners_of_faces, submesh
from ..surface.patches import PatchKinds, classify_patches
from .norm_depth import patch_bounds


@dataclass(frozen=True)
class Pose:
    """One pose of a mesh.

    make: gives the mesh in it, anew each time, so that many need not be held at once. All poses of a mesh have the same
    faces, edges and explicit sharpness (``PolygonMesh.changed``). tolerance: in the unit of the positions.
    """

    make: Callable[[], PolygonMesh]
    tolerance: float


@dataclass(frozen=True)
class ScaledPose:
    """A pose in units of its tolerance.

    allowance: for rounding. Each scaled point is off by at most uR (``rounding``), and the difference of two averages
    of points by twice that.
    """

    mesh: PolygonMesh
    tolerance: float
    allowance: float

    @staticmethod
    def of(pose: Pose) -> ScaledPose:
        mesh = pose.make()
        mesh = mesh.changed(positions=mesh.positions / pose.tolerance, rounded_size=mesh.rounded_size / pose.tolerance)
        allowance = rounding_allowance(mesh) + 2 * 2.0**-53 * rounded_size(mesh)
        return ScaledPose(mesh, pose.tolerance, allowance)


@dataclass(frozen=True)
class OtherFaces:
    """Some faces (N,) of a mesh, rising; the submesh of these with the faces around them, and the vertices it has."""

    faces: IndexArray
    around: PolygonMesh
    vertices: IndexArray

    @staticmethod
    def of(mesh: PolygonMesh, faces: IndexArray) -> OtherFaces:
        """These faces of a mesh."""
        around, kept = submesh(mesh, faces)
        return OtherFaces(faces, around, vertices_of(mesh, around, kept))

    def near(self, change: FloatArray) -> IndexArray:
        """Those of the faces whose patch depends on a vertex of the mesh with a change (V, 3)."""
        return self.faces[faces_near(self.around, change[self.vertices])[: len(self.faces)]]


@dataclass(frozen=True)
class PreparedMesh:
    """What the poses of a mesh have in common, and how they are bounded.

    Computed on first use: shared, the norms that are computed of many faces at once, and others, all other faces.
    """

    mesh: PolygonMesh
    kinds: PatchKinds
    method: Method
    vertices: Vertices

    @staticmethod
    def of(mesh: PolygonMesh, method: Method, vertices: Vertices) -> PreparedMesh:
        return PreparedMesh(mesh, classify_patches(mesh), method, vertices)

    @property
    def _rules(self) -> PatchMethod:
        return PATCH_METHODS[self.method if self.method in PATCH_METHODS else Method.SHARP]

    @cached_property
    def shared(self) -> MeshNorms | None:
        return MeshNorms.of(self.mesh, self.kinds) if self._rules.of_norm else None

    @cached_property
    def others(self) -> OtherFaces:
        is_other = np.ones(self.mesh.face_count, dtype=bool)
        if self.shared:
            is_other[self.shared.faces] = False
        return OtherFaces.of(self.mesh, np.flatnonzero(is_other))

    def norms(self, mesh: PolygonMesh, faces: IndexArray) -> Iterator[tuple[IndexArray, PatchBounds]]:
        """The bounds by norms of those of the faces that are patches, in a pose."""
        return patch_bounds(mesh, self.kinds, self._rules, self.vertices, faces)

    def all_norms(self, mesh: PolygonMesh, others: IndexArray) -> Iterator[tuple[IndexArray, PatchBounds]]:
        """The bounds by norms of all faces that are patches, in a pose. others: of the other faces only these."""
        of_norm = self._rules.of_norm
        if self.shared and of_norm:
            values = self.shared.values(mesh.positions)
            for valence, chosen in self.shared.of_valences.items():
                yield self.shared.faces[chosen], of_norm(values[chosen], valence, self.vertices)
        yield from self.norms(mesh, others)

    def norm_values(self, mesh: PolygonMesh) -> FloatArray:
        """(F,): the values of the bounds by norms; inf where there is none."""
        values = np.full(mesh.face_count, np.inf)
        for some, norms in self.all_norms(mesh, self.others.faces):
            values[some] = norms.value
        return values

    def norm_bounds(self, mesh: PolygonMesh, faces: IndexArray, levels: NDArray[np.int32]) -> FloatArray:
        """(F,): the bounds by norms of some faces, each at its own level (F,); inf where there is none."""
        bounds = np.full(mesh.face_count, np.inf)
        for some, norms in self.norms(mesh, faces):
            bounds[some] = at_each_level(norms, levels[some])
        return bounds


def at_each_level(norms: PatchBounds, levels: NDArray[np.int32]) -> FloatArray:
    """(P,): the bound of each patch at its own level (P,)."""
    table = np.array([norms.factor(level) for level in range(int(levels.max(initial=0)) + 1)])
    bounds: FloatArray = norms.value * table[levels]
    return bounds


def vertices_of(mesh: PolygonMesh, part: PolygonMesh, kept: IndexArray) -> IndexArray:
    """The vertices of a mesh that a submesh of it has, with the faces that it keeps."""
    vertices = np.zeros(part.vertex_count, dtype=np.intp)
    vertices[part.corner_vertices] = mesh.corner_vertices[corners_of_faces(mesh, kept)]
    return vertices


def faces_near(mesh: PolygonMesh, change: FloatArray) -> BoolArray:
    """(F,) bool: the faces whose patch depends on a vertex with a change (V, 3): those of faces that share a vertex."""
    vertices = np.any(change != 0.0, axis=1)
    if np.all(vertices):
        return np.ones(mesh.face_count, dtype=bool)
    for _ in range(2):
        faces = np.zeros(mesh.face_count, dtype=bool)
        faces[mesh.corner_faces[vertices[mesh.corner_vertices]]] = True
        vertices[mesh.corner_vertices[faces[mesh.corner_faces]]] = True
    return faces
