# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender object → control mesh: the polygon mesh whose Catmull-Clark surface is meant.

That is the surface the object's Subdivision Surface modifier makes at its place in the stack. With several such
modifiers it is the first of type Catmull-Clark that shows in the viewport, or else the first of that type; one of type
Simple is a modifier like any other. Without one, all modifiers that show in the viewport stand above it, and its
settings are the modifier's defaults.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .core.catmull_clark import apply_boundary_rule, crease_to_sharpness
from .core.mesh import FloatArray, IndexArray, InvalidMeshError, PolygonMesh
from .writing import own_copy, write_values

ORIGIN_ATTRIBUTE = "ccdepth_origin"
EDGE_CREASE, VERTEX_CREASE = "crease_edge", "crease_vert"
CREASE_DOMAINS = {EDGE_CREASE: "EDGE", VERTEX_CREASE: "POINT"}
NO_ORIGIN = -1

# The second number of an origin is the square of the first modulo this prime. A modifier that averages the origins of
# several faces makes a pair that does not fit, and its faces are known to come from no one face.
ORIGIN_PRIME = 2**31 - 1

# Objects are taken to be at least so thick, in parts of what they are stretched to at most.
LEAST_STRETCH = 1e-6

# These take faces away. What others lose, they have merged into faces that count for one of their origins only.
TAKING_FACES_AWAY = {"BOOLEAN", "BUILD", "MASK", "NODES", "WELD"}

# These stand in the stack and leave the mesh as it is.
NOT_SHAPING = {"COLLISION", "PARTICLE_SYSTEM"}

# Their result is kept with the object itself, and a copy of it has none.
SIMULATIONS = {"CLOTH", "EXPLODE", "FLUID", "SOFT_BODY"}


class ControlMeshError(ValueError):
    """The object has no control mesh that could be read; the message says why in a modeller's words."""


@dataclass(frozen=True)
class SurfaceRule:
    """The settings of a Subdivision Surface modifier that decide its surface; here, its defaults."""

    smooth_corners: bool = True
    use_creases: bool = True


@dataclass(frozen=True, eq=False)
class MeshAsRead:
    """A mesh in object space, its sharpness that of its creases alone, and the rule its surface is meant by."""

    arrays: PolygonMesh
    rule: SurfaceRule

    @cached_property
    def mesh(self) -> PolygonMesh:
        """The same with its sharpness explicit."""
        return apply_boundary_rule(self.arrays, smooth_corners=self.rule.smooth_corners)


@dataclass(frozen=True)
class ControlMesh:
    """The control mesh of an object.

    read: the mesh in object space. base_faces: (F,) intp, the face of the object's own mesh that each face comes from,
    ``NO_ORIGIN`` for none; None when they are the same faces. world: (3, 3) float64, the linear part of the object's
    matrix.
    """

    read: MeshAsRead
    base_faces: IndexArray | None
    world: FloatArray

    @property
    def mesh(self) -> PolygonMesh:
        """In object space, with its sharpness explicit."""
        return self.read.mesh

    @cached_property
    def in_world(self) -> PolygonMesh:
        """The mesh with the object's rotation, scale and shear applied, and without its location."""
        # Positions that are not finite are found and refused later.
        with np.errstate(invalid="ignore"):
            x, y, z = self.mesh.positions.T
            positions = np.empty_like(self.mesh.positions)
            for axis, weights in enumerate(self.world):
                positions[:, axis] = x * weights[0] + y * weights[1] + z * weights[2]
            return self.mesh.changed(positions=positions)

    def thickened(self) -> ControlMesh:
        """The same unless the object is scaled to nothing, or nearly, along some direction: then, to a little.

        That makes no distance shorter, and the scene tells again where the points of the mesh lie in object space.
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

        The box lies along the object's axes and holds every vertex that has a face; its eight corners are taken to the
        scene, and the longest of its four diagonals counts. So turning the object changes nothing.
        """
        has_faces = self.mesh.vertex_face_counts > 0
        used = self.mesh.positions if np.all(has_faces) else self.mesh.positions[has_faces]
        if not len(used):
            return 0.0
        # Positions that are not finite are found and refused later.
        with np.errstate(invalid="ignore"):
            # One axis after another is much faster than all three together.
            x, y, z = (np.ptp(along) for along in used.T)
            diagonals = np.array([(x, y, z), (-x, y, z), (x, -y, z), (x, y, -z)]) @ self.world.T
        return float(np.linalg.norm(diagonals, axis=1).max())


# By the session identifier of the mesh and the rule it was read with.
SharedMeshes = dict[tuple[int, SurfaceRule], MeshAsRead]


def subdivision_modifier(blender_object: bpy.types.Object) -> bpy.types.Modifier | None:
    """The modifier whose surface is meant, if there is one."""
    found = [
        modifier
        for modifier in blender_object.modifiers
        if modifier.type == "SUBSURF" and modifier.subdivision_type == "CATMULL_CLARK"
    ]
    return next((modifier for modifier in found if modifier.show_viewport), found[0] if found else None)


def surface_rule(blender_object: bpy.types.Object) -> SurfaceRule:
    """The rule of the object's Subdivision Surface modifier."""
    modifier = subdivision_modifier(blender_object)
    if modifier is None:
        return SurfaceRule()
    return SurfaceRule(smooth_corners=modifier.boundary_smooth == "ALL", use_creases=modifier.use_creases)


def counted_modifiers(blender_object: bpy.types.Object) -> list[bpy.types.Modifier]:
    """The modifiers above the Subdivision Surface modifier that show in the viewport."""
    last = subdivision_modifier(blender_object)
    counted = []
    for modifier in blender_object.modifiers:
        if last is not None and modifier.name == last.name:
            break
        if modifier.show_viewport:
            counted.append(modifier)
    return counted


def read_control_mesh(
    context: bpy.types.Context,
    blender_object: bpy.types.Object,
    *,
    use_modifiers: bool,
    shared: SharedMeshes | None = None,
) -> ControlMesh:
    """The object's control mesh; in Edit Mode, of the mesh as it is being edited.

    shared: the meshes read so far that other objects may use as well, to be read once only.
    Nothing of the file is changed. Raises ControlMeshError when its modifiers leave no trace of its faces, and
    InvalidMeshError when it has no faces.
    """
    depsgraph = context.evaluated_depsgraph_get()
    rule = surface_rule(blender_object)
    _refuse_crease_groups(blender_object, rule)
    counted = counted_modifiers(blender_object) if use_modifiers else []
    world = np.array(blender_object.evaluated_get(depsgraph).matrix_world, dtype=np.float64)[:3, :3]
    data = blender_object.data
    # What Edit Mode shows is the shape key being edited, and that is what it holds; elsewhere keys are mixed.
    if counted or (data.shape_keys is not None and not data.is_editmode):
        with own_mesh(blender_object) as own:
            mesh, base_faces = _read_evaluated(context, blender_object, own, [m.name for m in counted], rule)
        return ControlMesh(_with_faces(mesh, rule), base_faces, world)
    shared = {} if shared is None else shared
    if (data.session_uid, rule) not in shared:
        with own_mesh(blender_object) as own:
            shared[data.session_uid, rule] = _with_faces(mesh_arrays(own, rule), rule)
    return ControlMesh(shared[data.session_uid, rule], None, world)


def applied_modifiers(blender_object: bpy.types.Object, *, use_modifiers: bool) -> list[bpy.types.Modifier]:
    """The modifiers that a subdivision of the object's surface has in it: the Subdivision Surface modifier, and those
    that are counted in."""
    counted = counted_modifiers(blender_object) if use_modifiers else []
    subdivision = subdivision_modifier(blender_object)
    applied = [modifier for modifier in counted if modifier.type not in NOT_SHAPING]
    return applied if subdivision is None else [*applied, subdivision]


@contextmanager
def base_mesh(
    context: bpy.types.Context,
    blender_object: bpy.types.Object,
    *,
    use_modifiers: bool,
    shared: SharedMeshes | None = None,
) -> Iterator[tuple[bpy.types.Mesh, ControlMesh]]:
    """The Blender mesh whose Catmull-Clark surface is meant, with everything it carries, and its control mesh.

    In Object Mode. It is the object's own mesh, or where modifiers are counted in, a temporary one they have made.
    Unlike depths, a subdivision need not know which face of the object's own mesh each face comes from.
    """
    subdivision = subdivision_modifier(blender_object)
    applied = [m.name for m in applied_modifiers(blender_object, use_modifiers=use_modifiers) if m != subdivision]
    if not applied:
        control = read_control_mesh(context, blender_object, use_modifiers=False, shared=shared)
        yield blender_object.data, control
        return
    _refuse_crease_groups(blender_object, surface_rule(blender_object))
    _refuse_simulations(blender_object, applied)
    with frozen_copy(context, blender_object, blender_object.data, applied) as (copy, _):
        depsgraph = context.evaluated_depsgraph_get()
        evaluated = copy.evaluated_get(depsgraph)
        world = np.array(evaluated.matrix_world, dtype=np.float64)[:3, :3]
        mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=depsgraph)
    try:
        _copy_custom_properties(blender_object.data, mesh)
        rule = surface_rule(blender_object)
        yield mesh, ControlMesh(_with_faces(mesh_arrays(mesh, rule), rule), None, world)
    finally:
        bpy.data.meshes.remove(mesh)


def _copy_custom_properties(source: bpy.types.Mesh, target: bpy.types.Mesh) -> None:
    """Copy the properties that the user has made, with how they are shown; evaluated meshes have none.

    Before Blender 5.0 those of add-ons, which have their own names on the type, stand among them.
    """
    for name in source.keys():  # noqa: SIM118
        if name in source.bl_rna.properties:
            continue
        value = source[name]
        target[name] = value.to_dict() if hasattr(value, "to_dict") else value
        with suppress(TypeError):  # Not every type can be shown in another way.
            target.id_properties_ui(name).update_from(source.id_properties_ui(name))


def _with_faces(mesh: PolygonMesh, rule: SurfaceRule) -> MeshAsRead:
    if mesh.face_count == 0:
        raise InvalidMeshError("the mesh has no faces")
    return MeshAsRead(mesh, rule)


@contextmanager
def own_mesh(blender_object: bpy.types.Object) -> Iterator[bpy.types.Mesh]:
    """The object's mesh, or in Edit Mode a temporary copy of what is being edited."""
    if not blender_object.data.is_editmode:
        yield blender_object.data
        return
    import bmesh

    scratch = bpy.data.meshes.new(ORIGIN_ATTRIBUTE)
    try:
        bmesh.from_edit_mesh(blender_object.data).to_mesh(scratch)
        yield scratch
    finally:
        bpy.data.meshes.remove(scratch)


def mesh_arrays(mesh: bpy.types.Mesh, rule: SurfaceRule) -> PolygonMesh:
    """A Blender mesh, not in Edit Mode, as arrays. Sharpness is that of its creases alone."""
    face_starts = np.empty(len(mesh.polygons) + 1, dtype=np.intp)
    face_starts[:-1] = read_values(mesh.polygons, "loop_start", np.int32)
    face_starts[-1] = len(mesh.loops)
    attributes = mesh.attributes
    return PolygonMesh(
        positions=read_built_in(attributes, "position", "vector", np.float32, 3).astype(np.float64),
        face_starts=face_starts,
        corner_vertices=read_built_in(attributes, ".corner_vert", "value", np.int32).astype(np.intp),
        corner_edges=read_built_in(attributes, ".corner_edge", "value", np.int32).astype(np.intp),
        edge_vertices=read_built_in(attributes, ".edge_verts", "value", np.int32, 2).astype(np.intp),
        edge_sharpness=_sharpness(mesh, EDGE_CREASE, len(mesh.edges), rule),
        vertex_sharpness=_sharpness(mesh, VERTEX_CREASE, len(mesh.vertices), rule),
    )


def read_values(items: Any, name: str, dtype: type, width: int = 1) -> NDArray[Any]:
    """(items,) or (items, width): a property of every item of a collection, read in one go."""
    values: NDArray[Any] = np.empty(len(items) * width, dtype=dtype)
    if len(items):
        items.foreach_get(name, values)
    return values if width == 1 else values.reshape(-1, width)


def read_built_in(attributes: Any, name: str, value: str, dtype: type, width: int = 1) -> NDArray[Any]:
    """The same of an attribute; a mesh without vertices, edges or corners need not have it."""
    return read_values(attributes[name].data if name in attributes else (), value, dtype, width)


def _sharpness(mesh: bpy.types.Mesh, name: str, number: int, rule: SurfaceRule) -> FloatArray:
    creases = read_creases(mesh, name) if rule.use_creases else None
    return np.zeros(number) if creases is None else crease_to_sharpness(creases)


def read_creases(mesh: bpy.types.Mesh, name: str) -> NDArray[np.float32] | None:
    """(E,) or (V,): the creases that the Subdivision Surface modifier takes from an attribute, None without one.

    The modifier converts an attribute of another type or domain, and so does Blender's own operator, on a copy.
    """
    attribute = mesh.attributes.get(name)
    if attribute is None:
        return None
    if (attribute.data_type, attribute.domain) == ("FLOAT", CREASE_DOMAINS[name]):
        return read_values(attribute.data, "value", np.float32)
    copy = own_copy(mesh)
    holder = bpy.data.objects.new(copy.name, copy)
    try:
        copy.attributes.active = copy.attributes[name]
        # Another object that is being edited must not stand in the way.
        with bpy.context.temp_override(object=holder, active_object=holder, edit_object=None):
            bpy.ops.geometry.attribute_convert(mode="GENERIC", domain=CREASE_DOMAINS[name], data_type="FLOAT")
        return read_values(copy.attributes[name].data, "value", np.float32)
    finally:
        bpy.data.objects.remove(holder)
        bpy.data.meshes.remove(copy)


def _refuse_crease_groups(blender_object: bpy.types.Object, rule: SurfaceRule) -> None:
    """The modifier takes creases from vertex groups of these names, too."""
    for name in CREASE_DOMAINS if rule.use_creases else ():
        if name in blender_object.vertex_groups:
            raise ControlMeshError(
                f"it has a vertex group called “{name}”, which the Subdivision Surface modifier takes for creases; "
                "rename it"
            )


def _read_evaluated(
    context: bpy.types.Context,
    blender_object: bpy.types.Object,
    own: bpy.types.Mesh,
    counted: list[str],
    rule: SurfaceRule,
) -> tuple[PolygonMesh, IndexArray]:
    """The mesh as the counted modifiers make it, and the face of ``own`` that each of its faces comes from."""
    _refuse_simulations(blender_object, counted)
    with frozen_copy(context, blender_object, own, counted) as (copy, mesh):
        origins = write_origins(copy, mesh)
        evaluated = _evaluated_mesh(context, copy)
        base_faces = read_origins(evaluated, origins, len(own.polygons))
        mesh = mesh_arrays(evaluated, rule)
        if mesh.face_count and len(_present(base_faces)) < len(own.polygons):
            _refuse_lost_faces(context, copy, origins, len(own.polygons))
        return mesh, base_faces


def _refuse_simulations(blender_object: bpy.types.Object, counted: list[str]) -> None:
    for name in counted:
        if blender_object.modifiers[name].type in SIMULATIONS:
            raise ControlMeshError(
                f"the modifier “{name}” is a simulation, which cannot be counted in: apply it, or turn Modifiers off"
            )


@contextmanager
def frozen_copy(
    context: bpy.types.Context, blender_object: bpy.types.Object, own: bpy.types.Mesh, counted: list[str]
) -> Iterator[tuple[bpy.types.Object, bpy.types.Mesh]]:
    """A temporary copy of the object in the scene, with the counted modifiers alone, and the copy of ``own`` it has.

    Its values are those the object has now, keyed or not, so it must not be animated again.
    """
    mesh = own_copy(own)
    copy = own_copy(blender_object)
    try:
        copy.data = mesh
        copy.animation_data_clear()
        if mesh.shape_keys is not None:
            mesh.shape_keys.animation_data_clear()
        for modifier in [m for m in copy.modifiers if m.name not in counted]:
            copy.modifiers.remove(modifier)
        context.scene.collection.objects.link(copy)
        yield copy, mesh
    finally:
        bpy.data.objects.remove(copy)
        bpy.data.meshes.remove(mesh)


def _evaluated_mesh(context: bpy.types.Context, copy: bpy.types.Object) -> bpy.types.Mesh:
    return copy.evaluated_get(context.evaluated_depsgraph_get()).data


def write_origins(holder: bpy.types.Object, mesh: bpy.types.Mesh) -> str:
    """Write its number on every face of a mesh, and return the name it has there, which nothing else has."""
    taken = {*holder.vertex_groups.keys(), *mesh.attributes.keys()}
    name = next(name for number in count() if (name := f"{ORIGIN_ATTRIBUTE}_{number}") not in taken)
    origins = np.arange(1, len(mesh.polygons) + 1)
    pairs = np.stack([origins, origins * origins % ORIGIN_PRIME], axis=1).astype(np.int32)
    write_values(mesh.attributes.new(name, "INT32_2D", "FACE").data, "value", pairs)
    return name


def read_origins(mesh: bpy.types.Mesh, name: str, base_face_count: int) -> IndexArray:
    """(F,) intp: the face each face of an evaluated mesh comes from, or NO_ORIGIN."""
    attribute = mesh.attributes.get(name)
    if attribute is None or (attribute.data_type, attribute.domain) != ("INT32_2D", "FACE"):
        return np.full(len(mesh.polygons), NO_ORIGIN, dtype=np.intp)
    pairs = read_values(attribute.data, "value", np.int32, 2).astype(np.intp)
    origins = pairs[:, 0]
    known = (origins >= 1) & (origins <= base_face_count) & (origins * origins % ORIGIN_PRIME == pairs[:, 1])
    return np.where(known, origins - 1, NO_ORIGIN)


def _present(base_faces: IndexArray) -> IndexArray:
    return np.unique(base_faces[base_faces != NO_ORIGIN])


def _refuse_lost_faces(context: bpy.types.Context, copy: bpy.types.Object, origins: str, base_face_count: int) -> None:
    """Raise ControlMeshError when a modifier loses faces without taking them away."""
    modifiers = list(copy.modifiers)
    for modifier in modifiers:
        modifier.show_viewport = False
    present = base_face_count
    for modifier in modifiers:
        modifier.show_viewport = True
        before, present = (
            present,
            len(_present(read_origins(_evaluated_mesh(context, copy), origins, base_face_count))),
        )
        if present < before and (present == 0 or modifier.type not in TAKING_FACES_AWAY):
            raise ControlMeshError(
                f"the modifier “{modifier.name}” does not keep the mesh's faces apart, so their depths cannot be "
                "told: apply it, or turn Modifiers off"
            )
