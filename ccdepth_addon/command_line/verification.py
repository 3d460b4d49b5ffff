# SPDX-License-Identifier: GPL-3.0-or-later
"""Check a report again: that its files have not changed, and that all it says is found once more."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isclose
from pathlib import Path

import bpy

from ..state.properties import set_scene_tolerance
from ..ui.printable import printable_lines
from .arguments import MAKING, SUBDIVIDE
from .blender_calls import CommandError
from .chosen_objects import chosen_objects
from .mesh_files import load, scene_unit
from .one_file import ACTIONS, SETTINGS, evaluated_objects, measure_settings, settings_of, surfaces_of, with_answer
from .report import FileEntry, FileStamp, ObjectEntry, read_report, stamp
from .written_meshes import WrittenObject, measured_distances, read_written

# Files hold some lengths in single precision.
ROUNDING = 1e-6

EXACT = ("faces", "deepest", "level", "result_faces", "worst_frame")


def verify(path: Path) -> bool:
    """Check all that a report says, and print it; returns whether all of it is so and every tolerance is met.

    Raises ReportError when it cannot be read.
    """
    report = read_report(path)
    are_good = []
    for entry in report.files:
        try:
            faults = list(_faults(report.action, entry))
        except (CommandError, OSError, ValueError) as fault:
            faults = [str(fault)]
        are_good.append(not faults)
        for text in faults or ["all that the report says holds"]:
            print(printable_lines(f"{entry.name}: {text}"), flush=True)
    return all(are_good)


def _faults(action: str, entry: FileEntry) -> Iterator[str]:
    """What does not hold of a file. Raises CommandError, OSError and ValueError when it cannot be checked."""
    if entry.error is not None:
        yield f"it failed: {entry.error}"
        return
    if not entry.objects:
        yield "the report names no objects"
        return
    if action == SUBDIVIDE and entry.output is None:
        yield "the adaptive mesh was not written, so that it cannot be checked"
        return
    others = [*other_file(entry.source), *other_file(entry.output)]
    yield from others
    if others:
        return
    for said, found in zip(entry.objects, _found_anew(action, entry), strict=True):
        for difference in _differences(said, found):
            yield f"{said.name}: {difference}"


def other_file(stamped: FileStamp | None) -> Iterator[str]:
    """Why a file is not the one that a report names, if it is not."""
    if stamped is None:
        return
    checksum = stamp(stamped.path, None).sha256
    if checksum is None:
        yield f"{stamped.path} cannot be read"
    elif checksum != stamped.sha256:
        yield f"{stamped.path} is not the file that the report names: its SHA-256 is {checksum}"


def _found_anew(action: str, entry: FileEntry) -> list[ObjectEntry]:
    """The entries of the objects, found anew: what was computed is computed again, and what was written measured."""
    objects = reopened(action, entry)
    output = entry.output if action in MAKING else None
    targets = [] if output is None else surfaces_of(objects)
    if action == SUBDIVIDE:
        found = [
            replace(said, faces=len(each.data.polygons), measured=None, met=None)
            for said, each in zip(entry.objects, objects, strict=True)
        ]
    else:
        found = [each.entry for each in ACTIONS[action](objects, settings_of(action))]
    if output is None:
        return found
    if not output.metres_per_unit:
        raise CommandError(f"the report does not say how long a unit of {output.path} is")
    settings, scene = measure_settings(None), scene_unit(bpy.context.scene)
    written = [WrittenObject(each.result or each.name, each.triangles or 0) for each in entry.objects]
    parts = read_written(output.path, output.metres_per_unit / scene, written)
    answers = [measured_distances(*pair, settings) for pair in zip(targets, parts, strict=True)]
    return [with_answer(*pair, scene) for pair in zip(found, answers, strict=True)]


def reopened(action: str, entry: FileEntry) -> list[bpy.types.Object]:
    """Open the file of an entry, with its settings in the scene: the objects of the entry. Raises
    CommandError."""
    source = entry.source
    path, unit = (None, None) if source is None else (source.path, source.metres_per_unit)
    load(path, unit)
    if source is not None:
        _refuse_other_unit(source)
    objects, error = evaluated_objects(path, chosen_objects(path, [each.name for each in entry.objects]))
    if error is not None:
        raise CommandError(error)
    by_name = {each.name: each for each in objects}
    _take_settings(action, entry.objects)
    return [by_name[each.name] for each in entry.objects]


def _refuse_other_unit(source: FileStamp) -> None:
    """Raise CommandError when the open file's unit is not the one in the report."""
    unit = scene_unit(bpy.context.scene)
    if source.metres_per_unit is None or not isclose(source.metres_per_unit, unit, rel_tol=ROUNDING):
        raise CommandError(f"the report says that a unit of it is {source.metres_per_unit} m, but it is {unit} m")


def _take_settings(action: str, entries: Sequence[ObjectEntry]) -> None:
    """Put what the report says into the scene. Raises CommandError for what cannot be."""
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
    for name in EXACT:
        if getattr(said, name) != getattr(found, name):
            yield f"the report says {name} {getattr(said, name)}, but it is {getattr(found, name)}"
    for name in ("tolerance", "proved"):
        one, other = getattr(said, name), getattr(found, name)
        if (one is None) != (other is None) or (one is not None and not isclose(one, other, rel_tol=ROUNDING)):
            yield f"the report says {name} {one} m, but it is {other} m"
    one, other = said.measured, found.measured
    # Each pair holds the true distance, so both have a part in common.
    if one is not None and other is not None and (one.proved < other.reached or other.proved < one.reached):
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
