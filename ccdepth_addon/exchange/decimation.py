# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's Decimate modifier: copies of a mesh with fewer and fewer triangles, each made of the one before."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from ..core import BoolArray, FloatArray, Places, ShortIndexArray, TriangleMesh
from .blender_arrays import TYPES, products, read_built_in, read_values, write_values
from .custom_normals import smooth_faces
from .data_blocks import as_bmesh, meshes_with, own_copy, unused_name
from .feature_lines import border_edges, changes_along_lines, line_edges, thin_lines

# The tolerance in Decimate's coordinates: Decimate judges flatness by lengths in the unit of the coordinates.
TOLERANCE = 0.01

# The largest distance by which lines may move, as a part of the tolerance; the faces beside them need the rest.
PART_FOR_LINES = 0.5

# Values on the right side of a line leave the range around their vertex by no more than this part of it, mostly.
WIDENED = 0.1

# The weight of vertices that Decimate may move; edges at vertices of weight 0 it leaves alone.
MAY_MOVE = 1.0


class Decimation:
    """A mesh that is reduced step by step, along with all its attributes and vertex groups.

    Decimate works in the scene's proportions. Intermediate meshes are data-blocks. Each is removed once it is neither
    the first, the current, the attempted nor the kept mesh; ``remove`` removes these as well.
    """

    def __init__(self, mesh: bpy.types.Mesh, world: FloatArray, tolerance: float) -> None:
        """mesh: without shape keys; not changed. world: (3, 3), its object's matrix, invertible. tolerance: a length in
        the scene."""
        self._world = world
        positions = _positions(mesh)
        # Loose vertices may be anywhere.
        used = positions[np.unique(read_built_in(mesh.attributes, ".corner_vert", "value", np.int32))]
        self._middle = (used.min(axis=0) + used.max(axis=0)) / 2
        self._to_decimate = world * (TOLERANCE / tolerance)
        self._uids = dict.fromkeys(("start", "current", "attempt", "kept"), 0)
        scratch = own_copy(mesh)
        try:
            moved = (positions - self._middle) @ self._to_decimate.T
            write_values(scratch.attributes["position"].data, "vector", moved.astype(np.float32))
            self._uids["start"] = self._uids["current"] = _made_by(scratch, lambda holder: None).session_uid
        finally:
            bpy.data.meshes.remove(scratch)

    def current(self) -> TriangleMesh:
        """The triangles that the next attempt begins with, in the scene."""
        return self._triangles(self._mesh("current"))

    def lines(self) -> ShortIndexArray:
        """(L, 2): the vertices of edges on lines of the current mesh, unknown to Decimate."""
        return line_edges(self._mesh("current"))

    def borders(self) -> ShortIndexArray:
        """(B, 2): the vertices of edges at the border of the current mesh, where Decimate leaves more vertices than
        needed."""
        return border_edges(self._mesh("current"))

    def attempt_thinner(self, lines: ShortIndexArray, may_go: BoolArray) -> TriangleMesh:
        """The current mesh with fewer vertices on its lines, in the scene. may_go: (V,), the vertices that may be
        removed."""
        self._let("attempt", 0)
        thinned = own_copy(self._mesh("current"))
        self._let("attempt", thinned.session_uid)
        thin_lines(thinned, lines, may_go, PART_FOR_LINES * TOLERANCE)
        return self._triangles(thinned)

    def attempt(self, triangles: int, is_fixed: BoolArray) -> TriangleMesh:
        """The current mesh, merged to a number of triangles, in the scene. is_fixed: (V,), the vertices that must
        stay."""
        self._let("attempt", 0)
        mesh = self._mesh("current")

        def decimate(holder: bpy.types.Object) -> None:
            modifier = holder.modifiers.new("Decimate", "DECIMATE")
            modifier.ratio = triangles / len(mesh.polygons)
            modifier.use_collapse_triangulate = True
            if is_fixed.any():
                names = {*holder.vertex_groups.keys(), *mesh.attributes.keys()}
                group = holder.vertex_groups.new(name=unused_name("ccdepth_may_move", names))
                group.add(np.flatnonzero(~is_fixed).tolist(), MAY_MOVE, "REPLACE")
                modifier.vertex_group = group.name

        self._let("attempt", _made_by(mesh, decimate).session_uid)
        return self._triangles(self._mesh("attempt"))

    def accept(self, *, keep: bool) -> None:
        """Make the last attempt the current mesh. keep: whether ``write`` writes it, too."""
        self._let("current", self._uids["attempt"])
        if keep:
            self.keep()

    def keep(self) -> None:
        """Make the current mesh the kept mesh, for ``write``."""
        self._let("kept", self._uids["current"])

    def write(self, mesh: bpy.types.Mesh, places: Places) -> None:
        """Give a mesh the geometry, attributes and groups of the kept mesh, in object space. places: of its vertices on
        the first mesh."""
        kept = self._mesh("kept")
        names = set(mesh.attributes.keys())
        write_values(kept.attributes["position"].data, "vector", self._stored(kept))
        with as_bmesh(kept, mesh):
            pass
        _interpolate_at(places, self._mesh("start"), mesh)
        # Selections that BMesh adds.
        for name in [name for name in mesh.attributes.keys() if name.startswith(".") and name not in names]:  # noqa: SIM118
            if ".select" in name or ".uv_select" in name:
                mesh.attributes.remove(mesh.attributes[name])
        mesh.update()

    def remove(self) -> None:
        """Remove the remaining intermediate meshes."""
        for role in self._uids:
            self._let(role, 0)

    def _stored(self, mesh: bpy.types.Mesh) -> FloatArray:
        """(V, 3) float32: the stored positions in object space."""
        positions = _positions(mesh) @ np.linalg.inv(self._to_decimate).T + self._middle
        return positions.astype(np.float32)

    def _triangles(self, mesh: bpy.types.Mesh) -> TriangleMesh:
        positions = products(self._stored(mesh).astype(np.float64), self._world)
        corners = read_built_in(mesh.attributes, ".corner_vert", "value", np.int32).reshape(-1, 3)
        return TriangleMesh(positions, corners.astype(np.intp), smooth_faces(mesh))

    def _mesh(self, role: str) -> bpy.types.Mesh:
        return meshes_with([self._uids[role]])[0]

    def _let(self, role: str, uid: int) -> None:
        """Give a role to the mesh with this session identifier, or to none; a mesh without any role left is removed."""
        before, self._uids[role] = self._uids[role], uid
        if before not in self._uids.values():
            bpy.data.batch_remove(meshes_with([before]))


def _interpolate_at(places: Places, source: bpy.types.Mesh, mesh: bpy.types.Mesh) -> None:
    """Write UV maps and colours at the corners around the vertices of a mesh, from the triangles of another.

    Decimate interpolates values along merged edges, and moves vertices off these edges: textures would slide. Vertices
    on lines have not moved, and keep their values. A place beside a line may belong to the other side, and counts only
    if its values are about those of Decimate around the vertex.
    """
    triangles = read_built_in(source.attributes, ".corner_vert", "value", np.int32).reshape(-1, 3)
    beside_lines = np.zeros(len(source.vertices), dtype=bool)
    beside_lines[line_edges(source)] = True
    is_sure = ~beside_lines[triangles].any(axis=1)[places.triangles]
    moved = places.triangles >= 0
    moved[line_edges(mesh)] = False
    vertices = read_built_in(mesh.attributes, ".corner_vert", "value", np.int32)
    corners = np.flatnonzero(moved[vertices])
    around = vertices[corners]
    weights, which = places.weights[around], places.triangles[around]
    for attribute in mesh.attributes:
        if not changes_along_lines(attribute):
            continue
        kind = TYPES[attribute.data_type]
        known = read_values(source.attributes[attribute.name].data, kind.value, kind.dtype, kind.width)
        values = read_values(attribute.data, kind.value, kind.dtype, kind.width)
        found = np.einsum("ck,ckd->cd", weights, known.reshape(len(triangles), 3, -1)[which])
        low, high = _ranges_around(vertices, values, len(mesh.vertices))
        chosen = is_sure[around] | ((found >= low[around]) & (found <= high[around])).all(axis=1)
        values[corners[chosen]] = found[chosen]
        write_values(attribute.data, kind.value, values, kind.step)


def _ranges_around(vertices: ShortIndexArray, values: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """(V, d) twice: the ranges of the values of the triangles around each vertex, widened. vertices, values: (3T,) and
    (3T, d), at the corners of triangles."""
    of_triangles = values.reshape(len(vertices) // 3, 3, -1)
    low = np.full((count, of_triangles.shape[2]), np.inf)
    high = -low
    for corner in vertices.reshape(-1, 3).T:
        np.minimum.at(low, corner, of_triangles.min(axis=1))
        np.maximum.at(high, corner, of_triangles.max(axis=1))
    more = WIDENED * (high - low)
    return low - more, high + more


def _positions(mesh: bpy.types.Mesh) -> FloatArray:
    return read_built_in(mesh.attributes, "position", "vector", np.float32, 3).astype(np.float64)


def _made_by(mesh: bpy.types.Mesh, add_modifier: Callable[[bpy.types.Object], None]) -> bpy.types.Mesh:
    """A new mesh of triangles, made by a modifier, with all data of the mesh; in a scene of its own, as other scenes
    may be large."""
    holder = bpy.data.objects.new(mesh.name, mesh)
    scene = bpy.data.scenes.new(mesh.name)
    groups = len(holder.vertex_groups)
    try:
        scene.collection.objects.link(holder)
        if any(read_values(mesh.polygons, "loop_total", np.int32) != 3):
            # As drawn: along shorter diagonals two quads around a vertex with two edges may become one triangle twice.
            holder.modifiers.new("Triangulate", "TRIANGULATE").quad_method = "FIXED"
        add_modifier(holder)
        layer = scene.view_layers[0]
        layer.update()
        made = bpy.data.meshes.new_from_object(
            holder.evaluated_get(layer.depsgraph), preserve_all_data_layers=True, depsgraph=layer.depsgraph
        )
        _remove_groups(holder, groups)
        holder.data = made
        _remove_groups(holder, groups)
    finally:
        bpy.data.batch_remove([holder, scene])
    return made


def _remove_groups(holder: bpy.types.Object, kept: int) -> None:
    """Remove all vertex groups but the first ones."""
    for group in list(holder.vertex_groups)[kept:]:
        holder.vertex_groups.remove(group)
