# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of Blender's own Subdivision Surface modifier, point by point of the base faces.

Each face of the base mesh carries its number, and its corners parameters (as UVs, which are interpolated linearly), so
that a point of one level finds its counterpart in another: the one of the same face at the same parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.blender import scene
from tests.brute_force import Levels, linear_children

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Level:
    """A subdivided mesh, of some of the base faces only. P polygons, C corners in order.

    sizes: (P,); faces: (C,) the base face each corner came from; parameters: (C, 2); points: (C, 3).
    """

    sizes: NDArray[np.int32]
    faces: NDArray[np.int64]
    parameters: FloatArray
    points: FloatArray

    def quads(self, values: FloatArray) -> FloatArray:
        """(Q, 4, D): the corners of the facets, for (C, D) values at the corners of the polygons.

        A face that is no quad is the fan of quads over corner, edge midpoint, centroid and edge midpoint. Where
        there is one, so are the quads, which does not change their facets.
        """
        if self.all_quads:
            return values.reshape(-1, 4, values.shape[1])
        starts = np.cumsum(self.sizes) - self.sizes
        after = np.arange(1, len(values) + 1)
        after[starts + self.sizes - 1] = starts
        before = np.argsort(after)
        centroids = np.add.reduceat(values, starts) / self.sizes[:, None]
        middles = (values + values[after]) / 2
        return np.stack([values, middles, np.repeat(centroids, self.sizes, axis=0), middles[before]], axis=1)

    @property
    def all_quads(self) -> bool:
        return bool(np.all(self.sizes == 4))

    @property
    def quad_faces(self) -> NDArray[np.int64]:
        """(Q,) the base face of each of them."""
        return self.faces[::4] if self.all_quads else self.faces


class Positions:
    """The points of a level by face and parameters."""

    def __init__(self, deep: Level, level: int) -> None:
        # Cells of an eighth of the spacing in a quad: below the least spacing in any polygon, above all rounding.
        self.cells = 2.0 ** (level + 3)
        self.keys, first = np.unique(self._keys(deep.faces, deep.parameters), return_index=True)
        self.points = deep.points[first]

    def _keys(self, faces: NDArray[np.int64], parameters: FloatArray) -> NDArray[np.int64]:
        cells = np.rint(self.cells * parameters).astype(np.int64) + 1
        return (faces << 42) + (cells[..., 0] << 21) + cells[..., 1]

    def at(self, faces: NDArray[np.int64], parameters: FloatArray) -> FloatArray:
        """(…, 3) for faces and (…, 2) parameters, all of which must be there, in the same cell or one beside it."""
        wanted = self._keys(faces, parameters).reshape(-1)
        places = np.full(wanted.shape, -1)
        for beside in (0, 1, -1):
            for above in (0, 1, -1):
                missing = np.flatnonzero(places < 0)
                keys = wanted[missing] + (above << 21) + beside
                found = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
                hit = self.keys[found] == keys
                places[missing[hit]] = found[hit]
        assert np.all(places >= 0)
        return self.points[places].reshape((*parameters.shape[:-1], 3))


def corner_parameters(size: int) -> FloatArray:
    """(size, 2): a unit square for quads, whose parameters are exact in binary; for others a regular polygon."""
    if size == 4:
        return np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    angles = 2 * np.pi * np.arange(size) / size
    return 1 + np.stack([np.cos(angles), np.sin(angles)], axis=1)


def part_of(data: meshes.MeshData, faces: NDArray[np.intp]) -> tuple[meshes.MeshData, NDArray[np.intp]]:
    """The faces and all that touch them, on which their surface depends, and the number of each in the whole mesh."""
    wanted = np.isin(np.arange(len(data.face_sizes)), faces)
    touched = np.zeros(len(data.positions), dtype=bool)
    touched[data.corner_vertices[np.repeat(wanted, data.face_sizes)]] = True
    near = np.logical_or.reduceat(touched[data.corner_vertices], np.cumsum(data.face_sizes) - data.face_sizes)
    part = meshes.MeshData(
        data.positions, data.face_sizes[near], data.corner_vertices[np.repeat(near, data.face_sizes)]
    )
    creases: meshes.EdgeCreases = {}
    if data.edge_creases:
        edges = {tuple(edge) for edge in part.edges.tolist()}
        creases = {ends: crease for ends, crease in data.edge_creases.items() if tuple(sorted(ends)) in edges}
    return replace(part, edge_creases=creases, vertex_creases=data.vertex_creases), np.flatnonzero(near)


def add_part(data: meshes.MeshData, numbers: NDArray[np.intp]) -> bpy.types.Object:
    """An object of it whose faces carry their numbers, and their corners the parameters."""
    added = scene.add_object(data)
    added.data.attributes.new("base_face", "INT", "FACE").data.foreach_set("value", numbers.astype(np.int32))
    uvs = np.concatenate([corner_parameters(size) for size in data.face_sizes.tolist()])
    added.data.uv_layers.new(name="Parameters")
    added.data.uv_layers["Parameters"].uv.foreach_set("vector", uvs.reshape(-1).astype(np.float32))
    return added


def level_of(part: bpy.types.Object, level: int, faces: NDArray[np.intp]) -> Level:
    """The given base faces of an object after so many levels of its modifier."""
    part.modifiers[0].levels = level
    evaluated = part.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    bases = np.zeros(len(mesh.polygons), dtype=np.int32)
    mesh.attributes["base_face"].data.foreach_get("value", bases)
    sizes = np.zeros(len(mesh.polygons), dtype=np.int32)
    mesh.polygons.foreach_get("loop_total", sizes)
    corners = np.zeros(len(mesh.loops), dtype=np.int32)
    mesh.attributes[".corner_vert"].data.foreach_get("value", corners)
    uvs = np.zeros(2 * len(mesh.loops), dtype=np.float32)
    mesh.uv_layers["Parameters"].uv.foreach_get("vector", uvs)
    positions = np.zeros(3 * len(mesh.vertices), dtype=np.float32)
    mesh.attributes["position"].data.foreach_get("vector", positions)
    evaluated.to_mesh_clear()
    wanted = np.isin(bases, faces)
    at = np.repeat(wanted, sizes)
    parameters = uvs.reshape(-1, 2)[at].astype(np.float64)
    points = positions.reshape(-1, 3)[corners[at]].astype(np.float64)
    return Level(sizes[wanted], np.repeat(bases, sizes)[at].astype(np.int64), parameters, points)


def rounding(data: meshes.MeshData, level: int) -> float:
    """Blender computes in single precision; each level rounds weights, products and sums, an ulp or so each."""
    return 3 * level * float(np.finfo(np.float32).eps * np.abs(data.positions).max())


class BlenderLevels(Levels):
    """The levels of a part of a mesh with Blender's own positions; only their order and limits come from the core.

    Limit positions are averages of a vertex and its neighbours in Blender's deepest level, which takes less of it than
    to go on subdividing.
    """

    def __init__(self, data: meshes.MeshData, boundary: str) -> None:
        self._data = data
        core = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=boundary == "ALL")
        super().__init__(core)
        self._numbers = np.arange(core.face_count)
        self._parameters = [np.concatenate([corner_parameters(size) for size in data.face_sizes.tolist()])]
        self._object = add_part(data, self._numbers)
        scene.add_subdivision(self._object, 1, boundary).uv_smooth = "NONE"
        self._points: dict[int, FloatArray] = {}

    def mesh(self, level: int) -> PolygonMesh:
        if level not in self._points:
            self._points[level] = self._positions(level)
        return replace(self.subdivided(level), positions=self._points[level])

    @property
    def object(self) -> bpy.types.Object:
        """The object whose one modifier makes the levels."""
        return self._object

    def shown(self, level: int) -> FloatArray:
        """(V, 3): what the modifier makes of a level as it is set now, in the core's order."""
        return self._positions(level)

    def _positions(self, level: int) -> FloatArray:
        order = self.subdivided(level)
        while len(self._parameters) <= level:
            finer = self.subdivided(len(self._parameters) - 1)
            self._parameters.append(linear_children(finer, self._parameters[-1]))
        _, corners = np.unique(order.corner_vertices, return_index=True)
        faces = np.repeat(self._numbers, np.diff(self.subdivided(0).face_starts) * 4**level)
        if not level:
            return self._data.positions
        found = Positions(level_of(self._object, level, self._numbers), level)
        positions = order.positions.copy()
        positions[order.corner_vertices[corners]] = found.at(faces[corners], self._parameters[level][corners])
        return positions

    def remove(self) -> None:
        """Take the part out of Blender again."""
        bpy.data.meshes.remove(self._object.data)
