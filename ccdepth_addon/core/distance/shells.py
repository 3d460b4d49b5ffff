# SPDX-License-Identifier: GPL-3.0-or-later
"""A shell: the drawn triangles of a level, thickened along vectors at their vertices.

A point of the shell is T(p) + s N(p), where T and N are linear on every triangle, and |s| is at most the triangle's
range. Each triangle has a prism, and prisms meet in walls over the sides. If no prism is turned inside out, and the
prisms go once around every vertex, every path near the triangles has a unique place in the shell. docs/distance.md,
Shells. Triangles beyond the first M are flaps: each flap continues the triangle at a closed side, in its plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.masks import mask
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import component_major, cross_products, dot_products, lengths, squared_norms, sums_by_index, units

# The least cosine between a vector and the normals of the triangles around.
LEAST_COSINE = 0.05

# The part used by the shell of the range at which a prism might be turned inside out.
RANGE_SHARE = 0.9


@dataclass(frozen=True)
class JoinedTriangles:
    """T triangles of a shell: M triangles, then flaps. corners, vectors: (T, 3, 3), T(p) and N(p) at the corners.
    normals: (T, 3), unit vectors. vertices: (M, 3) intp, with vertices duplicated along closed sides; origins: (V,)
    intp, the original vertices. across: (M, 3) intp, the triangle across each side, from corner k to k + 1; apexes:
    (M, 3) intp, the opposite corner of the triangle across. is_closed: (M, 3) bool, sides with a flap across.
    """

    corners: FloatArray
    vectors: FloatArray
    normals: FloatArray
    vertices: IndexArray
    origins: IndexArray
    across: IndexArray
    apexes: IndexArray
    is_closed: BoolArray

    @staticmethod
    def of(corners: FloatArray, vertices: IndexArray) -> JoinedTriangles:
        """The triangles with corners (M, 3, 3) and vertices (M, 3), joined at sides of exactly two triangles of one
        orientation, with flaps at all other sides. Vectors are mean normals."""
        across, apexes, is_closed = _neighbours(vertices)
        normals = units(cross_products(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
        vertices, origins = _cut(vertices, across, apexes, is_closed)
        vectors = units(sums_by_index(vertices.ravel(), np.repeat(normals, 3, axis=0), len(origins)))[vertices]
        own, side = np.nonzero(is_closed)
        across[own, side] = len(corners) + np.arange(len(own))
        apexes[own, side] = 2
        flaps, their_vectors = _flaps(corners, vectors, normals, own, side)
        return JoinedTriangles(
            np.concatenate([corners, flaps]),
            np.concatenate([vectors, their_vectors]),
            np.concatenate([normals, normals[own]]),
            vertices,
            origins,
            across,
            apexes,
            is_closed,
        )

    def flap_vertices(self) -> IndexArray:
        """(T - M, 2) intp: the vertices of the flaps' first two corners."""
        own, side = np.nonzero(self.is_closed)
        return np.stack([self.vertices[own, (side + 1) % 3], self.vertices[own, side]], axis=1)


def _cut(
    vertices: IndexArray, across: IndexArray, apexes: IndexArray, is_closed: BoolArray
) -> tuple[IndexArray, IndexArray]:
    """(M, 3): the vertices, duplicated so that each belongs to triangles joined at open sides; and (V,): the original
    of each."""
    at_border = np.zeros(int(vertices.max(initial=-1)) + 1, dtype=bool)
    own, side = np.nonzero(is_closed)
    at_border[vertices[own, side]] = at_border[vertices[own, (side + 1) % 3]] = True
    # Corners of one vertex have one label.
    labels = np.where(at_border[vertices], len(at_border) + np.arange(vertices.size).reshape(-1, 3), vertices)
    own, side = np.nonzero(~is_closed & (at_border[vertices] | at_border[np.roll(vertices, -1, axis=1)]))
    there, apex = across[own, side], apexes[own, side]
    pairs = [((own, side), (there, (apex + 2) % 3)), ((own, (side + 1) % 3), (there, (apex + 1) % 3))]
    while True:
        before = labels.copy()
        for first, second in pairs:
            np.minimum.at(labels, first, labels[second])
        if np.array_equal(before, labels):
            break
    _, first, cut = np.unique(labels, return_index=True, return_inverse=True)
    return cut.reshape(vertices.shape), vertices.ravel()[first]


def _neighbours(vertices: IndexArray) -> tuple[IndexArray, IndexArray, BoolArray]:
    """``JoinedTriangles.across``, ``apexes`` and ``is_closed`` of triangles (M, 3): a side is open between exactly two
    triangles of one orientation."""
    count = int(vertices.max(initial=-1)) + 1
    ends = np.stack([vertices.ravel(), np.roll(vertices, -1, axis=1).ravel()])
    keys = ends.min(axis=0) * count + ends.max(axis=0)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    first = order[starts[np.diff(np.append(starts, len(keys))) == 2]]
    second = order[starts[np.diff(np.append(starts, len(keys))) == 2] + 1]
    opposite = ends[0, first] == ends[1, second]
    twins = np.full(len(keys), -1)
    twins[first[opposite]], twins[second[opposite]] = second[opposite], first[opposite]
    twins = twins.reshape(-1, 3)
    return np.maximum(twins, 0) // 3, (np.maximum(twins, 0) % 3 + 2) % 3, twins < 0


def _flaps(
    corners: FloatArray, vectors: FloatArray, normals: FloatArray, own: IndexArray, side: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """The corners and vectors (n, 3, 3) of the flaps at sides of triangles, each half as high as its side is long."""
    end, start = (own, (side + 1) % 3), (own, side)
    along = corners[end] - corners[start]
    outwards = units(cross_products(along, normals[own])) * lengths(along)[:, None] / 2
    apexes = (corners[end] + corners[start]) / 2 + outwards
    middles = (vectors[end] + vectors[start]) / 2
    return (
        np.stack([corners[end], corners[start], apexes], axis=1),
        np.stack([vectors[end], vectors[start], middles], axis=1),
    )


@dataclass(frozen=True)
class Shell:
    """The triangles of a shell with the ranges of their prisms.

    cosines: (T,), the least cosine between a triangle's normal and its vectors. ranges: (M,), the largest |s| for paths
    that begin at a triangle, at most the limit; 0 where the shell proves nothing. radii: (V,), the distance of each
    vertex from the opposite sides; least_cosines: (V,), the least of the triangles at each vertex. mean_normals:
    (V, 3), spreads: (V,), the mean normal of the triangles at each vertex, and a bound of their distance from the mean.
    is_border: (V,) bool, vertices of closed sides. star_starts: (V + 1,) intp, and star_triangles: the triangles at
    each vertex, vertex by vertex. planes: (4, T, 3), unit normals of planes through the sides of a triangle, inwards,
    and of its own plane; slopes: (3, T), how far a wall is off such a plane, times |s|.
    """

    triangles: JoinedTriangles
    cosines: FloatArray
    ranges: FloatArray
    radii: FloatArray
    least_cosines: FloatArray
    mean_normals: FloatArray
    spreads: FloatArray
    is_border: BoolArray
    star_starts: IndexArray
    star_triangles: IndexArray
    planes: FloatArray
    slopes: FloatArray

    @staticmethod
    def of(triangles: JoinedTriangles, is_whole: BoolArray, limits: FloatArray) -> Shell:
        """The shell over triangles. is_whole: whether all triangles around an original vertex are given, or beyond
        closed sides. limits: (M,), the largest distances of use."""
        cosines = dot_products(triangles.normals[:, None], triangles.vectors).min(axis=1)
        prism_ranges = np.where(cosines > LEAST_COSINE, _prism_ranges(triangles), 0.0)
        stars = _Stars.of(triangles, is_whole[triangles.origins], prism_ranges)
        ranges = np.minimum(stars.ranges[triangles.vertices].min(axis=1), limits)
        least = np.full(len(triangles.origins), np.inf)
        at, normals = np.repeat(np.arange(len(least)), np.diff(stars.starts)), triangles.normals[stars.triangles]
        np.minimum.at(least, at, cosines[stars.triangles])
        means, spreads = units(sums_by_index(at, normals, len(least))), np.zeros(len(least))
        np.maximum.at(spreads, at, lengths(normals - means[at]))
        return Shell(
            triangles, cosines, ranges, stars.distances, least, means, spreads, stars.is_border, stars.starts,
            stars.triangles, *_walls(triangles),
        )  # fmt: skip


def _walls(triangles: JoinedTriangles) -> tuple[FloatArray, FloatArray]:
    """``Shell.planes`` and ``slopes``."""
    corners, vectors = (component_major(each.swapaxes(0, 1)) for each in (triangles.corners, triangles.vectors))
    planes, slopes = [], []
    for side in range(3):
        first, second = vectors[side], vectors[(side + 1) % 3]
        planes.append(units(cross_products(first + second, units(corners[(side + 1) % 3] - corners[side]))))
        slopes.append(np.maximum(*(np.abs(dot_products(planes[-1], vector)) for vector in (first, second))))
    return component_major(np.stack([*planes, triangles.normals])), np.stack(slopes)


# Where vectors are parallel there is no such range.
@np.errstate(over="ignore")
def _prism_ranges(triangles: JoinedTriangles) -> FloatArray:
    """(T,): the largest |s| up to which a prism is not turned inside out: N · (T_u + s N_u) × (T_v + s N_v) > 0 at the
    corners, and so in the whole prism."""
    (along, across), (turn, other_turn) = (
        (each[:, 1] - each[:, 0], each[:, 2] - each[:, 0]) for each in (triangles.corners, triangles.vectors)
    )
    area = cross_products(along, across)
    linear = cross_products(along, other_turn) + cross_products(turn, across)
    square = cross_products(turn, other_turn)
    constant, first, second = (dot_products(triangles.vectors, each[:, None]) for each in (area, linear, square))
    first, second = np.abs(first), np.abs(second)
    roots = 2 * constant / np.maximum(first + np.sqrt(first**2 + 4 * second * np.maximum(constant, 0)), 1e-300)
    return RANGE_SHARE * np.maximum(roots.min(axis=1), 0.0)


@dataclass(frozen=True)
class _Stars:
    """The triangles at each of V vertices. ranges: (V,), the least range of their prisms, 0 where triangles are unknown
    or do not go around once; distances: (V,), lower bounds of the distance of the opposite sides; starts, triangles,
    is_border: as in ``Shell``."""

    ranges: FloatArray
    distances: FloatArray
    is_border: BoolArray
    starts: IndexArray
    triangles: IndexArray

    @staticmethod
    def of(triangles: JoinedTriangles, is_whole: BoolArray, prism_ranges: FloatArray) -> _Stars:
        count, own, every = len(is_whole), len(triangles.vertices), len(triangles.corners)
        flap_vertices = triangles.flap_vertices()
        which = np.concatenate([np.repeat(np.arange(own), 3), np.repeat(np.arange(own, every), 2)])
        corners = np.concatenate([np.tile(np.arange(3), own), np.tile(np.arange(2), every - own)])
        vertices = np.concatenate([triangles.vertices.ravel(), flap_vertices.ravel()])
        order = np.argsort(vertices, kind="stable")
        which, corners, vertices = which[order], corners[order], vertices[order]
        angle, distance = _at_corners(triangles, which, corners)
        angles = np.bincount(vertices, weights=angle, minlength=count)
        ranges, distances = np.full((2, count), np.inf)
        np.minimum.at(ranges, vertices, prism_ranges[which])
        np.minimum.at(distances, vertices, distance)
        is_border = mask(count, flap_vertices.ravel())
        # Angles below a half turn go around an inner vertex a whole number of times.
        goes_once = angles < np.where(is_border, 2 * np.pi * (1 - 2.0**-20), 3 * np.pi)
        starts = np.concatenate([[0], np.cumsum(np.bincount(vertices, minlength=count))])
        return _Stars(np.where(is_whole & goes_once, ranges, 0.0), distances, is_border, starts, which)


def _at_corners(triangles: JoinedTriangles, which: IndexArray, corners: IndexArray) -> tuple[FloatArray, FloatArray]:
    """(n,) each: the angles of triangles at given corners, seen along the vectors there; and the distances of the
    opposite sides."""
    points, vector = triangles.corners[which, corners], triangles.vectors[which, corners]
    following = triangles.corners[which, (corners + 1) % 3] - points
    before = triangles.corners[which, (corners + 2) % 3] - points
    across = dot_products(vector, cross_products(following, before))
    along = dot_products(following, before) - dot_products(following, vector) * dot_products(before, vector)
    opposite = before - following
    part = -dot_products(following, opposite) / np.maximum(squared_norms(opposite), 1e-300)
    nearest = following + np.clip(part, 0.0, 1.0)[:, None] * opposite
    return np.arctan2(across, along), lengths(nearest)
