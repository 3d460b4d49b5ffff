# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a run: the results for each file and object, and their printed text.

As JSON the report is a certificate that can be checked again (docs/report.md), as CSV a table with a row for each
object. All lengths are in metres.
"""

from __future__ import annotations

import csv
import io
import json
import os
from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from decimal import Decimal
from functools import partial
from hashlib import file_digest
from math import degrees, inf, nextafter
from operator import attrgetter
from pathlib import Path
from typing import Any, NewType

import bpy

from .. import version
from ..tasks.deviation_task import verdict_of
from ..ui.facts import deviation_text, factors_text, facts_of, ratio_texts
from ..ui.lengths import DIGITS, METRIC, Rounding, enough_digits, number_text, printable, printable_lines

DEPTHS, LEVELS, SUBDIVIDE, LODS, MEASURE = "depths", "levels", "subdivide", "lods", "measure"

ACTION_TEXTS = {
    DEPTHS: "Depths computed",
    LEVELS: "Subdivision levels set",
    SUBDIVIDE: "Adaptive meshes made",
    LODS: "Levels of detail made",
    MEASURE: "Deviations measured",
}

FORMAT, FORMAT_VERSION = "ccdepth-report", 3
PROGRAM = {"name": "CC Depth", "version": version()}

# The relative rounding of lengths. Blender keeps some lengths in single precision, with roundings of 6e-8 of a number.
# A dozen such roundings stay within this, with the far smaller effect of another order of additions in double
# precision.
ROUNDING = 1e-6


# A frame of an animation; there are negative ones.
Frame = NewType("Frame", int)


def metres_rounded_up(length: float, metres_per_unit: float) -> float:
    """A proved length of the scene in metres, rounded up."""
    return nextafter(length * metres_per_unit, inf)


def degrees_rounded_up(angle: float | None) -> float | None:
    """A proved angle in degrees, rounded up; None without an angle."""
    return None if angle is None else nextafter(degrees(angle), inf)


@dataclass(frozen=True)
class Distances:
    """Bounds of the distance between mesh and limit surface, both ways. proved: the upper bound. reached: the lower
    bound. Where the tolerance varies, each distance is divided by the factor at the point of the surface."""

    proved: float
    reached: float

    @classmethod
    def of(cls, proved: float, reached: float, metres_per_unit: float) -> Distances:
        """Distances from lengths of the scene."""
        least = max(0.0, nextafter(reached * metres_per_unit, 0.0))
        return cls(metres_rounded_up(proved, metres_per_unit), least)


@dataclass(frozen=True)
class ObjectEntry:
    """The findings on an object.

    name: the object of the limit surface; result: the object made of it, if another. settings: as given, by their
    names. tolerance: as a length; factors: the least and the greatest on it, of a measured mesh where it varies.
    faces: of its mesh; vertices: of the depths, CONTROL or LIMIT; result_faces: of the
    made mesh; triangles: of the written and measured mesh. deepest: the deepest depth of a face; level: the first at
    which all faces are within the tolerance; deepest_frame: a frame with the deepest depth. proved: the largest
    distance proved when the mesh was made; proved_shading, proved_facets: the largest angles in radians, where shading
    counts and elsewhere. measured: by Measure Deviation, on the written mesh. met: whether the tolerance is met; None
    without a measurement. facet_angle, shading_angle: of the measured mesh, the largest at samples, in degrees; None
    without a measurement, or without normals. closed, oriented: of the written and measured mesh, as of
    ``written_meshes.Edges``. lod_distance, lod_screen_size: of a level of detail, as of ``switch_distances.Switch``.
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
    deepest_frame: Frame | None = None
    proved: float | None = None
    proved_shading: float | None = None
    proved_facets: float | None = None
    measured: Distances | None = None
    met: bool | None = None
    facet_angle: float | None = None
    shading_angle: float | None = None
    closed: bool | None = None
    oriented: bool | None = None
    lod_distance: float | None = None
    lod_screen_size: float | None = None
    factors: tuple[float, float] | None = None


@dataclass(frozen=True)
class FileStamp:
    """A file at a time. sha256: of its content; None if it could not be read."""

    path: Path
    sha256: str | None
    metres_per_unit: float | None


@dataclass(frozen=True)
class Chosen:
    """The requested objects of a file, by their names and a collection; all objects without either."""

    objects: list[str] | None
    collection: str | None


@dataclass(frozen=True)
class ReportPictures:
    """The parts of the page on an object beside its numbers: the number of faces of each depth, from the least on, and
    pictures, as WebP files, or PNG files from a Blender without WebP."""

    faces_by_depth: tuple[tuple[int, int], ...]
    heat_map: bytes
    wireframe: bytes


@dataclass(frozen=True)
class FileEntry:
    """The entry of a file. source: None for Blender's Suzanne. error: why the file failed, if it did. chosen: None if
    no object was done. left_out: the names of other objects with a surface; None for a file that failed. companions:
    files written beside the output that belong to it. lost: the data of the objects that no file holds. pictures: one
    for each object if a page or the report holds them, else none."""

    source: FileStamp | None
    objects: tuple[ObjectEntry, ...] = ()
    output: FileStamp | None = None
    error: str | None = None
    chosen: Chosen | None = None
    left_out: tuple[str, ...] | None = None
    companions: tuple[FileStamp, ...] = ()
    lost: tuple[str, ...] = ()
    pictures: tuple[ReportPictures, ...] = ()

    @property
    def is_good(self) -> bool:
        """Whether the file did not fail, and every tolerance to be met is met."""
        return self.error is None and all(each.met is not False for each in self.objects)

    @property
    def name(self) -> str:
        return name_of(None if self.source is None else self.source.path)


@dataclass(frozen=True)
class Report:
    """The report of a run: depths, levels, subdivide or measure. is_own: whether this version of CC Depth made it, in
    this version of Blender."""

    action: str
    files: tuple[FileEntry, ...]
    is_own: bool = True

    @property
    def is_good(self) -> bool:
        return all(each.is_good for each in self.files)


def name_of(source: Path | None) -> str:
    """The name of a file, as given, or of Blender's Suzanne, which is no file."""
    return "Suzanne" if source is None else str(source)


def stamp(path: Path, metres_per_unit: float | None) -> FileStamp:
    """The stamp of the present file."""
    checksum = None
    # A pipe would be waited for.
    if path.is_file():
        with suppress(OSError), path.open("rb") as file:
            checksum = file_digest(file, "sha256").hexdigest()
    return FileStamp(path, checksum, metres_per_unit)


def json_text(report: Report, folder: Path | None, with_pictures: bool) -> str:
    """The report as JSON. folder: of the report; files are named relative to it, or without it with their full
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
    """The JSON value of a picture, or of a file relative to a folder."""
    if isinstance(value, bytes):
        return b64encode(value).decode()
    path = value.absolute()
    if folder is not None:
        # No relative path leads to another drive.
        with suppress(ValueError):
            path = Path(os.path.relpath(without_links(path.parent) / path.name, without_links(folder)))
    return path.as_posix()


def without_links(folder: Path) -> Path:
    """The folder by a path without links: from a link the way up is not the apparent one, and differs between Python
    and Blender."""
    real = os.path.realpath(folder)
    return folder if real == os.path.abspath(folder) else Path(real)


YES_OR_NO = {None: "", True: "yes", False: "no"}

# The characters that spreadsheets take for the beginning of a formula.
FORMULA_STARTS = ("=", "+", "-", "@")

# The columns of the table for an object, and their values from its entry.
COLUMNS: dict[str, Callable[[ObjectEntry], Any]] = {
    "object": attrgetter("name"),
    "tolerance_m": attrgetter("tolerance"),
    **{name: attrgetter(name) for name in ("faces", "deepest", "level", "deepest_frame", "result", "result_faces")},
    "proved_m": attrgetter("proved"),
    "proved_shading_degrees": lambda entry: degrees_rounded_up(entry.proved_shading),
    "proved_facets_degrees": lambda entry: degrees_rounded_up(entry.proved_facets),
    "measured_proved_m": lambda entry: entry.measured and entry.measured.proved,
    "measured_reached_m": lambda entry: entry.measured and entry.measured.reached,
    "least_factor": lambda entry: entry.factors and entry.factors[0],
    "greatest_factor": lambda entry: entry.factors and entry.factors[1],
    **{f"{name}_deg": attrgetter(name) for name in ("facet_angle", "shading_angle")},
    "met": lambda entry: YES_OR_NO[entry.met],
    "closed": lambda entry: YES_OR_NO[entry.closed],
    "oriented": lambda entry: YES_OR_NO[entry.oriented],
    "lod_distance_m": attrgetter("lod_distance"),
    "lod_screen_size": attrgetter("lod_screen_size"),
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


def reports_in(folder: Path) -> list[Path]:
    """The JSON reports in a folder, in the order of their names; hidden files belong to killed runs or to systems."""
    return sorted(folder.glob("[!.]*.json"))


def _cell(value: Any) -> Any:
    """A value of the table; texts neither command a terminal nor are taken for a formula by a spreadsheet."""
    if not isinstance(value, str):
        return value
    return ("'" if value.startswith(FORMULA_STARTS) else "") + printable_lines(value)


def print_facts(objects: Sequence[bpy.types.Object]) -> None:
    """Print the facts of the depths on each mesh, with the number of faces of each depth; or the facts of each adaptive
    mesh."""
    for mesh, names in _names_by_mesh(objects).items():
        print(f"\n{names}\n{_result_text(mesh.ccdepth)}\n")


def _result_text(record: bpy.types.PropertyGroup) -> str:
    """The facts of a result, as lines of text."""
    facts = [f"  {fact.name}: {fact.value}" for fact in facts_of(bpy.context.scene, record)]
    if record.subdivision:
        return "\n".join(facts)
    lines = [f"{'depth':>8}{'faces':>14}{'share':>9}"]
    lines += [f"{row.depth:>8}{row.faces:>14,}{row.faces / record.faces:>9.1%}" for row in record.rows]
    return "\n".join([*lines, *facts])


def losses(entry: FileEntry) -> Iterator[str]:
    """The omitted parts of a file, and the parts of objects missing from the written file."""
    for name in entry.left_out or ():
        yield f"“{printable(name)}” is left out"
    if entry.lost:
        yield f"lost in {entry.output and entry.output.path}: {', '.join(entry.lost)}"


def print_measured(entry: FileEntry) -> None:
    """Print the distances of meshes from their limit surfaces."""
    for each in entry.objects:
        if each.measured is not None:
            digits = enough_digits_in_metres(each.tolerance, each.measured.proved)
            most = metres_text(each.measured.proved, Rounding.UP, digits)
            least = metres_text(each.measured.reached, Rounding.DOWN)
            verdict = verdict_of(each.measured.proved, each.measured.reached, each.tolerance)
            tolerance = metres_text(each.tolerance, digits=digits)
            if each.factors:
                most, least = ratio_texts(each.measured.proved, each.measured.reached, each.tolerance)
                tolerance = f"{tolerance} {factors_text(each.factors)}"
            text = deviation_text(most, least, tolerance, verdict)
            angles = {"facets": each.facet_angle, "shading": each.shading_angle}
            told = "".join(f"; {name} {angle:.2f}° at samples" for name, angle in angles.items() if angle is not None)
            print(f"{printable(each.result or each.name)}: {text}{told}")


def enough_digits_in_metres(tolerance: float, *bounds: float) -> int:
    """The digits for a tolerance and bounds beside each other, in metres."""
    found = (enough_digits(Decimal(str(each)), Decimal(str(tolerance))) for each in bounds)
    return max(found, default=DIGITS)


def metres_text(length: float, rounding: Rounding = Rounding.NEAREST, digits: int = DIGITS) -> str:
    """A length in metres, in the unit that suits it."""
    *others, smallest = METRIC.values()
    unit = next((unit for unit in others if length >= unit.length), smallest)
    return f"{number_text(Decimal(str(length)) / unit.length, rounding, digits)} {unit.name}"


def _names_by_mesh(objects: Sequence[bpy.types.Object]) -> dict[bpy.types.Mesh, str]:
    """The printable names of the objects that use each mesh."""
    names: dict[bpy.types.Mesh, list[str]] = {}
    for blender_object in objects:
        names.setdefault(blender_object.data, []).append(printable(blender_object.name))
    return {mesh: ", ".join(users) for mesh, users in names.items()}
