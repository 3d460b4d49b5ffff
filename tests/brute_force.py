# SPDX-License-Identifier: GPL-3.0-or-later
"""Least depths by brute force: distances of the facets of every level from the limit surface, at very many parameters.

Nothing here is bounded or proved, and nothing of the methods is used, only subdivision and limit positions. Sampled
distances are true ones, hence never too large; where they look a little too small for a depth, ``reached`` looks for
the largest one more closely.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.depth.tolerance import FaceDepths
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.mesh.submesh import submesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def linear_children(mesh: PolygonMesh, values: FloatArray) -> FloatArray:
    """(C, D) values at the corners of some first faces → (4C, D) at the corners of their children, by bilinear facets.

    The facet of an n-gon is the fan of quads over corner, edge midpoint, centroid and edge midpoint.
    """
    count = len(values)
    faces = mesh.corner_faces[count - 1] + 1
    centroids = np.add.reduceat(values, mesh.face_starts[:faces]) / mesh.face_sizes[:faces, None]
    middles = (values + values[mesh.next_corner[:count]]) / 2
    before = middles[mesh.previous_corner[:count]]
    return np.stack([values, middles, centroids[mesh.corner_faces[:count]], before], axis=1).reshape(4 * count, -1)


def quad_places(levels: int) -> FloatArray:
    """(4 · 4ᵏ, 2): where the corners of a quad's descendants after k steps lie in it."""
    places = SQUARE[None]
    for _ in range(levels):
        middles = (places + np.roll(places, -1, axis=1)) / 2
        centres = np.broadcast_to(places.mean(axis=1, keepdims=True), places.shape)
        places = np.stack([places, middles, centres, np.roll(middles, 1, axis=1)], axis=2).reshape(-1, 4, 2)
    return places.reshape(-1, 2)


class Levels:
    """The levels of a mesh whose sharpness is explicit, each made when it is asked for."""

    def __init__(self, mesh: PolygonMesh) -> None:
        self._meshes = [mesh]
        self._limits: tuple[int, FloatArray] = (-1, mesh.positions)

    def mesh(self, level: int) -> PolygonMesh:
        return self.subdivided(level)

    def subdivided(self, level: int) -> PolygonMesh:
        """The core's mesh of a level, which is also the order of its faces and vertices."""
        while len(self._meshes) <= level:
            self._meshes.append(subdivide(self._meshes[-1]))
        return self._meshes[level]

    def limits(self, level: int) -> FloatArray:
        """(V, 3): where the vertices of a level go. Those of earlier levels come first, in the same order."""
        if self._limits[0] != level:
            self._limits = (level, limit_positions(self.mesh(level)))
        return self._limits[1]

    def offsets(self, points: FloatArray, level: int, deeper: int) -> FloatArray:
        """(C, D): bilinear facets of a level with its vertices at points (V, D) minus the limits, at the corners of so
        many levels later, which go through the faces of the mesh in their order."""
        values = points[self.subdivided(level).corner_vertices]
        for finer in range(level, level + deeper):
            values = linear_children(self.subdivided(finer), values)
        return values - self.limits(level + deeper)[self.subdivided(level + deeper).corner_vertices]

    def facet_offsets(self, level: int, vertices: str, deeper: int) -> FloatArray:
        """(C, D): Lᵏ(u, v) - S(u, v), at steps so many levels below level k's."""
        points = self.mesh(level).positions if vertices == "CONTROL" else self.limits(level + deeper)
        return self.offsets(points, level, deeper)

    def distances(self, level: int, vertices: str, deeper: int) -> FloatArray:
        """(F,): the largest length of those on each face of the mesh."""
        gaps = np.linalg.norm(self.facet_offsets(level, vertices, deeper), axis=1)
        # The corners of a face's descendants lie together, four times as many with every level.
        return np.maximum.reduceat(gaps, self.subdivided(0).face_starts[:-1] * 4 ** (level + deeper))


# In the search for the largest distance: how often the steps are halved, and how many quads of a face go on each time.
ROUNDS = 12
QUADS_OF_A_FACE = 256

# Beyond this level there is no such search, as all of a face is subdivided so often: the samples decide.
LAST_CLOSE_LEVEL = 8


def reached(mesh: PolygonMesh, faces: IndexArray, level: int, vertices: str) -> FloatArray:
    """(faces,): distances of the level's facets that are really reached, the largest one as far as can be found.

    The parameters' steps are halved again and again, in the end only around the farthest samples. Many are followed, as
    near semi-sharp creases the largest distance may stand between samples that are not the farthest.
    """
    part, bases = submesh(mesh, faces)[0], np.arange(len(faces))
    for _ in range(level):
        part, bases = _children(part, bases)
    points = part.positions if vertices == "CONTROL" else limit_positions(part)
    values = points[part.corner_vertices[: part.face_starts[len(bases)]]]
    farthest = np.zeros(len(faces))
    for _ in range(ROUNDS):
        values = linear_children(part, values)
        part, bases = _children(part, bases)
        limits = limit_positions(part)[part.corner_vertices[: len(values)]]
        gaps = np.linalg.norm(values - limits, axis=1).reshape(-1, 4).max(axis=1)
        np.maximum.at(farthest, bases, gaps)
        order = np.lexsort((-gaps, bases))
        starts = np.searchsorted(bases[order], bases[order])
        near = order[np.arange(len(order)) - starts < QUADS_OF_A_FACE]
        values = values.reshape(-1, 4, 3)[near].reshape(-1, 3)
        part, bases = submesh(part, near)[0], bases[near]
    return farthest


def _children(mesh: PolygonMesh, bases: IndexArray) -> tuple[PolygonMesh, IndexArray]:
    """The children of the mesh's first faces, and around them no more than they depend on; and their base faces."""
    bases = np.repeat(bases, mesh.face_sizes[: len(bases)])
    return submesh(subdivide(mesh), np.arange(len(bases)))[0], bases


@dataclass
class Comparison:
    """Depths next to the brute-force least ones, in numbers of faces.

    confirmed: equal, once the largest distance had been looked for more closely. wrongly_exact: not equal, though said
    to be exact. unproved: said not to be exact. unknown: with more levels than were measured.
    """

    faces: int = 0
    equal: int = 0
    confirmed: int = 0
    one_above: int = 0
    more_above: int = 0
    below: int = 0
    wrongly_exact: int = 0
    unproved: int = 0
    unknown: int = 0

    def __iadd__(self, other: Comparison) -> Comparison:
        for field in fields(self):
            setattr(self, field.name, getattr(self, field.name) + getattr(other, field.name))
        return self

    @property
    def equal_share(self) -> float:
        return self.equal / max(self.faces, 1)


def compare(mesh: PolygonMesh, sampled: FloatArray, found: FaceDepths, tolerance: float, vertices: str) -> Comparison:
    """Compare depths with the least ones by (levels, F) sampled distances, nan where a level was not measured.

    Where a depth is above, the lesser levels are measured again, closely, as far as ``LAST_CLOSE_LEVEL``.
    """
    sampled = sampled.copy()
    least = least_depths(sampled, tolerance)
    at_first = (least >= 0) & (found.depths == least)
    for level in range(min(len(sampled), LAST_CLOSE_LEVEL + 1)):
        faces = np.flatnonzero((least >= 0) & (level < found.depths) & (sampled[level] <= tolerance))
        if len(faces):
            sampled[level, faces] = np.maximum(sampled[level, faces], reached(mesh, faces, level, vertices))
    least = least_depths(sampled, tolerance)
    measured = np.sum(np.cumprod(~np.isnan(sampled), axis=0), axis=0)
    # Within so few levels none is enough: a depth among them is too little, others cannot be judged.
    below = np.where(least < 0, found.depths < measured, found.depths < least)
    known = (least >= 0) | below
    above = np.where(known & ~below, found.depths - least, 0)
    equal = known & ~below & (above == 0)
    return Comparison(
        faces=np.count_nonzero(known),
        equal=np.count_nonzero(equal),
        confirmed=np.count_nonzero(equal & ~at_first),
        one_above=np.count_nonzero(above == 1),
        more_above=np.count_nonzero(above > 1),
        below=np.count_nonzero(below),
        wrongly_exact=np.count_nonzero(known & ~equal & found.exact),
        unproved=np.count_nonzero(known & ~found.exact),
        unknown=np.count_nonzero(~known),
    )


def least_depths(sampled: FloatArray, tolerance: float) -> NDArray[np.intp]:
    """(F,): the first level within the tolerance, -1 where there is none before a level that was not measured."""
    near = sampled <= tolerance
    first = near.argmax(axis=0)
    measured = np.sum(np.cumprod(~np.isnan(sampled), axis=0), axis=0)
    return np.where(near.any(axis=0) & (first < measured), first, -1)
