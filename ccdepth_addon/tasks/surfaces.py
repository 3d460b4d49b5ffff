# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces in the scene: control meshes with their objects' matrices and tolerances, and the errors of unusable
ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Self

import bpy
import numpy as np

from ..core import FloatArray, InvalidMeshError, Pixels, ToleranceError, Variation, surface_boxes
from ..exchange.blender_arrays import WriteError
from ..exchange.control_mesh import ControlMesh, ControlMeshError, gram_matrix
from ..exchange.data_blocks import Identity
from ..exchange.evaluated import Evaluated
from ..exchange.mesh_arrays import own_mesh
from ..exchange.modifiers import counted_modifiers, is_evaluated
from ..exchange.tolerance_factors import corner_factors

# Relative slack for rounding when one object's scale is compared with another's.
SCALE_ROUNDING = 1e-9

# The condition of a matrix whose inverse has eight digits.
FLATTEST = 1e7

# The largest number that Blender stores, also in place of larger numbers and infinity.
LARGEST_TOLERANCE = float(str(np.finfo(np.float32).max))

# As Blender stores it.
RIGHT_ANGLE = float(np.float32(np.pi / 2))

NOT_PLACED = "it is disabled in viewports, or in no shown collection of this view layer"

TOO_LARGE = "The tolerance is too large a number"


class ComputeError(ValueError):
    """The error of an impossible computation; the message names every object at fault in a modeller's words.

    faces_at_fault: by the session identifiers of meshes, the number of faces whose removal would remove the fault.
    """

    def __init__(self, message: str, faces_at_fault: Mapping[int, int] | None = None) -> None:
        super().__init__(message)
        self.faces_at_fault = faces_at_fault or {}


@dataclass(frozen=True)
class SurfaceSettings:
    """The settings of all computations: ``tolerance`` is a length in the scene, a fraction of the diagonal, or a number
    of pixels, by ``tolerance_mode``. camera: the name of the camera with the pixels, empty for the scene's;
    camera_frames: CURRENT or SCENE; off_screen_scale: the factor of the tolerance off screen."""

    tolerance: float
    tolerance_mode: str
    use_modifiers: bool
    camera: str = field(default="", kw_only=True)
    camera_frames: str = field(default="CURRENT", kw_only=True)
    off_screen_scale: float = field(default=4.0, kw_only=True)

    @classmethod
    def of(cls, holder: Any, tolerance: float, **others: Any) -> Self:
        """The settings of an operator, a scene or a record, with this tolerance and other given settings; all numbers
        as typed."""
        names = [each.name for each in fields(cls) if each.name not in {"tolerance", *others}]
        return cls(shortest_decimal(tolerance), **typed_values(holder, names), **others)


@dataclass(frozen=True)
class VariedSettings(SurfaceSettings):
    """The settings of computations with a tolerance that may vary. tolerance_by: NONE, VERTEX_GROUP with the name of a
    vertex group and the factor coarsest for a weight of 0, or MATERIAL."""

    tolerance_by: str = field(default="NONE", kw_only=True)
    vertex_group: str = field(default="", kw_only=True)
    coarsest: float = field(default=10.0, kw_only=True)

    def variation(self, holder: bpy.types.Object, mesh: bpy.types.Mesh, *, is_own: bool) -> Variation | None:
        """The variation of the tolerance over a control mesh, as of ``corner_factors``; None for the same
        everywhere. Raises ControlMeshError."""
        factors = corner_factors(holder, mesh, self, is_own=is_own)
        return None if factors is None else Variation(factors)

    def variation_read(self, blender_object: bpy.types.Object, copies: Evaluated) -> Variation | None:
        """The variation of the tolerance over the control mesh of an object (``read``). Raises ControlMeshError."""
        if is_evaluated(blender_object, counted_modifiers(blender_object, use_modifiers=self.use_modifiers)):
            return self.variation(blender_object, copies.made(blender_object)[0], is_own=False)
        with own_mesh(blender_object) as own:
            return self.variation(blender_object, own, is_own=True)

    def refuse_bad_numbers(self) -> None:
        """Raise ComputeError for a tolerance or a coarsest factor without meaning."""
        refuse_bad_tolerance(self.tolerance)
        if not 1 <= self.coarsest < LARGEST_TOLERANCE:
            raise ComputeError("Coarsest must be 1 or more")


@dataclass(frozen=True)
class Surface:
    """A control mesh with its object's matrix, and the tolerance there, as a length in the scene.

    painted: the variation of the tolerance by weights or materials. pixels: of a tolerance in pixels, with the least
    length on the object as the unit. None for the same everywhere.
    """

    holder: Identity
    control: ControlMesh
    tolerance: float
    painted: Variation | None = None
    pixels: Pixels | None = None

    def variation(self, control: ControlMesh) -> Variation | None:
        """How the tolerance varies over the control mesh, perhaps as another object has it; None for the same
        everywhere."""
        if self.pixels is None:
            return self.painted
        moved = self.pixels.moved(relative_matrix(self.control.world, control.world))
        return Variation(self._factors, moved)

    @cached_property
    def variation_by_face(self) -> Variation | None:
        """A variation with the least tolerance of each face."""
        if self.pixels is None:
            return self.painted
        return Variation(self._factors * np.repeat(self._by_face[0], self.control.topology.arrays.face_sizes))

    def face_tolerances(self) -> FloatArray:
        """(F,): the least tolerance of each face."""
        least: FloatArray = np.minimum.reduceat(self._factors, self.control.topology.arrays.face_starts[:-1])
        return self.tolerance * least * self._by_face[0]

    @cached_property
    def _by_face(self) -> tuple[FloatArray, FloatArray]:
        """(F,) twice: the least and the greatest factors by pixels."""
        if self.pixels is None:
            return np.ones(self.control.face_count), np.ones(self.control.face_count)
        return self.pixels.extremes(*surface_boxes(self.control.in_world))

    @property
    def _factors(self) -> FloatArray:
        return np.ones(self.control.topology.arrays.corner_count) if self.painted is None else self.painted.factors

    @property
    def least_factor(self) -> float:
        """The least factor by weights or materials: none on the tolerance is less."""
        return float(self._factors.min())

    @property
    def varies(self) -> bool:
        """Whether the tolerance varies over the mesh."""
        return self.painted is not None or self.pixels is not None

    @property
    def factors(self) -> tuple[float, float] | None:
        """No more and no less than all factors on the tolerance; None for the same everywhere."""
        if not self.varies:
            return None
        return self.least_factor, float(self._factors.max() * self._by_face[1].max())

    @property
    def paint(self) -> bytes | None:
        """What is equal for surfaces with the same factors by weights or materials."""
        return None if self.painted is None else self.painted.factors.tobytes()

    def within(self, others: Iterable[Surface]) -> Surface:
        """The surface with pixels that hold for others that it dominates as well, of the same control mesh."""
        pixels = self.pixels
        if pixels is None:
            return self
        longest = self.tolerance * self._by_face[1].max()
        views = pixels.views
        for other in others:
            try:
                matrix = relative_matrix(other.control.world, self.control.world)
            except ControlMeshError:
                # No vector of a dominated surface is longer, in parts of its tolerance.
                return replace(self, pixels=None)
            if other.pixels is not None and other.tolerance < longest * np.linalg.norm(matrix, 2):
                views += other.pixels.moved(matrix).views
        return replace(self, pixels=replace(pixels, views=views))

    @property
    def object_name(self) -> str:
        return self.holder.name

    def scaled_gram(self) -> FloatArray:
        """(3, 3): the Gram matrix of the object's linear part, in units of the tolerance."""
        return gram_matrix(self.control.world) / self.tolerance**2


def relative_matrix(world: FloatArray, base: FloatArray) -> FloatArray:
    """(3, 3): the matrix that moves what base (3, 3) has moved to where world (3, 3) moves it, to eight digits. Raises
    ControlMeshError if base is too flat for any."""
    if np.array_equal(world, base, equal_nan=True):
        return np.eye(3)
    if not (np.isfinite(base).all() and np.linalg.cond(base) < FLATTEST):
        raise ControlMeshError("its scale is zero now, and may not be on other frames")
    return np.linalg.solve(base.T, world.T).T


# The errors of an object, in words to follow its name.
OBJECT_FAULTS = (ControlMeshError, InvalidMeshError, ToleranceError, WriteError)


@contextmanager
def naming(object_name: str) -> Iterator[None]:
    """Raise an error of the object as a ComputeError that names it."""
    try:
        yield
    except OBJECT_FAULTS as fault:
        raise ComputeError(f"{object_name}: {fault}") from fault


class Faults:
    """The objects at fault, and why."""

    def __init__(self, objects: Sequence[bpy.types.Object]) -> None:
        self._holders = {each.session_uid: Identity.of(each) for each in objects}
        self._found: dict[int, tuple[int | None, ValueError]] = {}

    @contextmanager
    def of(self, uid: int, frame: int | None = None) -> Iterator[None]:
        """Note errors that are raised in this context for the object with this session identifier, on a frame or
        without any: the last one of the first frame that has any."""
        try:
            yield
        except OBJECT_FAULTS as fault:
            if self._found.get(uid, (frame,))[0] == frame:
                self._found[uid] = frame, fault

    def refuse(self) -> None:
        """Raise ComputeError if there are any, naming every object at fault in the order they were given."""
        named = [(each, *self._found[uid]) for uid, each in self._holders.items() if uid in self._found]
        invalid = {
            each.mesh_uid: len(fault.faces)
            for each, _, fault in named
            if isinstance(fault, InvalidMeshError) and len(fault.faces)
        }
        texts = [
            f"{each.name}{'' if frame is None else f', on frame {frame}'}: {fault}" for each, frame, fault in named
        ]
        if texts:
            raise ComputeError("\n".join(texts), invalid)


def typed_values(holder: Any, names: Iterable[str]) -> dict[str, Any]:
    """The properties of a holder by their names, all numbers as typed."""
    values = {name: getattr(holder, name) for name in names}
    return {name: shortest_decimal(value) if isinstance(value, float) else value for name, value in values.items()}


def shortest_decimal(value: float) -> float:
    """The shortest decimal that rounds to this number in single precision: 0.1, not 0.10000000149."""
    return float(str(np.float32(value)))


def scene_unit(scene: bpy.types.Scene) -> float:
    """The length of the scene's unit in metres."""
    return shortest_decimal(scene.unit_settings.scale_length)


def refuse_bad_tolerance(tolerance: float) -> None:
    """Raise ComputeError unless the tolerance is a finite number greater than zero."""
    if not np.isfinite(tolerance):
        raise ComputeError("The tolerance is not a finite number")
    if tolerance >= LARGEST_TOLERANCE:
        raise ComputeError(TOO_LARGE)
    if tolerance <= 0:
        raise ComputeError("The tolerance must be greater than zero")


def refuse_bad_angles(*angles: float) -> None:
    """Raise ComputeError unless each angle, in radians, is 0 or more and less than a right angle."""
    if not all(0 <= angle < RIGHT_ANGLE for angle in angles):
        raise ComputeError("An angle must be 0° or more, and less than 90°")


# Meshes without extent or with positions that are not finite are refused later.
@np.errstate(all="ignore")
def surfaces_covering_others(surfaces: Sequence[Surface]) -> dict[int, list[int]]:
    """The surfaces of one control mesh that no other dominates, each with the surfaces it dominates, as indices.

    A surface dominates another if its object makes every vector at least as long, in units of the tolerance.
    """
    grams = np.array([surface.scaled_gram() for surface in surfaces])
    traces = np.trace(grams, axis1=1, axis2=2)
    kept: dict[int, list[int]] = {}
    rivals = np.empty_like(grams)
    for index in np.argsort(-traces, kind="stable").tolist():
        dominating = _dominating(grams[index], rivals[: len(kept)])
        if dominating is None:
            rivals[len(kept)] = grams[index]
            kept[index] = []
        else:
            kept[list(kept)[dominating]].append(index)
    return kept


def _dominating(gram: FloatArray, rivals: FloatArray) -> int | None:
    """The first of the rivals (K, 3, 3) that makes every vector at least as long, if there is one."""
    differences = rivals - gram
    finite = np.isfinite(differences).all(axis=(1, 2))
    least = np.linalg.eigvalsh(np.where(finite[:, None, None], differences, 0.0)).min(axis=1, initial=np.inf)
    dominating = finite & (least >= -SCALE_ROUNDING * np.trace(rivals, axis1=1, axis2=2))
    return int(np.argmax(dominating)) if dominating.any() else None
