# SPDX-License-Identifier: GPL-3.0-or-later
"""The certified depth: proved from the mesh itself, both ways, level by level.

For level k = 0, 1, 2, … the level-k facets of every face without a depth are tested against the tolerance. An upper
bound on their distance can prove them within it, a distance reached somewhere on them can disprove it; while neither
does, the undecided parts are split and evaluated again. Regular patches are bounded in closed form (``facet_bounds``)
and split by knot insertion, then in Bernstein form. All other faces are refined with their neighbours, together with
the level-k facets over them, until they are regular patches or their last bound is small enough (docs/methods.md,
Certified).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..arrays.chunks import AT_ONCE, index_chunks
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.facet_bounds import (
    CORNER_ROWS,
    LaterBounds,
    control_corner_errors,
    control_facet_bounds,
    facet_error,
    later_bounds,
    sampled_error,
)
from ..bounds.norm_bounds import (
    PatchBounds,
    Vertices,
    second_order_extraordinary,
    second_order_regular,
    sharp_extraordinary,
    support_bounds,
)
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import submesh
from ..surface.bicubic import HALVES, SPLINE_HALVES, bilinear_coefficients, both_ways, largest_norm, patch_coefficients
from ..surface.patches import PatchKind, PatchKinds, classify_patches, extraordinary_nets, regular_nets, ring_index
from ..surface.refinement import Refinement
from ..surface.stencils import LARGEST_STENCIL_VALENCE, PatchStencils, apply_stencils, patch_stencils
from .tolerance import FaceDepths, LevelBounds, ToleranceTest

# Each thread holds the refined mesh around so many.
OTHER_FACES_AT_ONCE = 1 << 10

# Cutting faces out of the mesh with their neighbours scans all of it, so many chunks are cut out together.
OTHER_FACES_TOGETHER = 1 << 15

# How often undecided parts are split. Each split multiplies the gap between the bounds by about a quarter for a patch
# in Bernstein form, by the subdominant eigenvalue (0.41 to 0.68) around an extraordinary vertex, and by a half where
# only the support is known.
NET_SPLITS = 3
DIFFERENCE_SPLITS = 9
REFINEMENTS = 18

# Most undecided pieces in Bernstein form: of a face, before its level is given up, and of all faces at a time.
MOST_PIECES_OF_A_FACE = 128
MOST_PIECES = 1 << 13


# (P,) base faces, and (4, 4, P, 3) a net or the Bernstein coefficients of S - L for each.
BasePatches = tuple[IndexArray, FloatArray]


def certified_depths(
    mesh: PolygonMesh, faces: IndexArray, test: ToleranceTest, vertices: Vertices, tick: Callable[[], None]
) -> Iterator[FaceDepths]:
    """The certified depths of some faces, in chunks. tick: called while they compute, and may raise."""
    return map_in_threads(lambda begin: begin().run(), _searches(mesh, faces, test, vertices), tick)


def certified_bounds_at(
    mesh: PolygonMesh,
    faces: IndexArray,
    test: ToleranceTest,
    vertices: Vertices,
    levels: NDArray[np.int32],
    tick: Callable[[], None],
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces, each at its own level, in chunks; as near as those of ``certified_depths``.

    levels: (F,) int32. tick: called while they compute, and may raise.
    """
    return map_in_threads(lambda begin: begin().at_each(levels), _searches(mesh, faces, test, vertices), tick)


def certified_level_bounds(
    mesh: PolygonMesh, faces: IndexArray, test: ToleranceTest, vertices: Vertices, level: int, tick: Callable[[], None]
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces at one level, in chunks. tick: called while they compute, and may raise."""
    return map_in_threads(lambda begin: begin().at(level), _searches(mesh, faces, test, vertices), tick)


def _searches(
    mesh: PolygonMesh, faces: IndexArray, test: ToleranceTest, vertices: Vertices
) -> Iterator[Callable[[], _CertifiedSearch]]:
    """Functions that start the search of a chunk of the faces each."""

    def begin_regular(some: IndexArray) -> _CertifiedSearch:
        nets = [(np.arange(len(some)), regular_nets(mesh, some))]
        return _CertifiedSearch(test, vertices, some, nets, None)

    def begin_other(part: PolygonMesh, own: IndexArray, some: IndexArray) -> _CertifiedSearch:
        return _CertifiedSearch(test, vertices, some, [], Refinement.start(part, own))

    is_regular = classify_patches(mesh).kinds[faces] == PatchKind.REGULAR
    # The slowest first, so that none of them runs alone at the end.
    for together in index_chunks(faces[~is_regular], OTHER_FACES_TOGETHER):
        part = submesh(mesh, together)[0]
        for own in index_chunks(np.arange(len(together)), OTHER_FACES_AT_ONCE):
            yield partial(begin_other, part, own, together[own])
    for some in index_chunks(faces[is_regular], AT_ONCE):
        yield partial(begin_regular, some)


@dataclass
class _Patches:
    """Regular patches that appear at one level: (P,) base faces.

    rows: (P,) indices of their nets in (4, 4, N, 3), which may still hold nets of faces that are settled.
    rough, later: bounds by the norm alone and from the net itself, computed on first use.
    """

    level: int
    bases: IndexArray
    rows: IndexArray
    nets: FloatArray
    rough: PatchBounds | None = None
    later: LaterBounds | None = None

    @staticmethod
    def joined(level: int, pieces: list[BasePatches]) -> _Patches:
        """The patches of several pieces together."""
        bases, nets = pieces[0] if len(pieces) == 1 else _joined(pieces)
        return _Patches(level, bases, np.arange(len(bases)), nets)

    def of(self, wanted: BoolArray) -> _Patches:
        """Those of some of the base faces: (B,) bool."""
        return self.at(np.flatnonzero(wanted[self.bases]))

    def at(self, chosen: IndexArray) -> _Patches:
        """Some of them, by index."""
        if len(chosen) == len(self.bases):
            return self
        rough = None if self.rough is None else replace(self.rough, value=self.rough.value[chosen])
        later = None if self.later is None else self.later.of(chosen)
        return _Patches(self.level, self.bases[chosen], self.rows[chosen], self.nets, rough, later)

    def nets_of(self, chosen: IndexArray) -> FloatArray:
        """(4, 4, chosen, 3): the nets of some of the patches, by index."""
        return self.nets.take(self.rows[chosen], axis=2)

    def compact(self) -> FloatArray:
        """(4, 4, P, 3): the nets of these patches, all others dropped."""
        if len(self.rows) < self.nets.shape[2]:
            self.nets, self.rows = self.nets.take(self.rows, axis=2), np.arange(len(self.rows))
        return self.nets

    def rough_bounds(self, vertices: Vertices) -> PatchBounds:
        if self.rough is None:
            self.rough = second_order_regular(self.compact(), vertices)
        return self.rough

    def later_bounds(self, vertices: Vertices) -> LaterBounds:
        if self.later is None:
            self.later = later_bounds(self.compact(), vertices)
        return self.later


@dataclass
class _ExtraordinaryPatches:
    """Extraordinary patches of one valence at the level being evaluated: (P,) base faces, (2n + 8, P, 3) nets."""

    bases: IndexArray
    nets: FloatArray

    @property
    def stencils(self) -> PatchStencils:
        return patch_stencils((len(self.nets) - 8) // 2)

    def at(self, chosen: IndexArray) -> _ExtraordinaryPatches:
        """Some of them, by index."""
        return _ExtraordinaryPatches(self.bases[chosen], self.nets.take(chosen, axis=1))

    def corners(self, vertices: Vertices) -> FloatArray:
        """(4, P, 3): the corners of their facets, in the face's order."""
        if vertices is Vertices.LIMIT:
            return apply_stencils(self.stencils.limits, self.nets)
        valence = (len(self.nets) - 8) // 2
        return self.nets[[0, *(ring_index(valence, number) for number in (6, 5, 4))]]

    def refined(self) -> tuple[_ExtraordinaryPatches, IndexArray, FloatArray]:
        """The children at the extraordinary vertices; the bases (3P,) and nets (4, 4, 3P, 3) of the regular ones."""
        regular = apply_stencils(self.stencils.regular, self.nets).reshape(3, 4, 4, -1, 3)
        regular = np.moveaxis(regular, 0, 2).reshape(4, 4, -1, 3)
        refined = _ExtraordinaryPatches(self.bases, apply_stencils(self.stencils.refined, self.nets))
        return refined, np.tile(self.bases, 3), regular


@dataclass
class _LevelDecision:
    """Bounds of the level-k facets of B base faces so far.

    wanted: (B,) bool, faces that are not disproved. upper, lower: (B,) float64, distances at most and at least over the
    decided parts. lasting: (B,) bool, proved faces that are so at all later levels, too. open_differences: S - L where
    it is still undecided.
    """

    test: ToleranceTest
    wanted: BoolArray
    upper: FloatArray
    lower: FloatArray
    lasting: BoolArray
    open_differences: list[BasePatches] = field(default_factory=list)

    @staticmethod
    def of(test: ToleranceTest, wanted: BoolArray) -> _LevelDecision:
        count = len(wanted)
        return _LevelDecision(test, wanted.copy(), np.zeros(count), np.zeros(count), np.zeros(count, dtype=bool))

    def update(self, bases: IndexArray, upper: FloatArray, lower: FloatArray) -> BoolArray:
        """Record the bounds of some parts of base faces; (parts,) bool, which of them are still undecided."""
        self.disprove(bases, lower)
        within = self.test.within(upper)
        np.maximum.at(self.upper, bases[within], upper[within])
        return ~within & self.wanted[bases]

    def disprove(self, bases: IndexArray, lower: FloatArray) -> None:
        """Record distances that some parts reach."""
        np.maximum.at(self.lower, bases, lower)
        self.wanted &= ~self.test.exceeds(self.lower)

    def bounds(self) -> FloatArray:
        """(B,): the proved distances of settled faces.

        Parts with rough bounds alone are within the tolerance, and within what some other part reaches.
        """
        reached = np.maximum(self.upper, self.lower) + self.test.allowance
        return np.minimum(reached, self.test.tolerance)

    def give_up(self, bases: IndexArray) -> None:
        """Leave faces without a proof either way; they do not count as within the tolerance."""
        self.upper[bases] = np.inf


@dataclass
class _CertifiedSearch:
    """The search for the depths of some base faces: their patches so far, and the refinement of the rest.

    new_patches: the regular patches that appear at the next level to be evaluated.
    """

    test: ToleranceTest
    vertices: Vertices
    faces: IndexArray
    new_patches: list[BasePatches]
    refinement: Refinement | None
    patches: list[_Patches] = field(default_factory=list)
    extraordinary: list[_ExtraordinaryPatches] = field(default_factory=list)

    def run(self) -> FaceDepths:
        """The depths of the base faces."""
        depths = FaceDepths.undecided(self.faces)
        wanted = np.ones(len(self.faces), dtype=bool)
        level = 0
        while np.any(wanted):
            decision = _LevelDecision.of(self.test, wanted)
            settled = self._evaluate_level(decision, level, with_distances=True)
            depths.settle(settled, level, decision.bounds(), decision.lower)
            depths.lasting[settled] = decision.lasting[settled]
            # After a level that was neither proved nor disproved, no later depth is proved to be the least.
            depths.exact[decision.wanted & ~settled] = False
            wanted &= ~settled
            self._descend(wanted)
            level += 1
        return depths

    def at(self, level: int) -> LevelBounds:
        """The proved bounds of all the base faces at one level."""
        everything = np.ones(len(self.faces), dtype=bool)
        decision = _LevelDecision.of(self.test, everything)
        for own in range(level):
            self._collect_patches(own)
            self._settle_early(decision, own, level)
            self._descend(everything)
        settled = self._evaluate_level(decision, level)
        return LevelBounds(self.faces, np.where(settled, decision.bounds(), np.inf))

    def at_each(self, levels: NDArray[np.int32]) -> LevelBounds:
        """The proved bounds of the base faces, each at its own level: (F,) int32 by the faces of the mesh."""
        wanted_at = levels[self.faces]
        bounds = np.full(len(self.faces), np.inf)
        for level in range(int(wanted_at.max(initial=0)) + 1):
            wanted = wanted_at == level
            if np.any(wanted):
                decision = _LevelDecision.of(self.test, wanted)
                settled = self._evaluate_level(decision, level)
                bounds[settled] = decision.bounds()[settled]
            else:
                self._collect_patches(level)
            self._descend(wanted_at > level)
        return LevelBounds(self.faces, bounds)

    def _evaluate_level(self, decision: _LevelDecision, level: int, *, with_distances: bool = False) -> BoolArray:
        """Evaluate the search's current level; (B,) bool, the base faces proved to be within the tolerance.

        with_distances: whether to look for the largest distances that are reached.
        """
        self._collect_patches(level)
        self._evaluate_corners(decision)
        # First what converges slowest: it disproves most levels, and the many regular patches need not be evaluated.
        for patches in self.extraordinary:
            patches = patches.at(np.flatnonzero(decision.wanted[patches.bases]))
            self._evaluate_extraordinary(decision, patches, patches.corners(self.vertices))
        evaluated = self._evaluate_patches(decision, level)
        self._evaluate_refinement(decision, level)
        if decision.open_differences:
            self._evaluate_differences(decision, *_joined(decision.open_differences))
        settled = decision.wanted & np.isfinite(decision.upper)
        for regular in evaluated:
            # Without bounds by the norm alone, those from the nets are recorded already.
            if with_distances or regular.rough is not None:
                self._tighten_bounds(decision, regular.of(settled), level)
        return settled

    def _settle_early(self, decision: _LevelDecision, own: int, level: int) -> None:
        """At level ``own`` of the search, settle what norms and supports alone prove about the later ``level``.

        Settled parts are refined no further; mostly only parts near creases and irregular vertices remain.
        """
        for place, patches in enumerate(self.patches):
            if patches.level == own:
                rough = patches.rough_bounds(self.vertices).at(level - own)
                self.patches[place] = patches.at(_undecided(decision, patches.bases, rough))
                self.patches[place].compact()
        of_valences = []
        for extraordinary in self.extraordinary:
            bounds = sharp_extraordinary(extraordinary.nets, self.vertices).at(level - own)
            of_valences.append(extraordinary.at(_undecided(decision, extraordinary.bases, bounds)))
        self.extraordinary = of_valences
        refinement = self.refinement
        if refinement is not None and len(refinement.bases) and np.all(refinement.mesh.face_sizes == 4):
            bounds = support_bounds(refinement.mesh, Vertices.LIMIT)[: len(refinement.bases)]
            wanted = np.zeros(len(bounds), dtype=bool)
            wanted[_undecided(decision, refinement.bases, bounds)] = True
            self.refinement = refinement.keep(wanted)

    def _descend(self, wanted: BoolArray) -> None:
        """Refine the wanted base faces to the next level."""
        self.patches = [patches.of(wanted) for patches in self.patches]
        kept = (patches.at(np.flatnonzero(wanted[patches.bases])) for patches in self.extraordinary)
        self.extraordinary = []
        for patches in kept:
            refined, bases, nets = patches.refined()
            self.extraordinary.append(refined)
            self.new_patches.append((bases, nets))
        if self.refinement is not None:
            self.refinement = self.refinement.of(wanted).refined()

    def _collect_patches(self, level: int) -> None:
        """Move the refinement's regular and extraordinary faces to the patches."""
        if self.refinement is not None and len(self.refinement.bases):
            classified = _classify(self.refinement)
            self.new_patches.append((classified.regular_bases, classified.regular_nets()))
            self.extraordinary += [patches for patches, _ in classified.extraordinary()]
            self.refinement = self.refinement.keep(classified.rest)
        if self.new_patches:
            self.patches.append(_Patches.joined(level, self.new_patches))
            self.new_patches = []

    def _evaluate_corners(self, decision: _LevelDecision) -> None:
        """Disprove faces by how far control points at extraordinary vertices are from their limits.

        It is the cheapest test, and most levels that are too low fail it.
        """
        if self.vertices is Vertices.CONTROL:
            for patches in self.extraordinary:
                gaps = largest_norm(patches.corners(Vertices.CONTROL) - patches.corners(Vertices.LIMIT))
                decision.disprove(patches.bases, gaps)

    def _evaluate_patches(self, decision: _LevelDecision, level: int) -> list[_Patches]:
        """Evaluate the regular patches of the faces that are still wanted, and return them.

        For most patches that a face is refined into, the bound by their norm alone is enough.
        """
        evaluated = []
        for patches in self.patches:
            patches = patches.of(decision.wanted)
            if not len(patches.bases):
                continue
            levels = level - patches.level
            if self.refinement is not None:
                near = self.test.within(patches.rough_bounds(self.vertices).at(levels))
                evaluated.append(patches.at(np.flatnonzero(near)))
                patches = patches.at(np.flatnonzero(~near))
            self._evaluate_nets(decision, patches, levels)
            evaluated.append(patches)
        return evaluated

    def _evaluate_nets(self, decision: _LevelDecision, patches: _Patches, levels: int) -> None:
        """Evaluate regular patches for the facets so many levels after their own, with the cheapest bounds first."""
        is_undecided = decision.update(patches.bases, *self._first_bounds(patches, levels))
        if self.refinement is None:
            proved = np.flatnonzero(decision.wanted[patches.bases] & ~is_undecided)
            self._note_lasting(decision, patches, proved, levels)
        undecided = np.flatnonzero(is_undecided)
        bases, nets = patches.bases[undecided], patches.nets_of(undecided)
        for remaining in range(levels, max(levels - NET_SPLITS, 0) - 1, -1):
            if not len(bases):
                return
            undecided = np.flatnonzero(decision.update(bases, *self._closer_bounds(nets, remaining)))
            bases, nets = bases[undecided], nets.take(undecided, axis=2)
            if remaining == 0:
                decision.open_differences.append((bases, facet_error(nets, self.vertices)))
                return
            bases, nets = np.tile(bases, 4), both_ways(SPLINE_HALVES, nets)
        decision.give_up(bases)

    def _note_lasting(self, decision: _LevelDecision, patches: _Patches, proved: IndexArray, levels: int) -> None:
        """Record faces that are one patch each, those proved by its first bounds, by index.

        These fall with every level, but for those of control facets of its own level: there the norm has to tell.
        """
        if not self._has_later_bounds(levels):
            norms = second_order_regular(patches.nets_of(proved), self.vertices)
            proved = proved[self.test.within(norms.at(1))]
        decision.lasting[patches.bases[proved]] = True

    def _has_later_bounds(self, levels: int) -> bool:
        """Whether ``later_bounds`` are the ones to use: a control facet of the patch's own level has better bounds."""
        return levels > 0 or self.vertices is Vertices.LIMIT

    def _first_bounds(self, patches: _Patches, levels: int) -> tuple[FloatArray, FloatArray]:
        """(P,) each: distances at most and at least, so many levels after the patches' own."""
        if not self._has_later_bounds(levels):
            return self._control_bounds(patches.compact())
        later = patches.later_bounds(self.vertices)
        return later.at(levels), later.least(levels)

    def _closer_bounds(self, nets: FloatArray, levels: int) -> tuple[FloatArray, FloatArray]:
        """(P,) each: the same from the nets (4, 4, P, 3), with sampled distances."""
        if not self._has_later_bounds(levels):
            return self._control_bounds(nets)
        return later_bounds(nets, self.vertices).at(levels), sampled_error(nets, self.vertices, levels)

    def _control_bounds(self, nets: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(P,) each: the same of the control facets of the nets' own level. Corners alone disprove most of them."""
        lower = control_corner_errors(nets)
        upper = np.full(len(lower), np.inf)
        open_ = np.flatnonzero(~self.test.exceeds(lower))
        upper[open_] = control_facet_bounds(nets.take(open_, axis=2), lower[open_])
        return upper, lower

    def _tighten_bounds(self, decision: _LevelDecision, patches: _Patches, level: int) -> None:
        """Record better bounds of settled faces' patches where they may hold the face's largest distance."""
        levels = level - patches.level
        if patches.rough is not None:
            within_reach = patches.rough.at(levels) > decision.lower[patches.bases]
            patches = patches.at(np.flatnonzero(within_reach))
        elif not self._has_later_bounds(levels):
            # These bounds were recorded when the patches were evaluated.
            return
        if len(patches.bases):
            upper, lower = self._first_bounds(patches, levels)
            if self._has_later_bounds(levels):
                promising = np.flatnonzero(upper > decision.lower[patches.bases])
                lower[promising] = sampled_error(patches.nets_of(promising), self.vertices, levels)
            decision.update(patches.bases, upper, lower)

    def _evaluate_extraordinary(
        self, decision: _LevelDecision, patches: _ExtraordinaryPatches, facets: FloatArray
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
            patches, bases, nets = patches.at(undecided).refined()
            of_children = _facets_of_quads(facets.take(undecided, axis=1))
            facets = of_children[:, 0]
            regular_facets = of_children[:, 1:].reshape(4, -1, 3)
            decision.open_differences.append((bases, patch_coefficients(nets) - bilinear_coefficients(regular_facets)))
        decision.give_up(patches.bases)

    def _evaluate_refinement(self, decision: _LevelDecision, level: int) -> None:
        """Evaluate the faces that are neither regular nor extraordinary, refining them while undecided."""
        if self.refinement is None:
            return
        if self.refinement.are_quads:
            # Found for all of them, those of their children at the next level are known as well.
            _ = self.refinement.limits_at_corners
        refinement = self.refinement.of(decision.wanted)
        facets = self._vertices_of(refinement)
        for later in range(REFINEMENTS):
            if not len(refinement.bases):
                return
            if np.all(refinement.mesh.face_sizes == 4):
                gaps = largest_norm(_quads(facets) - _quads(refinement.limits_at_corners))
                last = support_bounds(refinement.mesh, Vertices.LIMIT)[: len(refinement.bases)]
                undecided = decision.update(refinement.bases, gaps + last, gaps)
                if level == later == 0:
                    # Of the faces themselves these bounds hold at all later levels.
                    decision.lasting[refinement.bases[self.test.within(last)]] = True
                refinement, facets = refinement.keep(undecided), facets[np.repeat(undecided, 4)]
            refinement, facets = self._refine(decision, refinement, facets, of_faces=level == later == 0)
        decision.give_up(refinement.bases)

    def _vertices_of(self, refinement: Refinement) -> FloatArray:
        """(C, 3): where the vertices at the descendants' corners lie."""
        if self.vertices is Vertices.LIMIT:
            return refinement.limits_at_corners
        return refinement.mesh.positions[refinement.corner_vertices()]

    def _refine(
        self, decision: _LevelDecision, refinement: Refinement, facets: FloatArray, *, of_faces: bool
    ) -> tuple[Refinement, FloatArray]:
        """The children that are no patches, with the facets over them; children that are patches are evaluated.

        of_faces: whether the children are those of the base faces themselves.
        """
        if not len(refinement.bases):
            return refinement, facets
        parents, facets = refinement.bases, refinement.facets_of_children(facets)
        refinement = refinement.refined()
        classified = _classify(refinement)
        nets, extraordinary = classified.regular_nets(), list(classified.extraordinary())
        rest = refinement.keep(classified.rest)
        if of_faces:
            own = [own for own, _ in extraordinary]
            rising = self._may_rise(decision, classified.regular_bases, nets, own, rest)
            decision.lasting[parents] |= ~rising[parents]
        differences = patch_coefficients(nets)
        differences -= bilinear_coefficients(facets.take(classified.regular, axis=1))
        decision.open_differences.append((classified.regular_bases, differences))
        for patches, faces in extraordinary:
            self._evaluate_extraordinary(decision, patches, facets[classified.corners_from_extraordinary(faces), faces])
        return rest, facets.compress(classified.rest, axis=1).swapaxes(0, 1).reshape(-1, 3)

    def _may_rise(
        self,
        decision: _LevelDecision,
        bases: IndexArray,
        nets: FloatArray,
        extraordinary: list[_ExtraordinaryPatches],
        rest: Refinement,
    ) -> BoolArray:
        """(B,) bool: base faces with a descendant that may be farther than the tolerance at its level or a later one.

        bases, nets: of the regular descendants; extraordinary, rest: all others. Their bounds never rise.
        """
        bounds = [(bases, second_order_regular(nets, self.vertices).value)]
        for patches in extraordinary:
            bounds.append((patches.bases, second_order_extraordinary(patches.nets, self.vertices).value))
        bounds.append((rest.bases, support_bounds(rest.mesh, Vertices.LIMIT)[: len(rest.bases)]))
        rising = np.zeros(len(decision.wanted), dtype=bool)
        for own, upper in bounds:
            rising[own[~self.test.within(upper)]] = True
        return rising

    def _evaluate_differences(
        self, decision: _LevelDecision, bases: IndexArray, values: FloatArray, splits: int = DIFFERENCE_SPLITS
    ) -> None:
        """Evaluate differences S - L in Bernstein form, splitting them at most so often while undecided."""
        bases, values = _selected(bases, values, decision.wanted[bases])
        if not len(bases):
            return
        rows = values.reshape(16, -1, 3)
        bases, values = _selected(
            bases, values, decision.update(bases, largest_norm(rows), largest_norm(rows[CORNER_ROWS]))
        )
        counts = np.bincount(bases, minlength=len(decision.wanted))
        # Where the distance equals the tolerance along a line, each split leaves more undecided pieces, without end.
        undecidable = counts > (MOST_PIECES_OF_A_FACE if splits else 0)
        if np.any(undecidable):
            decision.give_up(np.flatnonzero(undecidable))
            bases, values = _selected(bases, values, ~undecidable[bases])
            counts[undecidable] = 0
        for some in _groups(counts, MOST_PIECES):
            chosen, parts = _selected(bases, values, some[bases])
            self._evaluate_differences(decision, np.tile(chosen, 4), both_ways(HALVES, parts), splits - 1)


def _undecided(decision: _LevelDecision, bases: IndexArray, upper: FloatArray) -> IndexArray:
    """Record upper bounds (P,) of parts of base faces (P,); the indices of the parts that are still undecided."""
    return np.flatnonzero(decision.update(bases, upper, np.zeros(len(bases))))


def _joined(pieces: list[BasePatches]) -> BasePatches:
    bases, values = zip(*pieces, strict=True)
    return np.concatenate(bases), np.concatenate(values, axis=2)


def _selected(bases: IndexArray, values: FloatArray, chosen: BoolArray) -> BasePatches:
    """The chosen pieces: (P,) bool."""
    if np.all(chosen):
        return bases, values
    kept = np.flatnonzero(chosen)
    return bases[kept], values.take(kept, axis=2)


def _groups(counts: IndexArray, most: int) -> Iterator[BoolArray]:
    """Base faces in groups of about ``most`` pieces together, given the pieces of each: (B,) bool for each group."""
    group = (np.cumsum(counts) - counts) // most
    for number in np.unique(group[counts > 0]):
        yield (group == number) & (counts > 0)


@dataclass(frozen=True)
class _ClassifiedDescendants:
    """The descendants in a refinement by the kind of their patch: indices of the regular ones; (descendants,) bool,
    those that are no patches (``rest``)."""

    refinement: Refinement
    kinds: PatchKinds
    regular: IndexArray
    rest: BoolArray

    @property
    def regular_bases(self) -> IndexArray:
        return self.refinement.bases[self.regular]

    def regular_nets(self) -> FloatArray:
        return regular_nets(self.refinement.mesh, self.regular)

    def extraordinary(self) -> Iterator[tuple[_ExtraordinaryPatches, IndexArray]]:
        """The extraordinary patches, valence by valence, with their indices among the descendants."""
        mesh = self.refinement.mesh
        faces = np.flatnonzero(~self.rest)
        faces = faces[self.kinds.kinds[faces] == PatchKind.EXTRAORDINARY]
        corners = self.kinds.extraordinary_corners[faces]
        valences = mesh.vertex_face_counts[mesh.corner_vertices[corners]]
        for valence in np.unique(valences).tolist():
            of_valence = valences == valence
            nets = extraordinary_nets(mesh, corners[of_valence], valence)
            yield _ExtraordinaryPatches(self.refinement.bases[faces[of_valence]], nets), faces[of_valence]

    def corners_from_extraordinary(self, faces: IndexArray) -> IndexArray:
        """(4, P): the corners 0 to 3 of extraordinary faces, from the extraordinary one on as in their nets."""
        first = self.kinds.extraordinary_corners[faces] - self.refinement.mesh.face_starts[faces]
        return (first + np.arange(4)[:, None]) % 4


def _classify(refinement: Refinement) -> _ClassifiedDescendants:
    mesh = refinement.mesh
    kinds = classify_patches(mesh)
    own = kinds.kinds[: len(refinement.bases)]
    extraordinary = np.flatnonzero(own == PatchKind.EXTRAORDINARY)
    valences = mesh.vertex_face_counts[mesh.corner_vertices[kinds.extraordinary_corners[extraordinary]]]
    rest = own == PatchKind.IRREGULAR
    rest[extraordinary[valences > LARGEST_STENCIL_VALENCE]] = True
    return _ClassifiedDescendants(refinement, kinds, np.flatnonzero(own == PatchKind.REGULAR), rest)


def _quads(corners: FloatArray) -> FloatArray:
    """(4, P, 3) from (4P, 3)."""
    return corners.reshape(-1, 4, 3).swapaxes(0, 1)


def _facets_of_quads(facets: FloatArray) -> FloatArray:
    """(4, 4, P, 3): bilinear facets (4, P, 3) restricted to the children: [corner of the child, child, facet]."""
    middles = (facets + facets[[1, 2, 3, 0]]) / 2
    centres = np.broadcast_to(facets.mean(axis=0), facets.shape)
    return np.stack([facets, middles, centres, middles[[3, 0, 1, 2]]])
