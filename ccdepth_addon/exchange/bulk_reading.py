# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers read from Blender's collections in one call each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def read_values(items: Any, name: str, dtype: type, width: int = 1) -> NDArray[Any]:
    """(items,) or (items, width): a property of every item of a collection, read in one go."""
    values: NDArray[Any] = np.empty(len(items) * width, dtype=dtype)
    if len(items):
        items.foreach_get(name, values)
    return values if width == 1 else values.reshape(-1, width)


def read_built_in(attributes: Any, name: str, value: str, dtype: type, width: int = 1) -> NDArray[Any]:
    """The same for a built-in attribute, which a mesh without vertices, edges or corners need not have."""
    return read_values(attributes[name].data if name in attributes else (), value, dtype, width)
