# SPDX-License-Identifier: GPL-3.0-or-later
"""Stencils of extraordinary patches: every refined point is a fixed combination of the net's 2n + 8 points.

So is that of every quad inside the surface, whatever the valences of its corners, of the points of the faces around it.
The matrices come from one Catmull-Clark step of a patch whose vertices are the unit vectors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.types import FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh, polygon_mesh
from .catmull_clark import subdivide
from .limit_positions import limit_positions
from .patches import PatchKind, PatchKinds, extraordinary_nets, nets_inside, regular_nets, ring_index

# Computing the stencils of a valence takes time proportional to its cube; beyond this, refining the mesh is faster.
LARGEST_STENCIL_VALENCE = 64

# Matrices take the more memory the more points a net has: not more than for one corner of the largest valence.
MOST_POINTS = 2 * LARGEST_STENCIL_VALENCE + 8


def stencil_patch(valence: int) -> PolygonMesh:
    """The faces of an extraordinary net of 2n + 8 points, vertex i at the i-th unit vector.

    Every position of a refinement is then its stencil on the net. Face 0 is the facet, from its extraordinary vertex
    on.
    """
    n = valence

    def ring(number: int) -> int:
        return ring_index(n, number)

    o2, o3, o4, o5, o6, o7, o8 = range(2 * n + 1, 2 * n + 8)
    around = [[0, ring(2 * i + 2), ring(2 * i + 1), ring(2 * i)] for i in range(2, n + 2)]
    outer = [
        [ring(6), o4, o3, ring(5)],
        [ring(5), o3, o2, o6],
        [ring(4), ring(5), o6, o7],
        [ring(3), ring(4), o7, o8],
        [ring(7), o5, o4, ring(6)],
    ]
    corners = np.array(around + outer).reshape(-1)
    patch = polygon_mesh(np.eye(2 * n + 8), np.full(n + 5, 4), corners)
    # The border of the net is no boundary of the surface.
    return replace(patch, sharpness_is_explicit=True)


@dataclass(frozen=True)
class PatchStencils:
    """Matrices for the nets of one valence.

    refined: (2n + 8, 2n + 8), the net of the child at the extraordinary vertex. regular: (3 · 16, 2n + 8), the nets of
    the children at V₆, V₅ and V₄. limits: (4, 2n + 8), the limit positions of the facet's corners.
    """

    refined: FloatArray
    regular: FloatArray
    limits: FloatArray


@lru_cache(maxsize=64)
def patch_stencils(valence: int) -> PatchStencils:
    """The matrices for a valence of 3, 5 or more."""
    patch = stencil_patch(valence)
    children = subdivide(patch).mesh
    size = 2 * valence + 8
    return PatchStencils(
        refined=extraordinary_nets(children, np.array([0]), valence).reshape(size, size),
        regular=regular_nets(children, np.array([1, 2, 3])).reshape(16, 3, size).swapaxes(0, 1).reshape(48, size),
        limits=limit_positions(patch)[patch.corner_vertices[:4]],
    )


# The valences of a quad's corners, in order.
Valences = tuple[int, int, int, int]


@dataclass(frozen=True)
class QuadStencils:
    """Matrices for the nets (N points) of quads with corners of some valences.

    children: for the child at each corner, counted from there, (2n + 8, N) to its extraordinary net, or (16, N) to its
    regular net where n = 4. limits: (4, N), the limit positions of the corners.
    """

    children: Sequence[FloatArray]
    limits: FloatArray


def is_extraordinary(valences: Valences) -> bool:
    """Whether only the first corner is extraordinary: then nets are in Stam's order."""
    return valences[1:] == (4, 4, 4)


def quad_nets(mesh: PolygonMesh, corners: IndexArray, valences: Valences) -> FloatArray:
    """(2 Σn - 16, P, 3): the nets of quads with corners of some valences, from the given corners (P,) on."""
    return (
        extraordinary_nets(mesh, corners, valences[0])
        if is_extraordinary(valences)
        else nets_inside(mesh, corners, valences)
    )


@lru_cache(maxsize=256)
def quad_stencils(valences: Valences) -> QuadStencils:
    """The matrices for nets as ``quad_nets`` has them."""
    if is_extraordinary(valences):
        stencils = patch_stencils(valences[0])
        return QuadStencils([stencils.refined, *np.split(stencils.regular, 3)], stencils.limits)
    patch = _patch_inside(valences)
    mesh, size = subdivide(patch).mesh, patch.vertex_count
    children = [
        (
            regular_nets(mesh, np.array([child]))
            if valence == 4
            else extraordinary_nets(mesh, np.array([4 * child]), valence)
        ).reshape(-1, size)
        for child, valence in enumerate(valences)
    ]
    return QuadStencils(children, limit_positions(patch)[patch.corner_vertices[:4]])


def _patch_inside(valences: Valences) -> PolygonMesh:
    """The faces around a quad, face 0, vertex i at the i-th unit vector: the order is that of ``nets_inside``."""
    rings, count = [], 4
    for valence in valences:
        rings.append(list(range(count, count + 2 * valence - 5)))
        count += 2 * valence - 5
    faces = [[0, 1, 2, 3]]
    for corner, ring in enumerate(rings):
        following = (corner + 1) % 4
        faces.append([following, corner, ring[0], rings[following][-1]])
        faces += [[corner, ring[i], ring[i - 1], ring[i - 2]] for i in range(2, len(ring), 2)]
    patch = polygon_mesh(np.eye(count), np.full(len(faces), 4), np.array(faces).ravel())
    # The border of the net is no boundary of the surface.
    return replace(patch, sharpness_is_explicit=True)


def by_valences(
    mesh: PolygonMesh, kinds: PatchKinds, faces: IndexArray, least: int
) -> tuple[list[tuple[Valences, IndexArray]], IndexArray]:
    """Faces by the valences of their corners: where stencils are at hand, of nets of ``MOST_POINTS`` at most, and at
    least so many faces alike, the valences and the first corners (P,); and the rest."""
    inside = faces[kinds.inside[faces]]
    corners = mesh.face_starts[inside][:, None] + np.arange(4)
    valences = mesh.vertex_face_counts[mesh.corner_vertices[corners]]
    digits = (LARGEST_STENCIL_VALENCE + 1) ** np.arange(3, -1, -1)
    # Of the four ways to count the corners, the first with the largest number.
    turned = np.stack([np.roll(valences, -turn, axis=1) for turn in range(4)])
    turns = (turned @ digits).argmax(axis=0)
    valences, first = turned[turns, np.arange(len(inside))], corners[np.arange(len(inside)), turns]
    _, own, counts = np.unique(valences @ digits, return_inverse=True, return_counts=True)
    small = np.all(valences <= LARGEST_STENCIL_VALENCE, axis=1) & (2 * valences.sum(axis=1) - 16 <= MOST_POINTS)
    chosen = (counts[own] >= least) & small
    groups = [np.flatnonzero(own == key) for key in np.unique(own[chosen])]
    found = [((*valences[group[0]].tolist(),), first[group]) for group in groups]
    return found, np.setdiff1d(faces, inside[chosen])


def apply_stencils(stencils: FloatArray, nets: FloatArray) -> FloatArray:
    """(rows, P, 3): stencils (rows, N) applied to nets (N, P, 3)."""
    return matrix_product(stencils, nets.reshape(len(nets), -1)).reshape(len(stencils), *nets.shape[1:])


def by_valence(
    mesh: PolygonMesh, kinds: PatchKinds, count: int
) -> tuple[IndexArray, list[tuple[int, IndexArray]], IndexArray]:
    """The regular ones of the first faces; the extraordinary ones, where there are stencils, valence by valence; and
    the rest."""
    own = kinds.kinds[:count]
    extraordinary = np.flatnonzero(own == PatchKind.EXTRAORDINARY)
    valences = mesh.vertex_face_counts[mesh.corner_vertices[kinds.extraordinary_corners[extraordinary]]]
    small = valences <= LARGEST_STENCIL_VALENCE
    by_valence = [(n, extraordinary[valences == n]) for n in np.unique(valences[small]).tolist()]
    rest = np.sort(np.concatenate([np.flatnonzero(own == PatchKind.IRREGULAR), extraordinary[~small]]))
    return np.flatnonzero(own == PatchKind.REGULAR), by_valence, rest
