# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply Adaptive Subdivision called in tests, and what it must leave as it is."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from tests.blender import addon

TOLERANCE = 0.01


def subdivide(*objects: bpy.types.Object, **settings: object) -> list[bpy.types.Object]:
    """Select the objects and subdivide them; the objects selected then, in the order of their names."""
    addon.select(*objects)
    settings.setdefault("tolerance", TOLERANCE)
    settings.setdefault("tolerance_mode", "ABSOLUTE")
    assert bpy.ops.ccdepth.subdivide(**settings) == {"FINISHED"}
    return sorted(bpy.context.selected_objects, key=lambda obj: obj.name)


def faces(holder: bpy.types.Object) -> int:
    return len(holder.data.polygons)


def everything_in_the_file() -> dict[str, tuple[object, ...]]:
    """What there is, with what a subdivision could change of it."""
    found: dict[str, tuple[object, ...]] = {item.name_full: () for item in bpy.data.user_map()}
    for obj in bpy.data.objects:
        found[obj.name_full] = (
            obj.data.name_full,
            obj.hide_get(),
            obj.hide_render,
            obj.select_get(),
            [modifier.name for modifier in obj.modifiers],
        )
    for mesh in bpy.data.meshes:
        coordinates = np.empty(3 * len(mesh.vertices), dtype=np.float32)
        mesh.vertices.foreach_get("co", coordinates)
        names = [name for name in mesh.attributes.keys() if not name.startswith(".select")]  # noqa: SIM118
        found[mesh.name_full] = (len(mesh.polygons), coordinates.tobytes(), mesh.users, sorted(names))
    return found


def refused(*objects: bpy.types.Object, match: str, **settings: object) -> None:
    """The operator reports an error, and nothing is changed."""
    addon.select(*objects)
    settings.setdefault("tolerance", TOLERANCE)
    settings.setdefault("tolerance_mode", "ABSOLUTE")
    before = everything_in_the_file()
    with pytest.raises(RuntimeError, match=match):
        bpy.ops.ccdepth.subdivide(**settings)
    assert everything_in_the_file() == before


def shape(holder: bpy.types.Object) -> np.ndarray:
    """(V, 3): where the object's vertices are in the scene."""
    bpy.context.view_layer.update()
    positions = np.empty(3 * len(holder.data.vertices), dtype=np.float32)
    holder.data.vertices.foreach_get("co", positions)
    world = np.array(holder.matrix_world)
    return positions.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]


def known_count(holder: bpy.types.Object) -> Any:
    settings = bpy.context.scene.ccdepth
    tolerance = getattr(settings, "relative_tolerance" if settings.tolerance_mode == "RELATIVE" else "tolerance")
    current = addon.module("tasks.adaptive_task").AdaptiveSettings.of(settings, tolerance)
    return addon.module("state.known").known_count([holder], current)
