# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender object → control mesh: the polygon mesh whose Catmull-Clark surface is used (``modifiers``)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import (
    BoolArray,
    FloatArray,
    IndexArray,
    InvalidMeshError,
    PolygonMesh,
    apply_boundary_rule,
    largest_coordinates,
)
from .blender_arrays import products, read_built_in
from .evaluated import Evaluated, evaluated
from .mesh_arrays import CREASE_DOMAINS, mesh_arrays, mesh_face_count, own_mesh
from .modifiers import SIMULATIONS, SurfaceRule, counted_modifiers, is_evaluated, surface_rule

# The arrays that a mesh keeps when its vertices alone move.
TOPOLOGY = ("face_starts", "corner_vertices", "corner_edges", "edge_vertices", "edge_sharpness", "vertex_sharpness")

# The least scale of an object along any direction, as a fraction of the largest.
LEAST_STRETCH = 1e-6


class ControlMeshError(ValueError):
    """The error of an object whose control mesh cannot be read; the message gives the reason in a modeller's words."""


@dataclass(frozen=True, eq=False)
class ControlTopology:
    """The common part of control meshes that differ only in the positions of their vertices.

    arrays: one of these meshes, in object space; its sharpness is that of its creases alone. rule: of its surface.
    base_faces: (F,) intp, the origin of each face among the faces of the object's own mesh, or ``NO_ORIGIN``; None if
    both have the same faces.
    """

    arrays: PolygonMesh
    rule: SurfaceRule
    base_faces: IndexArray | None

    @cached_property
    def key(self) -> bytes:
        """A checksum, equal for equal topologies."""
        digest = blake2b(repr(self.rule).encode())
        faces = () if self.base_faces is None else (self.base_faces,)
        for values in (*(getattr(self.arrays, name) for name in TOPOLOGY), *faces):
            digest.update(f"{values.shape} {values.dtype}".encode())
            digest.update(np.ascontiguousarray(values).data)
        return digest.digest()

    @cached_property
    def mesh(self) -> PolygonMesh:
        """The mesh with its sharpness explicit."""
        return apply_boundary_rule(self.arrays, smooth_corners=self.rule.smooth_corners)


@dataclass(frozen=True, eq=False)
class ControlMesh:
    """The control mesh of an object.

    positions: (V, 3) float32, in object space, as Blender holds them; loose vertices may be anywhere, and not finite.
    world: (3, 3) float64, the linear part of the object's matrix.
    """

    topology: ControlTopology
    positions: NDArray[np.float32]
    world: FloatArray

    @classmethod
    def of(
        cls, arrays: PolygonMesh, rule: SurfaceRule, base_faces: IndexArray | None, world: FloatArray
    ) -> ControlMesh:
        """The control mesh of arrays. Raises InvalidMeshError without faces, and for faces and edges with missing
        vertices."""
        if arrays.face_count == 0:
            raise InvalidMeshError("the mesh has no faces")
        for vertices, what in ((arrays.corner_vertices, "corners of faces"), (arrays.edge_vertices, "ends of edges")):
            missing = np.count_nonzero((vertices < 0) | (vertices >= arrays.vertex_count))
            if missing:
                raise InvalidMeshError(f"{missing:,} {what} at vertices that the mesh does not have")
        return cls(ControlTopology(arrays, rule, base_faces), arrays.positions.astype(np.float32), world)

    @cached_property
    def key(self) -> bytes:
        """A checksum, equal for control meshes that are equal in object space, and come from the same faces."""
        return blake2b(self.topology.key + self.positions.tobytes()).digest()

    def with_known_arrays(self, known: dict[bytes, Any]) -> ControlMesh:
        """The control mesh with known arrays, by their checksums; its other arrays become known."""
        topology = known.setdefault(self.topology.key, self.topology)
        positions = known.setdefault(blake2b(self.positions.tobytes()).digest(), self.positions)
        return replace(self, topology=topology, positions=positions)

    @property
    def base_faces(self) -> IndexArray | None:
        """The base faces, as of ``ControlTopology``."""
        return self.topology.base_faces

    @property
    def mesh(self) -> PolygonMesh:
        """The mesh in object space, with its sharpness explicit; made anew each time, except data of the faces
        alone."""
        return self.topology.mesh.changed(positions=self.positions.astype(np.float64))

    @property
    def in_world(self) -> PolygonMesh:
        """The mesh with the object's rotation, scale and shear applied, and without its location."""
        # Positions that are not finite are found and refused later.
        with np.errstate(invalid="ignore"):
            mesh = self.mesh
            positions = products(mesh.positions, self.world)
            rounded = float(np.linalg.norm(np.abs(self.world) @ largest_coordinates(mesh)))
            return mesh.changed(positions=positions, rounded_size=rounded, axes=self.world)

    @property
    def face_count(self) -> int:
        return self.topology.arrays.face_count

    def faces_at(self, level: int) -> int:
        """The number of faces with all of the mesh subdivided a number of times."""
        return self.face_count if level == 0 else self.topology.arrays.corner_count * 4 ** (level - 1)

    def unturned(self) -> ControlMesh:
        """The control mesh as if the object were not turned, with all lengths as they are."""
        if not np.isfinite(self.world).all():
            return self
        _, stretches, right = np.linalg.svd(self.world)
        return replace(self, world=right.T * stretches @ right)

    def thickened(self) -> ControlMesh:
        """The control mesh with a scale of at least ``LEAST_STRETCH`` of the largest along every direction.

        No distance becomes shorter, and the matrix becomes invertible.
        """
        if not np.isfinite(self.world).all():
            return self
        left, stretches, right = np.linalg.svd(self.world)
        least = LEAST_STRETCH * stretches.max()
        if least == 0 or stretches.min() >= least:
            return self
        return replace(self, world=left * np.maximum(stretches, least) @ right)

    def diagonal(self) -> float:
        """The diagonal of the object's dimensions, as a length in the scene.

        Positions that are not finite are found and refused later.
        """
        return diagonal_of(self.positions.astype(np.float64), self.topology.arrays.vertex_face_counts > 0, self.world)


def own_diagonal(blender_object: bpy.types.Object) -> float:
    """The diagonal of an object whose control mesh is its own mesh, in Object Mode. Only positions and corners are
    read."""
    attributes = blender_object.data.attributes
    positions = read_built_in(attributes, "position", "vector", np.float32, 3)
    has_faces = np.zeros(len(positions), dtype=np.bool_)
    has_faces[read_built_in(attributes, ".corner_vert", "value", np.int32)] = True
    world = np.array(blender_object.matrix_world, dtype=np.float64)[:3, :3]
    return diagonal_of(positions.astype(np.float64), has_faces, world)


def diagonal_of(positions: FloatArray, has_faces: BoolArray, world: FloatArray) -> float:
    """The length of the diagonal of the box around the positions (V, 3) with has_faces (V,).

    The box lies along the object's axes; its eight corners are moved to the scene by world (3, 3), and the longest of
    its four diagonals counts. So turning the object changes nothing.
    """
    used = positions if np.all(has_faces) else positions[has_faces]
    if not len(used):
        return 0.0
    with np.errstate(invalid="ignore"):
        # One axis after another is much faster than all three together.
        x, y, z = (np.ptp(along) for along in used.T)
        diagonals = np.array([(x, y, z), (-x, y, z), (x, -y, z), (x, y, -z)]) @ world.T
    return float(np.linalg.norm(diagonals, axis=1).max())


def gram_matrix(world: FloatArray) -> FloatArray:
    """(3, 3): AᵀA, the lengths that the object gives to all vectors of its mesh, independent of its rotation."""
    return world.T @ world


# Control meshes by the session identifier of the mesh and the rule.
SharedMeshes = dict[tuple[int, SurfaceRule], ControlMesh]


def counted_copies(
    context: bpy.types.Context, objects: Iterable[bpy.types.Object], *, use_modifiers: bool
) -> AbstractContextManager[Evaluated]:
    """Copies of the present objects with their ``counted_modifiers``, for ``read``."""
    context.view_layer.update()
    return evaluated(context, {each: counted_modifiers(each, use_modifiers=use_modifiers) for each in objects})


def read(
    blender_object: bpy.types.Object, copies: Evaluated, *, use_modifiers: bool, shared: SharedMeshes | None = None
) -> ControlMesh:
    """The object's control mesh; in Edit Mode, of the edited mesh.

    copies: as of ``counted_copies``, of this object and others. shared: the meshes read so far, for other objects that
    use the same mesh. Raises ControlMeshError if something that cannot be counted shapes the control mesh, and
    InvalidMeshError for one without faces.
    """
    counted = counted_modifiers(blender_object, use_modifiers=use_modifiers)
    rule = surface_rule(blender_object)
    _refuse_crease_groups(blender_object, rule)
    _refuse_simulations(counted)
    world = np.array(blender_object.matrix_world, dtype=np.float64)[:3, :3]
    data = blender_object.data
    if is_evaluated(blender_object, counted):
        made, base_faces = copies.made(blender_object)
        arrays = mesh_arrays(made, rule)
        if not arrays.face_count and mesh_face_count(data):
            raise InvalidMeshError("its modifiers leave no faces of the mesh")
        return ControlMesh.of(arrays, rule, base_faces, world)
    shared = {} if shared is None else shared
    if (data.session_uid, rule) not in shared:
        with own_mesh(blender_object) as own:
            shared[data.session_uid, rule] = ControlMesh.of(mesh_arrays(own, rule), rule, None, world)
    return replace(shared[data.session_uid, rule], world=world)


def read_with_origins(
    blender_object: bpy.types.Object, copies: Evaluated, *, use_modifiers: bool, shared: SharedMeshes | None = None
) -> ControlMesh:
    """The control mesh, as of ``read``, with values for the faces of the object's own mesh. Raises ControlMeshError if
    the modifiers leave no trace of these."""
    control = read(blender_object, copies, use_modifiers=use_modifiers, shared=shared)
    loss = None if control.base_faces is None else copies.loss_of_faces(blender_object, control.base_faces)
    if loss is not None:
        raise ControlMeshError(
            f"the modifier {loss} of the mesh, so the mesh's own faces have no depths: apply the modifier, or turn "
            "Include Modifiers off"
        )
    return control


def read_alone(context: bpy.types.Context, blender_object: bpy.types.Object, *, use_modifiers: bool) -> ControlMesh:
    """``read_with_origins`` for one object, which Blender evaluates by itself."""
    with counted_copies(context, [blender_object], use_modifiers=use_modifiers) as copies:
        return read_with_origins(blender_object, copies, use_modifiers=use_modifiers)


def base_mesh(blender_object: bpy.types.Object, copies: Evaluated, *, use_modifiers: bool) -> bpy.types.Mesh:
    """The Blender mesh whose Catmull-Clark surface is used, with all its attributes, in Object Mode: the object's own,
    or with counted modifiers their mesh, which lasts as long as the copies."""
    if not counted_modifiers(blender_object, use_modifiers=use_modifiers):
        return blender_object.data
    mesh = copies.without_origins(blender_object)
    _copy_custom_properties(blender_object.data, mesh)
    return mesh


def _copy_custom_properties(source: bpy.types.Mesh, target: bpy.types.Mesh) -> None:
    """Copy the user's custom properties with their interface settings; evaluated meshes have none.

    Before Blender 5.0, properties of add-ons, which are RNA properties of the type, are among them.
    """
    for name in source.keys():  # noqa: SIM118
        if name in source.bl_rna.properties:
            continue
        value = source[name]
        target[name] = value.to_dict() if hasattr(value, "to_dict") else value
        with suppress(TypeError):  # Not every type has interface settings.
            target.id_properties_ui(name).update_from(source.id_properties_ui(name))


def _refuse_crease_groups(blender_object: bpy.types.Object, rule: SurfaceRule) -> None:
    """Raise ControlMeshError for vertex groups whose names make the modifier take creases from them."""
    for name in CREASE_DOMAINS if rule.use_creases else ():
        if name in blender_object.vertex_groups:
            raise ControlMeshError(
                f"it has a vertex group called “{name}”, which the Subdivision Surface modifier takes for creases; "
                "rename it"
            )


def _refuse_simulations(modifiers: Sequence[bpy.types.Modifier]) -> None:
    for modifier in modifiers:
        if modifier.type in SIMULATIONS:
            raise ControlMeshError(
                f"the modifier “{modifier.name}” is a simulation and cannot be included: apply it, or turn "
                "Include Modifiers off"
            )
