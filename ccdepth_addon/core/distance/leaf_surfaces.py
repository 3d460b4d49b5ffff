# SPDX-License-Identifier: GPL-3.0-or-later
"""The surface over a level's quads as tiles: bicubic tiles over squares of their parameters, and hulls of the rest.

A regular quad is one tile. Around an extraordinary vertex each level of subdivision adds three tiles; the rest after
some levels lies in the hull of its control points, as limit points are averages of control points. A quad of any other
kind is refined into parts of these two kinds; the rest lies in the hull of the control points around.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.ranges import ranges
from ..arrays.tables import Table
from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import cross_products
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import corners_of_faces
from ..surface.bicubic import NET_TO_BERNSTEIN
from ..surface.patches import classify_patches, extraordinary_nets, regular_nets
from ..surface.refinement import Refinement
from ..surface.squares import SQUARE, TURNS, Squares
from ..surface.stencils import (
    LARGEST_STENCIL_VALENCE,
    by_valence,
    child_at_vertex,
    regular_children,
    valence_of,
)

# The rest at an extraordinary vertex shrinks by 0.41 a level for valence 3, and by up to 0.68 for other valences: more
# levels than these are beyond double precision.
MOST_LEVELS_3, MOST_REFINED_LEVELS = 8, 14

# The least number of points of a hull: fewer would be taken for coefficients.
LEAST_OF_HULLS = 5

# The corners of a box, each by its end along every axis.
BOX_CORNERS = np.array(list(product((0, 1), repeat=3)))


@dataclass(frozen=True)
class Tiles(Table, points=-2):
    """P parts of the surface over squares of quads' parameters. points: (R, P, 3), 16 Bernstein coefficients, or any
    points whose hull holds the part. are_bicubic: whether the points are coefficients."""

    squares: Squares
    points: FloatArray
    are_bicubic: bool = True


def tiles_of(refinement: Refinement, levels: int) -> Iterator[Tiles]:
    """The tiles of a refinement's quads; the squares' bases are indices of the quads. levels: the largest number of
    levels of tiles around extraordinary vertices, and of refinement."""
    squares = Squares.whole(len(refinement.bases))
    last_level = min(levels, MOST_REFINED_LEVELS)
    for level in range(last_level + 1):
        mesh, is_last = refinement.mesh, level == last_level
        regular, extraordinary, rest = by_valence(mesh, np.arange(len(refinement.bases)), classify_patches(mesh))
        if len(regular):
            nets = regular_nets(mesh, regular).reshape(16, -1, 3)
            yield Tiles(squares.at(regular), matrix_product(NET_TO_BERNSTEIN, nets))
        for valence, chosen, corners in extraordinary:
            nets, own = extraordinary_nets(mesh, corners, valence), _from_corners(squares.at(chosen), corners % 4)
            yield from _tiles_around_vertex(nets, own, 0 if is_last else levels)
        others = np.flatnonzero(rest)
        if not len(others):
            return
        if is_last:
            yield Tiles(squares.at(others), support_points(mesh, others), are_bicubic=False)
            return
        refinement, squares = refinement.keep(rest).refined(), squares.at(others).children()


def support_points(mesh: PolygonMesh, faces: IndexArray) -> FloatArray:
    """(R, P, 3): points whose hull holds the surface over each face: the control points of all faces that touch the
    face, or at vertices of large valence the corners of a box around these points. Shorter lists are padded by
    repeating a point."""
    order = np.argsort(mesh.corner_vertices, kind="stable")
    counts = mesh.vertex_face_counts
    starts = np.cumsum(counts) - counts
    own = corners_of_faces(mesh, faces)
    at, owners = mesh.corner_vertices[own], np.repeat(np.arange(len(faces)), mesh.face_sizes[faces])
    is_large = counts[at] > LARGEST_STENCIL_VALENCE
    large, which = np.unique(at[is_large], return_inverse=True)
    positions = np.concatenate([mesh.positions, *(_box_around(mesh, order[starts[v] :][: counts[v]]) for v in large)])
    of_boxes = mesh.vertex_count + 8 * which.reshape(-1)[:, None] + np.arange(8)
    owners_of_boxes = np.repeat(owners[is_large], 8)
    at, owners = at[~is_large], owners[~is_large]
    around = mesh.corner_faces[order[ranges(starts[at], counts[at])]]
    owners = np.repeat(np.repeat(owners, counts[at]), mesh.face_sizes[around])
    vertices = mesh.corner_vertices[corners_of_faces(mesh, around)]
    owners, vertices = np.append(owners, owners_of_boxes), np.append(vertices, of_boxes.ravel())
    owners, vertices = np.divmod(np.unique(owners * len(positions) + vertices), len(positions))
    sizes = np.bincount(owners, minlength=len(faces))
    first = np.cumsum(sizes) - sizes
    places = first + np.minimum(np.arange(max(sizes.max(), LEAST_OF_HULLS))[:, None], sizes - 1)
    return positions[vertices[places]]


def _box_around(mesh: PolygonMesh, corners: IndexArray) -> FloatArray:
    """(8, 3): the corners of a box that holds all faces at one vertex, by their corners there, along their mean
    normal."""
    at_corners = mesh.positions[mesh.corner_vertices]
    origin = at_corners[corners[0]]
    following, before = (at_corners[each[corners]] - origin for each in (mesh.next_corner, mesh.previous_corner))
    normal = cross_products(following, before).sum(axis=0)
    frame, _ = np.linalg.qr(np.column_stack([normal, np.eye(3)]))
    along = (at_corners[corners_of_faces(mesh, mesh.corner_faces[corners])] - origin) @ frame
    ends = np.stack([along.min(axis=0), along.max(axis=0)])
    found: FloatArray = origin + ends[BOX_CORNERS, np.arange(3)] @ frame.T
    return found


def _from_corners(squares: Squares, corners: IndexArray) -> Squares:
    """The squares with other corners (P,) as corner 0."""
    origins = squares.origins + np.einsum("pi,pij->pj", SQUARE[corners], squares.axes)
    return Squares(squares.bases, origins, TURNS[corners] @ squares.axes)


def _tiles_around_vertex(nets: FloatArray, squares: Squares, levels: int) -> Iterator[Tiles]:
    """The tiles of nets (2n + 8, P, 3) around extraordinary vertices at corners 0 of the squares."""
    for _ in range(min(levels, MOST_LEVELS_3) if valence_of(nets) == 3 else levels):
        children, first = squares.children(), 4 * np.arange(nets.shape[1])
        own = children.at((first + np.arange(1, 4)[:, None]).ravel())
        yield Tiles(own, matrix_product(NET_TO_BERNSTEIN, regular_children(nets).reshape(16, -1, 3)))
        nets, squares = child_at_vertex(nets), children.at(first)
    yield Tiles(squares, nets, are_bicubic=False)
