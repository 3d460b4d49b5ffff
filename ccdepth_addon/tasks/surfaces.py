# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces to measure: control meshes where objects put them, with the tolerance there, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import blake2b

import bpy
import numpy as np

from ..core import FloatArray, InvalidMeshError, ToleranceError
from ..exchange.bulk_writing import WriteError
from ..exchange.control_mesh import ControlMesh, ControlMeshError, gram_matrix

# How much smaller, relatively, an object's scale may be than another's by rounding alone and still be outdone by it.
SCALE_ROUNDING = 1e-9

# The largest number that Blender holds; it stands for infinity as well, and for all that is larger.
LARGEST_TOLERANCE = float(str(np.finfo(np.float32).max))
TOO_LARGE = "The tolerance is too large a number"


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
    if tolerance >= LARGEST_TOLERANCE:
        raise ComputeError(TOO_LARGE)
    if tolerance <= 0:
        raise ComputeError("The tolerance must be greater than zero")


def surface_of(blender_object: bpy.types.Object, control: ControlMesh, settings: SurfaceSettings) -> Surface:
    """The object's surface, with the tolerance as a length."""
    relative = settings.tolerance_mode == "RELATIVE"
    return Surface(blender_object.name, control, settings.tolerance * (control.diagonal() if relative else 1.0))


# A mesh without extent has no tolerance, and one of no finite positions has any: they will be refused.
@np.errstate(all="ignore")
def not_outdone(surfaces: Sequence[Surface]) -> dict[int, list[int]]:
    """Which surfaces of one control mesh no other outdoes, and the others, each with one that outdoes it, as indices.

    One is outdone by another that makes every vector at least as long, in parts of the tolerance.
    """
    grams = np.array([surface.weighed_gram() for surface in surfaces])
    traces = np.trace(grams, axis1=1, axis2=2)
    kept: dict[int, list[int]] = {}
    rivals = np.empty_like(grams)
    for index in np.argsort(-traces, kind="stable").tolist():
        outdoing = _outdoing(grams[index], rivals[: len(kept)])
        if outdoing is None:
            rivals[len(kept)] = grams[index]
            kept[index] = []
        else:
            kept[list(kept)[outdoing]].append(index)
    return kept


def _outdoing(gram: FloatArray, rivals: FloatArray) -> int | None:
    """The first of the rivals (K, 3, 3) that makes every vector at least as long, if there is one."""
    differences = rivals - gram
    finite = np.isfinite(differences).all(axis=(1, 2))
    least = np.linalg.eigvalsh(np.where(finite[:, None, None], differences, 0.0)).min(axis=1, initial=np.inf)
    outdoing = finite & (least >= -SCALE_ROUNDING * np.trace(rivals, axis1=1, axis2=2))
    return int(np.argmax(outdoing)) if outdoing.any() else None


def control_mesh_key(control: ControlMesh) -> bytes:
    """Equal for equal control meshes, and of meshes by modifiers, where their faces come from the same ones as well."""
    digest = blake2b(control.read.key)
    if control.base_faces is not None:
        digest.update(np.ascontiguousarray(control.base_faces).data)
    return digest.digest()


def same_control_mesh(one: ControlMesh, other: ControlMesh) -> bool:
    """Whether the two are equal."""
    return one.read is other.read or control_mesh_key(one) == control_mesh_key(other)
