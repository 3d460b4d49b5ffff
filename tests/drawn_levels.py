# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of a mesh as the triangles that Blender draws, and how far they and the limit surface are from each other, as
dense samples of both find it."""

from __future__ import annotations

import numpy as np

from ccdepth_addon.core.arrays.types import BoolArray, FloatArray, IndexArray
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from tests.brute_force import SQUARE, linear_children
from tests.triangle_distances import distances

# How many levels deeper the surface is sampled.
DEEPER = 2

# Fine triangles that stand for the surface are off it by so many times what their level has changed, at most: a level
# takes a third off at least, at poles of any valence; mostly three quarters.
OFF = 2


class Level:
    """A mesh at a level. owners: (F,), the face of the control mesh that each comes from; parameters: (C, 2), where
    corners are in it, as far as that decides along which diagonal a quad is drawn."""

    def __init__(self, mesh: PolygonMesh, is_turned: BoolArray | None = None) -> None:
        """is_turned: faces of the control mesh that are drawn along the other diagonal."""
        self.mesh, self.axes = mesh, mesh.axes
        self.owners = np.arange(mesh.face_count)
        self.is_turned = np.zeros(mesh.face_count, dtype=bool) if is_turned is None else is_turned
        self.parameters = np.tile(SQUARE, (mesh.face_count, 1)) if np.all(mesh.face_sizes == 4) else None

    def refined(self) -> Level:
        following = Level(subdivide(self.mesh), self.is_turned)
        following.axes, following.owners = self.axes, np.repeat(self.owners, self.mesh.face_sizes)
        if self.parameters is not None:
            following.parameters = linear_children(self.mesh, self.parameters).reshape(-1, 2)
            return following
        # The diagonals of polygons that are not quads run from corners to the middle.
        turns = np.concatenate([np.arange(size) % 2 if size == 4 else np.zeros(size) for size in self.mesh.face_sizes])
        assert following.parameters is not None
        following.parameters[:, 0] *= np.repeat(1 - 2 * turns, 4)
        return following

    def drawn(self, vertices: Vertices) -> tuple[FloatArray, IndexArray, IndexArray]:
        """Positions, (T, 3) triangles, and (T,) the face of the control mesh of each."""
        assert self.parameters is not None
        quads, parameters = self.mesh.corner_vertices.reshape(-1, 4), self.parameters.reshape(-1, 4, 2)
        rises = ((parameters[:, 2] - parameters[:, 0]).prod(axis=1) > 0) != self.is_turned[self.owners]
        quads = np.where(rises[:, None], quads, np.roll(quads, -1, axis=1))
        positions = self.mesh.positions if vertices is Vertices.CONTROL else limit_positions(self.mesh)
        if self.axes is not None:
            a, b, c, d = (positions @ np.linalg.inv(self.axes).T)[quads].swapaxes(0, 1)
            normals = np.cross(b - a, c - a), np.cross(c - a, d - a)
            folded = (normals[0] * normals[1]).sum(axis=1) < 0
            quads = np.where(folded[:, None], np.roll(quads, -1, axis=1), quads)
        return positions, quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3), np.repeat(self.owners, 2)


def refined(mesh: PolygonMesh, level: int, is_turned: BoolArray | None = None) -> Level:
    """The mesh at a level."""
    found = Level(mesh, is_turned)
    for _ in range(level):
        found = found.refined()
    return found


def points_of(corners: FloatArray, steps: int = 4) -> FloatArray:
    """(T, n, …): points all over triangles with these corners, (T, 3, …)."""
    i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1))
    weights = np.stack([i, j, steps - i - j], axis=-1)[i + j <= steps] / steps
    return np.einsum("sc,tci->tsi", weights, corners)


def surface(mesh: PolygonMesh, level: int) -> tuple[FloatArray, IndexArray, IndexArray, float]:
    """Fine triangles that stand for it as they are drawn, and how far they are off those of the level before: about
    four times as far as off the surface."""
    coarse = refined(mesh, level - 1)
    fine, triangles, owners = coarse.refined().drawn(Vertices.LIMIT)
    return fine, triangles, owners, float(distances(fine, *coarse.drawn(Vertices.LIMIT)[:2]).max())


def sampled(
    mesh: PolygonMesh, level: int, vertices: Vertices, is_turned: BoolArray | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """(F,) how far the triangles of each face are from the surface, (F,) the surface over it from the triangles, and
    how far the fine triangles that stand for the surface are off those of the level before."""
    fine, fine_triangles, fine_owners, step = surface(mesh, level + DEEPER)
    positions, triangles, owners = refined(mesh, level, is_turned).drawn(vertices)
    points = points_of(positions[triangles])
    there = distances(points.reshape(-1, 3), fine, fine_triangles).reshape(len(points), -1).max(axis=1)
    back = distances(fine, positions, triangles)[fine_triangles].max(axis=1)
    found = np.zeros((2, mesh.face_count))
    np.maximum.at(found[0], owners, there)
    np.maximum.at(found[1], fine_owners, back)
    return found[0], found[1], step


def largest_around(mesh: PolygonMesh, values: FloatArray) -> FloatArray:
    """(F,): the largest of each face and of those that share a vertex with it."""
    at_vertices = np.zeros(mesh.vertex_count)
    np.maximum.at(at_vertices, mesh.corner_vertices, values[mesh.corner_faces])
    return np.maximum.reduceat(at_vertices[mesh.corner_vertices], mesh.face_starts[:-1])
