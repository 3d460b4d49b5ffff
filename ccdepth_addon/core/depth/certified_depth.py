# SPDX-License-Identifier: GPL-3.0-or-later
"""The certified depth: proved from the mesh itself, both ways, level by level.

For level k = 0, 1, 2, … the level-k facets of every face without a depth are tested against the tolerance. An upper
bound within the tolerance proves the level; a distance beyond the tolerance, reached somewhere, disproves it; otherwise
the undecided parts are split and evaluated again. Regular patches are bounded in closed form (``facet_bounds``) and
split by knot insertion, then in Bernstein form. All other faces are refined with their neighbours, together with the
level-k facets over them, until they are regular patches or their last bound is small enough (docs/methods.md,
Certified).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ..arrays.chunks import AT_ONCE, index_chunks
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import cross_products, dot_products, lengths, squared_norms, units
from ..bounds.facet_bounds import (
    CORNER_ROWS,
    control_corner_errors,
    control_facet_bounds,
    facet_error,
    later_bounds,
    sampled_error,
)
from ..bounds.norm_bounds import (
    Vertices,
    second_order_extraordinary,
    sharp_extraordinary,
    support_bounds,
)
from ..bounds.polygon_bounds import polygon_thickness
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import submesh
from ..surface.bicubic import HALVES, SPLINE_HALVES, bilinear_coefficients, largest_norm, patch_coefficients
from ..surface.parts import Parts
from ..surface.patches import PatchKind, classify_patches, extraordinary_nets, regular_nets
from ..surface.refinement import Refinement
from ..surface.stencils import by_valence
from .base_patches import (
    ExtraordinaryPatches,
    RegularPatches,
)
from .level_decision import LevelDecision
from .tolerance import FaceDepths, LevelBounds, ToleranceTest

# The number of faces whose refined mesh each thread holds.
OTHER_FACES_AT_ONCE = 1 << 10

# Cutting faces out with their neighbours scans the whole mesh, so this many chunks are cut out together.
OTHER_FACES_TOGETHER = 1 << 15

# The number of times undecided parts are split. Each split multiplies the gap between the bounds by about a quarter for
# a patch in Bernstein form, by the subdominant eigenvalue (0.41 to 0.68) around an extraordinary vertex, and by a half
# with only the support known. Bounds of what is drawn are first bounds, for which less is enough, and least for regular
# faces, which have others.
NET_SPLITS = 3
DIFFERENCE_SPLITS = 9
DRAWN_SPLITS = 1, 4
REFINEMENTS = 18

# Most undecided pieces in Bernstein form: of a face, before its level is given up, and of all faces at a time.
MOST_PIECES_OF_A_FACE = 128
MOST_PIECES = 1 << 13

# The least turn at a corner of a convex facet, in parts of its longest side squared.
LEAST_TURN = 2.0**-40


def certified_depths(
    mesh: PolygonMesh, faces: IndexArray, test: ToleranceTest, vertices: Vertices, tick: Callable[[], None]
) -> Iterator[FaceDepths]:
    """The certified depths of some faces, in chunks. tick: called while they compute, and may raise."""
    return map_in_threads(lambda begin: begin().run(), _searches(mesh, faces, test, vertices, False), tick)


@dataclass
class DrawnLevels:
    """The certified bounds of what is drawn, for triangles along either diagonal, level by level from ``level`` on."""

    mesh: PolygonMesh
    test: ToleranceTest
    vertices: Vertices
    level: int
    searches: list[_CertifiedSearch] | None = None

    def bounds(self, faces: IndexArray, tick: Callable[[], None]) -> FloatArray:
        """(n,): the bounds of faces (n,), ascending, at the next level; infinite without a proof. At later levels only
        faces without a proof may be asked for. tick: called meanwhile, and may raise to stop."""
        if self.searches is None:
            self.searches = [begin() for begin in _searches(self.mesh, faces, self.test, self.vertices, True)]
            for search in self.searches:
                search.skip_to(self.level)
        found = np.full(len(faces), np.inf)

        def evaluate(search: _CertifiedSearch) -> LevelBounds:
            places = np.minimum(np.searchsorted(faces, search.faces), max(len(faces) - 1, 0))
            return search.next_bounds(self.level, faces[places] == search.faces if len(faces) else search.faces < 0)

        for block in map_in_threads(evaluate, self.searches, tick):
            is_proved = np.isfinite(block.bounds)
            found[np.searchsorted(faces, block.faces[is_proved])] = block.bounds[is_proved]
        self.level += 1
        return found


def certified_level_bounds(
    mesh: PolygonMesh,
    faces: IndexArray,
    test: ToleranceTest,
    vertices: Vertices,
    level: int,
    tick: Callable[[], None],
    *,
    nearly: bool,
    as_drawn: bool = False,
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces at one level, in chunks. tick: called while they compute, and may raise.

    nearly: whether bounds have to be as near as in ``certified_depths``; other bounds take less time. as_drawn: whether
    the distance of triangles counts, along either diagonal, and not of facets.
    """
    searches = _searches(mesh, faces, test, vertices, as_drawn)
    return map_in_threads(lambda begin: begin().at(level, nearly=nearly), searches, tick)


def _searches(
    mesh: PolygonMesh, faces: IndexArray, test: ToleranceTest, vertices: Vertices, as_drawn: bool
) -> Iterator[Callable[[], _CertifiedSearch]]:
    """Functions that start the search of a chunk of the faces each."""

    def begin_regular(some: IndexArray) -> _CertifiedSearch:
        nets = [Parts(np.arange(len(some)), regular_nets(mesh, some))]
        return _CertifiedSearch(test, vertices, as_drawn, some, nets, None)

    def begin_other(part: PolygonMesh, own: IndexArray, some: IndexArray) -> _CertifiedSearch:
        return _CertifiedSearch(test, vertices, as_drawn, some, [], Refinement.start(part, own))

    is_regular = classify_patches(mesh).kinds[faces] == PatchKind.REGULAR
    # The slowest first, so that none of them runs alone at the end.
    for together in index_chunks(faces[~is_regular], OTHER_FACES_TOGETHER):
        part = submesh(mesh, together)[0]
        for own in index_chunks(np.arange(len(together)), OTHER_FACES_AT_ONCE):
            yield partial(begin_other, part, own, together[own])
    for some in index_chunks(faces[is_regular], AT_ONCE):
        yield partial(begin_regular, some)


@dataclass
class _CertifiedSearch:
    """The search for the depths of some base faces: their patches so far, and the refinement of the rest.

    as_drawn: as of ``certified_level_bounds``. new_patches: the regular patches that appear at the next level to be
    evaluated.
    """

    test: ToleranceTest
    vertices: Vertices
    as_drawn: bool
    faces: IndexArray
    new_patches: list[Parts]
    refinement: Refinement | None
    patches: list[RegularPatches] = field(default_factory=list)
    extraordinary: list[ExtraordinaryPatches] = field(default_factory=list)

    def skip_to(self, level: int) -> None:
        """Refine all base faces up to a level."""
        for own in range(level):
            self._collect_patches(own)
            self._descend(np.ones(len(self.faces), dtype=bool))

    def next_bounds(self, level: int, wanted: BoolArray) -> LevelBounds:
        """The proved bounds of the wanted base faces (B,) bool at the search's current level; the search goes on to the
        next level with wanted faces without a proof."""
        decision = LevelDecision.of(self.test, wanted)
        settled = self._evaluate_level(decision, level)
        self._descend(wanted & ~settled)
        return LevelBounds(self.faces, np.where(settled, decision.bounds(), np.inf))

    def run(self) -> FaceDepths:
        """The depths of the base faces."""
        depths = FaceDepths.undecided(self.faces)
        wanted = np.ones(len(self.faces), dtype=bool)
        level = 0
        while np.any(wanted):
            decision = LevelDecision.of(self.test, wanted)
            settled = self._evaluate_level(decision, level, with_distances=True)
            depths.settle(settled, level, decision.bounds(), decision.lower)
            # After a level that was neither proved nor disproved, no later depth is proved to be the least.
            depths.exact[decision.wanted & ~settled] = False
            wanted &= ~settled
            self._descend(wanted)
            level += 1
        return depths

    def at(self, level: int, *, nearly: bool) -> LevelBounds:
        """The proved bounds of all the base faces at one level. nearly: as of ``certified_level_bounds``."""
        everything = np.ones(len(self.faces), dtype=bool)
        decision = LevelDecision.of(self.test, everything)
        for own in range(level):
            self._collect_patches(own)
            if not nearly:
                self._settle_early(decision, own, level)
            self._descend(everything)
        settled = self._evaluate_level(decision, level)
        return LevelBounds(self.faces, np.where(settled, decision.bounds(), np.inf))

    def _evaluate_level(self, decision: LevelDecision, level: int, *, with_distances: bool = False) -> BoolArray:
        """Evaluate the search's current level; (B,) bool, the base faces proved to be within the tolerance.

        with_distances: whether to find the largest distances reached.
        """
        self._collect_patches(level)
        if self.as_drawn:
            decision.off = self._off_drawn(level)
            decision.wanted &= self.test.within(decision.off)
        self._evaluate_corners(decision)
        # The slowest to converge comes first: it disproves most levels, and then the many regular patches need not be
        # evaluated.
        for patches in self.extraordinary:
            patches = patches.at(decision.wanted[patches.bases])
            self._evaluate_extraordinary(decision, patches, patches.corners(self.vertices))
        evaluated = self._evaluate_patches(decision, level)
        self._evaluate_refinement(decision)
        if decision.open_differences:
            splits = DRAWN_SPLITS[self.refinement is not None] if self.as_drawn else DIFFERENCE_SPLITS
            first, *others = decision.open_differences
            self._evaluate_differences(decision, first.joined(others), splits)
        settled = decision.wanted & np.isfinite(decision.upper)
        for regular in evaluated:
            # Without bounds by the norm alone, the bounds from the nets are recorded already.
            if with_distances or regular.rough is not None:
                self._tighten_bounds(decision, regular.at(settled[regular.bases]), level)
        return settled

    def _settle_early(self, decision: LevelDecision, own: int, level: int) -> None:
        """At level ``own`` of the search, settle what norms and supports alone prove about the later ``level``.

        Settled parts are refined no further; mostly only parts near creases and irregular vertices remain.
        """
        for place, patches in enumerate(self.patches):
            if patches.level == own:
                rough = patches.rough_bounds(self.vertices).after(level - own)
                if self.as_drawn:
                    rough = rough + patches.off_drawn(level - own, self.vertices, self.test)
                self.patches[place] = patches.at(_undecided(decision, patches.bases, rough))
        if self.as_drawn:
            return
        of_valences = []
        for extraordinary in self.extraordinary:
            bounds = sharp_extraordinary(extraordinary.nets, self.vertices).after(level - own)
            of_valences.append(extraordinary.at(_undecided(decision, extraordinary.bases, bounds)))
        self.extraordinary = of_valences
        refinement = self.refinement
        if refinement is not None and len(refinement.bases) and np.all(refinement.mesh.face_sizes == 4):
            bounds = support_bounds(refinement.mesh, Vertices.LIMIT)[: len(refinement.bases)]
            self.refinement = refinement.keep(_undecided(decision, refinement.bases, bounds))

    def _descend(self, wanted: BoolArray) -> None:
        """Refine the wanted base faces to the next level."""
        self.patches = [patches.at(wanted[patches.bases]) for patches in self.patches]
        kept = (patches.at(wanted[patches.bases]) for patches in self.extraordinary)
        self.extraordinary = []
        for patches in kept:
            refined, regular = patches.refined()
            self.extraordinary.append(refined)
            self.new_patches.append(regular)
        if self.refinement is not None:
            self.refinement = self.refinement.of(wanted).refined()

    def _collect_patches(self, level: int) -> None:
        """Move the refinement's regular and extraordinary faces to the patches."""
        if self.refinement is not None and len(self.refinement.bases):
            mesh, bases = self.refinement.mesh, self.refinement.bases
            regular, extraordinary, rest = by_valence(mesh, np.arange(len(bases)), classify_patches(mesh))
            self.new_patches.append(Parts(bases[regular], regular_nets(mesh, regular)))
            for valence, faces, corners in extraordinary:
                nets = extraordinary_nets(mesh, corners, valence)
                self.extraordinary.append(ExtraordinaryPatches(bases[faces], nets))
            self.refinement = self.refinement.keep(rest)
        if self.new_patches:
            self.patches.append(RegularPatches.of(level, self.new_patches))
            self.new_patches = []

    def _off_drawn(self, level: int) -> FloatArray:
        """(B,): bounds of the distance between the facets at the search's current level and what is drawn."""
        found = np.zeros(len(self.faces))
        for regular in self.patches:
            np.maximum.at(found, regular.bases, regular.off_drawn(level - regular.level, self.vertices, self.test))
        for patches in self.extraordinary:
            np.maximum.at(found, patches.bases, _off_diagonals(patches.corners(self.vertices)))
        if self.refinement is not None and len(self.refinement.bases):
            off = _off_polygons(self.refinement, self.vertices.at_corners(self.refinement))
            np.maximum.at(found, self.refinement.bases, off)
        return found

    def _evaluate_corners(self, decision: LevelDecision) -> None:
        """Disprove faces by the distances of control points from their limits, where faces are not regular.

        This test is the cheapest, and disproves most insufficient levels.
        """
        if self.vertices is Vertices.CONTROL:
            for patches in self.extraordinary:
                gaps = largest_norm(patches.corners(Vertices.CONTROL) - patches.corners(Vertices.LIMIT))
                decision.disprove(patches.bases, gaps)
            rest = self.refinement
            if rest is not None and len(rest.bases):
                gaps = lengths(rest.limits_at_corners - Vertices.CONTROL.at_corners(rest))
                starts = rest.mesh.face_starts[: len(rest.bases)]
                decision.disprove(rest.bases, np.maximum.reduceat(gaps, starts))

    def _evaluate_patches(self, decision: LevelDecision, level: int) -> list[RegularPatches]:
        """The regular patches of the wanted faces, evaluated.

        For most patches of a refined face the bound by their norm alone is enough.
        """
        evaluated = []
        for patches in self.patches:
            patches = patches.at(decision.wanted[patches.bases])
            if not len(patches.bases):
                continue
            levels = level - patches.level
            if self.refinement is not None:
                near = self.test.within(patches.rough_bounds(self.vertices).after(levels) + decision.off[patches.bases])
                evaluated.append(patches.at(near))
                patches = patches.at(~near)
            self._evaluate_nets(decision, patches, levels)
            evaluated.append(patches)
        return evaluated

    def _evaluate_nets(self, decision: LevelDecision, patches: RegularPatches, levels: int) -> None:
        """Evaluate regular patches for the facets a number of levels after their own, with the cheapest bounds
        first."""
        undecided = decision.update(patches.bases, *self._first_bounds(patches, levels))
        left = Parts(patches.bases, patches.nets).at(undecided)
        splits = 0 if self.as_drawn else NET_SPLITS
        for remaining in range(levels, max(levels - splits, 0) - 1, -1):
            if not len(left.faces):
                return
            left = left.at(decision.update(left.faces, *self._closer_bounds(left.values, remaining)))
            if remaining == 0:
                decision.open_differences.append(Parts(left.faces, facet_error(left.values, self.vertices)))
                return
            left = left.quarters(SPLINE_HALVES)
        decision.give_up(left.faces)

    def _has_later_bounds(self, levels: int) -> bool:
        """Whether to use ``later_bounds``: a control facet of the patch's own level has better bounds."""
        return levels > 0 or self.vertices is Vertices.LIMIT

    def _first_bounds(self, patches: RegularPatches, levels: int) -> tuple[FloatArray, FloatArray]:
        """(P,) each: upper and lower bounds of the distances, a number of levels after the patches' own."""
        if not self._has_later_bounds(levels):
            return self._control_bounds(patches.nets)
        later = patches.later_bounds(self.vertices)
        return later.after(levels), later.least(levels)

    def _closer_bounds(self, nets: FloatArray, levels: int) -> tuple[FloatArray, FloatArray]:
        """(P,) each: upper bounds from the nets (4, 4, P, 3), and sampled distances."""
        if not self._has_later_bounds(levels):
            return self._control_bounds(nets)
        return later_bounds(nets, self.vertices).after(levels), sampled_error(nets, self.vertices, levels)

    def _control_bounds(self, nets: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(P,) each: upper and lower bounds for the control facets of the nets' own level. Corners alone disprove most
        facets."""
        lower = control_corner_errors(nets)
        upper = np.full(len(lower), np.inf)
        open_ = np.flatnonzero(~self.test.exceeds(lower))
        upper[open_] = control_facet_bounds(nets.take(open_, axis=2), lower[open_])
        return upper, lower

    def _tighten_bounds(self, decision: LevelDecision, patches: RegularPatches, level: int) -> None:
        """Record better bounds of settled faces' patches where they may hold the face's largest distance."""
        levels = level - patches.level
        if patches.rough is not None:
            within_reach = patches.rough.after(levels) > decision.lower[patches.bases]
            patches = patches.at(within_reach)
        elif not self._has_later_bounds(levels):
            # The evaluation of the patches has recorded these bounds.
            return
        if len(patches.bases):
            upper, lower = self._first_bounds(patches, levels)
            if self._has_later_bounds(levels):
                promising = np.flatnonzero(upper > decision.lower[patches.bases])
                lower[promising] = sampled_error(patches.nets.take(promising, axis=2), self.vertices, levels)
            decision.update(patches.bases, upper, lower)

    def _evaluate_extraordinary(
        self, decision: LevelDecision, patches: ExtraordinaryPatches, facets: FloatArray
    ) -> None:
        """Evaluate extraordinary patches for facets over them, (4, P, 3), refining them while undecided."""
        for _ in range(REFINEMENTS):
            if not len(patches.bases):
                return
            gaps = largest_norm(facets - patches.corners(Vertices.LIMIT))
            decision.disprove(patches.bases, gaps)
            undecided = np.flatnonzero(decision.wanted[patches.bases])
            if not len(undecided):
                return
            patches, facets, gaps = patches.at(undecided), facets.take(undecided, axis=1), gaps[undecided]
            last = second_order_extraordinary(patches.nets, Vertices.LIMIT).value
            undecided = np.flatnonzero(decision.update(patches.bases, gaps + last, gaps))
            if not len(undecided):
                return
            patches, regular = patches.at(undecided).refined()
            of_children = _facets_of_quads(facets.take(undecided, axis=1))
            facets = of_children[:, 0]
            off = patch_coefficients(regular.values) - bilinear_coefficients(of_children[:, 1:].reshape(4, -1, 3))
            decision.open_differences.append(Parts(regular.faces, off))
        decision.give_up(patches.bases)

    def _evaluate_refinement(self, decision: LevelDecision) -> None:
        """Evaluate the faces that are neither regular nor extraordinary, refining them while undecided."""
        if self.refinement is None:
            return
        if self.refinement.are_quads:
            # Once found for all faces, the limits of their children at the next level are known as well.
            _ = self.refinement.limits_at_corners
        refinement = self.refinement.of(decision.wanted)
        facets = self.vertices.at_corners(refinement)
        for _ in range(REFINEMENTS):
            if not len(refinement.bases):
                return
            if np.all(refinement.mesh.face_sizes == 4):
                gaps = largest_norm(_quads(facets) - _quads(refinement.limits_at_corners))
                last = support_bounds(refinement.mesh, Vertices.LIMIT)[: len(refinement.bases)]
                undecided = decision.update(refinement.bases, gaps + last, gaps)
                refinement, facets = refinement.keep(undecided), facets[np.repeat(undecided, 4)]
            refinement, facets = self._refine(decision, refinement, facets)
        decision.give_up(refinement.bases)

    def _refine(
        self, decision: LevelDecision, refinement: Refinement, facets: FloatArray
    ) -> tuple[Refinement, FloatArray]:
        """The children that are no patches, with the facets over them; all other children are evaluated."""
        if not len(refinement.bases):
            return refinement, facets
        facets = refinement.facets_of_children(facets)
        refinement = refinement.refined()
        mesh, bases = refinement.mesh, refinement.bases
        regular, extraordinary, rest = by_valence(mesh, np.arange(len(bases)), classify_patches(mesh))
        differences = patch_coefficients(regular_nets(mesh, regular))
        differences -= bilinear_coefficients(facets.take(regular, axis=1))
        decision.open_differences.append(Parts(bases[regular], differences))
        for valence, faces, corners in extraordinary:
            patches = ExtraordinaryPatches(bases[faces], extraordinary_nets(mesh, corners, valence))
            # From the extraordinary corner on, as in the nets.
            self._evaluate_extraordinary(decision, patches, facets[(corners + np.arange(4)[:, None]) % 4, faces])
        return refinement.keep(rest), facets.compress(rest, axis=1).swapaxes(0, 1).reshape(-1, 3)

    def _evaluate_differences(self, decision: LevelDecision, differences: Parts, splits: int) -> None:
        """Evaluate differences S - L in Bernstein form, splitting them while undecided, up to a number of times."""
        left = differences.at(decision.wanted[differences.faces])
        if not len(left.faces):
            return
        rows = left.values.reshape(16, -1, 3)
        left = left.at(decision.update(left.faces, largest_norm(rows), largest_norm(rows[CORNER_ROWS])))
        counts = np.bincount(left.faces, minlength=len(decision.wanted))
        # Where the distance equals the tolerance along a line, each split leaves more undecided pieces, without end.
        undecidable = counts > (MOST_PIECES_OF_A_FACE if splits else 0)
        if np.any(undecidable):
            decision.give_up(np.flatnonzero(undecidable))
            left = left.at(~undecidable[left.faces])
            counts[undecidable] = 0
        for some in _groups(counts, MOST_PIECES):
            self._evaluate_differences(decision, left.at(some[left.faces]).quarters(HALVES), splits - 1)


def _undecided(decision: LevelDecision, bases: IndexArray, upper: FloatArray) -> BoolArray:
    """Record upper bounds (P,) of parts of base faces (P,). Returns (P,) bool, the parts that are still undecided."""
    return decision.update(bases, upper, np.zeros(len(bases)))


def _groups(counts: IndexArray, most: int) -> Iterator[BoolArray]:
    """Base faces in groups of about ``most`` pieces together, given the pieces of each: (B,) bool for each group."""
    group = (np.cumsum(counts) - counts) // most
    for number in np.unique(group[counts > 0]):
        yield (group == number) & (counts > 0)


def _off_diagonals(facets: FloatArray) -> FloatArray:
    """(P,): bounds of the distance of bilinear facets (4, P, 3) from their triangles along either diagonal.
    docs/distance.md, Facets."""
    sides = np.roll(facets, -1, axis=0) - facets
    normals = units(cross_products(facets[2] - facets[0], facets[3] - facets[1]))
    twists = sides[2] + sides[0]
    turns = dot_products(cross_products(np.roll(sides, 1, axis=0), sides), normals).min(axis=0)
    is_convex = turns > LEAST_TURN * squared_norms(sides).max(axis=0)
    found: FloatArray = lengths(twists) / 4
    return np.where(is_convex, np.minimum(found, np.abs(dot_products(twists, normals)) / 2), found)


def _off_polygons(refinement: Refinement, corners: FloatArray) -> FloatArray:
    """(K,): bounds of the distance between the facets of descendants, given at their corners (C, 3), and what is drawn
    for these: 0 of triangles, which are their facets, and infinite of most polygons that are not convex."""
    count = len(refinement.bases)
    sizes, starts, found = refinement.mesh.face_sizes[:count], refinement.mesh.face_starts[:count], np.zeros(count)
    quads, polygons = np.flatnonzero(sizes == 4), np.flatnonzero(sizes > 4)
    found[quads] = _off_diagonals(corners[starts[quads] + np.arange(4)[:, None]])
    if len(polygons):
        facets = refinement.facets_of_children(corners)[:, np.repeat(sizes > 4, sizes)]
        first = np.cumsum(sizes[polygons]) - sizes[polygons]
        found[polygons] = polygon_thickness(facets, np.zeros(facets.shape[1], dtype=bool), first, None)
    return found


def _quads(corners: FloatArray) -> FloatArray:
    """(4, P, 3) from (4P, 3)."""
    return corners.reshape(-1, 4, 3).swapaxes(0, 1)


def _facets_of_quads(facets: FloatArray) -> FloatArray:
    """(4, 4, P, 3): bilinear facets (4, P, 3) restricted to the children: [corner of the child, child, facet]."""
    middles = (facets + facets[[1, 2, 3, 0]]) / 2
    centres = np.broadcast_to(facets.mean(axis=0), facets.shape)
    return np.stack([facets, middles, centres, middles[[3, 0, 1, 2]]])
