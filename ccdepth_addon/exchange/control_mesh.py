# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender object → control mesh: the polygon mesh whose Catmull-Clark surface is used.

That is the surface the object's Subdivision Surface modifier makes at its place in the stack. With several such
modifiers it is the first of type Catmull-Clark that shows in the viewport, or else the first of that type; one of type
Simple is a modifier like any other. Without one, all modifiers that show in the viewport stand above it, and its
settings are the modifier's defaults.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property
from hashlib import blake2b
from itertools import count
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import FloatArray, IndexArray, InvalidMeshError, PolygonMesh, apply_boundary_rule, crease_to_sharpness
from .attribute_conversion import convert_attribute
from .bulk_writing import copy_without_keys, own_copy, write_values

ORIGIN_ATTRIBUTE = "ccdepth_origin"
EDGE_CREASE, VERTEX_CREASE = "crease_edge", "crease_vert"
CREASE_DOMAINS = {EDGE_CREASE: "EDGE", VERTEX_CREASE: "POINT"}
NO_ORIGIN = -1

# What meshes have in common whose vertices alone have moved.
SHARPNESS = {"edge_sharpness", "vertex_sharpness"}
LIKE = ("face_starts", "corner_vertices", "corner_edges", "edge_vertices", *sorted(SHARPNESS))

# The second number of an origin is the square of the first modulo this prime. Averaged origins of several faces do not
# fit together, which shows that a modifier has merged these faces.
ORIGIN_PRIME = 2**31 - 1

# The least scale of an object along any direction, as a fraction of the largest.
LEAST_STRETCH = 1e-6

# Objects evaluated at once, and vertices of their own meshes: few enough to keep the window responsive.
OBJECTS_AT_ONCE = 128
VERTICES_AT_ONCE = 1 << 18

# These remove faces. Faces that other modifiers lose are merged into faces that keep one origin alone.
REMOVING_FACES = {"BOOLEAN", "BUILD", "MASK", "NODES", "WELD"}

# These leave the mesh as it is.
NOT_SHAPING = {"COLLISION", "PARTICLE_SYSTEM"}

# Their cache belongs to the object itself: a copy has none.
SIMULATIONS = {"CLOTH", "EXPLODE", "FLUID", "SOFT_BODY"}


class ControlMeshError(ValueError):
    """The object's control mesh cannot be read; the message says why in a modeller's words."""


@dataclass(frozen=True)
class SurfaceRule:
    """The settings of a Subdivision Surface modifier that shape its surface, with its defaults."""

    smooth_corners: bool = True
    use_creases: bool = True


@dataclass(frozen=True, eq=False)
class MeshAsRead:
    """A mesh in object space, whose sharpness is that of its creases alone, and the rule of its surface."""

    arrays: PolygonMesh
    rule: SurfaceRule

    @cached_property
    def key(self) -> bytes:
        """Equal for equal meshes; loose vertices may be anywhere, and not finite."""
        digest = blake2b(repr(self.rule).encode())
        for field in fields(PolygonMesh):
            values = np.ascontiguousarray(getattr(self.arrays, field.name))
            digest.update(f"{field.name} {values.shape} {values.dtype}".encode())
            digest.update(values.data)
        return digest.digest()

    @cached_property
    def mesh(self) -> PolygonMesh:
        """The same with its sharpness explicit."""
        return apply_boundary_rule(self.arrays, smooth_corners=self.rule.smooth_corners)


@dataclass(frozen=True, eq=False)
class MovedMesh:
    """A mesh like another one, with its vertices elsewhere; of the arrays it has only these positions.

    first: the other one. positions: (V, 3) float32, as Blender holds them.
    """

    first: MeshAsRead
    positions: NDArray[np.float32]

    @property
    def rule(self) -> SurfaceRule:
        return self.first.rule

    @property
    def key(self) -> bytes:
        """Equal for equal meshes that are like the same one."""
        digest = blake2b(self.first.key)
        digest.update(self.positions.data)
        return digest.digest()

    @property
    def mesh(self) -> PolygonMesh:
        """The same with its sharpness explicit, made anew each time; what depends on the faces alone is kept."""
        return self.first.mesh.changed(positions=self.positions.astype(np.float64))


def moved_mesh(first: MeshAsRead, later: MeshAsRead) -> MovedMesh | None:
    """The later mesh as a moved one, if it is like the first but for its positions."""
    if first.rule != later.rule or not all(
        np.array_equal(getattr(first.arrays, name), getattr(later.arrays, name), equal_nan=name in SHARPNESS)
        for name in LIKE
    ):
        return None
    return MovedMesh(first, later.arrays.positions.astype(np.float32))


@dataclass(frozen=True)
class ControlMesh:
    """The control mesh of an object.

    read: the mesh in object space. base_faces: (F,) intp, the face of the object's own mesh that each face comes from,
    ``NO_ORIGIN`` for none; None when they are the same faces. world: (3, 3) float64, the linear part of the object's
    matrix.
    """

    read: MeshAsRead | MovedMesh
    base_faces: IndexArray | None
    world: FloatArray

    @property
    def mesh(self) -> PolygonMesh:
        """In object space, with its sharpness explicit."""
        return self.read.mesh

    @property
    def in_world(self) -> PolygonMesh:
        """The mesh with the object's rotation, scale and shear applied, and without its location."""
        # Positions that are not finite are found and refused later.
        with np.errstate(invalid="ignore"):
            x, y, z = self.mesh.positions.T
            positions = np.empty_like(self.mesh.positions)
            for axis, weights in enumerate(self.world):
                positions[:, axis] = x * weights[0] + y * weights[1] + z * weights[2]
            return self.mesh.changed(positions=positions)

    @property
    def face_count(self) -> int:
        return self._arrays.face_count

    @property
    def corner_count(self) -> int:
        return self._arrays.corner_count

    @property
    def own_arrays(self) -> PolygonMesh | None:
        """Those of the object's own mesh, as it was read; None when its modifiers made another one."""
        return self._arrays if self.base_faces is None else None

    @property
    def _arrays(self) -> PolygonMesh:
        return (self.read if isinstance(self.read, MeshAsRead) else self.read.first).arrays

    def unturned(self) -> ControlMesh:
        """The same with all lengths as they are, as if the object were not turned."""
        if not np.isfinite(self.world).all():
            return self
        _, stretches, right = np.linalg.svd(self.world)
        return replace(self, world=right.T * stretches @ right)

    def thickened(self) -> ControlMesh:
        """The same, with a scale of at least ``LEAST_STRETCH`` of the largest along every direction.

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

        The box lies along the object's axes and holds every vertex that has a face; its eight corners are moved to
        the scene, and the longest of its four diagonals counts. So turning the object changes nothing.
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


def gram_matrix(world: FloatArray) -> FloatArray:
    """(3, 3): AᵀA, which says how long the object makes every vector of its mesh, however it is turned."""
    return world.T @ world


# By the session identifier of the mesh and the rule it was read with.
SharedMeshes = dict[tuple[int, SurfaceRule], MeshAsRead]


def subdivision_modifier(blender_object: bpy.types.Object) -> bpy.types.Modifier | None:
    """The modifier whose surface is used, if there is one."""
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
    copies: FrozenCopies | None = None,
) -> ControlMesh:
    """The object's control mesh; in Edit Mode, of the mesh as it is being edited.

    shared: the meshes read so far that other objects may use as well, to be read once only. copies: what was made by
    ``copies_to_measure`` for this object and others; without, Blender evaluates this object alone.
    Nothing of the file is changed. Raises ControlMeshError when its modifiers leave no trace of its faces, and
    InvalidMeshError when it has no faces.
    """
    if copies is None:
        context.view_layer.update()
        with copies_to_measure(context, [blender_object], use_modifiers=use_modifiers) as alone:
            return read_control_mesh(context, blender_object, use_modifiers=use_modifiers, shared=shared, copies=alone)
    rule = surface_rule(blender_object)
    _refuse_crease_groups(blender_object, rule)
    world = np.array(blender_object.matrix_world, dtype=np.float64)[:3, :3]
    data = blender_object.data
    counted = counted_modifiers(blender_object) if use_modifiers else []
    _refuse_simulations(counted)
    if is_evaluated(blender_object, counted):
        mesh, base_faces = _read_evaluated(copies, blender_object, rule)
        return ControlMesh(_with_faces(mesh, rule), base_faces, world)
    shared = {} if shared is None else shared
    if (data.session_uid, rule) not in shared:
        with own_mesh(blender_object) as own:
            shared[data.session_uid, rule] = _with_faces(mesh_arrays(own, rule), rule)
    return ControlMesh(shared[data.session_uid, rule], None, world)


def is_evaluated(blender_object: bpy.types.Object, counted: Sequence[bpy.types.Modifier]) -> bool:
    """Whether the control mesh is not the object's own mesh, but one that Blender makes of it."""
    data = blender_object.data
    # What Edit Mode shows is the shape key being edited, and that is what it holds; elsewhere keys are mixed.
    return bool(counted) or (data.shape_keys is not None and not data.is_editmode)


def applied_modifiers(blender_object: bpy.types.Object, *, use_modifiers: bool) -> list[bpy.types.Modifier]:
    """The modifiers that an adaptive mesh replaces: the Subdivision Surface modifier, and those that are counted in."""
    counted = counted_modifiers(blender_object) if use_modifiers else []
    subdivision = subdivision_modifier(blender_object)
    applied = [modifier for modifier in counted if modifier.type not in NOT_SHAPING]
    return applied if subdivision is None else [*applied, subdivision]


def base_modifiers(blender_object: bpy.types.Object, *, use_modifiers: bool) -> list[bpy.types.Modifier]:
    """Those of the applied modifiers that make the base mesh: all but the Subdivision Surface modifier."""
    subdivision = subdivision_modifier(blender_object)
    return [m for m in applied_modifiers(blender_object, use_modifiers=use_modifiers) if m != subdivision]


def has_own_keys(blender_object: bpy.types.Object, *, use_modifiers: bool) -> bool:
    """Whether the base mesh has shape keys: they are applied where modifiers make it."""
    has_keys = blender_object.data.shape_keys is not None
    return has_keys and not base_modifiers(blender_object, use_modifiers=use_modifiers)


@contextmanager
def base_mesh(
    context: bpy.types.Context,
    blender_object: bpy.types.Object,
    *,
    use_modifiers: bool,
    shared: SharedMeshes | None = None,
    copies: FrozenCopies | None = None,
) -> Iterator[tuple[bpy.types.Mesh, ControlMesh]]:
    """The Blender mesh whose Catmull-Clark surface is used, with all its attributes, and its control mesh.

    In Object Mode. It is the object's own mesh, or where modifiers are counted in, a temporary one they have made.
    Unlike depths, an adaptive mesh need not know which face of the object's own mesh each face comes from.
    copies: what was made by ``copies_to_subdivide`` for this object and others; without, Blender evaluates it alone.
    """
    if copies is None:
        context.view_layer.update()
        with (
            copies_to_subdivide(context, [blender_object], use_modifiers=use_modifiers) as alone,
            base_mesh(context, blender_object, use_modifiers=use_modifiers, shared=shared, copies=alone) as base,
        ):
            yield base
        return
    applied = base_modifiers(blender_object, use_modifiers=use_modifiers)
    if not applied:
        control = read_control_mesh(context, blender_object, use_modifiers=False, shared=shared, copies=copies)
        yield blender_object.data, control
        return
    rule = surface_rule(blender_object)
    _refuse_crease_groups(blender_object, rule)
    _refuse_simulations(applied)
    mesh = copies.new_mesh(blender_object)
    _copy_custom_properties(blender_object.data, mesh)
    world = np.array(blender_object.matrix_world, dtype=np.float64)[:3, :3]
    yield mesh, ControlMesh(_with_faces(mesh_arrays(mesh, rule), rule), None, world)


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
        _copy_lists(blender_object, scratch)
        yield scratch
    finally:
        bpy.data.meshes.remove(scratch)


def mesh_face_count(mesh: bpy.types.Mesh) -> int:
    """How many faces a mesh has; in Edit Mode those being edited."""
    if not mesh.is_editmode:
        return len(mesh.polygons)
    import bmesh

    return len(bmesh.from_edit_mesh(mesh).faces)


def _copy_lists(blender_object: bpy.types.Object, scratch: bpy.types.Mesh) -> None:
    """Give a mesh the object's vertex groups and materials: its vertices and faces refer to them by index, modifiers by
    name."""
    for material in blender_object.data.materials:
        scratch.materials.append(material)
    if not blender_object.vertex_groups:
        return
    # Only objects can make vertex groups.
    holder = bpy.data.objects.new(scratch.name, scratch)
    for group in blender_object.vertex_groups:
        holder.vertex_groups.new(name=group.name)
    bpy.data.objects.remove(holder)


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
    """The same for a built-in attribute, which a mesh without vertices, edges or corners need not have."""
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
    copy = copy_without_keys(mesh)
    holder = bpy.data.objects.new(copy.name, copy)
    try:
        convert_attribute(holder, name, mode="GENERIC", domain=CREASE_DOMAINS[name], data_type="FLOAT")
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


def in_batches(objects: Sequence[bpy.types.Object]) -> Iterator[list[bpy.types.Object]]:
    """The objects in groups that are few and small enough to be evaluated at once."""
    batch: list[bpy.types.Object] = []
    vertices = 0
    for blender_object in objects:
        batch.append(blender_object)
        vertices += len(blender_object.data.vertices)
        if len(batch) == OBJECTS_AT_ONCE or vertices >= VERTICES_AT_ONCE:
            yield batch
            batch, vertices = [], 0
    if batch:
        yield batch


@contextmanager
def copies_to_measure(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object], *, use_modifiers: bool
) -> Iterator[FrozenCopies]:
    """For ``read_control_mesh``: copies of those of the objects that must be evaluated."""
    wanted = {}
    for blender_object in objects:
        counted = counted_modifiers(blender_object) if use_modifiers else []
        if is_evaluated(blender_object, counted):
            wanted[blender_object] = counted
    with _frozen_copies(context, wanted, with_origins=set(wanted)) as copies:
        yield copies


@contextmanager
def copies_to_subdivide(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object], *, use_modifiers: bool
) -> Iterator[FrozenCopies]:
    """For ``base_mesh``: copies of those of the objects that must be evaluated."""
    wanted = {}
    for blender_object in objects:
        applied = base_modifiers(blender_object, use_modifiers=use_modifiers)
        if is_evaluated(blender_object, applied):
            wanted[blender_object] = applied
    # Without modifiers, those with shape keys are read like any other control mesh.
    with_origins = {holder for holder, applied in wanted.items() if not applied}
    with _frozen_copies(context, wanted, with_origins=with_origins) as copies:
        yield copies


@contextmanager
def copies_with(
    context: bpy.types.Context, wanted: dict[bpy.types.Object, list[bpy.types.Modifier]]
) -> Iterator[FrozenCopies]:
    """Copies of these objects, each with the modifiers given and with origins on its faces."""
    with _frozen_copies(context, wanted, with_origins=set(wanted)) as copies:
        yield copies


class FrozenCopies:
    """Temporary copies of objects in the scene, with some of their modifiers.

    Their values are those the objects have now, keyed or not, so they must not be animated again. The scene is
    evaluated once for all of them: each time takes as long as there are objects.
    """

    def __init__(self, context: bpy.types.Context) -> None:
        self._context = context
        self._copies: dict[int, bpy.types.Object] = {}
        self._face_counts: dict[int, int] = {}
        self._own_copies: dict[tuple[int, bool], bpy.types.Mesh] = {}
        # The attribute with the origins, by copied meshes and by objects.
        self._origins: dict[int, str] = {}
        self._names: dict[int, str] = {}
        self._made: dict[int, bpy.types.Mesh] = {}
        self._losing: dict[int, bpy.types.Modifier | None] | None = None

    def add(
        self, blender_object: bpy.types.Object, modifiers: Sequence[bpy.types.Modifier], *, with_origins: bool
    ) -> None:
        """Copy an object, with these of its modifiers, and with origins on its faces where they are needed."""
        uid = blender_object.session_uid
        mesh = self._own_copy(blender_object, with_origins)
        names = {modifier.name for modifier in modifiers}
        copy = self._copies[uid] = own_copy(blender_object)
        self._face_counts[uid] = len(mesh.polygons)
        copy.data = mesh
        copy.animation_data_clear()
        # What is hidden in all viewports is not evaluated.
        copy.hide_viewport = False
        for modifier in [m for m in copy.modifiers if m.name not in names]:
            copy.modifiers.remove(modifier)
        self._context.scene.collection.objects.link(copy)
        if with_origins:
            if mesh.session_uid not in self._origins:
                self._origins[mesh.session_uid] = _write_origins(copy, mesh)
            self._names[uid] = self._origins[mesh.session_uid]

    def _own_copy(self, blender_object: bpy.types.Object, with_origins: bool) -> bpy.types.Mesh:
        """A copy of the object's mesh, made once for all objects that use it."""
        key = blender_object.data.session_uid, with_origins
        if key not in self._own_copies:
            with own_mesh(blender_object) as own:
                mesh = self._own_copies[key] = own_copy(own)
            if mesh.shape_keys is not None:
                mesh.shape_keys.animation_data_clear()
        return self._own_copies[key]

    def evaluated(self, blender_object: bpy.types.Object) -> tuple[bpy.types.Mesh, IndexArray]:
        """What the modifiers have made, and the face of the object's own mesh that each face comes from."""
        uid = blender_object.session_uid
        return self._evaluated(self._copies[uid]), self._read_origins(uid)

    def _read_origins(self, uid: int) -> IndexArray:
        return _read_origins(self._evaluated(self._copies[uid]), self._names[uid], self._face_counts[uid])

    def face_count(self, blender_object: bpy.types.Object) -> int:
        """Of the object's own mesh."""
        return self._face_counts[blender_object.session_uid]

    def new_mesh(self, blender_object: bpy.types.Object) -> bpy.types.Mesh:
        """What the modifiers have made, as a mesh that lasts as long as the copies do."""
        if not self._made:
            # All at once: each new mesh would have the scene evaluated again for the next.
            depsgraph = self._context.evaluated_depsgraph_get()
            for uid, copy in self._copies.items():
                self._made[uid] = bpy.data.meshes.new_from_object(
                    copy.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
                )
        return self._made[blender_object.session_uid]

    def made(self, blender_object: bpy.types.Object) -> tuple[bpy.types.Mesh, IndexArray]:
        """``new_mesh``, and the face of the object's own mesh that each face comes from.

        Unlike what Blender evaluates for itself, it has the last levels that the graphics card makes in the viewport.
        """
        uid, mesh = blender_object.session_uid, self.new_mesh(blender_object)
        return mesh, _read_origins(mesh, self._names[uid], self._face_counts[uid])

    def losing_modifier(self, blender_object: bpy.types.Object) -> str | None:
        """The modifier that merges faces of the object, if there is one."""
        if self._losing is None:
            self._losing = self._find_losing()
        modifier = self._losing.get(blender_object.session_uid)
        return None if modifier is None else modifier.name

    def _find_losing(self) -> dict[int, bpy.types.Modifier | None]:
        """Show one more modifier of all copies at a time."""
        stacks = {uid: list(copy.modifiers) for uid, copy in self._copies.items()}
        for modifier in [modifier for stack in stacks.values() for modifier in stack]:
            modifier.show_viewport = False
        present = dict(self._face_counts)
        losing: dict[int, bpy.types.Modifier | None] = {}
        for place in range(max(map(len, stacks.values()))):
            shown = {uid: stack[place] for uid, stack in stacks.items() if place < len(stack)}
            for modifier in shown.values():
                modifier.show_viewport = True
            for uid, modifier in shown.items():
                before, present[uid] = present[uid], len(_present(self._read_origins(uid)))
                if present[uid] < before and (present[uid] == 0 or modifier.type not in REMOVING_FACES):
                    losing.setdefault(uid, modifier)
        return losing

    def _evaluated(self, copy: bpy.types.Object) -> bpy.types.Mesh:
        return copy.evaluated_get(self._context.evaluated_depsgraph_get()).data

    def remove(self) -> None:
        bpy.data.batch_remove([*self._copies.values(), *self._own_copies.values(), *self._made.values()])


@contextmanager
def _frozen_copies(
    context: bpy.types.Context,
    wanted: dict[bpy.types.Object, list[bpy.types.Modifier]],
    *,
    with_origins: set[bpy.types.Object],
) -> Iterator[FrozenCopies]:
    copies = FrozenCopies(context)
    try:
        for blender_object, modifiers in wanted.items():
            # Simulations will be refused, and must not begin to run.
            if not any(modifier.type in SIMULATIONS for modifier in modifiers):
                copies.add(blender_object, modifiers, with_origins=blender_object in with_origins)
        yield copies
    finally:
        copies.remove()


def _read_evaluated(
    copies: FrozenCopies, blender_object: bpy.types.Object, rule: SurfaceRule
) -> tuple[PolygonMesh, IndexArray]:
    """The mesh as the counted modifiers make it, and the face of the object's own that each of its faces comes from."""
    evaluated, base_faces = copies.evaluated(blender_object)
    mesh = mesh_arrays(evaluated, rule)
    if mesh.face_count and len(_present(base_faces)) < copies.face_count(blender_object):
        losing = copies.losing_modifier(blender_object)
        if losing is not None:
            raise ControlMeshError(
                f"the modifier “{losing}” does not keep the mesh's faces apart, so their depths cannot be told: apply "
                "it, or turn Include Modifiers off"
            )
    return mesh, base_faces


def _refuse_simulations(modifiers: Sequence[bpy.types.Modifier]) -> None:
    for modifier in modifiers:
        if modifier.type in SIMULATIONS:
            raise ControlMeshError(
                f"the modifier “{modifier.name}” is a simulation, which cannot be counted in: apply it, or turn "
                "Include Modifiers off"
            )


def _write_origins(holder: bpy.types.Object, mesh: bpy.types.Mesh) -> str:
    """Write its number on every face of a mesh, and return the name it has there, which nothing else has."""
    used = {*holder.vertex_groups.keys(), *mesh.attributes.keys()}
    name = next(name for number in count() if (name := f"{ORIGIN_ATTRIBUTE}_{number}") not in used)
    origins = np.arange(1, len(mesh.polygons) + 1)
    pairs = np.stack([origins, origins * origins % ORIGIN_PRIME], axis=1).astype(np.int32)
    write_values(mesh.attributes.new(name, "INT32_2D", "FACE").data, "value", pairs)
    return name


def _read_origins(mesh: bpy.types.Mesh, name: str, base_face_count: int) -> IndexArray:
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
