# SPDX-License-Identifier: GPL-3.0-or-later
"""Disproved levels: points of the limit surface that are farther than the tolerance from the whole mesh at a level.

docs/distance.md, Least depths. A point of the surface over a face, exact but for rounding, is compared with every drawn
triangle of the level, of all faces; heights over the triangles below the point prove nothing, as other triangles may be
nearer. Only faces that can be near the points are divided down to the level.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..arrays.chunks import AT_ONCE, index_chunks
from ..arrays.masks import mask
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import columns, cross_products, dot_products, units
from ..bounds.norm_bounds import Vertices
from ..deviation.box_tree import BoxTree, overlapping
from ..deviation.triangles import distance_slack, to_triangles
from ..distance.middle_distances import (
    are_apart,
    middle_distances,
    middle_parts,
    most_curved_parts,
    rates_of,
    tight_boxes,
)
from ..mesh.level_quads import QUAD_TRIANGLES, may_be_folded, turned_children
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import submesh
from ..mesh.touching_faces import surface_boxes
from ..surface.patches import PatchKind, classify_patches, regular_nets
from ..surface.refinement import Refinement
from .tolerance import ToleranceTest

# The number of faces examined together.
FACES_AT_ONCE = 1 << 7

# The number of leaves of a face, with the largest sag, that are divided for the next level; and of points of a face
# that are tried: this many highest over their own leaf, and this many farthest from it.
LEAVES_OF_A_FACE, POINTS_OF_A_FACE = 16, 24

# The number of levels from a face to a part of ``most_curved_parts``.
PART_LEVELS = 2

# The largest number of faces, up to a level, with which regular faces are examined all over, too; with more faces that
# would take longer than the depths. At each later level the number is halved.
MOST_FACES, LEVEL_OF_MOST_FACES = 1 << 10, 3

# ``to_triangles`` finds distances too long by less than this part of themselves, besides the slack.
RELATIVE_SLACK = 2.0**-36


@dataclass(frozen=True)
class DisprovedLevels:
    """The search for disproved levels of a mesh, with the vertices of its levels from 1 on, the test, and a tree of
    boxes, each of which contains all levels of a face. is_regular: (F,) bool. rates: (F,), as of ``rates_of``, of
    regular faces."""

    mesh: PolygonMesh
    vertices: Vertices
    test: ToleranceTest
    tree: BoxTree
    is_regular: BoolArray
    rates: FloatArray

    @staticmethod
    def of(mesh: PolygonMesh, vertices: Vertices, test: ToleranceTest, tick: Callable[[], None]) -> DisprovedLevels:
        """The search for a mesh. tick: called meanwhile; it may raise to stop."""
        is_regular = classify_patches(mesh).kinds == PatchKind.REGULAR
        low, high = np.empty((2, mesh.face_count, 3))
        regular, others = np.flatnonzero(is_regular), np.flatnonzero(~is_regular)
        if len(others):
            around = surface_boxes(submesh(mesh, others)[0])
            low[others], high[others] = (ends[:, : len(others)].T for ends in around)
        rates = np.zeros(mesh.face_count)
        condition = 1.0 if mesh.axes is None else float(np.linalg.cond(mesh.axes))

        def look(some: IndexArray) -> None:
            nets = regular_nets(mesh, some)
            low[some], high[some] = tight_boxes(nets)
            rates[some] = rates_of(nets, condition)

        for _ in map_in_threads(look, index_chunks(regular, AT_ONCE), tick):
            pass
        return DisprovedLevels(mesh, vertices, test, BoxTree.around(low, high), is_regular, rates)

    def all_before(self, level: int, faces: IndexArray, tick: Callable[[], None]) -> BoolArray:
        """(n,) bool: whether every level before this one is disproved for faces (n,): some point of the surface over
        the face is proved to be farther than the tolerance from the whole mesh at that level. tick: as in ``of``."""
        found = np.zeros(self.mesh.face_count, dtype=bool)
        regular = index_chunks(faces[self.is_regular[faces]], AT_ONCE)
        for some in map_in_threads(lambda chunk: self._disproved_at_middle(level, chunk), regular, tick):
            found[some] = True
        left = faces[~found[faces]]
        if len(left) > MOST_FACES >> max(level - LEVEL_OF_MOST_FACES, 0):
            left = left[~self.is_regular[left]][:MOST_FACES]
        # The last level is the nearest to the surface, mostly.
        for lesser in range(level - 1, -1, -1):
            parts = map_in_threads(partial(self._disproved, lesser), index_chunks(left, FACES_AT_ONCE), tick)
            left = np.concatenate([left[:0], *parts])
        found[left] = True
        return found[faces]

    def _disproved_at_middle(self, level: int, faces: IndexArray) -> IndexArray:
        """The regular faces, among some, for which points near the middle, or near the middle of the most curved part,
        disprove every level before this one."""
        nets, of_parts = regular_nets(self.mesh, faces), np.zeros(len(faces), dtype=bool)
        for lesser in range(level - 1, -1, -1):
            is_far = self._are_far_at_middle(nets, faces, lesser, lesser)
            rest = np.flatnonzero(~is_far)
            if lesser >= PART_LEVELS and len(rest):
                parts = most_curved_parts(nets[:, :, rest])
                is_far[rest] = self._are_far_at_middle(parts, faces[rest], lesser, lesser - PART_LEVELS)
                of_parts[rest] = True
            far = np.flatnonzero(is_far)
            faces, of_parts, nets = faces[far], of_parts[far], nets.take(far, axis=2)
        if not len(faces):
            return faces
        reach = self.test.tolerance + 2 * self.test.allowance
        some = np.flatnonzero(of_parts)
        places = np.concatenate([np.arange(len(faces)), some])
        middles = np.concatenate([middle_parts(nets), middle_parts(most_curved_parts(nets[:, :, some]))], axis=1)
        owners, others = overlapping(
            BoxTree.around(middles.min(axis=0) - reach, middles.max(axis=0) + reach), self.tree
        )
        is_other = faces[places[owners]] != others
        owners, others = owners[is_other], others[is_other]
        is_near = ~self.is_regular[others]
        beside = np.flatnonzero(~is_near)
        others_there = regular_nets(self.mesh, others[beside])
        is_near[beside] = ~are_apart(others_there, middles[:, owners[beside]], reach)
        alone = np.ones(len(faces), dtype=bool)
        alone[places[owners[is_near]]] = False
        return faces[alone]

    def _are_far_at_middle(self, nets: FloatArray, faces: IndexArray, level: int, levels: int) -> BoolArray:
        """(P,) bool: whether a point near the middle of a part of each face (4, 4, P, 3) is farther than the tolerance
        from a level over the face. levels: from the part's own level to this level."""
        rates = self.rates[faces] * 0.5 ** (level - levels)
        return self.test.exceeds(middle_distances(nets, rates, levels, self.vertices.of_level(level)))

    def _disproved(self, level: int, faces: IndexArray) -> IndexArray:
        """The faces, among some, for which one of their points disproves a level."""
        points, bases = self._samples(level, faces)
        return np.unique(faces[bases[self._are_far(level, points)]])

    def _samples(self, level: int, faces: IndexArray) -> tuple[FloatArray, IndexArray]:
        """Points of the surface (n, 3), with the indices (n,) of their faces: the highest over their own leaves at a
        level and the farthest from these leaves, among the corners and the middles of sides and of quads one level
        later, and two levels later while leaves are few. Points near their leaves are left out."""
        leaves = _Leaves.start(self.mesh, faces, self.vertices.of_level(level))
        for _ in range(level):
            leaves = leaves.refined().with_largest_sag(LEAVES_OF_A_FACE)
        leaves = leaves.with_largest_sag(LEAVES_OF_A_FACE)
        children = leaves.refinement.refined()
        owners = np.repeat(np.arange(len(leaves.refinement.bases)), leaves.refinement.mesh.face_sizes[: leaves.count])
        # With limit vertices the corners are on the surface.
        is_off = leaves.shown is Vertices.CONTROL
        points, parents = [children.limits_at_corners[::4]] * is_off, [owners] * is_off
        for later in range(2 if level < PART_LEVELS else 1):
            if later:
                children, owners = children.refined(), np.repeat(owners, 4)
            corners = children.limits_at_corners.reshape(-1, 4, 3)
            # The last corner but one of a face's children is the middle of the face.
            is_first = np.arange(len(owners)) % 4 == 0 if later else np.diff(owners, prepend=-1) > 0
            points += [corners[:, 1], corners[is_first, 2]]
            parents += [owners, owners[is_first]]
        places, of_leaf = np.concatenate(points), np.concatenate(parents)
        off, heights = leaves.own_distances(places, of_leaf)
        far = np.flatnonzero(self.test.exceeds(off))
        places, bases = places[far], leaves.refinement.bases[of_leaf[far]]
        chosen = [_largest_of_each(each[far], bases, POINTS_OF_A_FACE) for each in (off, heights)]
        first = np.unique(np.concatenate(chosen))
        return places[first], bases[first]

    def _are_far(self, level: int, points: FloatArray) -> BoolArray:
        """(n,) bool: whether points (n, 3) are proved to be farther than the tolerance from the whole mesh at a
        level."""
        found = np.ones(len(points), dtype=bool)
        if not len(points):
            return found
        reach = self.test.tolerance + 2 * self.test.allowance
        around = BoxTree.around(points - reach, points + reach)
        leaves = _Leaves.start(self.mesh, np.unique(overlapping(around, self.tree)[1]), self.vertices.of_level(level))
        for later in range(level):
            if later:
                boxes = (ends[:, : leaves.count].T for ends in surface_boxes(leaves.refinement.mesh))
                near = mask(leaves.count, overlapping(around, BoxTree.around(*boxes))[1])
                leaves = leaves.keep(near)
            if not leaves.count:
                return found
            leaves = leaves.refined()
        if not leaves.count:
            return found
        for owners, lower in leaves.distances(points, around):
            found[owners[~self.test.exceeds(lower)]] = False
        return found


@dataclass(frozen=True)
class _Leaves:
    """Faces of a level. is_turned: (K,) bool, whether the drawn diagonal is from corner 1 to 3. shown: the kind of
    their vertices. axes: of their control mesh."""

    refinement: Refinement
    is_turned: BoolArray
    shown: Vertices
    axes: FloatArray | None

    @staticmethod
    def start(mesh: PolygonMesh, faces: IndexArray, shown: Vertices) -> _Leaves:
        return _Leaves(Refinement.start(mesh, faces), np.zeros(len(faces), dtype=bool), shown, mesh.axes)

    @property
    def count(self) -> int:
        return len(self.refinement.bases)

    @property
    def sizes(self) -> IndexArray:
        return self.refinement.mesh.face_sizes[: self.count]

    def keep(self, wanted: BoolArray) -> _Leaves:
        """The leaves to keep: (K,) bool."""
        return _Leaves(self.refinement.keep(wanted), self.is_turned[wanted], self.shown, self.axes)

    def refined(self) -> _Leaves:
        return _Leaves(self.refinement.refined(), turned_children(self.is_turned, self.sizes), self.shown, self.axes)

    def corners(self) -> FloatArray:
        """(C, 3): the drawn positions of the corners."""
        return self.shown.at_corners(self.refinement)

    def with_largest_sag(self, count: int) -> _Leaves:
        """The leaves with the largest sag, at most ``count`` of each base if all are quads. The sag is the estimated
        height of the surface over the corners and over the middles of sides and diagonals."""
        if not self.refinement.are_quads or np.bincount(self.refinement.bases, minlength=1).max() <= count:
            return self
        a, b, c, d = self.corners().reshape(-1, 4, 3).swapaxes(0, 1)
        normals = units(cross_products(c - a, d - b))
        sides, centres = self.refinement.limits_inside()
        w, x, y, z = sides.reshape(-1, 4, 3).swapaxes(0, 1)
        centre = centres[::4]
        off = [w - (a + b) / 2, x - (b + c) / 2, y - (c + d) / 2, z - (d + a) / 2, centre - (a + c) / 2]
        limits = self.refinement.limits_at_corners.reshape(-1, 4, 3).swapaxes(0, 1)
        off += [limits[0] - a, limits[1] - b, limits[2] - c, limits[3] - d]
        sag = np.abs(dot_products(np.stack(off), normals)).max(axis=0)
        wanted = mask(self.count, _largest_of_each(sag, self.refinement.bases, count))
        return self.keep(wanted)

    def triangles(self) -> tuple[FloatArray, IndexArray]:
        """The corners (T, 3, 3) of all triangles that may be drawn for quads and triangles, and the leaf of each
        (T,)."""
        corners, starts = self.corners(), self.refinement.mesh.face_starts[: self.count]
        triangles, quads = np.flatnonzero(self.sizes == 3), np.flatnonzero(self.sizes == 4)
        points = corners[starts[quads][:, None] + np.arange(4)]
        turned = self.is_turned[quads]
        drawn = [corners[starts[triangles][:, None] + np.arange(3)]]
        owners = [triangles]
        folded = np.flatnonzero(may_be_folded(points, turned, self.axes))
        # The diagonal of these quads is unknown.
        for some, is_turned in ((np.arange(len(quads)), turned), (folded, ~turned[folded])):
            order = QUAD_TRIANGLES[is_turned.astype(np.intp)].reshape(-1, 3)
            which = np.repeat(some, 2)
            drawn.append(points[which[:, None], order])
            owners.append(quads[which])
        return np.concatenate(drawn), np.concatenate(owners)

    def slabs(self) -> tuple[IndexArray, FloatArray, FloatArray, FloatArray]:
        """The polygons with more than four corners (N,), unit vectors (N, 3), and the least (N,) and the largest height
        (N,) of their corners along these: any triangles drawn for a polygon are between both heights."""
        polygons = np.flatnonzero(self.sizes > 4)
        if not len(polygons):
            return polygons, np.zeros((0, 3)), np.zeros(0), np.zeros(0)
        mesh = self.refinement.mesh
        own = np.flatnonzero(np.repeat(self.sizes > 4, self.sizes))
        starts = np.cumsum(self.sizes[polygons]) - self.sizes[polygons]
        points = self.corners()
        middles = np.repeat(
            np.add.reduceat(points[own], starts) / self.sizes[polygons][:, None], self.sizes[polygons], 0
        )
        areas = cross_products(points[own] - middles, points[mesh.next_corner[own]] - middles)
        normals = units(np.add.reduceat(areas, starts))
        heights = dot_products(points[own], np.repeat(normals, self.sizes[polygons], axis=0))
        return polygons, normals, np.minimum.reduceat(heights, starts), np.maximum.reduceat(heights, starts)

    def own_distances(self, points: FloatArray, leaves: IndexArray) -> tuple[FloatArray, FloatArray]:
        """(n,) twice: upper bounds of the distances from points (n, 3) to a leaf each, infinite for uncut polygons; and
        the heights over the plane of the leaf's nearest triangle."""
        found, heights = np.full(len(points), np.inf), np.zeros(len(points))
        corners, owners = self.triangles()
        normals = units(cross_products(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
        order = np.argsort(owners, kind="stable")
        first = np.searchsorted(owners[order], np.arange(self.count))
        counts = np.bincount(owners, minlength=self.count)
        for place in range(int(counts.max(initial=0))):
            some = np.flatnonzero(place < counts[leaves])
            which = order[first[leaves[some]] + place]
            off = to_triangles(columns(points[some]), columns(corners[which]))[0]
            nearer = off < found[some]
            some, which = some[nearer], which[nearer]
            found[some] = off[nearer]
            heights[some] = np.abs(dot_products(points[some] - corners[which, 0], normals[which]))
        polygons, directions, low, high = self.slabs()
        numbers = np.full(self.count, -1)
        numbers[polygons] = np.arange(len(polygons))
        some = np.flatnonzero(numbers[leaves] >= 0)
        heights[some] = _off_slabs(points[some], directions, low, high, numbers[leaves[some]])
        return found, heights

    def distances(self, points: FloatArray, around: BoxTree) -> list[tuple[IndexArray, FloatArray]]:
        """(m,) twice, in batches: points, and lower bounds of their distances from drawn things, for all things in
        boxes around the points."""
        found = []
        corners, _ = self.triangles()
        if len(corners):
            owners, which = overlapping(around, BoxTree.around(corners.min(axis=1), corners.max(axis=1)))
            own = corners[which]
            off = to_triangles(columns(points[owners]), columns(own))[0]
            found.append((owners, off * (1 - RELATIVE_SLACK) - distance_slack(own.swapaxes(0, 1))))
        polygons, normals, low, high = self.slabs()
        if len(polygons):
            starts = np.cumsum(self.sizes) - self.sizes
            boxes = [each.reduceat(self.corners(), starts)[polygons] for each in (np.minimum, np.maximum)]
            owners, which = overlapping(around, BoxTree.around(*boxes))
            found.append((owners, _off_slabs(points[owners], normals, low, high, which)))
        return found


def _off_slabs(
    points: FloatArray, normals: FloatArray, low: FloatArray, high: FloatArray, which: IndexArray
) -> FloatArray:
    """(n,): lower bounds of the distances from points (n, 3) to a slab each, ``which`` (n,) of ``_Leaves.slabs``."""
    heights = dot_products(points, normals[which])
    return np.maximum(low[which] - heights, heights - high[which])


def _largest_of_each(values: FloatArray, bases: IndexArray, count: int) -> IndexArray:
    """(m,) intp: the indices of the largest values (n,), ``count`` for each base."""
    order = np.lexsort((-values, bases))
    starts = np.searchsorted(bases[order], bases[order])
    return order[np.arange(len(order)) - starts < count]
