# SPDX-License-Identifier: GPL-3.0-or-later
"""The certified depth: proved from the mesh itself, both ways, level by level.

For level k = 0, 1, 2, … every face that has no depth yet is asked whether its level-k facets lie within the tolerance.
An upper bound on their distance says yes, a true distance somewhere on them says no; while neither does, the doubtful
parts are split and asked again. Regular patches are asked in closed form (``facet_bounds``) and split by knot
insertion, then in Bernstein form; everything else is refined with its neighbours, the level-k facets being carried
along, until regular patches and a last bound that has shrunk to nothing are left (docs/methods.md, Certified).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ..arrays.chunks import index_chunks
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.facet_bounds import (
    CORNER_ROWS,
    LaterBounds,
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
from ..surface.stencils import PatchStencils, apply_stencils, patch_stencils
from .tolerance_test import FaceBlock, LevelBlock, Question

REGULAR_FACES_AT_ONCE = 1 << 13
OTHER_FACES_AT_ONCE = 1 << 10

# They are cut out of the mesh with their neighbours, which takes a look at all of it, many blocks at a time.
OTHER_FACES_TOGETHER = 1 << 15

# How often doubtful parts are split: each time the gap between the bounds falls to about a quarter for a patch in
# Bernstein form, and by the subdominant eigenvalue (0.41 to 0.68) around an extraordinary vertex,
# or to a half where only the support is known.
NET_SPLITS = 3
BLOCK_SPLITS = 9
REFINEMENTS = 18

# Doubtful parts in Bernstein form: of a face at most, before its level is given up, and of all the faces at once.
MOST_BLOCKS_OF_A_FACE = 128
MOST_BLOCKS = 1 << 13

# The search uses the stencils of a valence over and over, so larger ones pay here than elsewhere.
LARGEST_SEARCHED_VALENCE = 512


# (P,) base faces, and for each of them (4, 4, P, 3): a net, or the difference S - L.
Blocks = tuple[IndexArray, FloatArray]


def certified_blocks(mesh: PolygonMesh, question: Question, vertices: Vertices) -> Iterator[FaceBlock]:
    """Every face of the mesh with its certified depth, in blocks; some are empty, to let the caller breathe."""
    yield FaceBlock.empty()
    searches = _searches(mesh, question, vertices, np.arange(mesh.face_count))
    for block in map_in_threads(lambda begin: begin().run(), searches):
        yield FaceBlock.empty() if block is None else block


def certified_bounds(
    mesh: PolygonMesh, question: Question, vertices: Vertices, faces: IndexArray, level: int
) -> Iterator[LevelBlock]:
    """Some faces with what is proved of them at one level, in blocks; some are empty, to let the caller breathe."""
    yield LevelBlock.empty()
    searches = _searches(mesh, question, vertices, faces)
    for block in map_in_threads(lambda begin: begin().at(level), searches):
        yield LevelBlock.empty() if block is None else block


def _searches(
    mesh: PolygonMesh, question: Question, vertices: Vertices, faces: IndexArray
) -> Iterator[Callable[[], _Search]]:
    """What begins with the faces, some at a time."""
    is_regular = classify_patches(mesh).kinds[faces] == PatchKind.REGULAR

    def begin_regular(some: IndexArray) -> _Search:
        nets = [(np.arange(len(some)), regular_nets(mesh, some))]
        return _Search(question, vertices, some, nets, None)

    def begin_other(part: PolygonMesh, own: IndexArray, some: IndexArray) -> _Search:
        return _Search(question, vertices, some, [], Refinement.start(part, own))

    # Those that take longest first, so that no processor is left with one of them in the end.
    for together in index_chunks(faces[~is_regular], OTHER_FACES_TOGETHER):
        part = submesh(mesh, together)[0]
        for own in index_chunks(np.arange(len(together)), OTHER_FACES_AT_ONCE):
            yield partial(begin_other, part, own, together[own])
    for some in index_chunks(faces[is_regular], REGULAR_FACES_AT_ONCE):
        yield partial(begin_regular, some)


@dataclass
class _Patches:
    """Regular patches that appear at one level: (P,) base faces.

    rows: (P,) which of the nets (4, 4, N, 3) is each one's; nets that are no longer wanted are left where they are.
    rough, later: bounds by the norm alone and from the net itself, worked out when they are asked for first.
    """

    level: int
    bases: IndexArray
    rows: IndexArray
    nets: FloatArray
    rough: PatchBounds | None = None
    later: LaterBounds | None = None

    @staticmethod
    def joined(level: int, pieces: list[Blocks]) -> _Patches:
        """One of several (P,) base faces with their (4, 4, P, 3) nets."""
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
        """(4, 4, P, 3): the nets, when those that are no longer wanted are gone."""
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
    """Extraordinary patches of one valence at the level that is asked about: (P,) base faces, (2n + 8, P, 3) nets."""

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
class _Verdict:
    """What is known of the level-k facets of B base faces: distances at most and at least, and what is still open."""

    question: Question
    wanted: BoolArray
    upper: FloatArray
    lower: FloatArray
    open_blocks: list[Blocks] = field(default_factory=list)

    @staticmethod
    def of(question: Question, wanted: BoolArray) -> _Verdict:
        return _Verdict(question, wanted.copy(), np.zeros(len(wanted)), np.zeros(len(wanted)))

    def hear(self, bases: IndexArray, upper: FloatArray, lower: FloatArray) -> BoolArray:
        """Take the bounds of some parts; (parts,) bool, those still in doubt. Settled parts count for good."""
        self.disprove(bases, lower)
        within = self.question.within(upper)
        np.maximum.at(self.upper, bases[within], upper[within])
        return ~within & self.wanted[bases]

    def disprove(self, bases: IndexArray, lower: FloatArray) -> None:
        """Take the least distances of some parts."""
        np.maximum.at(self.lower, bases, lower)
        self.wanted &= ~self.question.exceeds(self.lower)

    def bounds(self) -> FloatArray:
        """(B,): the proved distances of faces that are settled.

        Parts that were not looked at closely are within the tolerance, and within what some other part reaches.
        """
        reached = np.maximum(self.upper, self.lower) + self.question.allowance
        return np.minimum(reached, self.question.tolerance)

    def give_up(self, bases: IndexArray) -> None:
        """No proof either way: such a face is not taken to be within the tolerance."""
        self.upper[bases] = np.inf


@dataclass
class _Search:
    """Some base faces on their way to a depth: their patches so far, and the refinement of the rest.

    found: the regular patches that appear at the level to be asked about next.
    """

    question: Question
    vertices: Vertices
    faces: IndexArray
    found: list[Blocks]
    refinement: Refinement | None
    patches: list[_Patches] = field(default_factory=list)
    extraordinary: list[_ExtraordinaryPatches] = field(default_factory=list)

    def run(self) -> FaceBlock:
        block = FaceBlock.undecided(self.faces)
        wanted = np.ones(len(self.faces), dtype=bool)
        level = 0
        while np.any(wanted):
            verdict = _Verdict.of(self.question, wanted)
            settled = self._ask(verdict, level)
            block.settle(settled, level, verdict.bounds(), verdict.lower)
            # A level that was neither proved nor disproved leaves the depth above it without proof of being the least.
            block.exact[verdict.wanted & ~settled] = False
            wanted &= ~settled
            self._descend(wanted)
            level += 1
        return block

    def at(self, level: int) -> LevelBlock:
        """What is proved of all the base faces at one level."""
        everything = np.ones(len(self.faces), dtype=bool)
        verdict = _Verdict.of(self.question, everything)
        for own in range(level):
            self._take_patches(own)
            self._ask_ahead(verdict, own, level)
            self._descend(everything)
        settled = self._ask(verdict, level)
        return LevelBlock(self.faces, np.where(settled, verdict.bounds(), np.inf))

    def _ask(self, verdict: _Verdict, level: int) -> BoolArray:
        """Ask about the level that the search has come to; (B,) bool, the base faces that are proved to be near."""
        self._take_patches(level)
        self._ask_corners(verdict)
        asked = self._ask_patches(verdict, level)
        for patches in self.extraordinary:
            patches = patches.at(np.flatnonzero(verdict.wanted[patches.bases]))
            self._ask_extraordinary(verdict, patches, patches.corners(self.vertices))
        self._ask_refinement(verdict)
        if verdict.open_blocks:
            self._ask_blocks(verdict, *_joined(verdict.open_blocks))
        settled = verdict.wanted & np.isfinite(verdict.upper)
        for regular in asked:
            self._look_closer(verdict, regular.of(settled), level)
        return settled

    def _ask_ahead(self, verdict: _Verdict, own: int, level: int) -> None:
        """At a level of the search, settle what bounds by norms alone, and by the support, know of a later level.

        What is settled so is refined no further: mostly only what is near the difficulties of the mesh goes on.
        """
        for place, patches in enumerate(self.patches):
            if patches.level == own:
                rough = patches.rough_bounds(self.vertices).at(level - own)
                self.patches[place] = patches.at(_in_doubt(verdict, patches.bases, rough))
                self.patches[place].compact()
        of_valences = []
        for extraordinary in self.extraordinary:
            bounds = sharp_extraordinary(extraordinary.nets, self.vertices).at(level - own)
            of_valences.append(extraordinary.at(_in_doubt(verdict, extraordinary.bases, bounds)))
        self.extraordinary = of_valences
        refinement = self.refinement
        if refinement is not None and len(refinement.bases) and np.all(refinement.mesh.face_sizes == 4):
            bounds = support_bounds(refinement.mesh, Vertices.LIMIT)[: len(refinement.bases)]
            wanted = np.zeros(len(bounds), dtype=bool)
            wanted[_in_doubt(verdict, refinement.bases, bounds)] = True
            self.refinement = refinement.keep(wanted)

    def _descend(self, wanted: BoolArray) -> None:
        """Go from a level to the next with the wanted base faces."""
        self.patches = [patches.of(wanted) for patches in self.patches]
        kept = (patches.at(np.flatnonzero(wanted[patches.bases])) for patches in self.extraordinary)
        self.extraordinary = []
        for patches in kept:
            refined, bases, nets = patches.refined()
            self.extraordinary.append(refined)
            self.found.append((bases, nets))
        if self.refinement is not None:
            self.refinement = self.refinement.of(wanted).refined()

    def _take_patches(self, level: int) -> None:
        """Move the refinement's regular and extraordinary faces to the patches."""
        if self.refinement is not None and len(self.refinement.bases):
            sorted_out = _sort_out(self.refinement)
            self.found.append((sorted_out.regular_bases, sorted_out.regular_nets()))
            self.extraordinary += [patches for patches, _ in sorted_out.extraordinary()]
            self.refinement = self.refinement.keep(sorted_out.rest)
        if self.found:
            self.patches.append(_Patches.joined(level, self.found))
            self.found = []

    def _ask_corners(self, verdict: _Verdict) -> None:
        """Most levels that are not enough show it where control points at extraordinary vertices are far from them."""
        if self.vertices is Vertices.CONTROL:
            for patches in self.extraordinary:
                gaps = largest_norm(patches.corners(Vertices.CONTROL) - patches.corners(Vertices.LIMIT))
                verdict.disprove(patches.bases, gaps)

    def _ask_patches(self, verdict: _Verdict, level: int) -> list[_Patches]:
        """Ask regular patches of the faces that are still wanted, and return them.

        Most of those that a face is refined into are so near the surface that their norm alone says enough.
        """
        asked = []
        for patches in self.patches:
            patches = patches.of(verdict.wanted)
            if not len(patches.bases):
                continue
            levels = level - patches.level
            if self.refinement is not None:
                near = self.question.within(patches.rough_bounds(self.vertices).at(levels))
                asked.append(patches.at(np.flatnonzero(near)))
                patches = patches.at(np.flatnonzero(~near))
            self._ask_nets(verdict, patches, levels)
            asked.append(patches)
        return asked

    def _ask_nets(self, verdict: _Verdict, patches: _Patches, levels: int) -> None:
        """Ask regular patches about the facets so many levels after their own: first by what costs least."""
        doubtful = np.flatnonzero(verdict.hear(patches.bases, *self._first_bounds(patches, levels)))
        bases, nets = patches.bases[doubtful], patches.nets_of(doubtful)
        for remaining in range(levels, max(levels - NET_SPLITS, 0) - 1, -1):
            if not len(bases):
                return
            doubtful = np.flatnonzero(verdict.hear(bases, *self._closer_bounds(nets, remaining)))
            bases, nets = bases[doubtful], nets.take(doubtful, axis=2)
            if remaining == 0:
                verdict.open_blocks.append((bases, facet_error(nets, self.vertices)))
                return
            bases, nets = np.tile(bases, 4), both_ways(SPLINE_HALVES, nets)
        verdict.give_up(bases)

    def _has_later_bounds(self, levels: int) -> bool:
        """A control facet of the patch's own level is known better from its 12 coefficients."""
        return levels > 0 or self.vertices is Vertices.LIMIT

    def _first_bounds(self, patches: _Patches, levels: int) -> tuple[FloatArray, FloatArray]:
        """(P,) each: distances at most and at least, so many levels after the patches' own."""
        if not self._has_later_bounds(levels):
            return control_facet_bounds(patches.compact())
        later = patches.later_bounds(self.vertices)
        return later.at(levels), later.least(levels)

    def _closer_bounds(self, nets: FloatArray, levels: int) -> tuple[FloatArray, FloatArray]:
        """The same for nets alone, and with samples."""
        if not self._has_later_bounds(levels):
            return control_facet_bounds(nets)
        return later_bounds(nets, self.vertices).at(levels), sampled_error(nets, self.vertices, levels)

    def _look_closer(self, verdict: _Verdict, patches: _Patches, level: int) -> None:
        """Hear the distances of settled faces' patches where they may be the largest, as near as they are known."""
        levels = level - patches.level
        if patches.rough is not None:
            within_reach = patches.rough.at(levels) > verdict.lower[patches.bases]
            patches = patches.at(np.flatnonzero(within_reach))
        if len(patches.bases):
            upper, lower = self._first_bounds(patches, levels)
            if self._has_later_bounds(levels):
                promising = np.flatnonzero(upper > verdict.lower[patches.bases])
                lower[promising] = sampled_error(patches.nets_of(promising), self.vertices, levels)
            verdict.hear(patches.bases, upper, lower)

    def _ask_extraordinary(self, verdict: _Verdict, patches: _ExtraordinaryPatches, facets: FloatArray) -> None:
        """Ask extraordinary patches about facets over them, (4, P, 3), refining them further while in doubt."""
        for _ in range(REFINEMENTS):
            if not len(patches.bases):
                return
            gaps = largest_norm(facets - patches.corners(Vertices.LIMIT))
            verdict.disprove(patches.bases, gaps)
            doubtful = np.flatnonzero(verdict.wanted[patches.bases])
            if not len(doubtful):
                return
            patches, facets, gaps = patches.at(doubtful), facets.take(doubtful, axis=1), gaps[doubtful]
            last = second_order_extraordinary(patches.nets, Vertices.LIMIT).value
            doubtful = np.flatnonzero(verdict.hear(patches.bases, gaps + last, gaps))
            if not len(doubtful):
                return
            patches, bases, nets = patches.at(doubtful).refined()
            of_children = _facets_of_quads(facets.take(doubtful, axis=1))
            facets = of_children[:, 0]
            regular_facets = of_children[:, 1:].reshape(4, -1, 3)
            verdict.open_blocks.append((bases, patch_coefficients(nets) - bilinear_coefficients(regular_facets)))
        verdict.give_up(patches.bases)

    def _ask_refinement(self, verdict: _Verdict) -> None:
        """Ask the faces that are neither regular nor extraordinary, refining them further while in doubt."""
        if self.refinement is None:
            return
        refinement = self.refinement.of(verdict.wanted)
        facets = self._vertices_of(refinement)
        for _ in range(REFINEMENTS):
            if not len(refinement.bases):
                return
            if np.all(refinement.mesh.face_sizes == 4):
                gaps = largest_norm(_quads(facets) - _quads(refinement.limits_at_corners()))
                last = support_bounds(refinement.mesh, Vertices.LIMIT)[: len(refinement.bases)]
                doubtful = verdict.hear(refinement.bases, gaps + last, gaps)
                refinement, facets = refinement.keep(doubtful), facets[np.repeat(doubtful, 4)]
            refinement, facets = self._refine(verdict, refinement, facets)
        verdict.give_up(refinement.bases)

    def _vertices_of(self, refinement: Refinement) -> FloatArray:
        """(C, 3): where the vertices at the descendants' corners lie."""
        if self.vertices is Vertices.LIMIT:
            return refinement.limits_at_corners()
        return refinement.mesh.positions[refinement.corner_vertices()]

    def _refine(self, verdict: _Verdict, refinement: Refinement, facets: FloatArray) -> tuple[Refinement, FloatArray]:
        """The children that are no patches, with the facets over them; the patches among them are asked at once."""
        if not len(refinement.bases):
            return refinement, facets
        facets = refinement.facets_of_children(facets)
        refinement = refinement.refined()
        sorted_out = _sort_out(refinement)
        blocks = patch_coefficients(sorted_out.regular_nets())
        blocks -= bilinear_coefficients(facets.take(sorted_out.regular, axis=1))
        verdict.open_blocks.append((sorted_out.regular_bases, blocks))
        for patches, faces in sorted_out.extraordinary():
            self._ask_extraordinary(verdict, patches, facets[sorted_out.corners_from_extraordinary(faces), faces])
        rest = facets.compress(sorted_out.rest, axis=1)
        return refinement.keep(sorted_out.rest), rest.swapaxes(0, 1).reshape(-1, 3)

    def _ask_blocks(self, verdict: _Verdict, bases: IndexArray, values: FloatArray, splits: int = BLOCK_SPLITS) -> None:
        """Ask differences S - L in Bernstein form, splitting them so often while in doubt."""
        bases, values = _blocks_of(bases, values, verdict.wanted[bases])
        if not len(bases):
            return
        rows = values.reshape(16, -1, 3)
        bases, values = _blocks_of(
            bases, values, verdict.hear(bases, largest_norm(rows), largest_norm(rows[CORNER_ROWS]))
        )
        counts = np.bincount(bases, minlength=len(verdict.wanted))
        # Where a distance is the tolerance itself along a line, doubt grows with every split and never ends.
        hopeless = counts > (MOST_BLOCKS_OF_A_FACE if splits else 0)
        if np.any(hopeless):
            verdict.give_up(np.flatnonzero(hopeless))
            bases, values = _blocks_of(bases, values, ~hopeless[bases])
            counts[hopeless] = 0
        for some in _groups(counts, MOST_BLOCKS):
            chosen, parts = _blocks_of(bases, values, some[bases])
            self._ask_blocks(verdict, np.tile(chosen, 4), both_ways(HALVES, parts), splits - 1)


def _in_doubt(verdict: _Verdict, bases: IndexArray, upper: FloatArray) -> IndexArray:
    """Which parts, of (P,) base faces and with distances of at most (P,), are still in doubt; the others count."""
    return np.flatnonzero(verdict.hear(bases, upper, np.zeros(len(bases))))


def _joined(blocks: list[Blocks]) -> Blocks:
    bases, values = zip(*blocks, strict=True)
    return np.concatenate(bases), np.concatenate(values, axis=2)


def _blocks_of(bases: IndexArray, values: FloatArray, chosen: BoolArray) -> Blocks:
    """The chosen ones of some blocks."""
    if np.all(chosen):
        return bases, values
    kept = np.flatnonzero(chosen)
    return bases[kept], values.take(kept, axis=2)


def _groups(counts: IndexArray, most: int) -> Iterator[BoolArray]:
    """Base faces in groups that have so many blocks together, a little more where need be: (B,) bool each."""
    group = (np.cumsum(counts) - counts) // most
    for number in np.unique(group[counts > 0]):
        yield (group == number) & (counts > 0)


@dataclass(frozen=True)
class _SortedOut:
    """The descendants in a refinement by the kind of their patch."""

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
        """The extraordinary ones, valence by valence, and which of the descendants they are."""
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


def _sort_out(refinement: Refinement) -> _SortedOut:
    mesh = refinement.mesh
    kinds = classify_patches(mesh)
    own = kinds.kinds[: len(refinement.bases)]
    extraordinary = np.flatnonzero(own == PatchKind.EXTRAORDINARY)
    valences = mesh.vertex_face_counts[mesh.corner_vertices[kinds.extraordinary_corners[extraordinary]]]
    rest = own == PatchKind.IRREGULAR
    rest[extraordinary[valences > LARGEST_SEARCHED_VALENCE]] = True
    return _SortedOut(refinement, kinds, np.flatnonzero(own == PatchKind.REGULAR), rest)


def _quads(corners: FloatArray) -> FloatArray:
    """(4, P, 3) from (4P, 3)."""
    return corners.reshape(-1, 4, 3).swapaxes(0, 1)


def _facets_of_quads(facets: FloatArray) -> FloatArray:
    """(4, 4, P, 3): bilinear facets (4, P, 3) restricted to the children: [corner of the child, child, facet]."""
    middles = (facets + facets[[1, 2, 3, 0]]) / 2
    centres = np.broadcast_to(facets.mean(axis=0), facets.shape)
    return np.stack([facets, middles, centres, middles[[3, 0, 1, 2]]])
