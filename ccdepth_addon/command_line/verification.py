# SPDX-License-Identifier: GPL-3.0-or-later
"""The check of a report: it does not contradict itself, its files have not changed, and its claims are proved once
more. docs/report.md has a table of how each field is checked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf, isclose
from pathlib import Path

import bpy
import numpy as np

from ..exchange.displayed_mesh import shown_modifiers
from ..exchange.modifiers import applied_modifiers
from ..operators.measure_deviation import surface_object
from ..state.properties import set_scene_tolerance
from ..tasks.deviation_task import Measured, MeasureTask, prepare_measurement
from ..ui.printable import printable_lines
from .actions import ACTIONS, SETTINGS, settings_of
from .arguments import MAKING, MEASURE, SUBDIVIDE
from .blender_calls import CommandError
from .chosen_objects import chosen_objects
from .mesh_files import BLEND, load, scene_unit, unit_of
from .one_file import as_held, evaluated_objects, measure_settings, surfaces_of, with_answer
from .report import ROUNDING, FileEntry, FileStamp, ObjectEntry, Report, stamp
from .report_reading import read_report
from .written_meshes import GLB, STL, measured_distances, read_written

# Measure Deviation does not distinguish distances below this part of the tolerance from zero (docs/deviation.md).
PART_OF_TOLERANCE = 1e-3

# More levels than a Subdivision Surface modifier has.
MOST_LEVELS = 16

# The fields with the same value, and the fields that may be larger than proved now; distances differ by ROUNDING.
EXACT = ("faces", "vertices", "result", "result_faces", "triangles", "closed", "oriented")
AT_LEAST = ("deepest", "level")


def verify(path: Path) -> bool:
    """Check all claims of a report, and print the outcome; returns whether all claims hold and every tolerance is met.

    Raises ReportError if the report cannot be read.
    """
    report = read_report(path)
    are_good = []
    for entry in report.files:
        try:
            faults = list(_faults(report, entry))
        except (CommandError, OSError, ValueError) as fault:
            faults = [str(fault)]
        are_good.append(not faults)
        for text in faults or ["all that the report says holds"]:
            print(printable_lines(f"{entry.name}: {text}"), flush=True)
    return all(are_good)


def _faults(report: Report, entry: FileEntry) -> Iterator[str]:
    """The faults of a file. Raises CommandError, OSError and ValueError if the file cannot be checked."""
    files = (entry.source, entry.output, *entry.companions)
    faults = [*_contradictions(report, entry), *(fault for each in files for fault in _other_file(each))]
    yield from faults
    if faults:
        return
    largest = max(each.tolerance for each in entry.objects)
    for said, found in zip(entry.objects, _found_anew(report.action, entry), strict=True):
        for difference in _differences(said, found, largest):
            yield f"{said.name}: {difference}"


def _contradictions(report: Report, entry: FileEntry) -> Iterator[str]:
    """The contradictions in a file's entry, and claims that cannot be checked, with any contents of the files."""
    if entry.error is not None:
        yield f"it failed: {entry.error}"
    elif not entry.objects:
        yield "the report names no objects"
    elif entry.chosen is None:
        yield "the report does not say which objects were asked for"
    elif report.action == SUBDIVIDE and entry.output is None:
        yield "the adaptive mesh was not written, so that it cannot be checked"
    for each in entry.objects:
        if each.level is not None and each.level < (each.deepest or 0):
            yield f"{each.name}: the report says deepest {each.deepest}, and level {each.level} for all faces"
        if report.action == MEASURE and not _is_accurate(each):
            yield f"{each.name}: the distances measured are not as near to each other as its accuracy says"


def _is_accurate(entry: ObjectEntry) -> bool:
    """Whether the distances of an object measured unchanged are as near to each other as its settings demand, or too
    small a part of the tolerance to matter."""
    accuracy = entry.settings.get("accuracy")
    if entry.measured is None or not isinstance(accuracy, (int, float)):
        return False
    most = max((1 + accuracy) * entry.measured.reached, PART_OF_TOLERANCE * entry.tolerance)
    return entry.measured.proved <= most * (1 + ROUNDING)


def _other_file(stamped: FileStamp | None) -> Iterator[str]:
    """The reason why a file is not the reported file, or None."""
    if stamped is None:
        return
    checksum = stamp(stamped.path, None).sha256
    if checksum is None:
        yield f"{stamped.path} cannot be read"
    elif checksum != stamped.sha256:
        yield f"{stamped.path} is not the file that the report names: its SHA-256 is {checksum}"


def _found_anew(action: str, entry: FileEntry) -> list[ObjectEntry]:
    """The entries of the objects, found anew: depths are computed again, and written meshes measured."""
    objects = _reopened(action, entry)
    output, scene = entry.output, scene_unit(bpy.context.scene)
    if output is not None:
        _refuse_other_output(output, scene)
    targets = [] if output is None or action not in MAKING else surfaces_of(objects)
    keep_modifiers = [_keeps_modifiers(each) for each in objects]
    found = _computed_anew(action, entry.objects, objects)
    if action == MEASURE:
        settings = measure_settings(None)
        tasks = [prepare_measurement(bpy.context, [each], surface_object(each), settings) for each in objects]
        parts = [part for task in tasks for part in task.measured]
        return [_measured_anew(*each, scene) for each in zip(entry.objects, found, tasks, parts, strict=True)]
    if output is None or output.metres_per_unit is None or not targets:
        return found
    written = {each.result or each.name: each.triangles or 0 for each in entry.objects}
    parts = read_written(output.path, output.metres_per_unit / scene, written)
    found = [
        as_held(_measured_anew(*each, scene), each[-1])
        for each in zip(entry.objects, found, targets, parts, strict=True)
    ]
    if action == SUBDIVIDE:
        found = [
            each if keeps else _as_written(each, part, output, scene)
            for each, part, keeps in zip(found, parts, keep_modifiers, strict=True)
        ]
    return found


def _refuse_other_output(output: FileStamp, scene: float) -> None:
    """Raise CommandError if the reported unit of a written file is not the format's unit."""
    if not output.metres_per_unit:
        raise CommandError(f"the report does not say how long a unit of {output.path} is")
    is_blend = output.path.suffix.lower() == BLEND
    _refuse_other_unit(output, scene if is_blend else unit_of(output.path, output.metres_per_unit))


def _keeps_modifiers(blender_object: bpy.types.Object) -> bool:
    """Whether an adaptive mesh of the object has visible modifiers, so that the written mesh is another."""
    use_modifiers = bpy.context.scene.ccdepth.use_modifiers
    applied = applied_modifiers(blender_object, use_modifiers=use_modifiers)
    return any(each not in applied for each in shown_modifiers(blender_object))


def _computed_anew(
    action: str, entries: Sequence[ObjectEntry], objects: Sequence[bpy.types.Object]
) -> list[ObjectEntry]:
    """The entries of meshes that are not measured, found anew. Entries of adaptive meshes, which are not made again,
    keep the reported facts of their making."""
    settings = settings_of(action)
    if action not in (SUBDIVIDE, MEASURE):
        found = [each for each, _ in ACTIONS[action](objects, settings)]
        return [_at_the_level(*pair) for pair in zip(entries, found, strict=True)]
    found = [
        ObjectEntry(said.name, settings, said.tolerance, len(each.data.polygons))
        for said, each in zip(entries, objects, strict=True)
    ]
    if action == MEASURE:
        return found
    return [
        replace(
            each, result=said.result or "", result_faces=said.result_faces or 0, deepest=said.deepest or 0, proved=0.0
        )
        for said, each in zip(entries, found, strict=True)
    ]


def _at_the_level(said: ObjectEntry, found: ObjectEntry) -> ObjectEntry:
    """The entry found anew, with the number of faces at the reported level if a lower level is proved: each level has
    four faces for one, and the first a face for each corner."""
    more = min(said.level or 0, MOST_LEVELS) - (found.level or 0)
    if more <= 0 or found.result_faces is None:
        return found
    return replace(found, result_faces=found.result_faces * 4**more if found.level else said.result_faces)


def _measured_anew(
    said: ObjectEntry, found: ObjectEntry, target: MeasureTask, part: Measured, unit: float
) -> ObjectEntry:
    """The entry with a measured mesh: measured until its distance is known to be as small as reported, or not."""
    tolerance = target.surface.tolerance
    surface = replace(target.surface, tolerance=min(tolerance, _told(said) / unit))
    answer = measured_distances(replace(target, surface=surface), part, measure_settings(None))
    return with_answer(found, replace(answer, tolerance=tolerance), unit)


def _as_written(found: ObjectEntry, part: Measured, output: FileStamp, scene: float) -> ObjectEntry:
    """The entry of an adaptive mesh with the faces of the file, and with the least distance that can have been proved
    before writing.

    The file holds the proved mesh but for roundings. Writer and reader place the mesh with matrices in single
    precision, at most a dozen roundings of 2⁻²⁴ in each of three coordinates: √3 · 12 · 2⁻²⁴ < 1.3e-6 of the largest
    coordinate. .obj files have six decimals: √3 / 2 · 1e-6 of a unit. Twice ROUNDING of both is more.
    """
    assert found.measured is not None
    assert output.metres_per_unit is not None
    size = float(np.abs(part.shown.positions_from(np.zeros(3))).max()) * scene
    least = max(0.0, found.measured.reached - ROUNDING * 2 * (size + output.metres_per_unit))
    # Other files hold triangles alone, of which there are no fewer than faces.
    if output.path.suffix.lower() in (STL, GLB):
        faces = min(found.result_faces or 0, len(part.shown.triangles.corners))
    else:
        faces = len(np.unique(part.shown.triangles.faces))
    return replace(found, result_faces=faces, proved=least)


def _told(said: ObjectEntry) -> float:
    """The largest distance, in metres, of an entry's measurement, but for rounding."""
    return inf if said.measured is None else said.measured.proved * (1 + ROUNDING)


def _reopened(action: str, entry: FileEntry) -> list[bpy.types.Object]:
    """The objects of an entry, from its opened file, with its settings in the scene. Raises CommandError, also if these
    are not all requested objects."""
    source, names = entry.source, [each.name for each in entry.objects]
    path, unit = (None, None) if source is None else (source.path, source.metres_per_unit)
    load(path, unit)
    if source is not None:
        _refuse_other_unit(source, scene_unit(bpy.context.scene))
    assert entry.chosen is not None
    found, left_out = chosen_objects(path, entry.chosen.objects, entry.chosen.collection)
    objects, error = evaluated_objects(path, found)
    if error is not None:
        raise CommandError(error)
    if entry.left_out != left_out:
        raise CommandError(f"the report says that {entry.left_out} are left out, but these are {left_out}")
    by_name = {each.name: each for each in objects}
    others = by_name.keys() ^ set(names)
    if others or len(by_name) != len(names):
        raise CommandError(f"its objects are not those that were asked for, each once: {', '.join(sorted(others))}")
    _take_settings(action, entry.objects)
    return [by_name[name] for name in names]


def _refuse_other_unit(stamped: FileStamp, unit: float) -> None:
    """Raise CommandError if the unit of a file, in metres, is not the reported unit."""
    if stamped.metres_per_unit is None or not isclose(stamped.metres_per_unit, unit, rel_tol=ROUNDING):
        raise CommandError(
            f"the report says that a unit of {stamped.path} is {stamped.metres_per_unit} m, but it is {unit} m"
        )


def _take_settings(action: str, entries: Sequence[ObjectEntry]) -> None:
    """Put the reported settings into the scene. Raises CommandError for impossible settings."""
    settings, holder = entries[0].settings, bpy.context.scene.ccdepth
    if any(each.settings != settings for each in entries) or settings.keys() != {"tolerance", *SETTINGS[action]}:
        raise CommandError("the settings in the report are not those of a run")
    try:
        for name in SETTINGS[action]:
            setattr(holder, name, settings[name])
        set_scene_tolerance(holder, settings["tolerance"])
    except (TypeError, ValueError) as fault:
        raise CommandError(f"the settings in the report cannot be used: {fault}") from fault


def _differences(said: ObjectEntry, found: ObjectEntry, largest: float) -> Iterator[str]:
    """The differences of an object from the report. largest: the largest tolerance of the objects in its file."""
    wrong = [name for name in EXACT if getattr(said, name) != getattr(found, name)]
    wrong += [name for name in AT_LEAST if not _is_at_least(getattr(said, name), getattr(found, name))]
    if not isclose(said.tolerance, found.tolerance, rel_tol=ROUNDING):
        wrong.append("tolerance")
    # A version that proves lower depths and levels reports other distances and frames.
    is_lower = any(getattr(said, name) != getattr(found, name) for name in AT_LEAST)
    one, other = said.worst_frame, found.worst_frame
    if (one is None) != (other is None) or (one != other and not is_lower):
        wrong.append("worst_frame")
    # Over frames the tolerance told is the smallest one, if they differ.
    is_smallest = other is not None and said.settings["tolerance_mode"] == "RELATIVE"
    most = inf if is_smallest or found.proved is None else max(largest, found.proved)
    least = 0.0 if is_lower and found.proved is not None else found.proved
    if not _is_at_least(said.proved, least) or (said.proved or 0.0) > most * (1 + ROUNDING):
        wrong.append("proved")
    for name in wrong:
        yield f"the report says {name} {getattr(said, name)}, but it is {getattr(found, name)}"
    yield from _measured_differences(said, found)


def _is_at_least(one: float | None, other: float | None) -> bool:
    """Whether a number is at least another, but for rounding; or both are missing."""
    if one is None or other is None:
        return one is other
    return one * (1 + ROUNDING) >= other


def _measured_differences(said: ObjectEntry, found: ObjectEntry) -> Iterator[str]:
    """The differences of measured distances from the report."""
    one, other = said.measured, found.measured
    if one is None and other is not None:
        yield "the report does not say how far what was written is from the limit surface"
    elif one is not None and other is not None:
        # A mesh beyond the tolerance is measured only up to that verdict.
        is_proved = other.proved <= _told(said) or not said.met
        if not is_proved or other.reached > _told(said) or one.reached > other.proved * (1 + ROUNDING):
            yield (
                f"the report says a distance from {one.reached} m to {one.proved} m, but it is from {other.reached} m "
                f"to {other.proved} m"
            )
    if found.met is False:
        yield "it is not proved to be within the tolerance"
    elif found.met is None and (said.met is not None or said.measured is not None):
        yield "the report gives a measured distance, but no file in which to measure it again"
    elif said.met is False:
        yield "the report says that it is not within the tolerance, but it is"
