# SPDX-License-Identifier: GPL-3.0-or-later
"""Write Blender's data in bulk, and make copies that can be written to.

Blender silently drops what is written in bulk to a library override, and a copy of an override is an override.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from itertools import count
from typing import Any, TypeVar

import bpy
import numpy as np
from numpy.typing import NDArray

Data = TypeVar("Data", bpy.types.Mesh, bpy.types.Object)


@dataclass(frozen=True)
class ValueType:
    """How a type of attribute is read and written in bulk, its default, and the steps in which values are stored."""

    value: str
    dtype: type
    width: int = 1
    default: tuple[float, ...] = (0,)
    step: float = 0.0


IDENTITY = tuple(np.eye(4).ravel().tolist())
# Byte colours are interpolated as they are stored, in sRGB.
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
    """Blender did not keep what was written; the message says what in a modeller's words."""


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


def write_attribute(mesh: bpy.types.Mesh, name: str, data_type: str, domain: str, values: NDArray[Any]) -> None:
    """Write an attribute in Object Mode; one of another type or domain under the name makes way for it.

    values: (N,) or (N, D). Raises WriteError when Blender does not keep them.
    """
    kind = TYPES[data_type]
    attribute = mesh.attributes.get(name)
    if attribute is not None and (attribute.data_type, attribute.domain) != (data_type, domain):
        mesh.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        attribute = mesh.attributes.new(name, data_type, domain)
    write_values(attribute.data, kind.value, np.asarray(values, dtype=kind.dtype), kind.step)


def unused_name(prefix: str, taken: Container[str]) -> str:
    """A name for something temporary: the prefix and a number, which is none of those taken."""
    return next(name for number in count() if (name := f"{prefix}_{number}") not in taken)


def is_writable(mesh: bpy.types.Mesh) -> bool:
    """Whether a mesh keeps what is written to it: it is neither linked nor a library override."""
    return mesh.is_editable and mesh.override_library is None


def own_copy(data: Data) -> Data:
    """A local copy, which is no library override."""
    copy = data.copy()
    return copy if copy.override_library is None else copy.make_local(clear_liboverride=True)


def copy_without_keys(mesh: bpy.types.Mesh) -> bpy.types.Mesh:
    """A copy of a mesh, which may be an evaluated one, without its shape keys.

    The keys of an evaluated mesh are copied with it, but the copy does not refer to them: they would stay in the file,
    and refer to a mesh that is freed with the next evaluation. Reading them then crashes Blender.
    """
    before = {keys.session_uid for keys in bpy.data.shape_keys}
    copy = own_copy(mesh)
    bpy.data.batch_remove([keys for keys in bpy.data.shape_keys if keys.session_uid not in before])
    return copy


def remove_shape_keys(holder: bpy.types.Object) -> None:
    """Remove the shape keys from the object's mesh, and their data-block from the file.

    Before Blender 5.2 the keys of a copied mesh have a user too many and would stay without a mesh. A file with such
    keys cannot be saved again.
    """
    keys = holder.data.shape_keys
    if keys is None:
        return
    uid = keys.session_uid
    holder.shape_key_clear()
    bpy.data.batch_remove([left for left in bpy.data.shape_keys if left.session_uid == uid])
