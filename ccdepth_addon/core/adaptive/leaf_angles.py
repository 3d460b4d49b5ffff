# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of the angles between the normals of the surface and those of the drawn triangles of leaves.

*Shading* compares the normals stored at the corners of a triangle, interpolated, *facets* the triangle's own normal. A
leaf needs no neighbours: its surface is paired with its own triangles, both ways, within the limit of distance
(``paired_triangles``). docs/normals.md has the proofs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from ..arrays.chunks import AT_ONCE, index_chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import lengths, units
from ..distance.leaf_surfaces import MOST_REFINED_LEVELS, Tiles
from ..distance.piece_hulls import Pieces
from ..distance.pieces import Form
from .leaf_bounds import bound_at_equal, drawn_tiles, joined_by_points
from .leaf_normals import are_semi_sharp, leaf_normals
from .leaf_triangles import LeafTriangles
from .paired_triangles import MeasuredAngles, MeasuredPieces, PairedTriangles
from .plan import Plan
from .quad_normals import are_narrow, ways_of_normals
from .rectangle_tree import QUARTERS
from .surface_pieces import pieces_of_tiles

# Leaves, and pieces, worked through together.
LEAVES_AT_ONCE, PIECES_AT_ONCE = 1 << 11, 1 << 9

# The rest around a vertex has at most about this size, in parts of the limit and of its leaf.
REST_OF_LIMIT, REST_OF_LEAF = 0.25, 1 / 64


def beyond_angles(plan: Plan) -> tuple[IndexArray, IndexArray]:
    """The leaves whose angles exceed the limits, and how to split them: across the direction in which interpolated
    normals miss more. Leaves too narrow to count are never split."""
    leaves = plan.tree.leaves()
    wanted = leaves[np.isnan(plan.shading.values[leaves])]
    bound_at_equal(plan, wanted)
    for some in index_chunks(wanted, LEAVES_AT_ONCE):
        bound_angles(plan, some)
    angles = np.stack([plan.shading.values[leaves], plan.facets.values[leaves]])
    failed = leaves[(angles > plan.angle_limits(leaves)).any(axis=0)]
    failed = failed[~are_narrow_leaves(plan, failed)]
    return failed, ways_by_normals(plan, failed)


def proved_angles(plan: Plan, leaves: IndexArray) -> tuple[FloatArray, BoolArray]:
    """(n,): the proved angles of leaves, in radians, of shading where it counts, otherwise of facets, and 0 where none
    counts or the leaf is too narrow; and (n,) bool: whether leaves have parts too narrow to count."""
    limits = plan.angle_limits(leaves)
    angles = np.stack([plan.shading.values[leaves], plan.facets.values[leaves]])
    counts = np.isfinite(limits)
    is_narrow = (counts & ~(angles <= limits)).any(axis=0)
    own = np.where(counts[0], angles[0], np.where(counts[1], angles[1], 0.0))
    return np.where(is_narrow | np.isnan(own), 0.0, own), is_narrow | plan.has_narrow.values[leaves]


def are_narrow_leaves(plan: Plan, leaves: IndexArray) -> BoolArray:
    """(n,) bool: whether leaves are quads too narrow to count."""
    found = plan.tree.is_quad(leaves)
    corners = plan.positions.of(plan.tree.slot_vertices[plan.tree.quad_slots(leaves[found])].ravel())
    found[found] = are_narrow(corners.reshape(-1, 4, 3).swapaxes(0, 1), plan.reaches(leaves[found]))
    return found


def ways_by_normals(plan: Plan, leaves: IndexArray) -> IndexArray:
    """(n,): how to split leaves by their normals."""
    ways = np.full(len(leaves), QUARTERS)
    if not plan.request.may_halve:
        return ways
    angle = plan.request.shading or plan.request.facets
    for some in index_chunks(np.flatnonzero(plan.surfaces.are_bicubic(leaves)), AT_ONCE):
        ways[some] = ways_of_normals(plan.surfaces.coefficients(leaves[some]), angle)
    return ways


def bound_angles(plan: Plan, leaves: IndexArray) -> None:
    """Bound the angles of shading and of facets of leaves, ascending, and the distances of the pairs; infinite where
    nothing is proved. Parts too narrow to count are left out."""
    limits, approximation = plan.limits.values[leaves], plan.approximation(leaves)
    triangles = LeafTriangles.of(plan, leaves, approximation)
    corners, firsts = triangles.corners(plan), triangles.firsts
    is_polygon = ~plan.tree.is_quad(leaves) & (plan.tree.slot_counts(leaves) > 3)
    normals = _stored_normals(plan, leaves, triangles)
    drawn = PairedTriangles.of(triangles, corners, normals, is_polygon[triangles.leaves], plan.request)
    wanted = plan.angle_limits(leaves)
    pieces = [*_pieces(plan, leaves, triangles, corners)]
    angles, distances = np.full((2, len(leaves)), np.inf), np.full(len(leaves), np.inf)

    def prove(drawn: PairedTriangles, added: FloatArray, off: FloatArray, *, is_along_axis: bool) -> None:
        """Bound the angles of pairs that are near enough, and note distances within the limit."""
        within, paired = off <= limits, (off <= plan.reaches(leaves)) & (angles > wanted).any(axis=0)
        distances[within] = np.minimum(distances[within], off[within])
        found = MeasuredAngles.none(drawn, wanted[:, triangles.leaves] - added, is_along_axis=is_along_axis)
        for some, form, is_narrow in _of_leaves(pieces, drawn, paired):
            if form.quarters and not is_narrow:
                found.include(some, form)
        largest = np.maximum.reduceat(found.angles + added, firsts[:-1], axis=1)
        angles[:, paired] = np.minimum(angles[:, paired], largest[:, paired])

    at_equal = MeasuredPieces.none(drawn)
    for some, _, _ in _of_leaves(pieces, drawn, np.ones(len(leaves), dtype=bool)):
        at_equal.include_at_equal(some)
    off = np.minimum(at_equal.distances_at_equal() + approximation.thickness, plan.at_equal.values[leaves])
    prove(drawn, drawn.allowances, off, is_along_axis=False)
    is_left = (angles > wanted).any(axis=0) | np.isinf(distances)
    along = MeasuredPieces.none(drawn.along_common_axes())
    for some, form, _ in _of_leaves(pieces, drawn, is_left):
        along.include_along_axis(some, form)
    added, off = along.pairs_along_axis()
    off = np.where(is_left, off + approximation.thickness, np.inf)
    prove(along.triangles, drawn.allowances + added, off, is_along_axis=True)
    plan.shading.values[leaves], plan.facets.values[leaves] = angles
    plan.paired.values[leaves] = distances
    plan.report()


def _pieces(
    plan: Plan, leaves: IndexArray, triangles: LeafTriangles, corners: FloatArray
) -> Iterator[tuple[Pieces, Form, bool]]:
    """The pieces of the surface over the triangles of leaves, joined by form, and whether they are too narrow."""
    found: defaultdict[tuple[int, int, bool], list[tuple[Pieces, Form]]] = defaultdict(list)
    semi_sharp = are_semi_sharp(plan, leaves)
    for tiles in joined_by_points(drawn_tiles(plan, leaves, _levels(plan, leaves))):
        sizes = _sizes(tiles.tiles)
        narrow = semi_sharp[tiles.leaves] & (sizes.min(axis=0) < plan.reaches(leaves)[tiles.leaves])
        plan.has_narrow.values[leaves[tiles.leaves[narrow]]] = True
        narrow |= sizes.max(axis=0) < REST_OF_LIMIT * plan.limits.values[leaves[tiles.leaves]]
        for is_narrow in (False, True):
            some = tiles.at(narrow == is_narrow)
            if len(some.leaves):
                for _, pieces, form in pieces_of_tiles(corners, some, triangles.firsts[some.leaves] + some.firsts):
                    found[id(form), len(pieces.hulls), is_narrow].append((pieces, form))
    for (_, _, is_narrow), alike in found.items():
        (first, *others), (form, *_) = zip(*alike, strict=True)
        yield first.joined(others), form, is_narrow


def _of_leaves(
    pieces: list[tuple[Pieces, Form, bool]], drawn: PairedTriangles, chosen: BoolArray
) -> Iterator[tuple[Pieces, Form, bool]]:
    """The pieces of chosen leaves (n,), some at a time."""
    is_chosen = drawn.at_leaves(chosen)
    for every, form, is_narrow in pieces:
        for some in index_chunks(np.flatnonzero(is_chosen[every.triangles]), PIECES_AT_ONCE):
            yield every.at(some), form, is_narrow


def _levels(plan: Plan, leaves: IndexArray) -> int:
    """The levels of tiles after which rests are small."""
    others = leaves[~plan.surfaces.are_bicubic(leaves)]
    if not len(others):
        return 1
    counts = plan.tree.slot_counts(others)
    starts = np.cumsum(counts) - counts
    corners = plan.positions.of(plan.tree.slot_vertices[plan.tree.slots(others)])
    sizes = lengths(np.maximum.reduceat(corners, starts) - np.minimum.reduceat(corners, starts))
    of_limits = (sizes / (REST_OF_LIMIT * plan.limits.values[others])).max()
    needed = np.ceil(np.log2(4 * np.maximum(of_limits, 1 / REST_OF_LEAF)))
    return int(np.clip(needed, 2, MOST_REFINED_LEVELS))


def _sizes(tiles: Tiles) -> FloatArray:
    """(2, P): the lengths of tiles along u and v, the larger of two opposite sides; of rests infinite."""
    if not tiles.are_bicubic:
        return np.full((2, tiles.points.shape[1]), np.inf)
    net = tiles.points.reshape(4, 4, -1, 3)
    along = lengths(np.diff(net[:, [0, 3]], axis=0)).sum(axis=0).max(axis=0)
    across = lengths(np.diff(net[[0, 3]], axis=1)).sum(axis=1).max(axis=0)
    return np.stack([along, across])


def _stored_normals(plan: Plan, leaves: IndexArray, triangles: LeafTriangles) -> FloatArray:
    """(M, 3, 3): the normals at the corners of triangles; at the means of polygons the mean of their normals."""
    tree, slots, counts = plan.tree, plan.tree.slots(leaves), plan.tree.slot_counts(leaves)
    stored = leaf_normals(plan, leaves)
    owners = np.repeat(np.arange(len(leaves)), counts)
    count = len(tree.vertex_edges) + len(leaves)
    middles = tree.midpoints[tree.slot_edges[slots]]
    # Whole sides have no middle vertex: their keys are never wanted.
    keys = np.concatenate([owners * count + tree.slot_vertices[slots], owners * count + middles])
    means = units(np.add.reduceat(stored[0], np.cumsum(counts) - counts))
    keys = np.append(keys, np.arange(len(leaves)) * count + len(tree.vertex_edges) + np.arange(len(leaves)))
    normals = np.concatenate([stored[0], stored[1], means])
    keys[len(slots) : 2 * len(slots)][middles < 0] = -1
    order = np.argsort(keys, kind="stable")
    wanted = triangles.leaves[:, None] * count + triangles.used[triangles.vertices]
    found: FloatArray = normals[order[np.searchsorted(keys[order], wanted)]]
    return found
