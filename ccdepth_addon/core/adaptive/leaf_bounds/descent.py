# SPDX-License-Identifier: GPL-3.0-or-later
"""The descendants of faces that have no net of their own, as squares in the parameters of quads.

A regular descendant is bicubic. Any other is near the bilinear facet over its control points, and its children are
nearer: by stencils where it has one extraordinary corner, and by refining the mesh elsewhere. Several templates ask
for the same descendants, so each is computed once, when it is first asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...arrays.ranges import ranges
from ...arrays.types import FloatArray, IndexArray
from ...arrays.vectors import selected_vectors, transformed_nets
from ...bounds.norm_bounds import Vertices, second_order_extraordinary, support_bounds
from ...mesh.polygon_mesh import PolygonMesh
from ...surface.bicubic import SPLINE_TO_BERNSTEIN, facet_coefficients, patch_coefficients, tensor
from ...surface.patches import PatchKind, PatchKinds, classify_patches, extraordinary_nets, regular_nets, ring_index
from ...surface.refinement import Refinement
from ...surface.squares import Squares
from ...surface.stencils import by_valence, patch_stencils
from ..quadtree import NONE

TO_BERNSTEIN = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN)


@dataclass(frozen=True)
class Pieces:
    """The surface over N squares. coefficients: (16, N, 3), Bernstein coefficients in the squares' parameters, of the
    surface itself or of a facet; near: (N,), how far the surface may be from that, 0 where it is the surface."""

    squares: Squares
    coefficients: FloatArray
    near: FloatArray

    def at(self, chosen: IndexArray) -> Pieces:
        """Some of them, by index."""
        return Pieces(self.squares.at(chosen), selected_vectors(self.coefficients, chosen), self.near[chosen])

    def and_then(self, other: Pieces) -> Pieces:
        """These, followed by others."""
        return Pieces(
            self.squares.and_then(other.squares),
            np.concatenate([self.coefficients, other.coefficients], axis=1),
            np.concatenate([self.near, other.near]),
        )


class _Parents(Protocol):
    """Squares whose surface is known well enough to find their children."""

    def children(self, chosen: IndexArray) -> _Found:
        """Those of some, by ascending index; four of each in the order of its corners."""


@dataclass(frozen=True)
class _Found:
    """Surfaces over N squares, as in ``Pieces``; and those that are not exact, with their indices."""

    coefficients: FloatArray
    near: FloatArray
    parents: list[tuple[_Parents, IndexArray]]

    @staticmethod
    def of(refinement: Refinement) -> _Found:
        """All descendants of a refinement, quads."""
        mesh, count = refinement.mesh, len(refinement.bases)
        patches = classify_patches(mesh)
        regular, extraordinary, rest = by_valence(mesh, patches, count)
        coefficients, near = facet_coefficients(refinement.control_facets()), np.zeros(count)
        coefficients[:, regular] = patch_coefficients(regular_nets(mesh, regular)).reshape(16, -1, 3)
        parents: list[tuple[_Parents, IndexArray]] = []
        for valence, faces in extraordinary:
            corners = patches.extraordinary_corners[faces]
            nets = extraordinary_nets(mesh, corners, valence)
            near[faces] = second_order_extraordinary(nets, Vertices.CONTROL).value
            parents.append((_Nets(nets, corners - mesh.face_starts[faces]), faces))
        if len(rest):
            near[rest] = _facet_distances(mesh, patches, rest)
            wanted = np.zeros(count, dtype=bool)
            wanted[rest] = True
            parents.append((_Meshed(refinement.keep(wanted)), rest))
        return _Found(coefficients, near, parents)


def _facet_distances(mesh: PolygonMesh, patches: PatchKinds, faces: IndexArray) -> FloatArray:
    """(faces,): upper bounds of the distance between the surface over quads and the facets over their control points.

    Of irregular ones, and of those with an extraordinary corner, by the norm there."""
    bounds = np.empty(len(faces))
    kinds, corners = patches.kinds[faces], patches.extraordinary_corners[faces]
    irregular = kinds == PatchKind.IRREGULAR
    if np.any(irregular):
        bounds[irregular] = support_bounds(mesh, Vertices.CONTROL)[faces[irregular]]
    extraordinary = np.flatnonzero(kinds == PatchKind.EXTRAORDINARY)
    valences = mesh.vertex_face_counts[mesh.corner_vertices[corners[extraordinary]]]
    for valence in np.unique(valences).tolist():
        chosen = extraordinary[valences == valence]
        nets = extraordinary_nets(mesh, corners[chosen], valence)
        bounds[chosen] = second_order_extraordinary(nets, Vertices.CONTROL).value
    return bounds


@dataclass(frozen=True)
class _Meshed:
    """By the refined mesh."""

    refinement: Refinement

    def children(self, chosen: IndexArray) -> _Found:
        """As in ``_Parents``."""
        wanted = np.zeros(len(self.refinement.bases), dtype=bool)
        wanted[chosen] = True
        return _Found.of(self.refinement.keep(wanted).refined())


@dataclass(frozen=True)
class _Nets:
    """By nets (2n + 8, P, 3) of one valence n around their corners ``slots`` (P,)."""

    nets: FloatArray
    slots: IndexArray

    def children(self, chosen: IndexArray) -> _Found:
        """As in ``_Parents``."""
        valence, nets = (len(self.nets) - 8) // 2, selected_vectors(self.nets, chosen)
        stencils = patch_stencils(valence)
        places = 4 * np.arange(len(chosen)) + (self.slots[chosen] + np.arange(4)[:, None]) % 4
        coefficients, near = np.empty((16, 4 * len(chosen), 3)), np.zeros(4 * len(chosen))
        for child in (1, 2, 3):
            matrix = TO_BERNSTEIN @ stencils.regular[16 * (child - 1) : 16 * child]
            coefficients[:, places[child]] = transformed_nets(matrix, nets)
        smaller = transformed_nets(stencils.refined, nets)
        facets = smaller[[0, *(ring_index(valence, number) for number in (6, 5, 4))]]
        coefficients[:, places[0]] = facet_coefficients(facets)
        near[places[0]] = second_order_extraordinary(smaller, Vertices.CONTROL).value
        return _Found(coefficients, near, [(_Nets(smaller, np.zeros_like(chosen)), places[0])])


@dataclass
class _Level:
    """What has been computed of one level. For each of its N squares, (N,) each: the number and the index in it of the
    parents that it is among, and its first child on the next level; NONE where there are none."""

    pieces: Pieces
    numbers: IndexArray
    places: IndexArray
    first_children: IndexArray
    parents: list[_Parents]

    @staticmethod
    def empty() -> _Level:
        nothing = np.zeros(0, dtype=np.intp)
        pieces = Pieces(Squares.whole(0), np.zeros((16, 0, 3)), np.zeros(0))
        return _Level(pieces, nothing, nothing, nothing, [])

    def append(self, found: _Found, squares: Squares) -> None:
        """Add surfaces over squares."""
        count = len(self.numbers)
        self.pieces = self.pieces.and_then(Pieces(squares, found.coefficients, found.near))
        nothing = np.full(len(found.near), NONE)
        self.numbers, self.places, self.first_children = (
            np.concatenate([own, nothing]) for own in (self.numbers, self.places, self.first_children)
        )
        for parents, indices in found.parents:
            self.numbers[count + indices] = len(self.parents)
            self.places[count + indices] = np.arange(len(indices))
            self.parents.append(parents)


class Descent:
    """The descendants of faces, level by level. A square is known by its level and its index there."""

    def __init__(self, refinement: Refinement, squares: Squares) -> None:
        """refinement: of the faces themselves; squares: those of all their children, face by face."""
        self._refinement, self._squares = refinement, squares
        self._first_children = np.full(len(refinement.bases), NONE)
        self._levels = [_Level.empty()]

    @staticmethod
    def of_quads(refinement: Refinement) -> Descent:
        """As parts of the quads, which are the bases."""
        return Descent(refinement, Squares.whole(len(refinement.bases)).children())

    @staticmethod
    def of_fans(refinement: Refinement) -> Descent:
        """As parts of the faces' quarters, which are the bases, face by face."""
        return Descent(refinement, Squares.whole(len(refinement.corner_vertices())))

    def start(self, faces: IndexArray) -> IndexArray:
        """The children of some faces, by ascending index: squares of level 0, face by face."""
        mesh = self._refinement.mesh
        sizes, starts = mesh.face_sizes[faces], mesh.face_starts[faces]
        new = self._first_children[faces] == NONE
        if np.any(new):
            wanted = np.zeros(len(self._first_children), dtype=bool)
            wanted[faces[new]] = True
            level, count = self._levels[0], len(self._levels[0].numbers)
            self._first_children[faces[new]] = count + np.cumsum(sizes[new]) - sizes[new]
            squares = self._squares.at(ranges(starts[new], sizes[new]))
            level.append(_Found.of(self._refinement.keep(wanted).refined()), squares)
        return ranges(self._first_children[faces], sizes)

    def pieces(self, level: int, indices: IndexArray) -> Pieces:
        """The surface over some squares of a level."""
        return self._levels[level].pieces.at(indices)

    def children(self, level: int, indices: IndexArray) -> IndexArray:
        """The four children of each of some squares of a level that are not exact, in order: squares of the next."""
        own = self._levels[level]
        new = indices[own.first_children[indices] == NONE]
        if len(new) and level + 1 == len(self._levels):
            self._levels.append(_Level.empty())
        for number in np.unique(own.numbers[new]).tolist():
            parents, following = own.parents[number], self._levels[level + 1]
            chosen = new[own.numbers[new] == number]
            chosen = chosen[np.argsort(own.places[chosen])]
            own.first_children[chosen] = len(following.numbers) + 4 * np.arange(len(chosen))
            following.append(parents.children(own.places[chosen]), own.pieces.squares.at(chosen).children())
        return (own.first_children[indices, None] + np.arange(4)).ravel()
