# SPDX-License-Identifier: GPL-3.0-or-later
"""The report in a JSON file, or the reports in a folder as one: read, and refused if contradictory."""

from __future__ import annotations

import json
import os
from base64 import b64decode
from dataclasses import is_dataclass
from math import inf
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import bpy

from ..core import VERTICES
from .arguments import DEPTHS, LEVELS, MEASURE, SUBDIVIDE
from .report import (
    FORMAT,
    FORMAT_VERSION,
    PROGRAM,
    ROUNDING,
    FileEntry,
    Frame,
    ObjectEntry,
    Report,
    reports_in,
    without_links,
)

FIELDS = {"format", "version", "program", "blender", "action", "met", "files"}


class ReportError(ValueError):
    """The error of a file that cannot be read as a report; the message says why."""


def gathered_reports(folder: Path) -> Report:
    """One report of all JSON reports in a folder, in the order of their names.

    Raises ReportError without any report, for a report of another action, program or Blender, and for two reports that
    read or write the same file; and OSError.
    """
    paths = reports_in(folder)
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
        if type(number) is not int or number != FORMAT_VERSION:
            raise ReportError(f"{path}: it is a report of version {number}, and not of version {FORMAT_VERSION}")
        if unknown := content.keys() - FIELDS:
            raise ValueError(f"these fields are unknown: {', '.join(sorted(unknown))}")
        folder = without_links(path.parent)
        entries = tuple(_file_entry(each, folder) for each in content["files"])
        is_own = (content.get("program"), content.get("blender")) == (PROGRAM, bpy.app.version_string)
        report = Report(content["action"], entries, is_own)
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


def _file_entry(content: dict[str, Any], folder: Path) -> FileEntry:
    values = {"pictures": [], **content, "source": content["input"]}
    entry: FileEntry = _read(FileEntry, {name: values[name] for name in values.keys() - {"input", "met"}}, folder)
    for each in entry.objects:
        if (each.met is None) != (each.measured is None) or not _agree(each):
            raise ValueError("met and measured do not agree")
        if each.vertices not in (None, *VERTICES):
            raise ValueError(f"vertices cannot be {each.vertices!r}")
    return entry


def _agree(entry: ObjectEntry) -> bool:
    """Whether the measured distances are in order, and the verdict follows from them."""
    if entry.measured is None:
        return True
    slack = 1 + ROUNDING if entry.met else 1 - ROUNDING
    is_met = entry.measured.proved <= entry.tolerance * slack
    return entry.met == is_met and entry.measured.reached <= entry.measured.proved


def _read(hint: Any, value: Any, folder: Path, name: str = "") -> Any:
    """The value of a type from JSON; numbers, but for frames, have to be finite and not negative. Raises ValueError for
    any other value. folder: to which paths are relative. name: of the field."""
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
