# SPDX-License-Identifier: GPL-3.0-or-later
"""The report in a JSON file, or the reports in a folder as one: read, and refused if contradictory."""

from __future__ import annotations

import json
import os
from base64 import b64decode
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import bpy

from .report import (
    ACTION_TEXTS,
    FORMAT,
    FORMAT_VERSION,
    PROGRAM,
    ROUNDING,
    Chosen,
    Distances,
    FileEntry,
    FileStamp,
    ObjectEntry,
    Report,
    ReportPictures,
    reports_in,
    without_links,
)

FIELDS = {"format", "version", "program", "blender", "action", "met", "files"}


Entry = TypeVar("Entry")


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
        if content["format"] != FORMAT or content["version"] != FORMAT_VERSION:
            raise ValueError(f"it is no report of version {FORMAT_VERSION}")
        _refuse_other_fields(content, FIELDS)
        folder = without_links(path.parent)
        files = tuple(_file_entry(each, folder) for each in content["files"])
        is_own = (content["program"], content["blender"]) == (PROGRAM, bpy.app.version_string)
        report = Report(content["action"], files, is_own)
        if report.action not in ACTION_TEXTS:
            raise ValueError(f"there is no action {report.action!r}")
        verdicts = [content["met"], *(each["met"] for each in content["files"])]
        if not files or verdicts != [report.is_good, *(each.is_good for each in files)]:
            raise ValueError("what it says of its files and of their objects does not agree")
    except OSError as fault:
        raise ReportError(f"{path}: it cannot be read: {fault.strerror}") from fault
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as fault:
        raise ReportError(f"{path}: it is not a CC Depth report: {fault}") from fault
    return report


def _refuse_other_fields(content: dict[str, Any], names: set[str]) -> None:
    """Raise ValueError unless these are the names of all fields."""
    if content.keys() != names:
        raise ValueError(f"these fields are missing or unknown: {', '.join(sorted(content.keys() ^ names))}")


def _made(kind: type[Entry], content: dict[str, Any], **changed: Any) -> Entry:
    """The entry of a kind with the fields of its content, some of them changed. Raises ValueError for others."""
    _refuse_other_fields(content, {*get_type_hints(kind)})
    return kind(**{**content, **changed})


def _file_entry(content: dict[str, Any], folder: Path) -> FileEntry:
    """The entry of a file, with paths relative to a folder."""
    content = {"source": content.pop("input"), "pictures": [], **content}
    del content["met"]
    stamps = [content["source"], content["output"], *content["companions"]]
    source, output, *companions = (each and _made(FileStamp, each, path=folder / each["path"]) for each in stamps)
    return _made(
        FileEntry,
        content,
        source=source,
        output=output,
        companions=tuple(companions),
        objects=tuple(map(_object_entry, content["objects"])),
        chosen=content["chosen"] and _made(Chosen, content["chosen"]),
        left_out=None if content["left_out"] is None else tuple(content["left_out"]),
        pictures=tuple(map(_pictures, content["pictures"])),
    )


def _object_entry(content: dict[str, Any]) -> ObjectEntry:
    measured = content["measured"] and _made(Distances, content["measured"])
    factors = content["factors"] and tuple(content["factors"])
    entry = _made(ObjectEntry, content, measured=measured, factors=factors)
    # The verdict follows from the distances, which are in order.
    slack = 1 + ROUNDING if entry.met else 1 - ROUNDING
    is_met = None if measured is None else measured.reached <= measured.proved <= entry.tolerance * slack
    if entry.met is not is_met:
        raise ValueError("met and measured do not agree")
    return entry


def _pictures(content: dict[str, Any]) -> ReportPictures:
    pictures = {name: b64decode(content[name], validate=True) for name in ("heat_map", "wireframe")}
    return _made(ReportPictures, content, **pictures)
