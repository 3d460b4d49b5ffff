# SPDX-License-Identifier: GPL-3.0-or-later
"""Quads of a quadtree as cells.

``NetCells`` are known by a net from which every bound is linear: bicubic quads, and those with an extraordinary corner.
``RefinedCells`` are known by the mesh refined so far, with the neighbours it needs.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from . import triangle_bounds
from .coordinates import applied, chosen_vectors, coordinates_apart
from .fits import HOPEFUL, Cells, Fit, Samples, in_turn, least_heights, triangle_normals
from .mesh import FloatArray, IndexArray, PolygonMesh
from .patches import PatchKind, PatchKinds, classify_patches, extraordinary_nets, regular_nets
from .polygons import thickness_of_quads
from .quadtree import Quadtree
from .refined_bounds import template_misses
from .refinement import Refinement
from .splines import HALVES, SPLINE_TO_BERNSTEIN, patch_coefficients, tensor
from .stencils import LARGEST_STENCIL_VALENCE, patch_stencils
from .templates import ALL_SPLIT, TURNS, WHOLE, Transitions, templates
from .triangle_bounds import Misses

BoolArray = NDArray[np.bool_]

# A bound that misses the tolerance by more than this is not worth a second look: splitting the parts of triangles once
# takes at most about a fifth of it away.
WORTH_A_SECOND_LOOK = 1.5

# What ``graph_bounds`` leaves is a third of a height at most, and that of the least triangle around.
ROOM = 0.12

PATTERN_BITS = np.array([1, 2, 4, 8])

# Cells with nets that are looked at together: enough of them that the threads seldom wait for the interpreter. Those
# by refined meshes take so long that fewer are enough.
CELLS_AT_ONCE = 1 << 15
REFINED_AT_ONCE = 1 << 12


def cells_of_refinement(nodes: IndexArray, refinement: Refinement) -> Iterator[Cells]:
    """Descendants, all quads, as cells: descendant i is ``nodes[i]``."""
    mesh = refinement.mesh
    kinds = classify_patches(mesh)
    regular, extraordinary, rest = by_valence(mesh, kinds, len(nodes))
    if len(regular):
        yield NetCells.bicubic(nodes[regular], regular_nets(mesh, regular))
    for valence, faces in extraordinary:
        yield extraordinary_cells(mesh, kinds, valence, faces, nodes[faces])
    if len(rest):
        wanted = np.zeros(len(nodes), dtype=bool)
        wanted[rest] = True
        yield RefinedCells(nodes[rest], refinement.keep(wanted).numbered())


def by_valence(
    mesh: PolygonMesh, kinds: PatchKinds, count: int
) -> tuple[IndexArray, list[tuple[int, IndexArray]], IndexArray]:
    """The regular ones of the first faces, the extraordinary ones valence by valence, and the rest."""
    own = kinds.kinds[:count]
    extraordinary = np.flatnonzero(own == PatchKind.EXTRAORDINARY)
    valences = mesh.vertex_face_counts[mesh.corner_vertices[kinds.extraordinary_corners[extraordinary]]]
    small = valences <= LARGEST_STENCIL_VALENCE
    by_valence = [(n, extraordinary[valences == n]) for n in np.unique(valences[small]).tolist()]
    rest = np.sort(np.concatenate([np.flatnonzero(own == PatchKind.IRREGULAR), extraordinary[~small]]))
    return np.flatnonzero(own == PatchKind.REGULAR), by_valence, rest


def extraordinary_cells(
    mesh: PolygonMesh, kinds: PatchKinds, valence: int, faces: IndexArray, nodes: IndexArray
) -> NetCells:
    corners = kinds.extraordinary_corners[faces]
    nets = coordinates_apart(extraordinary_nets(mesh, corners, valence))
    return NetCells(nodes, corners - mesh.face_starts[faces], nets, valence)


def _child_matrices() -> list[FloatArray]:
    """Four of (16, 16): a bicubic quad's Bernstein coefficients → those of its child at each slot, in its own frame."""
    low, high = HALVES
    quarters = [np.kron(a, b).reshape(4, 4, 16) for a, b in ((low, low), (high, low), (high, high), (low, high))]
    return [np.ascontiguousarray(np.rot90(q, -turns).reshape(16, 16)) for turns, q in enumerate(quarters)]


CHILD_MATRICES = _child_matrices()

# The Bernstein coefficients of a bicubic quad in the order of the same quad counted from slot 0, 1, 2 or 3.
TURNED_COEFFICIENTS = [np.rot90(np.arange(16).reshape(4, 4), -turns).ravel() for turns in range(4)]
TO_BERNSTEIN = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN)


class QuadCells(ABC):
    """Quads, drawn by the templates for their split sides."""

    nodes: IndexArray

    @abstractmethod
    def at(self, chosen: IndexArray) -> Self:
        """Some of them, by ascending index."""

    @abstractmethod
    def turns(self) -> IndexArray:
        """(P,) the slot from which the points and the patterns of each are counted."""

    @abstractmethod
    def points(self) -> FloatArray:
        """(9, P, 3): the quads' points (``templates.QUAD_POINTS``) and centres, on the surface."""

    @abstractmethod
    def misses(self, pattern: int, alternative: int, points: FloatArray, limit: float) -> Misses:
        """How far the quads are off at most, drawn by a template, as well as it takes to see what is within the limit.

        points: their own.
        """

    @abstractmethod
    def misses_along(self, pattern: int, alternative: int, points: FloatArray, limit: float) -> Misses:
        """The same, as well as it takes to bound by the neighbours what is within the limit along the normals."""

    def fit(self, hanging: BoolArray, transitions: Transitions, limit: float, axes: FloatArray) -> Fit:
        """As in ``Cells``."""
        patterns = _patterns(hanging, self.turns())
        found = Fit.none(len(self.nodes))
        found.turns[:] = self.turns()
        found.patterns[:] = patterns
        for pattern in np.unique(patterns[patterns != ALL_SPLIT]).tolist():
            chosen = np.flatnonzero(patterns == pattern)
            part = self if len(chosen) == len(self.nodes) else self.at(chosen)
            part._fit_pattern(found, chosen, pattern, transitions, limit, axes)
        return found

    def _fit_pattern(
        self,
        found: Fit,
        chosen: IndexArray,
        pattern: int,
        transitions: Transitions,
        limit: float,
        axes: FloatArray,
    ) -> None:
        """Try the templates of a pattern, the likeliest first, until one is within the limit, or likely to be.

        chosen: where in what is found the quads are.
        """
        points = self.points()
        samples = Samples.of(points, pattern)
        found.least[chosen] = samples.whole.min(axis=0)
        as_polygons = transitions is Transitions.NGONS and pattern != WHOLE
        for alternative, tried in in_turn(samples.whole, lambda: np.isinf(found.bounds[chosen])):
            tried = tried[samples.whole[alternative, tried] <= limit]
            if len(tried):
                misses = self.at(tried).misses(pattern, alternative, chosen_vectors(points, tried), limit)
                reached = misses.whole
                if as_polygons:
                    reached = reached + thickness_of_quads(chosen_vectors(points, tried), pattern, alternative, axes)
                within = np.flatnonzero(reached <= limit)
                found.bounds[chosen[tried[within]]] = reached[within]
                found.take(chosen[tried[within]], misses.at(within), alternative)
        if not as_polygons:
            self._hope(found, chosen, pattern, samples, points, limit)
        found.fold(chosen, pattern, points, axes)

    def _hope(
        self, found: Fit, chosen: IndexArray, pattern: int, samples: Samples, points: FloatArray, limit: float
    ) -> None:
        """Where none is within the limit at equal parameters, take one that is likely to be along the surface."""
        hopes = samples.hope(samples.normal, samples.tangential)
        for alternative, tried in in_turn(hopes, lambda: ~found.fits[chosen]):
            tried = tried[hopes[alternative, tried] <= HOPEFUL * limit]
            if len(tried):
                misses = self.at(tried).misses_along(
                    pattern, alternative, chosen_vectors(points, tried), HOPEFUL * limit
                )
                hopeful = samples.at(tried).hope(misses.normal, misses.tangential) <= HOPEFUL * limit
                found.take(chosen[tried[hopeful]], misses.at(np.flatnonzero(hopeful)), alternative)


@dataclass(frozen=True)
class NetCells(QuadCells):
    """Quads with a net: bicubic ones by their 16 Bernstein coefficients, others by the net around a corner.

    nodes: (P,); slots: (P,) the slot the net is counted from; nets: (16 or 2n + 8, P, 3); valence: 4 or n.
    """

    nodes: IndexArray
    slots: IndexArray
    nets: FloatArray
    valence: int = 4

    @staticmethod
    def bicubic(nodes: IndexArray, spline_nets: FloatArray) -> NetCells:
        """From B-spline nets (4, 4, P, 3)."""
        coefficients = coordinates_apart(patch_coefficients(spline_nets).reshape(16, -1, 3))
        return NetCells(nodes, np.zeros_like(nodes), coefficients)

    @staticmethod
    def joined(blocks: list[NetCells]) -> NetCells:
        """Cells of one valence as one block."""
        if len(blocks) == 1:
            return blocks[0]
        return NetCells(
            np.concatenate([block.nodes for block in blocks]),
            np.concatenate([block.slots for block in blocks]),
            np.concatenate([block.nets for block in blocks], axis=1),
            blocks[0].valence,
        )

    def at(self, chosen: IndexArray) -> NetCells:
        return NetCells(self.nodes[chosen], self.slots[chosen], chosen_vectors(self.nets, chosen), self.valence)

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        first = tree.first_child[self.nodes]
        zeros = np.zeros_like(first)
        if self.valence == 4:
            for slot, matrix in enumerate(CHILD_MATRICES):
                yield NetCells(first + slot, zeros, applied(matrix, self.nets))
            return
        stencils = patch_stencils(self.valence)
        yield NetCells(first + self.slots, zeros, applied(stencils.refined, self.nets), self.valence)
        for turn in (1, 2, 3):
            matrix = TO_BERNSTEIN @ stencils.regular[16 * (turn - 1) : 16 * turn]
            yield NetCells(first + (self.slots + turn) % 4, zeros, applied(matrix, self.nets))

    def fit(self, hanging: BoolArray, transitions: Transitions, limit: float, axes: FloatArray) -> Fit:
        turns = TURNS[_patterns(hanging, self.slots)]
        if self.valence == 4 and np.any(turns):
            # Fewer patterns mean less work.
            return self._turned(turns).fit(hanging, transitions, limit, axes)
        return super().fit(hanging, transitions, limit, axes)

    def _turned(self, turns: NDArray[np.int8]) -> NetCells:
        """Bicubic quads counted from other slots, (P,) turns further on."""
        nets = self.nets.copy("K")
        for turn in (1, 2, 3):
            chosen = np.flatnonzero(turns == turn)
            nets[:, chosen] = chosen_vectors(self.nets, chosen).take(TURNED_COEFFICIENTS[turn], axis=0)
        return NetCells(self.nodes, (self.slots + turns) % 4, nets, self.valence)

    def turns(self) -> IndexArray:
        return self.slots

    def points(self) -> FloatArray:
        if self.valence == 4:
            return applied(triangle_bounds.regular_points(), self.nets)
        return applied(triangle_bounds.extraordinary_points(self.valence), self.nets)

    def misses(self, pattern: int, alternative: int, points: FloatArray, limit: float) -> Misses:
        """Looked at twice where that decides."""
        normals = triangle_normals(points, templates(pattern)[alternative])
        misses = self._misses_once(pattern, alternative, normals, fine=False)
        doubtful = np.flatnonzero((misses.whole > limit) & (misses.whole <= WORTH_A_SECOND_LOOK * limit))
        if len(doubtful):
            self._look_again(misses, doubtful, pattern, alternative, normals)
        return misses

    def misses_along(self, pattern: int, alternative: int, points: FloatArray, limit: float) -> Misses:
        """Looked at twice where they leave the triangles little room, or are far along the normals."""
        template = templates(pattern)[alternative]
        normals = triangle_normals(points, template)
        if self.valence == 4:
            # These take little time.
            return self._misses_once(pattern, alternative, normals, fine=True)
        misses = self._misses_once(pattern, alternative, normals, fine=False)
        crowded = misses.normal + misses.tangential > ROOM * least_heights(points, template)
        doubtful = np.flatnonzero(crowded | (misses.normal > limit / 2))
        if len(doubtful):
            self._look_again(misses, doubtful, pattern, alternative, normals)
        return misses

    def _look_again(
        self, misses: Misses, doubtful: IndexArray, pattern: int, alternative: int, normals: FloatArray
    ) -> None:
        """Find the misses of doubtful ones anew, finely."""
        normals = chosen_vectors(normals, doubtful)
        misses.put(doubtful, self.at(doubtful)._misses_once(pattern, alternative, normals, fine=True))

    def _misses_once(self, pattern: int, alternative: int, normals: FloatArray, *, fine: bool) -> Misses:
        if self.valence == 4:
            rows = triangle_bounds.regular_rows(pattern, alternative, fine=fine)
            return triangle_bounds.regular_misses(rows, self.nets, normals)
        matrices = triangle_bounds.extraordinary_rows(self.valence, pattern, alternative, fine=fine)
        return triangle_bounds.extraordinary_misses(matrices, self.nets, normals)


@dataclass(frozen=True)
class RefinedCells(QuadCells):
    """Quads of another kind, by the mesh refined so far: descendant i is ``nodes[i]``."""

    nodes: IndexArray
    refinement: Refinement

    def at(self, chosen: IndexArray) -> RefinedCells:
        wanted = np.zeros(len(self.nodes), dtype=bool)
        wanted[chosen] = True
        places = np.sort(chosen)
        return RefinedCells(self.nodes[places], self.refinement.keep(wanted).numbered())

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        return refined_children(tree, self.nodes, self.refinement)

    def turns(self) -> IndexArray:
        return np.zeros_like(self.nodes)

    def points(self) -> FloatArray:
        return _points_of_quads(self.refinement, self.refinement.limits_at_corners())

    def misses(self, pattern: int, alternative: int, points: FloatArray, limit: float) -> Misses:
        normals = triangle_normals(points, templates(pattern)[alternative])
        return template_misses(self.refinement.refined(), points, (pattern, alternative), normals, limit)

    def misses_along(self, pattern: int, alternative: int, points: FloatArray, limit: float) -> Misses:
        # What leaves its neighbours no room now may do so when some of its sides are split.
        normals, room = triangle_normals(points, templates(pattern)[alternative]), np.full(len(self.nodes), np.inf)
        return template_misses(self.refinement.refined(), points, (pattern, alternative), normals, limit, room)


def _patterns(hanging: BoolArray, turns: IndexArray) -> NDArray[np.int8]:
    """(P,) the patterns of quads, counted from slot ``turns`` on."""
    sides = hanging.reshape(-1, 4)
    places = (np.arange(4) + turns[:, None]) % 4
    return (np.take_along_axis(sides, places, axis=1) @ PATTERN_BITS).astype(np.int8)


def refined_children(tree: Quadtree, nodes: IndexArray, refinement: Refinement) -> Iterator[Cells]:
    sizes = refinement.mesh.face_sizes[: len(nodes)]
    places = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    children = np.repeat(tree.first_child[nodes], sizes) + places
    return cells_of_refinement(children, refinement.refined().numbered())


def _points_of_quads(refinement: Refinement, corners: FloatArray) -> FloatArray:
    """(9, P, 3): the points of quads and their centres, from the limits at their corners (4P, 3)."""
    middles, centres = refinement.limits_inside()
    by_quad = [corners.reshape(-1, 4, 3), middles.reshape(-1, 4, 3), centres.reshape(-1, 4, 3)[:, :1]]
    return coordinates_apart(np.concatenate(by_quad, axis=1).swapaxes(0, 1))
