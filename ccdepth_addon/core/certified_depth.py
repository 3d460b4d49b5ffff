# SPDX-License-Identifier: GPL-3.0-or-later
"""The certified depth: proved from the mesh itself, both ways, level by level.

For level k = 0, 1, 2, … every face that has no depth yet is asked whether its level-k facets lie within the tolerance.
An upper bound on their distance says yes, a true distance somewhere on them says no; while neither does, the doubtful
parts are split and asked again. Regular patches are asked in closed form (``facets``) and split by knot insertion,
then in Bernstein form; everything else is refined with its neighbours, the level-k facets being carried along, until
regular patches and a last bound that has shrunk to nothing are left (docs/methods.md, Certified).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from .bounds import Vertices, second_order_extraordinary, support_bounds
from .catmull_clark import limit_positions
from .facets import LaterBounds, control_facet_bounds, facet_error, later_bounds, sampled_error
from .mesh import FloatArray, IndexArray, PolygonMesh
from .norms import ring_index
from .parallel import in_parallel
from .patches import PatchKind, PatchKinds, classify_patches, extraordinary_nets, regular_nets
from .refinement import Refinement, split
from .search import FaceBlock, Question
from .splines import HALVES, SPLINE_HALVES, bilinear_coefficients, both_ways, largest_norm, patch_coefficients
from .stencils import PatchStencils, apply_stencils, patch_stencils

REGULAR_FACES_AT_ONCE = 1 << 13
OTHER_FACES_AT_ONCE = 1 << 11

# How often doubtful parts are split: each time the gap between the bounds falls to about a quarter for a patch in
# Bernstein form, and by the subdominant eigenvalue (0.41 to 0.68) around an extraordinary vertex,
# or to a half where only the support is known.
NET_SPLITS = 3
BLOCK_SPLITS = 9
REFINEMENTS = 18

# Doubtful parts in Bernstein form: of a face at most, before its level is given up, and of all the faces at once.
MOST_BLOCKS_OF_A_FACE = 128
MOST_BLOCKS = 1 << 13

# The stencils of a valence are a square matrix of 2n + 8 rows; beyond this the mesh itself is refined.
LARGEST_STENCIL_VALENCE = 512

BoolArray = NDArray[np.bool_]

# (P,) base faces, and (4, 4, P, 3) differences S - L over them.
Blocks = tuple[IndexArray, FloatArray]


def certified_blocks(mesh: PolygonMesh, question: Question, vertices: Vertices) -> Iterator[FaceBlock]:
    """Every face of the mesh with its certified depth, in blocks; some are empty, to let the caller breathe."""
    patches = classify_patches(mesh)
    yield FaceBlock.empty()
    regular = patches.kinds == PatchKind.REGULAR

    def settle_regular(faces: IndexArray) -> FaceBlock:
        pieces = [_Patches.new(0, np.arange(len(faces)), regular_nets(mesh, faces))]
        return _Search(question, vertices, faces, pieces, None).run()

    def settle_other(faces: IndexArray) -> FaceBlock:
        return _Search(question, vertices, faces, [], Refinement.start(mesh, faces)).run()

    # Those that take longest first, so that no processor is left with one of them in the end.
    jobs = [partial(settle_other, block) for block in split(np.flatnonzero(~regular), OTHER_FACES_AT_ONCE)]
    jobs += [partial(settle_regular, block) for block in split(np.flatnonzero(regular), REGULAR_FACES_AT_ONCE)]
    for block in in_parallel(lambda job: job(), jobs):
        yield FaceBlock.empty() if block is None else block


@dataclass
class _Patches:
    """Regular patches that appear at one level.

    bases: (P,) base faces. rows: (P,) which of the nets (4, 4, N, 3) is each one's; nets that are no longer wanted are
    left where they are. later: the bounds for later levels, once they have been asked for.
    """

    level: int
    bases: IndexArray
    rows: IndexArray
    nets: FloatArray
    later: LaterBounds | None = None

    @staticmethod
    def new(level: int, bases: IndexArray, nets: FloatArray) -> _Patches:
        return _Patches(level, bases, np.arange(len(bases)), nets)

    def of(self, wanted: BoolArray) -> _Patches:
        kept = np.flatnonzero(wanted[self.bases])
        if len(kept) == len(self.bases):
            return self
        later = None if self.later is None else self.later.of(kept)
        return _Patches(self.level, self.bases[kept], self.rows[kept], self.nets, later)

    def nets_of(self, chosen: IndexArray) -> FloatArray:
        """(4, 4, chosen, 3): the nets of some of the patches, by index."""
        return self.nets.take(self.rows[chosen], axis=2)

    def with_later_bounds(self, vertices: Vertices) -> LaterBounds:
        if self.later is None:
            if len(self.rows) < self.nets.shape[2]:
                self.nets, self.rows = self.nets.take(self.rows, axis=2), np.arange(len(self.rows))
            self.later = later_bounds(self.nets, vertices)
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
        np.maximum.at(self.lower, bases, lower)
        self.wanted &= ~self.question.exceeds(self.lower)
        within = self.question.within(upper)
        np.maximum.at(self.upper, bases[within], upper[within])
        return ~within & self.wanted[bases]

    def give_up(self, bases: IndexArray) -> None:
        """No proof either way: such a face is not taken to be within the tolerance."""
        self.upper[bases] = np.inf


@dataclass
class _Search:
    """Some base faces on their way to a depth: their regular patches so far, and the refinement of the rest."""

    question: Question
    vertices: Vertices
    faces: IndexArray
    patches: list[_Patches]
    refinement: Refinement | None
    extraordinary: list[_ExtraordinaryPatches] = field(default_factory=list)

    def run(self) -> FaceBlock:
        block = FaceBlock.undecided(self.faces)
        wanted = np.ones(len(self.faces), dtype=bool)
        level = 0
        while np.any(wanted):
            verdict = _Verdict.of(self.question, wanted)
            self._take_patches(level)
            self._ask_patches(verdict, level)
            for patches in self.extraordinary:
                self._ask_extraordinary(verdict, patches, patches.corners(self.vertices))
            self._ask_refinement(verdict)
            self._ask_blocks(verdict, verdict.open_blocks)
            settled = verdict.wanted & np.isfinite(verdict.upper)
            self._look_closer(verdict, settled, level)
            block.settle(settled, level, verdict.upper + self.question.allowance, verdict.lower)
            # A level that was neither proved nor disproved leaves the depth above it without proof of being the least.
            block.exact[verdict.wanted & ~settled] = False
            wanted &= ~settled
            self._descend(wanted, level)
            level += 1
        return block

    def _descend(self, wanted: BoolArray, level: int) -> None:
        """Go from a level to the next with the wanted base faces."""
        self.patches = [patches.of(wanted) for patches in self.patches]
        kept = (patches.at(np.flatnonzero(wanted[patches.bases])) for patches in self.extraordinary)
        self.extraordinary = []
        for patches in kept:
            refined, bases, nets = patches.refined()
            self.extraordinary.append(refined)
            self.patches.append(_Patches.new(level + 1, bases, nets))
        if self.refinement is not None:
            self.refinement = self.refinement.of(wanted).refined()

    def _take_patches(self, level: int) -> None:
        """Move the refinement's regular and extraordinary faces to the patches."""
        if self.refinement is None or not len(self.refinement.bases):
            return
        sorted_out = _sort_out(self.refinement)
        self.patches.append(_Patches.new(level, sorted_out.regular_bases, sorted_out.regular_nets()))
        self.extraordinary += [patches for patches, _ in sorted_out.extraordinary()]
        self.refinement = self.refinement.keep(sorted_out.rest)

    def _ask_patches(self, verdict: _Verdict, level: int) -> None:
        for patches in self.patches:
            if len(patches.bases):
                self._ask_nets(verdict, patches, level - patches.level)

    def _ask_nets(self, verdict: _Verdict, patches: _Patches, levels: int) -> None:
        """Ask regular patches about the facets so many levels after their own: first by what costs least."""
        upper, lower = self._first_bounds(patches, levels)
        doubtful = np.flatnonzero(verdict.hear(patches.bases, upper, lower))
        if not len(doubtful):
            return
        bases, upper, nets = patches.bases[doubtful], upper[doubtful], patches.nets_of(doubtful)
        for remaining in range(levels, max(levels - NET_SPLITS, 0) - 1, -1):
            if self._has_later_bounds(remaining):
                lower = sampled_error(nets, self.vertices, remaining)
                doubtful = np.flatnonzero(verdict.hear(bases, upper, lower))
                bases, nets = bases[doubtful], nets.take(doubtful, axis=2)
            if not len(bases):
                return
            if remaining == 0:
                verdict.open_blocks.append((bases, facet_error(nets, self.vertices)))
                return
            bases, nets = np.tile(bases, 4), both_ways(SPLINE_HALVES, nets)
            upper, lower = self._bounds(nets, remaining - 1)
            doubtful = np.flatnonzero(verdict.hear(bases, upper, lower))
            bases, upper, nets = bases[doubtful], upper[doubtful], nets.take(doubtful, axis=2)
        verdict.give_up(bases)

    def _has_later_bounds(self, levels: int) -> bool:
        """A control facet of the patch's own level is known better from its 12 coefficients."""
        return levels > 0 or self.vertices is Vertices.LIMIT

    def _first_bounds(self, patches: _Patches, levels: int) -> tuple[FloatArray, FloatArray]:
        """(P,) each: distances at most and at least, so many levels after the patches' own."""
        if not self._has_later_bounds(levels):
            return control_facet_bounds(patches.nets)
        later = patches.with_later_bounds(self.vertices)
        return later.at(levels), later.least(levels)

    def _bounds(self, nets: FloatArray, levels: int) -> tuple[FloatArray, FloatArray]:
        """The same for nets alone."""
        if not self._has_later_bounds(levels):
            return control_facet_bounds(nets)
        later = later_bounds(nets, self.vertices)
        return later.at(levels), later.least(levels)

    def _look_closer(self, verdict: _Verdict, settled: BoolArray, level: int) -> None:
        """Raise the least distances of settled faces as far as the samples of regular patches do."""
        for patches in self.patches:
            if patches.later is None:
                continue
            levels = level - patches.level
            promising = settled[patches.bases] & (patches.later.at(levels) > verdict.lower[patches.bases])
            chosen = np.flatnonzero(promising)
            if len(chosen):
                found = sampled_error(patches.nets_of(chosen), self.vertices, levels)
                np.maximum.at(verdict.lower, patches.bases[chosen], found)

    def _ask_extraordinary(self, verdict: _Verdict, patches: _ExtraordinaryPatches, facets: FloatArray) -> None:
        """Ask extraordinary patches about facets over them, (4, P, 3), refining them further while in doubt."""
        for _ in range(REFINEMENTS):
            if not len(patches.bases):
                return
            gaps = largest_norm(facets - patches.corners(Vertices.LIMIT))
            doubtful = np.flatnonzero(verdict.hear(patches.bases, np.full(len(gaps), np.inf), gaps))
            patches, facets, gaps = patches.at(doubtful), facets.take(doubtful, axis=1), gaps[doubtful]
            last = second_order_extraordinary(patches.nets, Vertices.LIMIT).value
            doubtful = np.flatnonzero(verdict.hear(patches.bases, gaps + last, gaps))
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
                gaps = largest_norm(_quads(facets) - _quads(_limits_of(refinement)))
                last = support_bounds(refinement.mesh, Vertices.LIMIT)[: len(refinement.bases)]
                doubtful = verdict.hear(refinement.bases, gaps + last, gaps)
                refinement, facets = refinement.keep(doubtful), facets[np.repeat(doubtful, 4)]
            refinement, facets = self._refine(verdict, refinement, facets)
        verdict.give_up(refinement.bases)

    def _vertices_of(self, refinement: Refinement) -> FloatArray:
        """(C, 3): where the vertices at the descendants' corners lie."""
        if self.vertices is Vertices.LIMIT:
            return _limits_of(refinement)
        return refinement.mesh.positions[_corner_vertices(refinement)]

    def _refine(self, verdict: _Verdict, refinement: Refinement, facets: FloatArray) -> tuple[Refinement, FloatArray]:
        """The children that are no patches, with the facets over them; the patches among them are asked at once."""
        if not len(refinement.bases):
            return refinement, facets
        facets = _facets_of_faces(refinement, facets)
        refinement = refinement.refined()
        sorted_out = _sort_out(refinement)
        blocks = patch_coefficients(sorted_out.regular_nets())
        blocks -= bilinear_coefficients(facets.take(sorted_out.regular, axis=1))
        verdict.open_blocks.append((sorted_out.regular_bases, blocks))
        for patches, faces in sorted_out.extraordinary():
            self._ask_extraordinary(verdict, patches, facets[sorted_out.corners_from_extraordinary(faces), faces])
        rest = facets.compress(sorted_out.rest, axis=1)
        return refinement.keep(sorted_out.rest), rest.swapaxes(0, 1).reshape(-1, 3)

    def _ask_blocks(self, verdict: _Verdict, blocks: list[Blocks], splits: int = BLOCK_SPLITS) -> None:
        """Ask differences S - L in Bernstein form, splitting them so often while in doubt."""
        doubtful = [block for block in (self._hear_blocks(verdict, *block) for block in blocks) if len(block[0])]
        if not doubtful:
            return
        counts = np.bincount(np.concatenate([bases for bases, _ in doubtful]), minlength=len(verdict.wanted))
        # Where a distance is the tolerance itself along a line, doubt grows with every split and never ends.
        hopeless = counts > (MOST_BLOCKS_OF_A_FACE if splits else 0)
        if np.any(hopeless):
            verdict.give_up(np.flatnonzero(hopeless))
            doubtful = _blocks_of(doubtful, ~hopeless)
            counts = np.where(hopeless, 0, counts)
        for some in _groups(counts, MOST_BLOCKS):
            chosen = doubtful if np.all(some[counts > 0]) else _blocks_of(doubtful, some)
            halved = [(np.tile(bases, 4), both_ways(HALVES, values)) for bases, values in chosen]
            self._ask_blocks(verdict, halved, splits - 1)

    def _hear_blocks(self, verdict: _Verdict, bases: IndexArray, values: FloatArray) -> Blocks:
        """The blocks that are left in doubt."""
        [(bases, values)] = _blocks_of([(bases, values)], verdict.wanted) or [(bases[:0], values[:, :, :0])]
        if not len(bases):
            return bases, values
        rows = values.reshape(16, -1, 3)
        doubtful = verdict.hear(bases, largest_norm(rows), largest_norm(rows[[0, 3, 12, 15]]))
        return bases[doubtful], values.compress(doubtful, axis=2)


def _blocks_of(blocks: list[Blocks], wanted: BoolArray) -> list[Blocks]:
    """The blocks of the wanted base faces."""
    kept = []
    for bases, values in blocks:
        chosen = wanted[bases]
        if np.all(chosen):
            kept.append((bases, values))
        elif np.any(chosen):
            kept.append((bases[chosen], values.compress(chosen, axis=2)))
    return kept


def _groups(counts: IndexArray, most: int) -> Iterator[BoolArray]:
    """Base faces in groups that have so many blocks together, a little more where need be: (B,) bool each."""
    group = (np.cumsum(counts) - counts) // most
    for number in np.unique(group[counts > 0]):
        yield (group == number) & (counts > 0)


def _corner_vertices(refinement: Refinement) -> IndexArray:
    """(C,) the vertices at the corners of the descendants, face by face."""
    return refinement.mesh.corner_vertices[: refinement.mesh.face_starts[len(refinement.bases)]]


def _limits_of(refinement: Refinement) -> FloatArray:
    """(C, 3) the limit positions of the vertices at the corners of the descendants."""
    vertices = _corner_vertices(refinement)
    wanted = np.zeros(refinement.mesh.vertex_count, dtype=bool)
    wanted[vertices] = True
    return limit_positions(refinement.mesh, wanted)[vertices]


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
    rest[extraordinary[valences > LARGEST_STENCIL_VALENCE]] = True
    return _SortedOut(refinement, kinds, np.flatnonzero(own == PatchKind.REGULAR), rest)


def _quads(corners: FloatArray) -> FloatArray:
    """(4, P, 3) from (4P, 3)."""
    return corners.reshape(-1, 4, 3).swapaxes(0, 1)


def _facets_of_quads(facets: FloatArray) -> FloatArray:
    """(4, 4, P, 3): bilinear facets (4, P, 3) restricted to the children: [corner of the child, child, facet]."""
    middles = (facets + facets[[1, 2, 3, 0]]) / 2
    centres = np.broadcast_to(facets.mean(axis=0), facets.shape)
    return np.stack([facets, middles, centres, middles[[3, 0, 1, 2]]])


def _facets_of_faces(refinement: Refinement, facets: FloatArray) -> FloatArray:
    """(4, C, 3): the facet of each face, given at its corners (C, 3), restricted to its children.

    An n-gon's facet is the fan of quads over corner, edge midpoint, centroid and edge midpoint.
    """
    mesh = refinement.mesh
    count = len(refinement.bases)
    corner_count = mesh.face_starts[count]
    following = mesh.next_corner[:corner_count]
    before = mesh.previous_corner[:corner_count]
    sizes = mesh.face_sizes[:count]
    centroids = np.add.reduceat(facets, mesh.face_starts[:count]) / sizes[:, None]
    middles = (facets + facets[following]) / 2
    return np.stack([facets, middles, np.repeat(centroids, sizes, axis=0), middles[before]])
