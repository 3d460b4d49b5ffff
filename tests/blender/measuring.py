# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of Blender's own Subdivision Surface modifier, point by point of the base faces.

Each face of the base mesh carries its number, and its corners parameters (as UVs, which are interpolated linearly), so
that a point of one level finds its counterpart in another: the one of the same face at the same parameters.
"""

from dataclasses import replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from tests import meshes
from tests.blender import scene
from tests.brute_force import Levels, linear_children


class Positions:
    """The points of a level by face and parameters."""

    def __init__(self, faces: NDArray[np.int64], parameters: FloatArray, points: FloatArray, level: int) -> None:
        """Of all corners (C,): the base face each came from, its parameters (C, 2) there, and points (C, 3)."""
        # Cells of an eighth of the spacing in a quad: below the least spacing in any polygon, above all rounding.
        self.cells = 2.0 ** (level + 3)
        self.keys, first = np.unique(self._keys(faces, parameters), return_index=True)
        self.points = points[first]

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


def level_of(part: bpy.types.Object, level: int) -> Positions:
    """An object of a part after so many levels of its modifier."""
    part.modifiers[0].levels = level
    evaluated = part.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    bases, corners = scene.read(mesh, "base_face")[:, 0], scene.read(mesh, ".corner_vert")[:, 0]
    uvs, positions = (scene.read(mesh, name).astype(np.float64) for name in ("Parameters", "position"))
    evaluated.to_mesh_clear()
    faces = np.repeat(bases, len(corners) // len(bases)).astype(np.int64)
    return Positions(faces, uvs, positions[corners], level)


def quad_count(data: meshes.MeshData, level: int) -> int:
    """How many quads a mesh has at a level from 1 on."""
    return int(data.face_sizes.sum()) * 4 ** (level - 1)


def rounding(positions: FloatArray, level: int) -> float:
    """Blender computes in single precision; each level rounds weights, products and sums, an ulp or so each."""
    return 3 * level * float(np.finfo(np.float32).eps * np.abs(positions).max())


class BlenderLevels(Levels):
    """The levels of a part of a mesh with Blender's own positions; only their order and limits come from the core.

    Limit positions are averages of a vertex and its neighbours in Blender's deepest level, which takes less of it than
    to go on subdividing.
    """

    def __init__(self, data: meshes.MeshData, boundary: str) -> None:
        self._data = data
        core = meshes.build(data, smooth_corners=boundary == "ALL")
        super().__init__(core)
        self._numbers = np.arange(core.face_count)
        self._parameters = [np.concatenate([corner_parameters(size) for size in data.face_sizes.tolist()])]
        # Its faces carry their numbers, and their corners the parameters; its one modifier makes the levels.
        self.object = scene.add_object(data)
        scene.write(self.object.data, "base_face", "INT", "FACE", self._numbers)
        uvs = self._parameters[0].astype(np.float32)
        self.object.data.uv_layers.new(name="Parameters").uv.foreach_set("vector", uvs.ravel())
        scene.add_subdivision(self.object, 1, boundary).uv_smooth = "NONE"
        self._points: dict[int, FloatArray] = {}

    def mesh(self, level: int) -> PolygonMesh:
        if level not in self._points:
            self._points[level] = self.shown(level)
        return replace(self.subdivided(level), positions=self._points[level])

    def shown(self, level: int) -> FloatArray:
        """(V, 3): what the modifier makes of a level as it is set now, in the core's order."""
        order = self.subdivided(level)
        while len(self._parameters) <= level:
            finer = self.subdivided(len(self._parameters) - 1)
            self._parameters.append(linear_children(finer, self._parameters[-1]))
        _, corners = np.unique(order.corner_vertices, return_index=True)
        faces = np.repeat(self._numbers, np.diff(self.subdivided(0).face_starts) * 4**level)
        if not level:
            return self._data.positions
        found = level_of(self.object, level)
        positions = order.positions.copy()
        positions[order.corner_vertices[corners]] = found.at(faces[corners], self._parameters[level][corners])
        return positions

    def remove(self) -> None:
        """Take the part out of Blender again."""
        bpy.data.meshes.remove(self.object.data)
