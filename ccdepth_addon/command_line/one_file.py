# SPDX-License-Identifier: GPL-3.0-or-later
"""A file from beginning to end: opened, processed by the operators of an action, written, and measured as written."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import degrees
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import bpy
import numpy as np

from ..exchange.blender_arrays import read_values
from ..exchange.blender_calls import CommandError
from ..exchange.face_values import BOUND_KIND
from ..exchange.mesh_files import (
    BLEND,
    COMPANIONS,
    INPUTS,
    check_blend,
    load,
    names_of,
    reader,
    refuse_place,
    unit_of,
    write_blend,
    write_meshes,
    writer,
    written_there,
)
from ..exchange.modifiers import shown_vertices
from ..exchange.switch_distances import Switch
from ..exchange.whole_files import PNG
from ..operators.adaptive_operator import finest, make_and_place, way_to_place
from ..operators.compute_depth import depth_notes, depths_computed
from ..operators.count_faces import read_to_count, tolerance_found
from ..operators.export_within import leave_out_shading
from ..operators.levels_of_detail import wanted_levels
from ..operators.measure_deviation import deviation_notes, deviations_measured
from ..operators.mesh_operators import answer_of
from ..operators.place_results import as_levels
from ..operators.set_levels import levels_set
from ..state import properties, result_record
from ..state.chosen import surface_object
from ..state.mesh_values import AdaptiveFacts
from ..state.properties import Settings, scene_tolerance, set_scene_tolerance, setting_names
from ..tasks.adaptive_task import FINEST, AdaptiveSettings, Level
from ..tasks.deviation_task import Measured, MeasureSettings, MeasureTask, MeshDeviation, Verdict, prepare_targets
from ..tasks.surfaces import LARGEST_TOLERANCE, TOO_LARGE, scene_unit, shortest_decimal
from ..ui.lengths import printable
from . import picture
from .amounts import UNITS
from .arguments import MAKING, SCENE_RANGE, action_of, is_measured, output_of
from .chosen_objects import chosen_objects, missing_inputs
from .report import (
    DEPTHS,
    LEVELS,
    LODS,
    MEASURE,
    SUBDIVIDE,
    Chosen,
    Distances,
    FileEntry,
    FileStamp,
    Frame,
    ObjectEntry,
    ReportPictures,
    metres_rounded_up,
    print_facts,
    print_measured,
    stamp,
)
from .written_meshes import Edges, measured_distances, read_written, shown_triangles

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
    lost = leave_out_shading(settings, objects, output) if output and action in (SUBDIVIDE, LODS) else ()
    if options.faces is not None:
        adaptive = AdaptiveSettings.of(settings, scene_tolerance(settings))
        sources = [result_record.control_object(each) for each in objects]
        tasks = answer_of(read_to_count(bpy.context, objects, sources, adaptive))
        answer_of(tolerance_found(bpy.context, tasks, adaptive, options.faces))
    unit = scene_unit(bpy.context.scene)
    is_checked = action in MAKING and output is not None and is_measured(options)
    targets = surfaces_of(objects, levels_of(action)) if is_checked else []
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


def levels_of(action: str) -> list[Level]:
    """The levels of detail that the scene's settings ask an action for."""
    settings = bpy.context.scene.ccdepth
    if action != LODS:
        return [FINEST]
    return [Level(number, shortest_decimal(settings.step)) for number in range(settings.count)]


def surfaces_of(objects: Sequence[bpy.types.Object], levels: Sequence[Level]) -> list[MeasureTask]:
    """The limit surfaces of the objects, with the tolerance of each level. Raises ComputeError."""
    finest, targets = measure_settings(None), []
    for level in levels:
        settings = replace(finest, tolerance=level.tolerance(finest.tolerance))
        targets += prepare_targets(bpy.context, list(objects), settings)
    return targets


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
            lost += write_meshes({each.name: each for each in shown}, path, scene / unit)
        # The stamps of the measured file, before anything can take its place.
        stamped, companions = stamps(path, output, unit)
        if targets or not is_blend:
            written = {each.name: shown_triangles(each, path) for each in shown}
            parts = read_written(path, unit / scene, written)
        measured = entry.objects
        if targets:
            measured = tuple(
                as_held(with_answer(each, measured_distances(target, part, settings), scene), part)
                for each, target, part in zip(entry.objects, targets, parts, strict=True)
            )
    return replace(entry, objects=measured, output=stamped, companions=companions, lost=lost)


def stamps(path: Path, place: Path, unit: float) -> tuple[FileStamp, tuple[FileStamp, ...]]:
    """The stamps of a written file, and of files beside it that belong to it, for the place where it goes."""
    beside = [each for each in COMPANIONS.get(place.suffix.lower(), ()) if path.with_suffix(each).exists()]
    companions = (replace(stamp(path.with_suffix(each), None), path=place.with_suffix(each)) for each in beside)
    return replace(stamp(path, unit), path=place), tuple(companions)


def with_answer(entry: ObjectEntry, answer: MeshDeviation, unit: float) -> ObjectEntry:
    """The entry with the measured distances and angles. unit: of the surface, in metres."""
    distances = Distances.of(answer.proved, answer.reached, unit)
    is_met = answer.verdict is Verdict.MET
    return replace(
        entry,
        tolerance=answer.tolerance * unit,
        factors=answer.factors,
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
    """``written_there``, and printed."""
    with written_there(path, options.overwrite) as beside:
        yield beside
    print(f"Written: {printable(str(path))}")


# The settings of each action, beside the tolerance.
OF_DEPTHS = setting_names(properties.ToleranceProperties, properties.VariationProperties, properties.DepthProperties)
OF_RESULTS = (
    properties.ToleranceProperties,
    properties.VariationProperties,
    properties.DivisionProperties,
    properties.MakingProperties,
)
SETTINGS = {
    DEPTHS: OF_DEPTHS,
    LEVELS: OF_DEPTHS,
    SUBDIVIDE: setting_names(*OF_RESULTS),
    LODS: setting_names(*OF_RESULTS, properties.LevelProperties, properties.ViewProperties),
    MEASURE: setting_names(
        properties.ToleranceProperties, properties.VariationProperties, properties.MeasureProperties
    ),
}


# The outcome for objects: the entry of each so far, and the object with the result.
Outcomes = list[tuple[ObjectEntry, bpy.types.Object]]


def settings_of(action: str) -> dict[str, Any]:
    """The scene's settings for an action, by their names."""
    return Settings.of(bpy.context.scene.ccdepth, SETTINGS[action]).values


def _print_notes(notes: Iterable[str]) -> None:
    for note in notes:
        print(f"Warning: {printable(note)}")


def _entry(blender_object: bpy.types.Object, settings: dict[str, Any], tolerance: float) -> ObjectEntry:
    """The entry of an object. tolerance: in the unit of the scene."""
    length = shortest_decimal(tolerance) * scene_unit(bpy.context.scene)
    return ObjectEntry(blender_object.name, settings, length, len(blender_object.data.polygons))


def _compute(objects: list[bpy.types.Object]) -> None:
    holder = bpy.context.scene.ccdepth
    _print_notes(depth_notes(answer_of(depths_computed(bpy.context, objects, holder, scene_tolerance(holder)))))


def _compute_depths(objects: list[bpy.types.Object], settings: dict[str, Any]) -> Outcomes:
    _compute(objects)
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


def _set_levels(objects: list[bpy.types.Object], settings: dict[str, Any]) -> Outcomes:
    _compute(objects)
    _print_notes(filter(None, [levels_set(bpy.context, objects)]))
    print_facts(objects)
    return [
        (replace(_depth_entry(each, settings), result_faces=int(each.data.ccdepth.uniform_faces)), each)
        for each in objects
    ]


def _subdivide(objects: list[bpy.types.Object], settings: dict[str, Any]) -> Outcomes:
    names, faces = [each.name for each in objects], [len(each.data.polygons) for each in objects]
    holder, unit = bpy.context.scene.ccdepth, scene_unit(bpy.context.scene)
    adaptive, way = AdaptiveSettings.of(holder, scene_tolerance(holder)), way_to_place(objects, holder)
    made = answer_of(make_and_place(bpy.context, finest(objects), holder, adaptive, way))
    results = [made.placed[FINEST, each] for each in objects]
    _print_notes(made.notes)
    print_facts(results)
    return [
        (replace(adaptive_entry(name, count, AdaptiveFacts.of(each.data), settings, unit), result=each.name), each)
        for name, count, each in zip(names, faces, results, strict=True)
    ]


def _make_levels(objects: list[bpy.types.Object], settings: dict[str, Any]) -> Outcomes:
    holder, unit = bpy.context.scene.ccdepth, scene_unit(bpy.context.scene)
    adaptive, wanted = AdaptiveSettings.of(holder, scene_tolerance(holder)), wanted_levels(objects, holder)
    made = answer_of(make_and_place(bpy.context, wanted, holder, adaptive, as_levels))
    pairs = [(each, made.placed[level, each]) for level in wanted for each in objects]
    _print_notes(made.notes)
    print_facts([result for _, result in pairs])
    return [(_level_entry(*pair, settings, unit), pair[1]) for pair in pairs]


def _level_entry(
    source: bpy.types.Object, result: bpy.types.Object, settings: dict[str, Any], unit: float
) -> ObjectEntry:
    switch = Switch.read(result)
    assert switch is not None
    return replace(
        adaptive_entry(source.name, len(source.data.polygons), AdaptiveFacts.of(result.data), settings, unit),
        result=result.name,
        lod_distance=metres_rounded_up(switch.distance, unit),
        lod_screen_size=switch.screen_size,
    )


def adaptive_entry(name: str, faces: int, facts: AdaptiveFacts, settings: dict[str, Any], unit: float) -> ObjectEntry:
    """The entry of an object with an adaptive mesh. faces: of its own mesh. unit: of the scene, in metres."""
    return ObjectEntry(
        name,
        settings,
        shortest_decimal(facts.tolerance) * unit,
        faces,
        result_faces=facts.faces,
        deepest=facts.deepest,
        proved=metres_rounded_up(facts.proved, unit),
        proved_shading=facts.shading,
        proved_facets=facts.facets,
    )


def _measure(objects: list[bpy.types.Object], settings: dict[str, Any]) -> Outcomes:
    """Measure each object against its own limit surface."""
    found, unit = [], scene_unit(bpy.context.scene)
    for each in objects:
        wanted = {surface_object(each): [each]}
        [answer] = answers = answer_of(deviations_measured(bpy.context, wanted, MeasureSettings(**settings)))
        _print_notes(deviation_notes(answers))
        found.append((with_answer(_entry(each, settings, answer.tolerance), answer, unit), each))
    return found


ACTIONS = {DEPTHS: _compute_depths, LEVELS: _set_levels, SUBDIVIDE: _subdivide, LODS: _make_levels, MEASURE: _measure}
