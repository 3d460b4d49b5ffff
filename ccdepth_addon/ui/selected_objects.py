# SPDX-License-Identifier: GPL-3.0-or-later
"""The selected objects with depths, results or refusals, for panels and legend, and their totals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable

import bpy

from ..state import heat_map, known, mesh_values, result_record
from ..state.chosen import chosen
from ..state.heat_map import Shown
from .lengths import DIGITS, Unit, common_unit, length_text

# Without anything selected, the legend looks through no more objects than this.
MOST_SEARCHED = 1000


def with_depths(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected or edited objects with depths that were not made by subdivision."""
    return _selected(context, lambda each: mesh_values.has_depths(each.data) and not each.data.ccdepth.subdivision)


def made_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected objects that Apply Adaptive Subdivision made, from others or in place."""
    return _selected(context, result_record.is_adaptive)


def refused_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected objects with faces that the last run could not use."""
    return _selected(context, lambda holder: known.faces_at_fault(holder.data) > 0)


def colored_objects(context: bpy.types.Context, kind: Shown) -> list[bpy.types.Object]:
    """The objects of the legend: the selected objects that show a heat map; or else all objects that show one."""

    def is_colored(holder: bpy.types.Object) -> bool:
        return heat_map.has_shown(holder.data, kind) and bool(holder.visible_get())

    found = _selected(context, is_colored)
    objects = context.view_layer.objects
    if found or len(objects) > MOST_SEARCHED:
        return found
    return [each for each in objects if each.type == "MESH" and is_colored(each)]


def _selected(context: bpy.types.Context, wanted: Callable[[bpy.types.Object], bool]) -> list[bpy.types.Object]:
    return [each for each in chosen(context) if wanted(each)]


def faces_by_depth(objects: Iterable[bpy.types.Object]) -> Counter[int]:
    """The number of faces of each depth; each mesh counts once."""
    counts = Counter[int]()
    for mesh in {each.data for each in objects}:
        for row in mesh.ccdepth.rows:
            counts[row.depth] += row.faces
    return counts


def lengths_text(
    scene: bpy.types.Scene, lengths: Iterable[float], digits: int = DIGITS, unit: Unit | None = None
) -> str:
    """One length, or the least and the largest of several, to some significant digits. unit: None for the unit that
    suits them."""
    found = {*lengths}
    unit = unit or common_unit(scene, found)
    least, largest = (length_text(scene, each, digits=digits, unit=unit) for each in (min(found), max(found)))
    if least == largest:
        return least
    return f"{least if unit is None else least.removesuffix(unit.name).rstrip()}–{largest}"
