# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply Adaptive Subdivision called in tests, and what it must leave as it is."""

from typing import Any

import bpy
import numpy as np
import pytest

from tests.blender import addon, scene, snapshot

TOLERANCE = 0.01


def subdivide(*objects: bpy.types.Object, **settings: object) -> list[bpy.types.Object]:
    """Show and select the objects and subdivide them; the objects selected then, in the order of their names."""
    addon.finish("subdivide", *objects, **{"tolerance": TOLERANCE, **settings})
    return sorted(bpy.context.selected_objects, key=lambda obj: obj.name)


def faces(holder: bpy.types.Object) -> int:
    return len(holder.data.polygons)


def refuses(operator: str, match: str, *objects: bpy.types.Object, **settings: object) -> None:
    """The operator reports an error about these objects, or about what is selected, and nothing is changed."""
    if objects:
        addon.select(*objects)
    with snapshot.unchanged(), pytest.raises(RuntimeError, match=match):
        getattr(bpy.ops.ccdepth, operator)(**settings)


def refused(*objects: bpy.types.Object, match: str, **settings: object) -> None:
    """So does Apply Adaptive Subdivision about these objects."""
    refuses("subdivide", match, *objects, **{"tolerance": TOLERANCE, "tolerance_mode": "ABSOLUTE", **settings})


def shape(holder: bpy.types.Object) -> np.ndarray:
    """(V, 3): where the object's vertices are in the scene."""
    bpy.context.view_layer.update()
    world = np.array(holder.matrix_world)
    return scene.mesh_data(holder.data).positions @ world[:3, :3].T + world[:3, 3]


def known_count(holder: bpy.types.Object) -> Any:
    """Of this object alone, once Blender has passed on its updates."""
    bpy.context.view_layer.update()
    return addon.module("state.known").count_to_make([holder], bpy.context.scene.ccdepth)
