# SPDX-License-Identifier: GPL-3.0-or-later
"""What the legend says: one for each thing that the colours of the objects stand for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import bpy

from ..state.colors import depth_colors
from ..state.results import Shown
from . import deviation_panel, panels
from .distance_scale import Distances, Scale, distance_scale, distances, relative_scale
from .legend_layout import Legend, Row
from .lengths import Rounding, common_unit, length_text
from .selected_results import faces_by_depth, lengths_text

# The list of objects is no longer than this.
MOST_OBJECTS = 5

# What has the last colour, by the scene's setting.
ENDS = {"LARGEST": "largest", "TOLERANCE": "tolerance", "FIXED": ""}


def legends(scene: bpy.types.Scene, objects: Sequence[bpy.types.Object]) -> list[Legend]:
    """The legends of objects that show a heat map; nothing in them refers to Blender's data."""
    groups: dict[tuple[str, tuple[float, ...]], list[bpy.types.Object]] = {}
    for each in objects:
        record = each.data.ccdepth
        is_depth = record.color_kind == Shown.DEPTH.name
        groups.setdefault((record.color_kind, tuple(record.color_range) if is_depth else ()), []).append(each)
    return [_legend(scene, Shown[kind], group) for (kind, _), group in groups.items() if kind]


def _legend(scene: bpy.types.Scene, kind: Shown, objects: list[bpy.types.Object]) -> Legend:
    if kind is Shown.DEPTH:
        records = [each.data.ccdepth for each in objects]
        return Legend(
            kind.value,
            f"for {lengths_text(scene, (record.world_tolerance for record in records))}",
            notes=_name(objects),
            alert=_alert(objects, lambda each: panels.stale_line(scene.ccdepth, each.data, each)),
            rows=depth_rows(objects),
            objects=_listed(objects, lambda each: f"{each.data.ccdepth.faces:,}"),
        )
    if kind is Shown.BOUND:
        return Legend(
            kind.value,
            notes=[*_name(objects), f"Faces {sum(mesh.ccdepth.faces for mesh in {each.data for each in objects}):,}"],
            alert=_alert(objects, lambda each: panels.stale_line(scene.ccdepth, each.data, each)),
            scale=_scale(scene, kind, objects),
            objects=_listed_lengths(scene, objects, lambda each: each.data.ccdepth.largest_bound),
        )
    faces = sum(mesh.ccdepth.measurement.faces for mesh in {each.data for each in objects})
    return Legend(
        kind.value,
        notes=[*_name(objects), f"Faces {faces:,}"],
        alert=_alert(objects, lambda each: deviation_panel.stale_line(scene.ccdepth, each.data)),
        scale=_scale(scene, kind, objects),
        objects=_listed_lengths(scene, objects, lambda each: each.data.ccdepth.deviation),
    )


def depth_rows(objects: Sequence[bpy.types.Object]) -> list[Row]:
    """A row for each colour of the depths of these objects, which have the same range of colours; the deepest first."""
    first, last = (int(depth) for depth in objects[0].data.ccdepth.color_range)
    counts = faces_by_depth(objects)
    faces: dict[int, int] = {}
    for depth, number in counts.items():
        shown = min(max(depth, first), last)
        faces[shown] = faces.get(shown, 0) + number
    labels = {depth: str(depth) for depth in faces}
    if counts and min(counts) < first:
        labels[first] = f"≤ {first}"
    if counts and max(counts) > last:
        labels[last] = f"≥ {last}"
    depths = sorted(faces, reverse=True)
    colors = depth_colors(depths, first, last).tolist()
    return [Row(labels[depth], faces[depth], tuple(color)) for depth, color in zip(depths, colors, strict=True)]


def _scale(scene: bpy.types.Scene, kind: Shown, objects: list[bpy.types.Object]) -> Callable[[float], Scale]:
    end = ENDS[scene.ccdepth.distance_range]
    shown = [_distances(scene, kind, each.data.ccdepth, end) for each in objects]
    worst = max(shown, key=lambda each: each.largest)
    if len({each.top for each in shown}) == 1:
        return lambda gap: distance_scale(kind.value, worst, gap)
    has_beyond = any(each.largest > each.top for each in shown)
    return lambda gap: relative_scale(kind.value, end, gap, has_beyond=has_beyond)


def _distances(scene: bpy.types.Scene, kind: Shown, record: bpy.types.PropertyGroup, end: str) -> Distances:
    top = record.color_range[1]
    if kind is Shown.BOUND:
        return distances(scene, top, record.world_tolerance, record.largest_bound, end)
    return distances(scene, top, record.measurement.world_tolerance, record.measurement.largest_shown, end)


def _alert(objects: Sequence[bpy.types.Object], line_of: Callable[[bpy.types.Object], str]) -> str:
    stale = sum(bool(line_of(each)) for each in objects)
    if not stale:
        return ""
    return "Out of date" if len(objects) == 1 else f"Out of date: {stale} of {len(objects)}"


def _name(objects: Sequence[bpy.types.Object]) -> list[str]:
    """Whose colours they are; of several objects the list below tells."""
    return [_short(objects[0].name)] if len(objects) == 1 else []


def _listed(objects: Sequence[bpy.types.Object], number_of: Callable[[bpy.types.Object], str]) -> list[tuple[str, str]]:
    """Names and numbers, when there are several objects; the last line counts those that are left out."""
    if len(objects) == 1:
        return []
    shown: Iterable[bpy.types.Object] = objects
    rest = []
    if len(objects) > MOST_OBJECTS:
        shown = objects[: MOST_OBJECTS - 1]
        rest = [(f"{len(objects) - MOST_OBJECTS + 1} more", "")]
    return [*((_short(each.name), number_of(each)) for each in shown), *rest]


def _listed_lengths(
    scene: bpy.types.Scene, objects: Sequence[bpy.types.Object], length_of: Callable[[bpy.types.Object], float]
) -> list[tuple[str, str]]:
    """The same of proved distances."""
    unit = common_unit(scene, map(length_of, objects))
    return _listed(objects, lambda each: length_text(scene, length_of(each), Rounding.UP, unit=unit))


def _short(name: str) -> str:
    return name if len(name) <= 20 else f"{name[:19]}…"
