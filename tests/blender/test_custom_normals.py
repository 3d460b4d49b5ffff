# SPDX-License-Identifier: GPL-3.0-or-later
"""The limit surface's own normals as custom normals, on request."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core import limit_normals
from tests import meshes
from tests.blender import scene
from tests.blender.full_mesh import (
    ROUNDING,
    compare,
)


def corner_normals(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    normals = np.empty(3 * len(mesh.loops), dtype=np.float32)
    mesh.corner_normals.foreach_get("vector", normals)
    return normals.reshape(-1, 3)


def test_custom_normals_are_left_out() -> None:
    holder = scene.add_object(meshes.creased_cube())
    holder.data.normals_split_custom_set([(0.6, 0.0, 0.8)] * len(holder.data.loops))
    assert not compare(holder).mesh.has_custom_normals


@pytest.mark.parametrize("deformable", [False, True])
def test_limit_normals_on_request(deformable: bool) -> None:
    holder = scene.add_object(meshes.creased_cube())
    holder.data.polygons[0].use_smooth = False
    if deformable:
        holder.vertex_groups.new(name="Group")
    comparison = compare(holder, exact_normals=True)
    expected = limit_normals(comparison.control, comparison.subdivided.corner_points)
    # As they are, or as angles in 16 bits: those are up to π, from normals that may be far off.
    free = bpy.app.version >= (4, 5) and not deformable
    tolerance = ROUNDING if free else 1e-3
    np.testing.assert_allclose(corner_normals(comparison.mesh), expected, atol=tolerance, rtol=0)
    by_vertex = np.zeros((len(comparison.mesh.vertices), 3))
    by_vertex[comparison.subdivided.corner_vertices] = expected
    assert np.abs(by_vertex[comparison.subdivided.corner_vertices] - expected).max() > 0.5
