# SPDX-License-Identifier: GPL-3.0-or-later
"""The check of a report: it does not contradict itself, its files have not changed, and its claims are proved once
more, as docs/report.md says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf, isclose
from pathlib import Path

import bpy

from ..state.chosen import surface_object
from ..state.properties import set_scene_tolerance
from ..tasks.deviation_task import Measured, MeasureTask, prepare_measurement
from ..ui.lengths import printable_lines
from .arguments import MAKING, MEASURE, SUBDIVIDE
from .blender_calls import CommandError
from .chosen_objects import chosen_objects
from .mesh_files import BLEND, load, scene_unit, unit_of
from .one_file import (
    ACTIONS,
    SETTINGS,
    as_held,
    evaluated_objects,
    measure_settings,
    settings_of,
    surfaces_of,
    with_answer,
)
from .report import ROUNDING, FileEntry, FileStamp, ObjectEntry, Report, stamp
from .report_reading import read_report
from .written_meshes import measured_distances, read_written

# Measure Deviation does not distinguish distances below this part of the tolerance from zero (docs/deviation.md).
PART_OF_TOLERANCE = 1e-3

# The numbers that are the same, and the numbers that may be larger than proved now; lengths differ by ROUNDING.
EXACT = ("faces", "triangles", "closed", "oriented")
AT_LEAST = ("deepest", "level", "proved")


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
    for said, found in zip(entry.objects, _found_anew(report.action, entry), strict=True):
        for difference in _differences(said, found):
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
        for name, allowed in (("proved_shading", "shading_angle"), ("proved_facets", "facet_angle")):
            said = getattr(each, name)
            if said is not None and not said <= each.settings.get(allowed, 0.0) * (1 + ROUNDING):
                yield f"{each.name}: the report says {name} {said}, beyond its {allowed}"
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
    if action == MEASURE:
        found = [_unmeasured(said, each) for said, each in zip(entry.objects, objects, strict=True)]
        settings = measure_settings(None)
        targets = [prepare_measurement(bpy.context, [each], surface_object(each), settings) for each in objects]
        parts = [part for task in targets for part in task.measured]
        return [_measured_anew(*each, scene) for each in zip(entry.objects, found, targets, parts, strict=True)]
    targets = surfaces_of(objects) if output is not None and action in MAKING else []
    if action == SUBDIVIDE:
        # Adaptive meshes are not made again: the facts about their making stay as reported.
        found = [
            replace(_unmeasured(said, each), deepest=said.deepest or 0, proved=said.proved or 0.0)
            for said, each in zip(entry.objects, objects, strict=True)
        ]
    else:
        found = [each for each, _ in ACTIONS[action](objects, settings_of(action))]
    if output is None or output.metres_per_unit is None or not targets:
        return found
    written = {each.result or each.name: each.triangles or 0 for each in entry.objects}
    parts = read_written(output.path, output.metres_per_unit / scene, written)
    return [
        as_held(_measured_anew(*each, scene), each[-1])
        for each in zip(entry.objects, found, targets, parts, strict=True)
    ]


def _unmeasured(said: ObjectEntry, blender_object: bpy.types.Object) -> ObjectEntry:
    """The entry of an object to be measured."""
    return ObjectEntry(said.name, said.settings, said.tolerance, len(blender_object.data.polygons))


def _refuse_other_output(output: FileStamp, scene: float) -> None:
    """Raise CommandError if the reported unit of a written file is not the format's unit."""
    if not output.metres_per_unit:
        raise CommandError(f"the report does not say how long a unit of {output.path} is")
    is_blend = output.path.suffix.lower() == BLEND
    _refuse_other_unit(output, scene if is_blend else unit_of(output.path, output.metres_per_unit))


def _measured_anew(
    said: ObjectEntry, found: ObjectEntry, target: MeasureTask, part: Measured, unit: float
) -> ObjectEntry:
    """The entry with a measured mesh: measured until its distance is known to be as small as reported, or not."""
    tolerance = target.surface.tolerance
    surface = replace(target.surface, tolerance=min(tolerance, _told(said) / unit))
    answer = measured_distances(replace(target, surface=surface), part, measure_settings(None))
    return with_answer(found, replace(answer, tolerance=tolerance), unit)


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


def _differences(said: ObjectEntry, found: ObjectEntry) -> Iterator[str]:
    """The differences of an object from the report."""
    wrong = [name for name in EXACT if getattr(said, name) != getattr(found, name)]
    wrong += [name for name in AT_LEAST if not _is_at_least(getattr(said, name), getattr(found, name))]
    if said.proved is not None and (said.deepest, said.level) != (found.deepest, found.level):
        # A version that proves lower depths proves other distances.
        wrong = [name for name in wrong if name != "proved"]
    if not isclose(said.tolerance, found.tolerance, rel_tol=ROUNDING):
        wrong.append("tolerance")
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
