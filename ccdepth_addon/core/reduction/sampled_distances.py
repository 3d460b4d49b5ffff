# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance of a mesh from a finer mesh near the surface, at samples. Samples are quick, and prove nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import AT_ONCE, chunks
from ..arrays.types import FloatArray, IndexArray
from ..deviation.columns import NONE
from ..deviation.surface_to_mesh import nearest_triangles
from ..deviation.triangles import Triangles, barycentric, places_among

# The largest number of vertices of the finer mesh taken as samples.
MOST_SAMPLES = 1 << 18

Tick = Callable[[], None]


@dataclass(frozen=True)
class Places:
    """The places of V vertices on a mesh. triangles: (V,) intp, the nearest triangle, or ``NONE`` if that faces away,
    as across a thin wall. weights: (V, 3) float64, the barycentric weights of the triangle's corners."""

    triangles: IndexArray
    weights: FloatArray


class SampledDistances:
    """Distances between a fine mesh and coarser ones, both ways, in parts of factors on the tolerance. Triangles of the
    mesh before keep their distances, and so do samples nearest to them. triangles: those of the fine mesh.

    positions: (V, 3) float64; corners: (T, 3) intp, of the fine mesh, at least one triangle; factors: (T,), of these.
    tick: is called again and again, and may raise to stop, here as in the methods.
    """

    def __init__(self, positions: FloatArray, corners: IndexArray, factors: FloatArray, tick: Tick) -> None:
        self.triangles, self._factors = Triangles.of(positions, corners, tick), factors
        at_vertices = np.full(len(positions), np.inf)
        np.minimum.at(at_vertices, corners, factors[:, None])
        used, first = np.unique(corners, return_index=True)
        chosen = slice(None, None, len(used) // MOST_SAMPLES + 1)
        self._samples, self._at_samples = positions[used[chosen]], at_vertices[used[chosen]]
        # Of the last mesh, at first the fine one: the triangles, the distances of their own points, and the triangle
        # that each sample is nearest to, with its distance.
        self._rows, self._own = self.triangles.rows, np.zeros(len(corners))
        self._nearest, self._apart = first[chosen] // 3, np.zeros(len(self._samples))

    def of(self, mesh: Triangles, positions: FloatArray, corners: IndexArray, tick: Tick) -> FloatArray:
        """(T,) float64: the longest distance at each triangle of a mesh. positions: (V, 3); corners: (T, 3), its own.

        A sample of the fine mesh counts for its nearest triangle, as found in this mesh or before; vertices, middles of
        edges and centroids of the coarse mesh count for their triangles.
        """
        rows = mesh.rows
        before = places_among(rows, self._rows)
        now = np.full(len(self._rows), NONE)
        there = np.flatnonzero(before != NONE)
        now[before[there]] = there
        nearest, apart = now[self._nearest], self._apart.copy()
        lost = np.flatnonzero(nearest == NONE)
        for block in chunks(len(lost), AT_ONCE):
            found = nearest_triangles(mesh, self._samples[lost[block]])
            nearest[lost[block]] = found.which
            apart[lost[block]] = found.distances / self._at_samples[lost[block]]
            tick()
        own, new = self._own[before], np.flatnonzero(before == NONE)
        own[new] = self._of_own_points(positions, corners[new], tick)
        self._rows, self._own, self._nearest, self._apart = rows, own, nearest, apart
        farthest = own.copy()
        np.maximum.at(farthest, nearest, apart)
        return farthest

    def _of_own_points(self, positions: FloatArray, corners: IndexArray, tick: Tick) -> FloatArray:
        """(T,): the longest distance of the vertices, middles of edges and centroid of triangles (T, 3)."""
        if not len(corners):
            return np.zeros(0)
        used, of_corners = np.unique(corners, return_inverse=True)
        at_vertices = self._from(positions[used], tick)[of_corners.reshape(corners.shape)]
        at_centroids = self._from(positions[corners].mean(axis=1), tick)
        edges, of_triangles = edges_of(corners)
        at_middles = self._from(positions[edges].mean(axis=1), tick)[of_triangles]
        found: FloatArray = np.concatenate([at_vertices, at_middles, at_centroids[:, None]], axis=1).max(axis=1)
        return found

    def places_of(self, positions: FloatArray, corners: IndexArray, tick: Tick) -> Places:
        """The places on the fine mesh of the vertices (V, 3) of a coarse one with triangles (T, 3)."""
        triangles = np.full(len(positions), NONE)
        weights = np.zeros((len(positions), 3))
        normals = vertex_normals(positions, corners)
        used = np.unique(corners)
        for block in chunks(len(used), AT_ONCE):
            chosen = used[block]
            found = nearest_triangles(self.triangles, positions[chosen])
            faces_it = (normals[chosen] * self.triangles.normals[found.which]).sum(axis=1) > 0
            triangles[chosen] = np.where(faces_it, found.which, NONE)
            weights[chosen] = barycentric(found.points, self.triangles.points[:, found.which])
            tick()
        return Places(triangles, weights)

    def _from(self, places: FloatArray, tick: Tick) -> FloatArray:
        """(P,): the distances of places (P, 3) from the fine mesh, in parts of factors."""
        distances = np.empty(len(places))
        for block in chunks(len(places), AT_ONCE):
            found = nearest_triangles(self.triangles, places[block])
            distances[block] = found.distances / self._factors[found.which]
            tick()
        return distances


def edges_of(corners: IndexArray) -> tuple[IndexArray, IndexArray]:
    """(E, 2) intp: the edges of triangles (T, 3); and (T, 3) intp: the edges of each triangle."""
    pairs = np.sort(np.stack([corners, corners[:, [1, 2, 0]]], axis=-1).reshape(-1, 2), axis=1)
    count = int(pairs.max()) + 1
    keys, of_pairs = np.unique(pairs[:, 0] * count + pairs[:, 1], return_inverse=True)
    return np.stack([keys // count, keys % count], axis=1), of_pairs.reshape(corners.shape)


def vertex_normals(positions: FloatArray, corners: IndexArray) -> FloatArray:
    """(V, 3): the sums of the normals of the triangles (T, 3) around vertices, by area; of any length."""
    a, b, c = np.moveaxis(positions[corners], 1, 0)
    normals = np.zeros_like(positions)
    for corner in corners.T:
        np.add.at(normals, corner, np.cross(b - a, c - a))
    return normals


def nearest_of(mesh: Triangles, places: FloatArray, tick: Tick) -> IndexArray:
    """(P,) intp: the triangle that places (P, 3) are nearest to."""
    which = np.empty(len(places), dtype=np.intp)
    for block in chunks(len(places), AT_ONCE):
        which[block] = nearest_triangles(mesh, places[block]).which
        tick()
    return which
