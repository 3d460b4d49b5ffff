# SPDX-License-Identifier: GPL-3.0-or-later
"""The proved distances of all faces at one level."""

import numpy as np

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.norm_bounds import Method, Vertices
from ccdepth_addon.core.bounds.rounding import rounding_allowance
from ccdepth_addon.core.depth.face_depths import level_bounds_in_chunks
from ccdepth_addon.core.depth.tolerance import ToleranceTest
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh


def level_bounds(mesh: PolygonMesh, tolerance: float, method: str, vertices: str, level: int) -> FloatArray:
    """(F,) float64, in the unit of the positions; inf where none within the tolerance is proved."""
    bounds, every = np.full(mesh.face_count, np.inf), np.arange(mesh.face_count)
    test = ToleranceTest(tolerance, rounding_allowance(mesh))
    kinds = Method(method), Vertices(vertices)
    for block in level_bounds_in_chunks(mesh, every, test, *kinds, level, lambda: None):
        bounds[block.faces] = block.bounds
    return bounds
