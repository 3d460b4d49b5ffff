# SPDX-License-Identifier: GPL-3.0-or-later
"""The check of a report: it does not contradict itself, its files have not changed, and its claims are proved once
more, as docs/report.md says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf, isclose
from pathlib import Path

import bpy

from ..exchange.blender_calls import CommandError
from ..exchange.mesh_files import BLEND, load, unit_of
from ..state.chosen import surface_object
from ..state.properties import set_scene_tolerance
from ..tasks.deviation_task import Measured, MeasureTask, prepare_measurement
from ..tasks.surfaces import scene_unit
from ..ui.lengths import printable_lines
from .arguments import MAKING
from .chosen_objects import chosen_objects
from .one_file import (
    ACTIONS,
    SETTINGS,
    as_held,
    evaluated_objects,
    levels_of,
    measure_settings,
    settings_of,
    surfaces_of,
    with_answer,
)
from .report import DEPTHS, LEVELS, LODS, MEASURE, ROUNDING, SUBDIVIDE, FileEntry, FileStamp, ObjectEntry, stamp
from .report_reading import read_report
from .written_meshes import measured_distances, read_written

# The numbers that are the same, and the numbers that may be larger than proved now; lengths differ by ROUNDING.
EXACT = ("faces", "triangles", "closed", "oriented")
AT_LEAST = ("deepest", "level", "proved")


def verify(path: Path) -> bool:
    """Check all claims of a report, and print the outcome; returns whether all claims hold and every tolerance is met.

    Raises ReportError if the report cannot be read.
    """
    report = read_report(path)
    is_good = True
    for entry in report.files:
        try:
            faults = list(_contradictions(report.action, entry)) or list(_differences(report.action, entry))
        except (CommandError, OSError, TypeError, ValueError) as fault:
            faults = [str(fault)]
        is_good &= not faults
        for text in faults or ["all that the report says holds"]:
            print(printable_lines(f"{entry.name}: {text}"), flush=True)
    return is_good


def _contradictions(action: str, entry: FileEntry) -> Iterator[str]:
    """The contradictions in a file's entry, the claims that cannot be checked, and its other files."""
    if entry.error is not None:
        yield f"it failed: {entry.error}"
    elif not entry.objects:
        yield "the report names no objects"
    elif entry.chosen is None:
        yield "the report does not say which objects were asked for"
    elif action in (SUBDIVIDE, LODS) and entry.output is None:
        yield "the adaptive mesh was not written, so that it cannot be checked"
    for each in entry.objects:
        if each.met is False:
            yield f"{each.name}: it is not within the tolerance"
        for proved, allowed in (("proved_shading", "shading_angle"), ("proved_facets", "facet_angle")):
            angle = getattr(each, proved)
            if angle is not None and not angle <= each.settings.get(allowed, 0.0) * (1 + ROUNDING):
                yield f"{each.name}: the report says {proved} {angle}, beyond its {allowed}"
    yield from _other_files([each for each in (entry.source, entry.output, *entry.companions) if each is not None])


def _other_files(stamps: Sequence[FileStamp]) -> Iterator[str]:
    """The files that are not those of the report."""
    for stamped in stamps:
        checksum = stamp(stamped.path, None).sha256
        if checksum is None:
            yield f"{stamped.path} cannot be read"
        elif checksum != stamped.sha256:
            yield f"{stamped.path} is not the file that the report names: its SHA-256 is {checksum}"


def _differences(action: str, entry: FileEntry) -> Iterator[str]:
    """The claims about a file's objects that do not hold. Raises CommandError, OSError and ValueError if they cannot be
    checked."""
    for said, found in zip(entry.objects, _found_anew(action, entry), strict=True):
        wrong = [name for name in EXACT if getattr(said, name) != getattr(found, name)]
        wrong += [name for name in AT_LEAST if not _is_at_least(getattr(said, name), getattr(found, name))]
        if said.proved is not None and (said.deepest, said.level) != (found.deepest, found.level):
            # A version that proves lower depths proves other distances.
            wrong = [name for name in wrong if name != "proved"]
        if not isclose(said.tolerance, found.tolerance, rel_tol=ROUNDING):
            wrong.append("tolerance")
        if not _are_near(said.factors, found.factors):
            wrong.append("factors")
        if not _is_proved(said, found):
            wrong.append("measured")
        if said.met != found.met:
            wrong.append("met")
        for name in wrong:
            yield f"{said.name}: the report says {name} {getattr(said, name)}, but it is {getattr(found, name)}"


def _is_at_least(one: float | None, other: float | None) -> bool:
    """Whether a number is at least another, but for rounding; or both are missing."""
    if one is None or other is None:
        return one is other
    return one * (1 + ROUNDING) >= other


def _are_near(some: Sequence[float] | None, others: Sequence[float] | None) -> bool:
    """Whether factors are equal but for rounding; or both are missing."""
    if some is None or others is None:
        return some is others
    return all(isclose(*pair, rel_tol=ROUNDING) for pair in zip(some, others, strict=True))


def _is_proved(said: ObjectEntry, found: ObjectEntry) -> bool:
    """Whether measured distances are proved; or both are missing."""
    if said.measured is None or found.measured is None:
        return said.measured is found.measured
    is_reached = said.measured.reached <= found.measured.proved * (1 + ROUNDING)
    return is_reached and found.measured.proved <= _told(said)


def _told(said: ObjectEntry) -> float:
    """The largest distance, in metres, of an entry's measurement, but for rounding."""
    return inf if said.measured is None else said.measured.proved * (1 + ROUNDING)


def _found_anew(action: str, entry: FileEntry) -> list[ObjectEntry]:
    """The entries of the objects, found anew: depths are computed again, and the meshes that were written, or for
    ``measure`` shown, are measured."""
    objects, output, scene = _reopened(action, entry), entry.output, scene_unit(bpy.context.scene)
    if output is not None:
        is_blend = output.path.suffix.lower() == BLEND
        _refuse_other_unit(output, scene if is_blend else unit_of(output.path, output.metres_per_unit))
    if action == MEASURE:
        settings = measure_settings(None)
        targets = [prepare_measurement(bpy.context, [each], surface_object(each), settings) for each in objects]
        parts = [part for task in targets for part in task.measured]
    else:
        is_written = output is not None and action in MAKING
        targets = surfaces_of([*dict.fromkeys(objects)], levels_of(action)) if is_written else []
    if action in (DEPTHS, LEVELS):
        found = [each for each, _ in ACTIONS[action](objects, settings_of(action))]
    else:
        found = [_unmeasured(action, *pair) for pair in zip(entry.objects, objects, strict=True)]
    if targets and action != MEASURE:
        assert output is not None
        assert output.metres_per_unit is not None
        written = {each.result or each.name: each.triangles or 0 for each in entry.objects}
        parts = read_written(output.path, output.metres_per_unit / scene, written)
        found = [as_held(*pair) for pair in zip(found, parts, strict=True)]
    if not targets:
        return found
    return [_measured_anew(*each, scene) for each in zip(entry.objects, found, targets, parts, strict=True)]


def _unmeasured(action: str, said: ObjectEntry, blender_object: bpy.types.Object) -> ObjectEntry:
    """The entry of an object to be measured. Adaptive meshes are not made again: the facts about their making stay as
    reported."""
    found = ObjectEntry(said.name, said.settings, said.tolerance, len(blender_object.data.polygons))
    return replace(found, deepest=said.deepest, proved=said.proved) if action in (SUBDIVIDE, LODS) else found


def _measured_anew(
    said: ObjectEntry, found: ObjectEntry, target: MeasureTask, part: Measured, unit: float
) -> ObjectEntry:
    """The entry with a measured mesh: measured until its distance is known to be as small as reported, or not."""
    tolerance = target.surface.tolerance
    surface = replace(target.surface, tolerance=min(tolerance, _told(said) / unit))
    answer = measured_distances(replace(target, surface=surface), part, measure_settings(None))
    return with_answer(found, replace(answer, tolerance=tolerance), unit)


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
    _take_settings(action, entry)
    wanted = [*by_name] * len(levels_of(action))
    if sorted(wanted) != sorted(names):
        raise CommandError(f"its objects are not those that were asked for, each once: {', '.join(sorted(by_name))}")
    return [by_name[name] for name in names]


def _refuse_other_unit(stamped: FileStamp, unit: float) -> None:
    """Raise CommandError if the unit of a file, in metres, is not the reported unit."""
    if stamped.metres_per_unit is None or not isclose(stamped.metres_per_unit, unit, rel_tol=ROUNDING):
        raise CommandError(
            f"the report says that a unit of {stamped.path} is {stamped.metres_per_unit} m, but it is {unit} m"
        )


def _take_settings(action: str, entry: FileEntry) -> None:
    """Put the reported settings into the scene. Raises CommandError for impossible settings."""
    settings, holder = entry.objects[0].settings, bpy.context.scene.ccdepth
    if any(each.settings != settings for each in entry.objects) or settings.keys() != {"tolerance", *SETTINGS[action]}:
        raise CommandError("the settings in the report are not those of a run")
    try:
        for name in SETTINGS[action]:
            setattr(holder, name, settings[name])
        set_scene_tolerance(holder, settings["tolerance"])
    except (TypeError, ValueError) as fault:
        raise CommandError(f"the settings in the report cannot be used: {fault}") from fault
