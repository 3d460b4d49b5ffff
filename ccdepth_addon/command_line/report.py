# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a run: what was found and made of each file and object. As JSON it is a certificate that can be checked
again (docs/report.md), as CSV a table with a row for each object. All lengths are in metres."""

from __future__ import annotations

import csv
import io
import json
import os
from base64 import b64decode, b64encode
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, is_dataclass
from functools import partial
from hashlib import file_digest
from math import inf, nextafter
from operator import attrgetter
from pathlib import Path
from types import UnionType
from typing import Any, NewType, Union, get_args, get_origin, get_type_hints

import bpy

from .. import version
from ..core import VERTICES
from ..ui.printable import printable_lines
from .arguments import DEPTHS, LEVELS, MAKING, MEASURE, SUBDIVIDE

FORMAT, FORMAT_VERSION = "ccdepth-report", 2
OLD_VERSION = 1
FIELDS = {"format", "version", "program", "blender", "action", "met", "files"}
PROGRAM = {"name": "CC Depth", "version": version()}

# What reports of version 1 do not tell: which objects of a file were asked for, and two things of what was written.
UNTOLD_OF_FILES: dict[str, Any] = {"chosen": None}
UNTOLD_OF_OBJECTS: dict[str, Any] = {"closed": None, "oriented": None}

# Relative. Blender keeps some lengths in single precision, whose roundings are 6e-8 of a number: a dozen of them, and
# what another order of additions makes of double precision, which is far less, stay within this.
ROUNDING = 1e-6


# A frame of an animation; there are negative ones.
Frame = NewType("Frame", int)


class ReportError(ValueError):
    """A file cannot be read as a report; the message says why."""


def metres_rounded_up(length: float, metres_per_unit: float) -> float:
    """A proved length of the scene in metres, rounded up."""
    return nextafter(length * metres_per_unit, inf)


@dataclass(frozen=True)
class Distances:
    """proved: the distance between mesh and limit surface is at most this, both ways. reached: it is at least this."""

    proved: float
    reached: float

    @classmethod
    def of(cls, proved: float, reached: float, metres_per_unit: float) -> Distances:
        """Of lengths of the scene."""
        least = max(0.0, nextafter(reached * metres_per_unit, 0.0))
        return cls(metres_rounded_up(proved, metres_per_unit), least)


@dataclass(frozen=True)
class ObjectEntry:
    """What was found of an object.

    name: the object whose limit surface it is; result: the object that was made of it, if another. settings: as they
    were given, by their names. tolerance: as a length. faces: of its mesh; vertices: those that depths were computed
    for, CONTROL or LIMIT; result_faces: of what was made of it; triangles: of what was written and measured. deepest:
    the deepest depth of a face; level: the first at which all faces are within the tolerance; worst_frame: of depths
    over frames. proved: the largest distance proved when it was made. measured: by Measure Deviation, on what was
    written. met: whether the tolerance is met; None where nothing was measured. closed, oriented: of what was written
    and measured, as of ``written_meshes.Edges``.
    """

    name: str
    settings: dict[str, Any]
    tolerance: float
    faces: int
    vertices: str | None = None
    result: str | None = None
    result_faces: int | None = None
    triangles: int | None = None
    deepest: int | None = None
    level: int | None = None
    worst_frame: Frame | None = None
    proved: float | None = None
    measured: Distances | None = None
    met: bool | None = None
    closed: bool | None = None
    oriented: bool | None = None


@dataclass(frozen=True)
class FileStamp:
    """A file as it was. sha256: of its content; None where it could not be read."""

    path: Path
    sha256: str | None
    metres_per_unit: float | None


@dataclass(frozen=True)
class Chosen:
    """Which objects of a file were asked for: those of these names and of this collection; all without any."""

    objects: list[str] | None
    collection: str | None


@dataclass(frozen=True)
class ReportPictures:
    """What the page shows of an object beside its numbers: how many faces have which depth, from the least on, and
    pictures, as WebP files, or PNG files from a Blender that cannot write those."""

    faces_by_depth: tuple[tuple[int, int], ...]
    heat_map: bytes
    wireframe: bytes


@dataclass(frozen=True)
class FileEntry:
    """What was done with a file. source: None for Blender's Suzanne. error: why it failed, if it did.
    chosen: None where no object was done. left_out: why objects were, by their names: HIDDEN, COLLECTION_INSTANCE or
    their type in Blender; None where it is not told. companions: files that were written beside the output and belong
    to it. lost: what of the objects these do not hold. pictures: one for each object where a page is to be written or
    the report is to hold them, else none."""

    source: FileStamp | None
    objects: tuple[ObjectEntry, ...] = ()
    output: FileStamp | None = None
    error: str | None = None
    chosen: Chosen | None = None
    left_out: dict[str, str] | None = None
    companions: tuple[FileStamp, ...] = ()
    lost: tuple[str, ...] = ()
    pictures: tuple[ReportPictures, ...] = ()

    @property
    def is_good(self) -> bool:
        """Whether it did not fail, and every tolerance that was to be met is."""
        return self.error is None and all(each.met is not False for each in self.objects)

    @property
    def name(self) -> str:
        return name_of(None if self.source is None else self.source.path)


@dataclass(frozen=True)
class Report:
    """What a run did: depths, levels, subdivide or measure. version: of the format that it was read from. is_own:
    whether this version of CC Depth made it, in this version of Blender."""

    action: str
    files: tuple[FileEntry, ...]
    version: int = FORMAT_VERSION
    is_own: bool = True

    @property
    def is_good(self) -> bool:
        return all(each.is_good for each in self.files)


def name_of(source: Path | None) -> str:
    """What a file is called: as it was given, and Blender's Suzanne, which is none, by its name."""
    return "Suzanne" if source is None else str(source)


def stamp(path: Path, metres_per_unit: float | None) -> FileStamp:
    """The file as it is now."""
    checksum = None
    # A pipe would be waited for.
    if path.is_file():
        with suppress(OSError), path.open("rb") as file:
            checksum = file_digest(file, "sha256").hexdigest()
    return FileStamp(path, checksum, metres_per_unit)


def json_text(report: Report, folder: Path | None, with_pictures: bool) -> str:
    """The report as JSON. folder: where it will be; files are named as seen from there, or else with their full
    paths."""
    content = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "program": PROGRAM,
        "blender": bpy.app.version_string,
        "action": report.action,
        "met": report.is_good,
        "files": [_file_content(each, with_pictures) for each in report.files],
    }
    written = partial(_written, folder)
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False, default=written) + "\n"


def _file_content(entry: FileEntry, with_pictures: bool) -> dict[str, Any]:
    content = asdict(entry)
    content = {"input": content.pop("source"), "error": content.pop("error"), "met": entry.is_good, **content}
    if not with_pictures:
        del content["pictures"]
    return content


def _written(folder: Path | None, value: bytes | Path) -> str:
    """What JSON has for a picture, or for a file as it is seen from a folder."""
    if isinstance(value, bytes):
        return b64encode(value).decode()
    path = value.absolute()
    if folder is not None:
        # To another drive there is no way from there.
        with suppress(ValueError):
            path = Path(os.path.relpath(_without_links(path.parent) / path.name, _without_links(folder)))
    return path.as_posix()


def _without_links(folder: Path) -> Path:
    """The folder as it is, or by another way if there are links on this one: from these the way up is another than it
    looks, and not the same for Python and for Blender."""
    real = os.path.realpath(folder)
    return folder if real == os.path.abspath(folder) else Path(real)


def gathered_reports(folder: Path) -> Report:
    """One report of all JSON reports in a folder, in the order of their names.

    Raises ReportError where they do not make one: there are none, one is of another action, program or Blender, or two
    read or write the same file; and OSError.
    """
    paths = sorted(folder.glob("*.json"))
    if not folder.is_dir():
        raise ReportError(f"{folder}: there is no such folder")
    if not paths:
        raise ReportError(f"{folder}: there are no reports in it")
    reports = [read_report(path) for path in paths]
    seen: dict[str, Path] = {}
    for path, report in zip(paths, reports, strict=True):
        if not report.is_own:
            raise ReportError(f"{path}: it was made by another version of CC Depth or of Blender")
        if report.action != reports[0].action:
            raise ReportError(f"{path}: its action is {report.action}, and that of others {reports[0].action}")
        for entry in report.files:
            written = () if entry.output is None else (f"written {os.path.realpath(entry.output.path)}",)
            for name in (entry.name, *written):
                if name in seen:
                    raise ReportError(f"{path}: it has {name}, and so has {seen[name]}")
                seen[name] = path
    return Report(reports[0].action, tuple(entry for report in reports for entry in report.files))


def read_report(path: Path) -> Report:
    """The report in a JSON file. Raises ReportError."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != FORMAT:
            raise ReportError(f"{path}: it is not a CC Depth report")
        number = content["version"]
        if type(number) is not int or number not in (OLD_VERSION, FORMAT_VERSION):
            raise ReportError(
                f"{path}: it is a report of version {number}, and this version of CC Depth reads {OLD_VERSION} and "
                f"{FORMAT_VERSION}"
            )
        if unknown := content.keys() - FIELDS:
            raise ValueError(f"these fields are unknown: {', '.join(sorted(unknown))}")
        if number == OLD_VERSION:
            _take_for_new(content)
        folder = _without_links(path.parent)
        entries = tuple(_file_entry(each, folder) for each in content["files"])
        made_by = (content.get("program"), content.get("blender"), number)
        is_own = made_by == (PROGRAM, bpy.app.version_string, FORMAT_VERSION)
        report = Report(content["action"], entries, number, is_own)
        verdicts = [content["met"], *(each["met"] for each in content["files"])]
    except OSError as fault:
        raise ReportError(f"{path}: it cannot be read: {fault.strerror}") from fault
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as fault:
        if isinstance(fault, ReportError):
            raise
        raise ReportError(f"{path}: it is not a CC Depth report: {fault}") from fault
    if report.action not in (DEPTHS, LEVELS, SUBDIVIDE, MEASURE):
        raise ReportError(f"{path}: it is not a CC Depth report: there is no action {report.action!r}")
    if not report.files:
        raise ReportError(f"{path}: it names no files")
    if verdicts != [report.is_good, *(each.is_good for each in report.files)]:
        raise ReportError(f"{path}: what it says of its files and of their objects does not agree")
    return report


def _take_for_new(content: dict[str, Any]) -> None:
    """Turn the content of a report of version 1 into that of the newest, without what it does not tell."""
    for entry in content["files"]:
        entry.update(UNTOLD_OF_FILES)
        for each in entry["objects"]:
            each.update(UNTOLD_OF_OBJECTS)
            if content["action"] in MAKING:
                # Meshes that are made are measured until it is known whether they are within the tolerance.
                each["settings"].pop("accuracy", None)


def _file_entry(content: dict[str, Any], folder: Path) -> FileEntry:
    # Older reports of this version do not tell of these, and of the vertices among the settings alone.
    values = {"left_out": None, "companions": [], "lost": [], "pictures": [], **content, "source": content["input"]}
    values["objects"] = [{"vertices": (each["settings"] or {}).get("vertices"), **each} for each in content["objects"]]
    entry: FileEntry = _read(FileEntry, {name: values[name] for name in values.keys() - {"input", "met"}}, folder)
    for each in entry.objects:
        if (each.met is None) != (each.measured is None) or not _agree(each):
            raise ValueError("met and measured do not agree")
        if each.vertices not in (None, *VERTICES):
            raise ValueError(f"vertices cannot be {each.vertices!r}")
    return entry


def _agree(entry: ObjectEntry) -> bool:
    """Whether the distances measured are in order, and the verdict is that of these distances."""
    if entry.measured is None:
        return True
    slack = 1 + ROUNDING if entry.met else 1 - ROUNDING
    is_met = entry.measured.proved <= entry.tolerance * slack
    return entry.met == is_met and entry.measured.reached <= entry.measured.proved


def _read(hint: Any, value: Any, folder: Path, name: str = "") -> Any:
    """What JSON has for a value of a type; numbers, but for frames, have to be finite and not negative. Raises
    ValueError where it is no such value. folder: that paths are seen from. name: of the field."""
    if get_origin(hint) in (Union, UnionType):
        return None if value is None else _read(get_args(hint)[0], value, folder, name)
    if isinstance(hint, type) and is_dataclass(hint) and isinstance(value, dict):
        hints = get_type_hints(hint)
        if value.keys() != hints.keys():
            raise ValueError(f"these fields are missing or unknown: {', '.join(sorted(value.keys() ^ hints.keys()))}")
        return hint(**{each: _read(kind, value[each], folder, each) for each, kind in hints.items()})
    if get_origin(hint) is tuple and isinstance(value, list):
        kinds = get_args(hint)
        kinds = kinds[:1] * len(value) if kinds[-1] is Ellipsis else kinds
        return tuple(_read(kind, each, folder, name) for kind, each in zip(kinds, value, strict=True))
    if hint is Path and isinstance(value, str):
        return folder / value
    if hint is bytes and isinstance(value, str):
        return b64decode(value, validate=True)
    if hint is Frame:
        is_one = type(value) is int
    elif hint in (int, float):
        is_one = type(value) in (int, hint) and 0 <= value < inf
    else:
        is_one = isinstance(value, get_origin(hint) or hint)
    if not is_one:
        raise ValueError(f"{name} cannot be {value!r}")
    return value


YES_OR_NO = {None: "", True: "yes", False: "no"}

# What spreadsheets take for the beginning of a formula.
FORMULA_STARTS = ("=", "+", "-", "@")

# The columns of the table that are about an object, and what they have of its entry.
COLUMNS: dict[str, Callable[[ObjectEntry], Any]] = {
    "object": attrgetter("name"),
    "tolerance_m": attrgetter("tolerance"),
    **{name: attrgetter(name) for name in ("faces", "deepest", "level", "worst_frame", "result", "result_faces")},
    "proved_m": attrgetter("proved"),
    "measured_proved_m": lambda entry: entry.measured and entry.measured.proved,
    "measured_reached_m": lambda entry: entry.measured and entry.measured.reached,
    "met": lambda entry: YES_OR_NO[entry.met],
    "closed": lambda entry: YES_OR_NO[entry.closed],
    "oriented": lambda entry: YES_OR_NO[entry.oriented],
}


def csv_text(report: Report) -> str:
    """The report as a table: a row for each object, and one for each file that failed."""
    text = io.StringIO()
    table = csv.DictWriter(text, ("file", "error", *COLUMNS, "output"), lineterminator="\n")
    table.writeheader()
    for entry in report.files:
        file = {"file": entry.name, "error": entry.error, "output": entry.output and str(entry.output.path)}
        for row in [{name: get(each) for name, get in COLUMNS.items()} for each in entry.objects] or [{}]:
            table.writerow({name: _cell(value) for name, value in (file | row).items()})
    return text.getvalue()


def _cell(value: Any) -> Any:
    """A value of the table; texts neither command a terminal nor are taken for a formula by a spreadsheet."""
    if not isinstance(value, str):
        return value
    return ("'" if value.startswith(FORMULA_STARTS) else "") + printable_lines(value)
