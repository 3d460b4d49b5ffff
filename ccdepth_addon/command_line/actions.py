# SPDX-License-Identifier: GPL-3.0-or-later
"""The actions on the objects of a file: their settings, their operators, and their entries in a report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import degrees
from typing import Any

import bpy
import numpy as np

from ..exchange.blender_arrays import read_values
from ..exchange.face_values import BOUND_KIND
from ..exchange.modifiers import shown_vertices
from ..state import properties
from ..state.properties import Settings, setting_names
from ..tasks.deviation_task import Verdict
from ..tasks.surfaces import shortest_decimal
from .arguments import DEPTHS, LEVELS, MEASURE, SUBDIVIDE
from .blender_calls import call
from .mesh_files import scene_unit
from .report import Distances, Frame, ObjectEntry, metres_rounded_up
from .report_text import print_facts

# The settings of each action, beside the tolerance.
OF_DEPTHS = setting_names(properties.ToleranceProperties, properties.DepthProperties)
SETTINGS = {
    DEPTHS: OF_DEPTHS,
    LEVELS: OF_DEPTHS,
    SUBDIVIDE: setting_names(
        properties.ToleranceProperties, properties.DivisionProperties, properties.MakingProperties
    ),
    MEASURE: setting_names(properties.ToleranceProperties, properties.MeasureProperties),
}


# The outcome for objects: the entry of each so far, and the object with the result.
Outcomes = list[tuple[ObjectEntry, bpy.types.Object]]


def settings_of(action: str) -> dict[str, Any]:
    """The scene's settings for an action, by their names."""
    return Settings.of(bpy.context.scene.ccdepth, SETTINGS[action]).values


def call_for(objects: Sequence[bpy.types.Object], operator: Any, **properties: Any) -> None:
    """Call an operator with chosen objects selected."""
    with bpy.context.temp_override(selected_objects=list(objects), active_object=objects[0]):
        call(operator, **properties)


def _entry(blender_object: bpy.types.Object, settings: dict[str, Any], tolerance: float) -> ObjectEntry:
    """The entry of an object. tolerance: in the unit of the scene."""
    length = shortest_decimal(tolerance) * scene_unit(bpy.context.scene)
    return ObjectEntry(blender_object.name, settings, length, len(blender_object.data.polygons))


def _compute_depths(objects: Sequence[bpy.types.Object], settings: dict[str, Any]) -> Outcomes:
    call_for(objects, bpy.ops.ccdepth.compute)
    print_facts(objects)
    return [(_depth_entry(each, settings), each) for each in objects]


def _depth_entry(blender_object: bpy.types.Object, settings: dict[str, Any]) -> ObjectEntry:
    mesh = blender_object.data
    record = mesh.ccdepth
    bounds = read_values(mesh.attributes[BOUND_KIND.name].data, "value", np.float32)
    return replace(
        _entry(blender_object, settings, record.world_tolerance),
        vertices=shown_vertices(blender_object, settings["vertices"]),
        deepest=max(record.deepest, record.added_deepest),
        level=record.uniform_level,
        worst_frame=Frame(record.worst_frame) if record.frames else None,
        proved=metres_rounded_up(float(bounds.max(initial=0.0)), scene_unit(bpy.context.scene)),
    )


def _set_levels(objects: Sequence[bpy.types.Object], settings: dict[str, Any]) -> Outcomes:
    call_for(objects, bpy.ops.ccdepth.compute)
    call_for(objects, bpy.ops.ccdepth.set_levels)
    print_facts(objects)
    return [
        (replace(_depth_entry(each, settings), result_faces=int(each.data.ccdepth.uniform_faces)), each)
        for each in objects
    ]


def _subdivide(objects: Sequence[bpy.types.Object], settings: dict[str, Any]) -> Outcomes:
    names, faces = [each.name for each in objects], [len(each.data.polygons) for each in objects]
    in_place = bpy.context.scene.ccdepth.output == "IN_PLACE"
    before = set(bpy.data.objects)
    call_for(objects, bpy.ops.ccdepth.subdivide)
    made = list(objects)
    if not in_place:
        results = {each.ccdepth.source: each for each in bpy.data.objects if each not in before}
        made = [results[each] for each in objects]
    print_facts(made)
    return [
        (replace(_adaptive_entry(each, settings), name=name, faces=count), each)
        for name, count, each in zip(names, faces, made, strict=True)
    ]


def _adaptive_entry(result: bpy.types.Object, settings: dict[str, Any]) -> ObjectEntry:
    record = result.data.ccdepth
    return replace(
        _entry(result, settings, record.world_tolerance),
        result=result.name,
        result_faces=record.faces,
        deepest=record.deepest,
        proved=metres_rounded_up(record.largest_bound, scene_unit(bpy.context.scene)),
        proved_shading=record.largest_shading_angle if record.shading_angle else None,
        proved_facets=record.largest_facet_angle if record.facet_angle else None,
    )


def _measure(objects: Sequence[bpy.types.Object], settings: dict[str, Any]) -> Outcomes:
    """Measure each object against its own limit surface."""
    found = []
    for each in objects:
        call_for([each], bpy.ops.ccdepth.measure)
        record = each.data.ccdepth
        distances = Distances.of(record.deviation, record.deviation_reached, scene_unit(bpy.context.scene))
        entry = _entry(each, settings, record.measurement.world_tolerance)
        entry = replace(entry, measured=distances, met=record.measurement.verdict == Verdict.MET.name)
        angles = degrees(record.deviation_facet_angle), degrees(record.deviation_shading_angle)
        found.append((replace(entry, facet_angle=angles[0], shading_angle=angles[1]), each))
    return found


ACTIONS = {DEPTHS: _compute_depths, LEVELS: _set_levels, SUBDIVIDE: _subdivide, MEASURE: _measure}
