# SPDX-License-Identifier: GPL-3.0-or-later
"""A report checked again: whether the files are those it tells of, and all that it says is found anew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isclose
from pathlib import Path

import bpy

from ..state.properties import tolerance_name
from ..ui.printable import printable_lines
from .arguments import MAKING, SUBDIVIDE
from .blender_calls import CommandError
from .mesh_files import load, scene_unit
from .one_file import ACTIONS, SETTINGS, chosen_objects, measure_settings, settings_of, surfaces_of, with_answer
from .report import FileEntry, FileStamp, ObjectEntry, read_report, stamp
from .written_meshes import WrittenObject, measured_distances, read_written

# Files hold some lengths in single precision.
ROUNDING = 1e-6

EXACT = ("faces", "deepest", "level", "result_faces")


def verify(path: Path) -> bool:
    """Check all that a report says, and print it; returns whether all of it is so and every tolerance is met.

    Raises ReportError and OSError when it cannot be read.
    """
    report = read_report(path)
    are_good = []
    for entry in report.files:
        try:
            faults = list(_faults(report.action, entry))
        except (CommandError, OSError) as fault:
            faults = [str(fault)]
        are_good.append(not faults)
        for text in faults or ["all that the report says holds"]:
            print(printable_lines(f"{entry.name}: {text}"), flush=True)
    return all(are_good)


def _faults(action: str, entry: FileEntry) -> Iterator[str]:
    """What does not hold of a file. Raises CommandError and OSError when it cannot be checked."""
    if entry.error is not None:
        yield f"it failed: {entry.error}"
        return
    others = [*_other_file(entry.source), *_other_file(entry.output)]
    yield from others
    if others:
        return
    for said, found in zip(entry.objects, _found_anew(action, entry), strict=True):
        for difference in _differences(said, found):
            yield f"{said.name}: {difference}"


def _other_file(stamped: FileStamp | None) -> Iterator[str]:
    if stamped is None:
        return
    checksum = stamp(stamped.path, None).sha256
    if checksum is None:
        yield f"{stamped.path} cannot be read"
    elif checksum != stamped.sha256:
        yield f"{stamped.path} is not the file that the report tells of: its SHA-256 is {checksum}"


def _found_anew(action: str, entry: FileEntry) -> list[ObjectEntry]:
    """The entries of the objects, found anew: what was computed is computed again, and what was written measured."""
    source = entry.source
    path, unit = (None, None) if source is None else (source.path, source.metres_per_unit)
    load(path, unit)
    by_name = {each.name: each for each in chosen_objects(path, [each.name for each in entry.objects])}
    objects = [by_name[each.name] for each in entry.objects]
    _take_settings(action, entry.objects)
    is_measured = action in MAKING and entry.output is not None
    targets = surfaces_of(objects) if is_measured else []
    if action == SUBDIVIDE:
        found = [
            replace(said, faces=len(each.data.polygons)) for said, each in zip(entry.objects, objects, strict=True)
        ]
    else:
        found = [each.entry for each in ACTIONS[action](objects, settings_of(action))]
    if entry.output is None or not is_measured:
        return found
    settings, scene = measure_settings(None), scene_unit(bpy.context.scene)
    written = [WrittenObject(each.result or each.name, each.triangles or 0) for each in entry.objects]
    parts = read_written(entry.output.path, (entry.output.metres_per_unit or scene) / scene, written)
    answers = [measured_distances(*pair, settings) for pair in zip(targets, parts, strict=True)]
    return [with_answer(*pair, scene) for pair in zip(found, answers, strict=True)]


def _take_settings(action: str, entries: Sequence[ObjectEntry]) -> None:
    """Put what the report says into the scene. Raises CommandError for what cannot be."""
    settings, holder = entries[0].settings, bpy.context.scene.ccdepth
    if any(each.settings != settings for each in entries) or settings.keys() != {"tolerance", *SETTINGS[action]}:
        raise CommandError("the settings in the report are not those of a run")
    try:
        for name in SETTINGS[action]:
            setattr(holder, name, settings[name])
        setattr(holder, tolerance_name(holder.tolerance_mode), settings["tolerance"])
    except (TypeError, ValueError) as fault:
        raise CommandError(f"the settings in the report cannot be used: {fault}") from fault


def _differences(said: ObjectEntry, found: ObjectEntry) -> Iterator[str]:
    for name in EXACT:
        if getattr(said, name) != getattr(found, name):
            yield f"the report says {name} {getattr(said, name)}, and it is {getattr(found, name)}"
    for name in ("tolerance", "proved"):
        one, other = getattr(said, name), getattr(found, name)
        if (one is None) != (other is None) or (one is not None and not isclose(one, other, rel_tol=ROUNDING)):
            yield f"the report says {name} {one} m, and it is {other} m"
    if said.measured is not None and found.measured is not None:
        one, other = said.measured, found.measured
        # Each pair holds the true distance, so both have a part in common.
        if one.proved < other.reached or other.proved < one.reached:
            yield (
                f"the report says a distance from {one.reached} m to {one.proved} m, and it is from {other.reached} m "
                f"to {other.proved} m"
            )
    if found.met is False:
        yield "it is not proved to be within the tolerance"
    elif said.met is not None and said.met != found.met:
        yield "the report says that it is not within the tolerance, and it is"
