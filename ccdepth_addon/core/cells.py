# SPDX-License-Identifier: GPL-3.0-or-later
"""The surface over the nodes of a quadtree: what is known of it, its children's share of that, and how it is drawn.

Cells are nodes whose surface is known in one way: ``NetCells`` by a net from which every bound is linear (bicubic quads
and quads with one extraordinary corner), ``RefinedCells`` and ``PolygonCells`` by the mesh refined so far, with the
neighbours it needs. How a cell is drawn depends on which of its sides are split (``templates``).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from . import triangle_bounds
from .facet_bounds import facet_bounds
from .mesh import FloatArray, IndexArray, PolygonMesh
from .norms import cross_products, squared_norms
from .patches import PatchKind, PatchKinds, classify_patches, extraordinary_nets, regular_nets
from .polygons import is_folded, polygon_thickness, thickness_of_quads
from .products import product
from .quadtree import Quadtree
from .refined_bounds import refined_misses
from .refinement import Refinement, split
from .splines import HALVES, SPLINE_TO_BERNSTEIN, patch_coefficients, tensor
from .stencils import LARGEST_STENCIL_VALENCE, patch_stencils
from .templates import ALL_SPLIT, TURNS, WHOLE, Template, Transitions, templates
from .triangle_bounds import Misses

BoolArray = NDArray[np.bool_]

CELLS_AT_ONCE = 1 << 13

# A bound that misses the tolerance by more than this is not worth a second look: splitting the parts of triangles once
# takes at most about a fifth of it away.
WORTH_A_SECOND_LOOK = 1.5

# How much of the limit what is expected of the neighbours may take up; and what the tilt of triangles against their
# neighbours is to the height of a side's middle over its chord, in parts of its length: 8 for a circle, and some more.
HOPEFUL = 0.9
SLOPE_OF_HEIGHT = 10.0

# What ``graph_bounds`` leaves is a third of a height at most, and that of the least triangle around.
ROOM = 0.12

# Points of a quad (``templates.QUAD_POINTS``, then the centre): the middles of its sides, between corners, and of its
# diagonals.
MIDDLES, STARTS, ENDS = [4, 5, 6, 7], [0, 1, 2, 3], [1, 2, 3, 0]
CENTRE = 8

PATTERN_BITS = np.array([1, 2, 4, 8])


@dataclass
class Fit:
    """How P cells are drawn, and how well: (P,) each.

    bounds: float64, the proved distance as they are drawn, inf where that is not within the limit. normal, tangential:
    float64, how far they are off at equal parameters, along the triangles' normals and across these, at most; inf where
    no template will do. Where these are finite and the bound is not, it takes the neighbours to find one
    (``graph_bounds``), and is likely to be within the limit. patterns and
    alternatives: int8, the template (``templates``), counted from slot ``turns`` on. folded: bool, whether the
    triangles of a whole quad face away from each other, here or where Blender triangulates it, so that it has to be
    drawn as triangles. least: float64, a distance that is really there when the cell's sides are whole.
    """

    bounds: FloatArray
    normal: FloatArray
    tangential: FloatArray
    patterns: NDArray[np.int8]
    alternatives: NDArray[np.int8]
    turns: NDArray[np.int8]
    folded: BoolArray
    least: FloatArray

    @staticmethod
    def none(count: int) -> Fit:
        """Nothing found yet."""
        small = np.zeros(count, dtype=np.int8)
        far = np.full(count, np.inf)
        folded = np.zeros(count, dtype=bool)
        return Fit(far, far.copy(), far.copy(), small, small.copy(), small.copy(), folded, np.zeros(count))

    def at(self, chosen: IndexArray) -> Fit:
        """Those of some of the cells, by index."""
        return Fit(*(getattr(self, field.name)[chosen] for field in fields(self)))

    @property
    def fits(self) -> BoolArray:
        """(P,) whether a template will do, or is likely to."""
        return np.isfinite(self.normal)

    def take(self, chosen: IndexArray, misses: Misses, alternative: int) -> None:
        """Draw the chosen cells by a template that is within the limit, or likely to be."""
        self.normal[chosen] = misses.normal
        self.tangential[chosen] = misses.tangential
        self.alternatives[chosen] = alternative

    def fold(self, chosen: IndexArray, pattern: int, points: FloatArray, axes: FloatArray) -> None:
        """Find out which of the chosen cells, whose points are (8 or more, n, 3), are folded as they are drawn."""
        if pattern == WHOLE:
            first = self.alternatives[chosen][None, :, None] == 0
            corners = np.where(first, points[:4], np.roll(points[:4], -1, axis=0))
            self.folded[chosen] = is_folded(corners, np.eye(3)) | is_folded(corners, axes)


class Cells(Protocol):
    """P nodes whose surface is known in one way."""

    @property
    def nodes(self) -> IndexArray:
        """(P,) intp."""

    def at(self, chosen: IndexArray) -> Cells:
        """Some of them, by index."""

    def fit(self, hanging: BoolArray, transitions: Transitions, limit: float, axes: FloatArray) -> Fit:
        """How to draw them within a limit; hanging: (slots of the nodes,) bool, which sides are split. axes: (3, 3), of
        the space where Blender triangulates (``polygons``)."""

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        """The cells of their children; the tree's nodes have been split."""


def cells_of_faces(mesh: PolygonMesh) -> Iterator[Cells]:
    """The faces of a control mesh, whose sharpness is explicit, as cells: node f is face f."""
    kinds = classify_patches(mesh)
    regular, extraordinary, rest = _by_valence(mesh, kinds, mesh.face_count)
    for faces in split(regular, CELLS_AT_ONCE):
        yield NetCells.bicubic(faces, regular_nets(mesh, faces))
    for valence, of_valence in extraordinary:
        for faces in split(of_valence, CELLS_AT_ONCE):
            yield _extraordinary_cells(mesh, kinds, valence, faces, faces)
    quads = mesh.face_sizes[rest] == 4
    for faces in split(rest[quads], CELLS_AT_ONCE):
        yield RefinedCells(faces, Refinement.start(mesh, faces))
    for faces in split(rest[~quads], CELLS_AT_ONCE):
        yield PolygonCells(faces, Refinement.start(mesh, faces))


def _cells_of_refinement(nodes: IndexArray, refinement: Refinement) -> Iterator[Cells]:
    """Descendants, all quads, as cells: descendant i is ``nodes[i]``."""
    mesh = refinement.mesh
    kinds = classify_patches(mesh)
    regular, extraordinary, rest = _by_valence(mesh, kinds, len(nodes))
    if len(regular):
        yield NetCells.bicubic(nodes[regular], regular_nets(mesh, regular))
    for valence, faces in extraordinary:
        yield _extraordinary_cells(mesh, kinds, valence, faces, nodes[faces])
    if len(rest):
        wanted = np.zeros(len(nodes), dtype=bool)
        wanted[rest] = True
        yield RefinedCells(nodes[rest], _numbered(refinement.keep(wanted)))


def _by_valence(
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


def _extraordinary_cells(
    mesh: PolygonMesh, kinds: PatchKinds, valence: int, faces: IndexArray, nodes: IndexArray
) -> NetCells:
    corners = kinds.extraordinary_corners[faces]
    return NetCells(nodes, corners - mesh.face_starts[faces], extraordinary_nets(mesh, corners, valence), valence)


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
        samples = _Samples.of(points, pattern)
        found.least[chosen] = samples.whole.min(axis=0)
        as_polygons = transitions is Transitions.NGONS and pattern != WHOLE
        for alternative, tried in _in_turn(samples.whole, lambda: np.isinf(found.bounds[chosen])):
            tried = tried[samples.whole[alternative, tried] <= limit]
            if len(tried):
                misses = self.at(tried).misses(pattern, alternative, points[:, tried], limit)
                reached = misses.whole
                if as_polygons:
                    reached = reached + thickness_of_quads(points[:, tried], pattern, alternative, axes)
                within = np.flatnonzero(reached <= limit)
                found.bounds[chosen[tried[within]]] = reached[within]
                found.take(chosen[tried[within]], misses.at(within), alternative)
        if not as_polygons:
            self._hope(found, chosen, pattern, samples, points, limit)
        found.fold(chosen, pattern, points, axes)

    def _hope(
        self, found: Fit, chosen: IndexArray, pattern: int, samples: _Samples, points: FloatArray, limit: float
    ) -> None:
        """Where none is within the limit at equal parameters, take one that is likely to be along the surface."""
        hopes = samples.hope(samples.normal, samples.tangential)
        for alternative, tried in _in_turn(hopes, lambda: ~found.fits[chosen]):
            tried = tried[hopes[alternative, tried] <= HOPEFUL * limit]
            if len(tried):
                misses = self.at(tried).misses_along(pattern, alternative, points[:, tried], HOPEFUL * limit)
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
        return NetCells(nodes, np.zeros_like(nodes), patch_coefficients(spline_nets).reshape(16, -1, 3))

    @staticmethod
    def joined(blocks: list[NetCells]) -> NetCells:
        """Cells of one valence as one block."""
        return NetCells(
            np.concatenate([block.nodes for block in blocks]),
            np.concatenate([block.slots for block in blocks]),
            np.concatenate([block.nets for block in blocks], axis=1),
            blocks[0].valence,
        )

    def at(self, chosen: IndexArray) -> NetCells:
        return NetCells(self.nodes[chosen], self.slots[chosen], self.nets.take(chosen, axis=1), self.valence)

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        first = tree.first_child[self.nodes]
        zeros = np.zeros_like(first)
        if self.valence == 4:
            for slot, matrix in enumerate(CHILD_MATRICES):
                yield NetCells(first + slot, zeros, _apply(matrix, self.nets))
            return
        stencils = patch_stencils(self.valence)
        yield NetCells(first + self.slots, zeros, _apply(stencils.refined, self.nets), self.valence)
        for turn in (1, 2, 3):
            matrix = TO_BERNSTEIN @ stencils.regular[16 * (turn - 1) : 16 * turn]
            yield NetCells(first + (self.slots + turn) % 4, zeros, _apply(matrix, self.nets))

    def fit(self, hanging: BoolArray, transitions: Transitions, limit: float, axes: FloatArray) -> Fit:
        turns = TURNS[_patterns(hanging, self.slots)]
        if self.valence == 4 and np.any(turns):
            # Fewer patterns mean less work.
            return self._turned(turns).fit(hanging, transitions, limit, axes)
        return super().fit(hanging, transitions, limit, axes)

    def _turned(self, turns: NDArray[np.int8]) -> NetCells:
        """Bicubic quads counted from other slots, (P,) turns further on."""
        nets = self.nets.copy()
        for turn in (1, 2, 3):
            chosen = np.flatnonzero(turns == turn)
            nets[:, chosen] = self.nets[:, chosen].take(TURNED_COEFFICIENTS[turn], axis=0)
        return NetCells(self.nodes, (self.slots + turns) % 4, nets, self.valence)

    def turns(self) -> IndexArray:
        return self.slots

    def points(self) -> FloatArray:
        if self.valence == 4:
            return _apply(triangle_bounds.regular_points(), self.nets)
        return _apply(triangle_bounds.extraordinary_points(self.valence), self.nets)

    def misses(self, pattern: int, alternative: int, points: FloatArray, limit: float) -> Misses:
        """Looked at twice where that decides."""
        normals = _triangle_normals(points, templates(pattern)[alternative])
        misses = self._misses_once(pattern, alternative, normals, fine=False)
        doubtful = np.flatnonzero((misses.whole > limit) & (misses.whole <= WORTH_A_SECOND_LOOK * limit))
        if len(doubtful):
            misses.put(doubtful, self.at(doubtful)._misses_once(pattern, alternative, normals[:, doubtful], fine=True))
        return misses

    def misses_along(self, pattern: int, alternative: int, points: FloatArray, limit: float) -> Misses:
        """Looked at twice where they leave the triangles little room, or are far along the normals."""
        template = templates(pattern)[alternative]
        normals = _triangle_normals(points, template)
        if self.valence == 4:
            # These take little time.
            return self._misses_once(pattern, alternative, normals, fine=True)
        misses = self._misses_once(pattern, alternative, normals, fine=False)
        crowded = misses.normal + misses.tangential > ROOM * _least_heights(points, template)
        doubtful = np.flatnonzero(crowded | (misses.normal > limit / 2))
        if len(doubtful):
            misses.put(doubtful, self.at(doubtful)._misses_once(pattern, alternative, normals[:, doubtful], fine=True))
        return misses

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
        return RefinedCells(self.nodes[places], _numbered(self.refinement.keep(wanted)))

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        return _refined_children(tree, self.nodes, self.refinement)

    def turns(self) -> IndexArray:
        return np.zeros_like(self.nodes)

    def points(self) -> FloatArray:
        return _points_of_quads(self.refinement, self.refinement.limits_at_corners())

    def misses(self, pattern: int, alternative: int, points: FloatArray, limit: float) -> Misses:
        return self._misses(pattern, alternative, points, limit, along=False)

    def misses_along(self, pattern: int, alternative: int, points: FloatArray, limit: float) -> Misses:
        return self._misses(pattern, alternative, points, limit, along=True)

    def _misses(self, pattern: int, alternative: int, points: FloatArray, limit: float, *, along: bool) -> Misses:
        normals = _triangle_normals(points, templates(pattern)[alternative])
        children = self.refinement.refined()
        return refined_misses(children, points, (pattern, alternative), normals, limit, along=along)


@dataclass(frozen=True)
class PolygonCells:
    """Faces of the control mesh that are no quads, drawn as they are."""

    nodes: IndexArray
    refinement: Refinement

    def at(self, chosen: IndexArray) -> PolygonCells:
        wanted = np.zeros(len(self.nodes), dtype=bool)
        wanted[chosen] = True
        places = np.sort(chosen)
        return PolygonCells(self.nodes[places], _numbered(self.refinement.keep(wanted)))

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        return _refined_children(tree, self.nodes, self.refinement)

    def fit(self, hanging: BoolArray, transitions: Transitions, limit: float, axes: FloatArray) -> Fit:
        """By way of the fans of bilinear facets around the centroids, which bend at the middles of split sides."""
        found = Fit.none(len(self.nodes))
        corners = self.refinement.limits_at_corners()
        middles, _ = _limits_of_children(self.refinement)
        facets = self.refinement.facets_of_children(corners)
        before = self.refinement.mesh.previous_corner[: len(corners)]
        facets[1] = np.where(hanging[:, None], middles, facets[1])
        facets[3] = facets[1][before]
        starts = self.refinement.mesh.face_starts[: len(self.nodes)]
        found.least[:] = np.maximum.reduceat(np.sqrt(squared_norms(middles - facets[1])), starts)
        promising = (found.least <= limit) & ~np.logical_and.reduceat(hanging, starts)
        if np.any(promising):
            chosen = np.flatnonzero(promising)
            kept = np.repeat(promising, self.refinement.mesh.face_sizes[: len(self.nodes)])
            part = _numbered(self.refinement.keep(promising))
            bounds = facet_bounds(part, facets[:, kept], limit)
            starts = part.mesh.face_starts[: len(chosen)]
            bounds += polygon_thickness(facets[:, kept], hanging[kept], starts, axes)
            found.bounds[chosen] = np.where(bounds <= limit, bounds, np.inf)
        found.normal[:] = found.tangential[:] = found.bounds
        return found


def _apply(matrix: FloatArray, nets: FloatArray) -> FloatArray:
    """(rows, P, 3): a matrix (rows, N) applied to nets (N, P, 3)."""
    return product(matrix, nets.reshape(len(nets), -1)).reshape(len(matrix), -1, 3)


def _patterns(hanging: BoolArray, turns: IndexArray) -> NDArray[np.int8]:
    """(P,) the patterns of quads, counted from slot ``turns`` on."""
    sides = hanging.reshape(-1, 4)
    places = (np.arange(4) + turns[:, None]) % 4
    return (np.take_along_axis(sides, places, axis=1) @ PATTERN_BITS).astype(np.int8)


@dataclass(frozen=True)
class _Samples:
    """S - T at the middles of the sides and of the diagonals of P quads, as lengths: (alternatives, P) each.

    slopes: (P,) by how much the triangles there and around are tilted against each other, roughly.
    """

    whole: FloatArray
    normal: FloatArray
    tangential: FloatArray
    slopes: FloatArray

    @staticmethod
    def of(points: FloatArray, pattern: int) -> _Samples:
        """From the quads' points and centres (9, P, 3); for split sides nothing is sampled but the slopes."""
        sides = points[MIDDLES] - (points[STARTS] + points[ENDS]) / 2
        diagonals = points[CENTRE] - (points[[0, 1]] + points[[2, 3]]) / 2
        normals = _triangle_normals(points, ((0, 1, 2), (0, 2, 3)))
        normals = (normals[0] + normals[1]) / 2
        lengths = np.sqrt(squared_norms(points[ENDS] - points[STARTS])).min(axis=0)
        heights, across = _along_and_across(np.concatenate([sides, diagonals]), normals)
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = SLOPE_OF_HEIGHT * heights[:4].max(axis=0) / lengths
        slopes = np.where(np.isfinite(slopes), slopes, np.inf)
        if pattern != WHOLE:
            none = np.zeros((len(templates(pattern)), points.shape[1]))
            return _Samples(none, none, none, slopes)
        normal = np.maximum(heights[:4].max(axis=0), heights[4:])
        tangential = np.maximum(across[:4].max(axis=0), across[4:])
        whole = np.sqrt(squared_norms(np.concatenate([sides, diagonals])))
        return _Samples(np.maximum(whole[:4].max(axis=0), whole[4:]), normal, tangential, slopes)

    def at(self, chosen: IndexArray) -> _Samples:
        return _Samples(self.whole[:, chosen], self.normal[:, chosen], self.tangential[:, chosen], self.slopes[chosen])

    def hope(self, normal: FloatArray, tangential: FloatArray) -> FloatArray:
        """About what ``graph_bounds`` will find for quads that are off by so much."""
        secants = np.sqrt(1 + self.slopes**2)
        with np.errstate(invalid="ignore"):
            hope = normal * secants + 2 * self.slopes * (tangential + normal * self.slopes / secants)
        return np.where(np.isnan(hope), np.inf, hope)


def _in_turn(samples: FloatArray, wanted: Callable[[], BoolArray]) -> Iterator[tuple[int, IndexArray]]:
    """The alternatives (A, P), for each cell in the order of its samples, with the cells that still want one."""
    for rank in np.argsort(samples, axis=0, kind="stable"):
        for alternative in range(len(samples)):
            yield alternative, np.flatnonzero((rank == alternative) & wanted())


def _triangle_normals(points: FloatArray, template: Template) -> FloatArray:
    """(T, P, 3): unit normals of the triangles over quads' points (8 or more, P, 3); zero where there is no area."""
    crosses = np.stack([cross_products(points[b] - points[a], points[c] - points[a]) for a, b, c in template])
    lengths = np.sqrt(squared_norms(crosses))[..., None]
    return crosses / np.where(lengths > 0, lengths, 1.0)


def _least_heights(points: FloatArray, template: Template) -> FloatArray:
    """(P,): the least height of the triangles over quads' points (8 or more, P, 3)."""
    heights = np.full(points.shape[1], np.inf)
    for triangle in template:
        corners = points[list(triangle)]
        areas = np.sqrt(squared_norms(cross_products(corners[1] - corners[0], corners[2] - corners[0])))
        longest = np.sqrt(squared_norms(np.roll(corners, -1, axis=0) - corners)).max(axis=0)
        heights = np.minimum(heights, areas / np.where(longest > 0, longest, 1.0))
    return heights


def _along_and_across(vectors: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(R, P) twice: the lengths of vectors (R, P, 3) along unit normals (P, 3) and across them."""
    along = np.abs(np.einsum("rpi,pi->rp", vectors, normals))
    return along, np.sqrt(np.maximum(squared_norms(vectors) - along**2, 0.0))


def _numbered(refinement: Refinement) -> Refinement:
    """The same, each descendant its own base."""
    return Refinement(refinement.mesh, np.arange(len(refinement.bases)))


def _refined_children(tree: Quadtree, nodes: IndexArray, refinement: Refinement) -> Iterator[Cells]:
    sizes = refinement.mesh.face_sizes[: len(nodes)]
    places = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    children = np.repeat(tree.first_child[nodes], sizes) + places
    return _cells_of_refinement(children, _numbered(refinement.refined()))


def _limits_of_children(refinement: Refinement) -> tuple[FloatArray, FloatArray]:
    """(C, 3) twice: where the middle of each side, and the centre of the face, lie on the limit surface."""
    children = refinement.refined()
    corners = children.limits_at_corners().reshape(-1, 4, 3)
    return corners[:, 1], corners[:, 2]


def _points_of_quads(refinement: Refinement, corners: FloatArray) -> FloatArray:
    """(9, P, 3): the points of quads and their centres, from the limits at their corners (4P, 3)."""
    middles, centres = _limits_of_children(refinement)
    by_quad = [corners.reshape(-1, 4, 3), middles.reshape(-1, 4, 3), centres.reshape(-1, 4, 3)[:, :1]]
    return np.ascontiguousarray(np.concatenate(by_quad, axis=1).swapaxes(0, 1))
