# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers of Blender's collections, read and written in one call each.

Blender silently drops values written in bulk to a library override.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ValueType:
    """A type of attribute: its bulk access, its default, and the steps in which values are stored."""

    value: str
    dtype: type
    width: int = 1
    default: tuple[float, ...] = (0,)
    step: float = 0.0


IDENTITY = tuple(np.eye(4).ravel().tolist())
# Byte colours are interpolated as stored, in sRGB.
TYPES = {
    "FLOAT": ValueType("value", np.float32),
    "FLOAT2": ValueType("vector", np.float32, 2),
    "FLOAT_VECTOR": ValueType("vector", np.float32, 3),
    "FLOAT4": ValueType("vector", np.float32, 4),
    "FLOAT_COLOR": ValueType("color", np.float32, 4),
    "BYTE_COLOR": ValueType("color_srgb", np.float32, 4, step=1 / 255),
    "QUATERNION": ValueType("value", np.float32, 4, (1, 0, 0, 0)),
    "FLOAT4X4": ValueType("value", np.float32, 16, IDENTITY),
    "BOOLEAN": ValueType("value", np.bool_),
    "INT": ValueType("value", np.int32),
    "INT8": ValueType("value", np.int8),
    "INT16_2D": ValueType("value", np.int16, 2),
    "INT32_2D": ValueType("value", np.int32, 2),
}


class WriteError(ValueError):
    """The error of values that Blender did not keep; the message names them in a modeller's words."""


def read_values(items: Any, name: str, dtype: type, width: int = 1) -> NDArray[Any]:
    """(items,) or (items, width): a property of every item of a collection, read in one go."""
    values: NDArray[Any] = np.empty(len(items) * width, dtype=dtype)
    if len(items):
        items.foreach_get(name, values)
    return values if width == 1 else values.reshape(-1, width)


def read_built_in(attributes: Any, name: str, value: str, dtype: type, width: int = 1) -> NDArray[Any]:
    """The values of a built-in attribute, which a mesh without vertices, edges or corners need not have."""
    return read_values(attributes[name].data if name in attributes else (), value, dtype, width)


def face_sizes(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """(F,): the number of corners of each face."""
    return np.diff(read_values(mesh.polygons, "loop_start", np.int32), append=np.int32(len(mesh.loops)))


def products(positions: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """(V, 3): the matrix (3, 3) times each position (V, 3), summed column by column: equal points stay equal."""
    x, y, z = np.ascontiguousarray(positions.T)
    moved = np.empty_like(positions)
    for axis, weights in enumerate(matrix):
        along = x * weights[0]
        along += y * weights[1]
        along += z * weights[2]
        moved[:, axis] = along
    return moved


def write_values(items: Any, name: str, values: NDArray[Any], step: float = 0.0) -> None:
    """Write a property of every item of a collection in one go, and read it back once.

    values: (items,) or (items, width), of the type that the property has. step: for numbers
    from 0 to 1 that Blender stores in steps. Raises WriteError when other values are there afterwards.
    """
    written = np.ascontiguousarray(values).ravel()
    if not len(written):
        return
    items.foreach_set(name, written)
    found = np.empty_like(written)
    items.foreach_get(name, found)
    if not _is_kept(written, found, step):
        raise WriteError("Blender did not keep what was written to the mesh, and nothing was changed")


def _is_kept(written: NDArray[Any], found: NDArray[Any], step: float) -> bool:
    if np.array_equal(written, found):
        return True
    if step == 0.0:
        return written.dtype.kind == "f" and np.array_equal(written, found, equal_nan=True)
    # NaN is stored as some number.
    return bool(np.all((np.abs(np.clip(written, 0.0, 1.0) - found) <= step) | np.isnan(written)))


def find_attribute(mesh: bpy.types.Mesh, name: str, data_type: str, domain: str) -> bpy.types.Attribute | None:
    """The attribute with this name, type and domain, or None."""
    attribute = mesh.attributes.get(name)
    if attribute is None or (attribute.data_type, attribute.domain) != (data_type, domain):
        return None
    return attribute


def write_attribute(mesh: bpy.types.Mesh, name: str, data_type: str, domain: str, values: NDArray[Any]) -> None:
    """Write an attribute in Object Mode, in place of an attribute of the same name with another type or domain.

    values: (N,) or (N, D). Raises WriteError when Blender does not keep them.
    """
    kind = TYPES[data_type]
    attribute = find_attribute(mesh, name, data_type, domain)
    if attribute is None:
        if name in mesh.attributes:
            mesh.attributes.remove(mesh.attributes[name])
        attribute = mesh.attributes.new(name, data_type, domain)
    write_values(attribute.data, kind.value, np.asarray(values, dtype=kind.dtype), kind.step)
