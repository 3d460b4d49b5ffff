# SPDX-License-Identifier: GPL-3.0-or-later
"""The types of arrays."""

import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]
# The indices of generated meshes: Blender's own type, at half the size.
ShortIndexArray = NDArray[np.int32]
FloatArray = NDArray[np.float64]
