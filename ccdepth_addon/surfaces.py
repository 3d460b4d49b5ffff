# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces to measure: control meshes where objects put them, with the tolerance there, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields

import bpy
import numpy as np

from .control_mesh import ControlMesh, ControlMeshError
from .core.depth import ToleranceError
from .core.mesh import FloatArray, InvalidMeshError, PolygonMesh
from .writing import WriteError

# How much smaller, relatively, an object's scale may be than another's by rounding alone and still be outdone by it.
SCALE_ROUNDING = 1e-9


class ComputeError(ValueError):
    """What is asked cannot be computed; the message names every object at fault in a modeller's words."""


@dataclass(frozen=True)
class SurfaceSettings:
    """What is asked of every surface: ``tolerance`` is a length in the scene or a part of the diagonal, by
    ``tolerance_mode``."""

    tolerance: float
    tolerance_mode: str
    use_modifiers: bool


@dataclass(frozen=True)
class Surface:
    """One surface to measure: a control mesh where an object puts it, and the tolerance there, as a length."""

    object_name: str
    control: ControlMesh
    tolerance: float

    def weighed_gram(self) -> FloatArray:
        """How long the object makes vectors of its mesh, in parts of the tolerance."""
        return gram_matrix(self.control.world) / self.tolerance**2


class Faults:
    """What is wrong with objects, as it is found."""

    def __init__(self, objects: Sequence[bpy.types.Object]) -> None:
        self._names = [blender_object.name for blender_object in objects]
        self._found: dict[str, ValueError] = {}

    @contextmanager
    def of(self, name: str) -> Iterator[None]:
        """Whatever turns out to be wrong meanwhile is this object's fault."""
        try:
            yield
        except (ControlMeshError, InvalidMeshError, ToleranceError, WriteError) as fault:
            self._found[name] = fault

    def refuse(self) -> None:
        """Raise ComputeError if anything was found, naming every object at fault in the order they were given."""
        if self._found:
            raise ComputeError("\n".join(f"{name}: {self._found[name]}" for name in self._names if name in self._found))


def as_typed(value: float) -> float:
    """The shortest decimal that Blender's single-precision number stands for: 0.1, not 0.10000000149."""
    return float(str(np.float32(value)))


def refuse_bad_tolerance(tolerance: float) -> None:
    """Raise ComputeError unless the tolerance is a finite number greater than zero."""
    if not np.isfinite(tolerance):
        raise ComputeError("The tolerance is not a finite number")
    if tolerance <= 0:
        raise ComputeError("The tolerance must be greater than zero")


def surface_of(blender_object: bpy.types.Object, control: ControlMesh, settings: SurfaceSettings) -> Surface:
    """The object's surface, with the tolerance as a length."""
    relative = settings.tolerance_mode == "RELATIVE"
    return Surface(blender_object.name, control, settings.tolerance * (control.diagonal() if relative else 1.0))


def gram_matrix(world: FloatArray) -> FloatArray:
    """(3, 3): AᵀA, which says how long the object makes every vector of its mesh, however it is turned."""
    return world.T @ world


def is_outdone(gram: FloatArray, other: FloatArray) -> bool:
    """Whether the other makes every vector at least as long."""
    difference = other - gram
    # A bad mesh can make it anything; the mesh will be refused.
    if not np.isfinite(difference).all():
        return False
    return bool(np.linalg.eigvalsh(difference).min() >= -SCALE_ROUNDING * np.trace(other))


def same_control_mesh(one: ControlMesh, other: ControlMesh) -> bool:
    """Whether the two are equal; of meshes by modifiers, whether their faces come from the same ones as well."""
    if one.read is other.read:
        return True
    if one.read.rule != other.read.rule or not np.array_equal(np.array(one.base_faces), np.array(other.base_faces)):
        return False
    # Loose vertices may be anywhere.
    return all(
        np.array_equal(getattr(one.read.arrays, field.name), getattr(other.read.arrays, field.name), equal_nan=True)
        for field in fields(PolygonMesh)
    )
