# SPDX-License-Identifier: GPL-3.0-or-later
"""Flat parts of a control mesh: faces over which the surface lies in one plane, whatever their polygons.

The surface over a face is in the convex hull of the vertices of the faces around its corners. So where all of these lie
in one plane, or nearly, so does the surface, and the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import cross_products, dot_products, squared_norms, sums_by_index
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import corners_of_faces
from .quadtree import NONE

# Two faces are in one plane if their vertices are, but for some units in the last place of single precision, in parts
# of the largest coordinate; and their normals before that is looked at.
ROUNDING_OF_INPUT = 2.0**-20
SAME_DIRECTION = 1 - 1e-6

# A flat part may be so thick, in parts of the limit.
THICKEST = 1 / 8


@dataclass(frozen=True)
class FlatParts:
    """parts: (faces,) intp, the flat part over which each face lies with all the faces around its corners, or NONE. Of
    each part normals (parts, 3), unit vectors, and thicknesses (parts,), along them. centres and radii: (faces, 3) and
    (faces,), of balls that hold all vertices of the faces around a face's corners."""

    parts: IndexArray
    normals: FloatArray
    thicknesses: FloatArray
    centres: FloatArray
    radii: FloatArray

    @staticmethod
    def of(mesh: PolygonMesh, limit: float) -> FlatParts:
        """Those that are thin enough for a limit on the distance."""
        nothing = FlatParts(
            np.full(mesh.face_count, NONE), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0)
        )
        if not mesh.face_count:
            return nothing
        doubled = _area_vectors(mesh)
        pairs = _pairs_in_one_plane(mesh, doubled)
        if not len(pairs):
            return nothing
        _, labels = np.unique(_connected(mesh.face_count, pairs), return_inverse=True)
        labels = labels.reshape(-1)
        count = int(labels.max()) + 1
        normals = sums_by_index(labels, doubled, count)
        lengths = np.sqrt(squared_norms(normals))[:, None]
        normals /= np.where(lengths > 0, lengths, 1.0)
        of_corner = labels[mesh.corner_faces]
        heights = dot_products(mesh.positions[mesh.corner_vertices], normals[of_corner])
        highest, lowest = np.full(count, -np.inf), np.full(count, np.inf)
        np.maximum.at(highest, of_corner, heights)
        np.minimum.at(lowest, of_corner, heights)
        thicknesses = highest - lowest
        least, greatest = np.full(mesh.vertex_count, count), np.full(mesh.vertex_count, NONE)
        np.minimum.at(least, mesh.corner_vertices, of_corner)
        np.maximum.at(greatest, mesh.corner_vertices, of_corner)
        at_one = (least == greatest)[mesh.corner_vertices]
        is_flat = np.logical_and.reduceat(at_one, mesh.face_starts[:-1]) & (thicknesses <= THICKEST * limit)[labels]
        if not np.any(is_flat):
            return nothing
        return FlatParts(np.where(is_flat, labels, NONE), normals, thicknesses, *_supports(mesh))

    def is_flat(self, faces: IndexArray) -> BoolArray:
        """(faces,) bool."""
        return self.parts[faces] != NONE


def _supports(mesh: PolygonMesh) -> tuple[FloatArray, FloatArray]:
    """(F, 3) and (F,): centres and radii of balls around the vertices of the faces around faces' corners."""
    starts, vertices = mesh.face_starts[:-1], mesh.corner_vertices
    ends = []
    for extreme in (np.minimum, np.maximum):
        of_faces = extreme.reduceat(mesh.positions[vertices], starts, axis=0)
        of_vertices = mesh.positions.copy()
        extreme.at(of_vertices, vertices, of_faces[mesh.corner_faces])
        ends.append(extreme.reduceat(of_vertices[vertices], starts, axis=0))
    lows, highs = ends
    return (lows + highs) / 2, np.sqrt(squared_norms(highs - lows)) / 2 * (1 + ROUNDING_OF_INPUT)


def _area_vectors(mesh: PolygonMesh) -> FloatArray:
    """(F, 3): twice the area of faces, along their normals."""
    points = (
        mesh.positions[mesh.corner_vertices]
        - mesh.positions[mesh.corner_vertices[mesh.face_starts[:-1]]][mesh.corner_faces]
    )
    crosses = cross_products(points, points[mesh.next_corner])
    return sums_by_index(mesh.corner_faces, crosses, mesh.face_count)


def _pairs_in_one_plane(mesh: PolygonMesh, doubled: FloatArray) -> IndexArray:
    """(N, 2): faces on both sides of an edge, with all vertices in one plane, but for rounding."""
    lengths = np.sqrt(squared_norms(doubled))[:, None]
    normals = doubled / np.where(lengths > 0, lengths, 1.0)
    shared = np.flatnonzero(mesh.twin > np.arange(mesh.corner_count))
    pairs = np.stack([mesh.corner_faces[shared], mesh.corner_faces[mesh.twin[shared]]], axis=1)
    pairs = pairs[dot_products(normals[pairs[:, 0]], normals[pairs[:, 1]]) > SAME_DIRECTION]
    near = ROUNDING_OF_INPUT * np.abs(mesh.positions).max(initial=0.0)
    keep = np.ones(len(pairs), dtype=bool)
    for plane in range(2):
        for other in range(2):
            keep &= _is_in_plane(mesh, normals, pairs[:, plane], pairs[:, other], near)
    return pairs[keep]


def _is_in_plane(
    mesh: PolygonMesh, normals: FloatArray, planes: IndexArray, faces: IndexArray, near: float
) -> BoolArray:
    """(N,): whether all vertices of faces are near the planes of others, both (N,)."""
    if not len(faces):
        return np.zeros(0, dtype=bool)
    corners, sizes = corners_of_faces(mesh, faces), mesh.face_sizes[faces]
    origins = mesh.positions[mesh.corner_vertices[mesh.face_starts[planes]]]
    off = mesh.positions[mesh.corner_vertices[corners]] - np.repeat(origins, sizes, axis=0)
    heights = np.abs(dot_products(off, np.repeat(normals[planes], sizes, axis=0)))
    return np.maximum.reduceat(heights, np.cumsum(sizes) - sizes) <= near


def _connected(count: int, pairs: IndexArray) -> IndexArray:
    """(count,): for each of so many the least of all that pairs (N, 2) connect with it."""
    labels = np.arange(count)
    while True:
        before = labels.copy()
        least = np.minimum(labels[pairs[:, 0]], labels[pairs[:, 1]])
        # The representatives of both take the lesser label, and all that follow them jump there.
        for side in range(2):
            np.minimum.at(labels, before[pairs[:, side]], least)
            np.minimum.at(labels, pairs[:, side], least)
        labels = labels[labels]
        if np.array_equal(labels, before):
            return labels
