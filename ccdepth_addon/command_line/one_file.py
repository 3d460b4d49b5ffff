# SPDX-License-Identifier: GPL-3.0-or-later
"""A file from beginning to end: opened, processed by the operators of an action, written, and measured as written."""

from __future__ import annotations

import os
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import degrees
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import bpy
import numpy as np

from ..exchange.blender_arrays import read_values
from ..exchange.custom_normals import smooth_faces
from ..exchange.face_values import BOUND_KIND
from ..exchange.modifiers import shown_vertices
from ..state import properties
from ..state.properties import Settings, set_scene_tolerance, setting_names
from ..tasks.deviation_task import Measured, MeasureSettings, MeasureTask, MeshDeviation, Verdict, prepare_targets
from ..tasks.surfaces import LARGEST_TOLERANCE, TOO_LARGE, ComputeError, shortest_decimal
from ..ui.lengths import printable
from . import picture
from .amounts import UNITS
from .arguments import MAKING, SCENE_RANGE, action_of, is_measured, output_of
from .blender_calls import CommandError, call
from .chosen_objects import chosen_objects, missing_inputs
from .mesh_files import (
    BLEND,
    COMPANIONS,
    INPUTS,
    WITHOUT_NORMALS,
    check_blend,
    load,
    names_of,
    reader,
    scene_unit,
    unit_of,
    write_blend,
    write_meshes,
    writer,
)
from .report import (
    DEPTHS,
    LEVELS,
    MEASURE,
    SUBDIVIDE,
    Chosen,
    Distances,
    FileEntry,
    Frame,
    ObjectEntry,
    ReportPictures,
    metres_rounded_up,
    print_facts,
    print_measured,
    stamp,
)
from .whole_files import PNG, UnwrittenError, refuse_existing, written_whole
from .written_meshes import Edges, measured_distances, read_written, shown_triangles

SHADING_LOST = "the shading angle (the format has no normals)"

# The options that are settings of the scene under the same names.
GIVEN = set(setting_names(*properties.GROUPS)) - {"frames", "frame_list", "output"}


def process_file(source: Path | None, options: Namespace) -> FileEntry:
    """The entry of a processed file, or of Suzanne.

    Raises CommandError and OSError, with nothing written, if the file cannot be done.
    """
    output = output_of(source, options)
    refuse_impossible(source, output, options)
    for path in (output, options.picture):
        if path is not None:
            refuse_place(path, options.overwrite)
    # Before the work, during which the file may be saved anew.
    stamped = None if source is None else stamp(source, None)
    load(source, UNITS.get(options.unit))
    found, left_out = chosen_objects(source, options.objects, options.collection)
    objects, error = evaluated_objects(source, found)
    settings = bpy.context.scene.ccdepth
    change_settings(settings, options)
    action = action_of(options)
    lost = _leave_out_shading(settings, objects) if action == SUBDIVIDE and _has_no_normals(output) else ()
    if options.faces is not None:
        call_for(objects, bpy.ops.ccdepth.find_tolerance, face_budget=options.faces)
    unit = scene_unit(bpy.context.scene)
    is_checked = action in MAKING and output is not None and is_measured(options)
    if is_checked and action == SUBDIVIDE and settings.tolerance_by != "NONE":
        raise CommandError("a report is about one tolerance, and --tolerance-by varies it: leave the report out")
    targets = surfaces_of(objects) if is_checked else []
    outcomes = ACTIONS[action](objects, settings_of(action))
    shown = [made for _, made in outcomes]
    stamped = stamped and replace(stamped, metres_per_unit=unit)
    chosen = Chosen(options.objects, options.collection)
    entries = tuple(each for each, _ in outcomes)
    entry = FileEntry(stamped, entries, error=error, chosen=chosen, left_out=left_out, lost=lost)
    if options.picture is not None:
        with _written(options.picture, options) as path:
            picture.render(bpy.context, shown, path)
    if options.html is not None or options.pictures:
        entry = replace(entry, pictures=tuple(map(_report_pictures, shown)))
    if output is not None:
        entry = _write(output, shown, targets, entry, options)
    print_measured(entry)
    return entry


def _has_no_normals(output: Path | None) -> bool:
    return output is not None and output.suffix.lower() in WITHOUT_NORMALS


def _leave_out_shading(settings: bpy.types.PropertyGroup, objects: Sequence[bpy.types.Object]) -> tuple[str, ...]:
    """Turn the shading angle off; returns what objects with smooth faces thereby lose."""
    is_lost = settings.shading_angle > 0 and any(smooth_faces(each.data).any() for each in objects)
    settings.shading_angle = 0.0
    return (SHADING_LOST,) if is_lost else ()


def _report_pictures(shown: bpy.types.Object) -> ReportPictures:
    """The pictures on the page of an object with a result. Raises CommandError."""
    pictures = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"picture{picture.WEBP if picture.has_webp() else PNG}"
        for look in (picture.Look.HEAT_MAP, picture.Look.WIREFRAME):
            picture.render(bpy.context, [shown], path, look, picture.SMALL)
            pictures.append(path.read_bytes())
    return ReportPictures(tuple((row.depth, row.faces) for row in shown.data.ccdepth.rows), *pictures)


def evaluated_objects(
    source: Path | None, objects: Sequence[bpy.types.Object]
) -> tuple[list[bpy.types.Object], str | None]:
    """The objects with all that they depend on, and the faults of the others. Raises CommandError without any left."""
    failed = missing_inputs(objects)
    error = "\n".join(f"“{each.name}” depends on {cause}" for each, cause in failed.items())
    if failed and len(failed) == len(objects):
        raise CommandError(f"{source}: {error}")
    return [each for each in objects if each not in failed], error or None


def refuse_impossible(source: Path | None, output: Path | None, options: Namespace) -> None:
    """Raise CommandError for an unreadable file, and for outputs that cannot be written."""
    if source is not None:
        if source.suffix.lower() not in INPUTS:
            raise CommandError(f"{source}: not a {names_of(INPUTS)} file")
        if not source.is_file():
            raise CommandError(f"{source}: there is no such file")
        if source.suffix.lower() != BLEND:
            reader(source)
    if output is not None and output.suffix.lower() != BLEND:
        writer(output)
    if options.picture is not None and options.picture.suffix.lower() != PNG:
        raise CommandError(f"{options.picture}: its name must end in {PNG}")


def refuse_place(path: Path, overwrite: bool) -> None:
    """Raise CommandError without a writable folder for a file, and if something there has to stay."""
    if not path.absolute().parent.is_dir():
        raise CommandError(f"{path}: there is no folder {path.parent}")
    if not os.access(path.absolute().parent, os.W_OK):
        raise CommandError(f"{path}: the folder {path.parent} cannot be written to")
    try:
        refuse_existing(path, overwrite, COMPANIONS.get(path.suffix.lower(), ()))
    except UnwrittenError as fault:
        raise CommandError(f"{path}: {fault}") from fault


def change_settings(settings: bpy.types.PropertyGroup, options: Namespace) -> None:
    """Put the given options into the scene, so that a written file holds the settings of its results."""
    for name in GIVEN:
        value = getattr(options, name, None)
        if value is not None:
            setattr(settings, name, value)
    if options.output_kind is not None:
        settings.output = options.output_kind
    if options.frames == SCENE_RANGE:
        settings.frames = "SCENE"
    elif options.frames is not None:
        settings.frames, settings.frame_list = "CUSTOM", options.frames
    if options.tolerance is not None:
        tolerance = options.tolerance.in_scene(scene_unit(bpy.context.scene))
        # Blender would store a larger number as its largest number.
        if not tolerance < LARGEST_TOLERANCE:
            raise CommandError(TOO_LARGE)
        set_scene_tolerance(settings, tolerance)


def measure_settings(time_limit: float | None) -> MeasureSettings:
    """The scene's settings for measuring written meshes. time_limit: in seconds, for each object; without one there is
    no limit, as the scene's own is for a waiting user."""
    return MeasureSettings(**{**settings_of(MEASURE), "time_limit": time_limit or 0.0})


def surfaces_of(objects: Sequence[bpy.types.Object]) -> list[MeasureTask]:
    """The limit surfaces of the objects. Raises CommandError."""
    try:
        return prepare_targets(bpy.context, list(objects), measure_settings(None))
    except ComputeError as fault:
        raise CommandError(str(fault)) from fault


def _write(
    output: Path, shown: Sequence[bpy.types.Object], targets: list[MeasureTask], entry: FileEntry, options: Namespace
) -> FileEntry:
    """Write the objects to a file, read back formats other than Blender's, and measure the meshes against the surfaces,
    if any, before the file takes its place. Afterwards another file may be open."""
    is_blend = output.suffix.lower() == BLEND
    settings = measure_settings(options.time_limit)
    scene = scene_unit(bpy.context.scene)
    unit = scene if is_blend else unit_of(output, UNITS.get(options.unit))
    with _written(output, options) as path:
        lost = entry.lost
        if is_blend:
            write_blend(path)
            check_blend(path, [each.name for each in shown])
        else:
            lost += write_meshes(shown, path, unit)
        # The stamp of the measured file, before anything can take its place.
        stamped = replace(stamp(path, unit), path=output)
        companions = tuple(
            replace(stamp(beside, None), path=output.with_suffix(suffix))
            for suffix in COMPANIONS.get(path.suffix.lower(), ())
            if (beside := path.with_suffix(suffix)).exists()
        )
        if targets or not is_blend:
            written = {each.name: shown_triangles(each) for each in shown}
            parts = read_written(path, unit / scene, written)
        measured = entry.objects
        if targets:
            measured = tuple(
                as_held(with_answer(each, measured_distances(target, part, settings), scene), part)
                for each, target, part in zip(entry.objects, targets, parts, strict=True)
            )
    return replace(entry, objects=measured, output=stamped, companions=companions, lost=lost)


def with_answer(entry: ObjectEntry, answer: MeshDeviation, unit: float) -> ObjectEntry:
    """The entry with the measured distances and angles. unit: of the surface, in metres."""
    distances = Distances.of(answer.proved, answer.reached, unit)
    is_met = answer.verdict is Verdict.MET
    return replace(
        entry,
        tolerance=answer.tolerance * unit,
        measured=distances,
        met=is_met,
        facet_angle=degrees(answer.facet_angle),
        shading_angle=None if answer.shading_angle is None else degrees(answer.shading_angle),
    )


def as_held(entry: ObjectEntry, part: Measured) -> ObjectEntry:
    """The entry with the triangles that a file holds of its object."""
    triangles = part.shown.triangles
    edges = Edges.of(triangles)
    return replace(entry, triangles=len(triangles.corners), closed=edges.are_closed, oriented=edges.are_oriented)


@contextmanager
def _written(path: Path, options: Namespace) -> Iterator[Path]:
    """The path to write the file to; afterwards the whole file is there, or CommandError is raised."""
    companions = COMPANIONS.get(path.suffix.lower(), ())
    try:
        with written_whole(path, companions=companions, overwrite=options.overwrite) as beside:
            yield beside
    except (UnwrittenError, CommandError) as fault:
        # Blender's own message about a failure need not name the file.
        raise CommandError(f"{path}: {fault}") from fault
    print(f"Written: {printable(str(path))}")


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
        deepest_frame=Frame(record.deepest_frame) if record.frames else None,
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
