# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact evaluation of the limit surface at given points, for positions or any other values of the control vertices.

Only the descendants that contain a point are refined, until it lies on a spline patch or is an irregular vertex:

- on a regular face the values are those of the bicubic B-spline patch of its 4 × 4 net (``patches``);
- on an extraordinary face the net is refined by the matrices of ``stencils`` until the point lies in one of the three
  regular children (Stam, *Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values*, 1998);
- any other face is refined with its one-ring, and evaluation goes on with the child that contains the point.

A quarter of a face (``surface_points``) is its child after one step, with the same parameters. So a point's parameters
in a child are doubled ones, without rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..arrays.chunks import AT_ONCE, FEW_AT_ONCE, chunks
from ..arrays.masks import mask
from ..arrays.matrix_products import matrix_product
from ..arrays.tables import Table
from ..arrays.types import FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import submesh
from .catmull_clark import subdivide
from .limit_positions import limit_positions
from .patches import classify_patches, extraordinary_nets, regular_nets
from .stencils import by_valence, child_at_vertex, patch_stencils, regular_children, valence_of
from .surface_points import SurfacePoints


class Quantity(Protocol):
    """A quantity of the limit surface: K numbers at every point."""

    def on_splines(self, nets: FloatArray, which: IndexArray, parameters: FloatArray) -> FloatArray:
        """(P, K): on spline patches. nets (4, 4, F, D); which (P,) of them; parameters (P, 2), [0, 1] along i and j."""

    def at_extraordinary_vertices(self, nets: FloatArray) -> FloatArray:
        """(P, K): at the first point of extraordinary nets (2n + 8, P, D) in Stam's order."""

    def at_vertices(self, mesh: PolygonMesh, corners: IndexArray) -> FloatArray:
        """(P, K): at the vertices of corners (P,), seen from their faces; all faces around the vertices are there."""


def limit_values(mesh: PolygonMesh, values: FloatArray, points: SurfacePoints) -> FloatArray:
    """(N, D) float64: the limit of values (V, D) of the control vertices at points of the limit surface.

    mesh: with explicit sharpness (``sharpness.apply_boundary_rule``); its rules act on the values in place of its
    positions. The result is exact up to some units in the last place of the largest value for each level of descent.
    Parameters should be dyadic fractions; on irregular faces others are rounded to dyadic fractions.
    """
    surface = mesh.changed(positions=np.ascontiguousarray(values, dtype=np.float64))
    return evaluate(surface, points, _Values(), surface.positions.shape[1])


class _Values:
    """The values that stand in place of the control vertices' positions."""

    def on_splines(self, nets: FloatArray, which: IndexArray, parameters: FloatArray) -> FloatArray:
        return spline_sums(nets, which, spline_weights(parameters[:, 0]), spline_weights(parameters[:, 1]))

    def at_extraordinary_vertices(self, nets: FloatArray) -> FloatArray:
        return matrix_product(patch_stencils(valence_of(nets)).limits[:1], nets)[0]

    def at_vertices(self, mesh: PolygonMesh, corners: IndexArray) -> FloatArray:
        vertices = mesh.corner_vertices[corners]
        wanted = mask(mesh.vertex_count, vertices)
        return limit_positions(mesh, wanted)[vertices]


def spline_weights(parameters: FloatArray) -> FloatArray:
    """(4, P): the weights of four points in a row of the cubic B-spline over the middle two, at parameters (P,)."""
    t, s = parameters, 1 - parameters
    return np.stack([s * s * s, 4 - 3 * t * t * (1 + s), 4 - 3 * s * s * (1 + t), t * t * t]) / 6


def spline_sums(nets: FloatArray, which: IndexArray, along: FloatArray, across: FloatArray) -> FloatArray:
    """(P, D): tensor products of weights (4, P), for i and for j, with nets (4, 4, F, D), ``which`` (P,) of them."""
    # Each column contiguous: rows of two or three numbers are too short to be fast.
    columns = np.ascontiguousarray(np.moveaxis(nets, 3, 2))
    sums = np.empty((nets.shape[3], len(which)))
    for chunk in chunks(len(which), AT_ONCE):
        total = 0.0
        for j in range(4):
            row = sum(along[i, chunk] * columns[i, j].take(which[chunk], axis=1) for i in range(4))
            total += across[j, chunk] * row
        sums[:, chunk] = total
    return sums.T


def evaluate(mesh: PolygonMesh, points: SurfacePoints, quantity: Quantity, columns: int) -> FloatArray:
    """(N, columns) float64: a quantity of the limit surface at the points."""
    result = np.empty((len(points.corners), columns))
    # Depth first, so that few refined meshes are in memory together.
    lines: list[Iterator[_Pending]] = [iter([_Pending(mesh, points, np.arange(len(points.corners)))])]
    while lines:
        pending = next(lines[-1], None)
        if pending is None:
            lines.pop()
        else:
            lines.append(_settled(pending, quantity, result))
    return result


@dataclass(frozen=True)
class _Pending(Table):
    """Points on a mesh that are still to be evaluated. rows: (N,) intp, their rows in the result."""

    mesh: PolygonMesh
    points: SurfacePoints
    rows: IndexArray

    def faces(self) -> IndexArray:
        return self.mesh.corner_faces[self.points.corners]

    def corners_from(self, faces: IndexArray) -> IndexArray:
        """(N,) intp: the number of each point's corner in its face, from 0, given the faces (N,)."""
        return self.points.corners - self.mesh.face_starts[faces]


def _settled(pending: _Pending, quantity: Quantity, result: FloatArray) -> Iterator[_Pending]:
    """Put the values that this level gives into the result, and yield the other points on refined meshes."""
    mesh, faces = pending.mesh, pending.faces()
    regular, extraordinary, rest = by_valence(mesh, faces, classify_patches(mesh))
    at_vertex = rest & ~pending.points.parameters.any(axis=1)
    _put_on_regular(pending, regular, quantity, result)
    for valence, chosen, corners in extraordinary:
        _put_on_extraordinary(pending.at(chosen), corners, valence, quantity, result)
    _put_at_vertices(pending.at(at_vertex), quantity, result)
    return _refined(pending.at(rest & ~at_vertex))


def _put_on_regular(pending: _Pending, regular: IndexArray, quantity: Quantity, result: FloatArray) -> None:
    """regular: (n,) intp, which of the points lie on regular faces."""
    mesh = pending.mesh
    for faces, chosen, which in _by_faces(pending.faces()[regular], AT_ONCE):
        nets = regular_nets(mesh, faces)
        for chunk in chunks(len(chosen), AT_ONCE):
            part = pending.at(regular[chosen[chunk]])
            parameters = _in_face(part.corners_from(faces[which[chunk]]), part.points.parameters)
            result[part.rows] = quantity.on_splines(nets, which[chunk], parameters)


def _put_on_extraordinary(
    pending: _Pending, corners: IndexArray, valence: int, quantity: Quantity, result: FloatArray
) -> None:
    """corners: (N,) intp, the extraordinary corner of each point's face, all of one valence."""
    # With one extraordinary corner in each face, the corner identifies the face.
    for at_corners, chosen, which in _by_faces(corners, AT_ONCE):
        part = pending.at(chosen)
        turned = (part.points.corners - at_corners[which]) % 4
        nets = extraordinary_nets(pending.mesh, at_corners, valence)
        _descend(nets, which, SurfacePoints(turned, part.points.parameters), part.rows, quantity, result)


def _descend(
    nets: FloatArray, which: IndexArray, points: SurfacePoints, rows: IndexArray, quantity: Quantity, result: FloatArray
) -> None:
    """Descend through the children at the extraordinary vertex. The points' corners are counted from there."""
    while True:
        outer = np.flatnonzero(points.corners > 0)
        if len(outer):
            child = (points.corners[outer] - 1) * nets.shape[1] + which[outer]
            result[rows[outer]] = quantity.on_splines(regular_children(nets), child, points.parameters[outer])
        away = points.parameters.any(axis=1)
        centre = np.flatnonzero((points.corners == 0) & ~away)
        if len(centre):
            result[rows[centre]] = quantity.at_extraordinary_vertices(nets)[which[centre]]
        inner = np.flatnonzero((points.corners == 0) & away)
        if not len(inner):
            return
        kept, which = np.unique(which[inner], return_inverse=True)
        nets = child_at_vertex(nets[:, kept])
        rows, points = rows[inner], _in_quarters(points.parameters[inner])


def _put_at_vertices(pending: _Pending, quantity: Quantity, result: FloatArray) -> None:
    for faces, chosen, which in _by_faces(pending.faces(), FEW_AT_ONCE):
        part = pending.at(chosen)
        neighbourhood, _ = submesh(part.mesh, faces)
        corners = neighbourhood.face_starts[which] + part.corners_from(faces[which])
        result[part.rows] = quantity.at_vertices(neighbourhood, corners)


def _refined(pending: _Pending) -> Iterator[_Pending]:
    """The points on the children of their faces."""
    for faces, chosen, which in _by_faces(pending.faces(), FEW_AT_ONCE):
        part = pending.at(chosen)
        neighbourhood, _ = submesh(part.mesh, faces)
        children = neighbourhood.face_starts[which] + part.corners_from(faces[which])
        points = _in_quarters(part.points.parameters)
        on_children = SurfacePoints(4 * children + points.corners, points.parameters)
        yield _Pending(subdivide(neighbourhood), on_children, part.rows)


def _by_faces(faces: IndexArray, at_once: int) -> Iterator[tuple[IndexArray, IndexArray, IndexArray]]:
    """Points in chunks of faces, given the face of each: the faces of a chunk, the indices of the points on them, and
    for each point the index of its face in the chunk."""
    order = np.argsort(faces, kind="stable")
    ordered = faces[order]
    first = np.flatnonzero(np.diff(ordered, prepend=-1))
    ends = np.append(first, len(order))
    for start in range(0, len(first), at_once):
        chunk = ends[start : start + at_once + 1]
        which = np.repeat(np.arange(len(chunk) - 1), np.diff(chunk))
        yield ordered[chunk[:-1]], order[chunk[0] : chunk[-1]], which


def _in_face(corners: IndexArray, parameters: FloatArray) -> FloatArray:
    """(N, 2): parameters in the quarters of quads → in the quads, with corner 0 at (0, 0) and corner 1 at (1, 0)."""
    u, v = parameters.T / 2
    along = np.choose(corners, [u, 1 - v, 1 - u, v])
    across = np.choose(corners, [v, u, 1 - v, 1 - u])
    return np.stack([along, across], axis=1)


def _in_quarters(parameters: FloatArray) -> SurfacePoints:
    """The quarters with parameters (N, 2) in quads, by their corner, 0 to 3, and the parameters there."""
    u, v = parameters.T
    right, upper = u > 0.5, v > 0.5
    corners = np.where(upper, np.where(right, 2, 3), np.where(right, 1, 0))
    from_side, from_bottom = np.where(right, 1 - u, u), np.where(upper, 1 - v, v)
    swapped = right != upper
    along = np.where(swapped, from_bottom, from_side)
    across = np.where(swapped, from_side, from_bottom)
    return SurfacePoints(corners, 2 * np.stack([along, across], axis=1))
