# SPDX-License-Identifier: GPL-3.0-or-later
"""The arguments of the command line."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from ..core import METHODS, Effort, Mode
from ..exchange.mesh_files import BLEND, COMPANIONS, INPUTS, OUTPUTS, names_of
from ..state.properties import CAMERA_FRAMES_ITEMS, TOLERANCE_BY_ITEMS, VERTEX_TEXTS
from ..tasks.frames import typed_frames
from ..tasks.surfaces import ComputeError
from .amounts import LEAST, UNITS, angle, face_budget, face_limit, number_from, typed_tolerance, whole_number
from .report import DEPTHS, LEVELS, LODS, MEASURE, SUBDIVIDE, reports_in

# The actions that make meshes for other formats.
MAKING = {LEVELS, SUBDIVIDE, LODS}

# The actions on several frames.
OVER_FRAMES = {DEPTHS, LEVELS}

STANDARD_OUTPUT = "-"

# The options that --gather allows.
GATHERING = {"gather", "json", "csv", "html", "pictures", "overwrite"}

# The word in place of a list of frames.
SCENE_RANGE = "scene"

DESCRIPTION = (
    "Computes how many Catmull-Clark levels bring each face within a tolerance of the limit surface, for all mesh "
    "objects of each file, and prints the number of faces by depth; or makes meshes within the tolerance, or measures "
    "whether meshes are within the tolerance."
)
EPILOG = (
    "Without a file, Blender's Suzanne is used. Options that are not given come from the scene of a .blend file, or "
    "have the panel's defaults. Exit status: 0 when all is done and every tolerance is met, 1 when something failed or "
    "a tolerance is not met, 2 when the command line is wrong."
)


class Parser(argparse.ArgumentParser):
    """The parser of the command line."""

    def __init__(self, program: str) -> None:
        super().__init__(prog=program, description=DESCRIPTION, epilog=EPILOG)
        self.add_argument("files", nargs="*", type=Path, metavar="FILE", help=f"{names_of(INPUTS)} file")
        _add_choices(self)
        _add_actions(self)
        _add_outputs(self)
        _add_runs(self)

    def parsed(self, arguments: Sequence[str]) -> argparse.Namespace:
        """The options. Raises SystemExit, with status 2 and an explanation when the command line is wrong."""
        options = self.parse_intermixed_args(_without_separator(arguments))
        if options.tolerance is not None and options.tolerance.mode is not None:
            if options.tolerance_mode not in (None, options.tolerance.mode):
                self.error(f"a tolerance of {options.tolerance} is not {options.tolerance_mode.lower()}")
            options.tolerance_mode = options.tolerance.mode
        options.jobs = options.jobs or (1 if options.file_timeout else None)
        fault = _fault(options, self._given(options))
        if fault is not None:
            self.error(fault)
        return options

    def _given(self, options: argparse.Namespace) -> set[str]:
        """The given values, by the names of the options here."""
        values = {each.dest: (getattr(options, each.dest, each.default), each.default) for each in self._actions}
        return {name for name, (value, default) in values.items() if value not in (default, [])}


def _without_separator(arguments: Sequence[str]) -> list[str]:
    """The arguments without a --. All arguments after a -- are files, but argparse takes some of them for options when
    files and options are mixed."""
    if "--" not in arguments:
        return list(arguments)
    end = list(arguments).index("--")
    return [*arguments[:end], *(f"./{name}" if name.startswith("-") else name for name in arguments[end + 1 :])]


def _add_choices(parser: Parser) -> None:
    """The options that choose objects, and the tolerance."""
    add = parser.add_argument
    add("--objects", nargs="+", action="extend", metavar="NAME", help="these objects alone")
    add("--collection", metavar="NAME", help="the objects of this collection alone")
    add(
        "--unit",
        choices=UNITS,
        help="the length of one unit in .stl, .obj and .ply files, read and written (mm for .stl, otherwise m)",
    )
    near = parser.add_mutually_exclusive_group()
    near.add_argument(
        "--tolerance",
        type=typed_tolerance,
        help="largest distance allowed to the limit surface: 0.1mm, 0.01in, 0.1%% of the diagonal, 0.5px of the "
        "camera's image, or a bare number",
    )
    near.add_argument(
        "--faces", type=face_budget, help="find the best tolerance for a number of faces of the adaptive meshes: 50k"
    )
    mode = parser.add_mutually_exclusive_group()
    add("--camera", metavar="NAME", help="the camera of a tolerance in pixels, by default the scene's")
    add(
        "--camera-frames",
        type=_name,
        choices=[name for name, *_ in CAMERA_FRAMES_ITEMS],
        help="when that camera looks at the objects: on the current frame (default), or over the scene's range",
    )
    lengths = {
        "relative": "a part of the diagonal of each object's dimensions (default, unless a .blend file says otherwise)",
        "absolute": "a distance in the scene",
    }
    for name, length in lengths.items():
        text = f"a bare tolerance is {length}"
        mode.add_argument(f"--{name}", dest="tolerance_mode", action="store_const", const=name.upper(), help=text)
    add("--method", type=_name, choices=METHODS, help="how the distance is bounded; by default DISTANCE")
    add(
        "--vertices",
        type=_name,
        choices=list(VERTEX_TEXTS),
        help="where the subdivided mesh has its vertices; OBJECT (default) is as the object's own Subdivision Surface "
        "modifier has them, on the limit surface without one",
    )
    add(
        "--effort",
        type=_name,
        choices=list(Effort),
        help="how long DISTANCE looks for fewer levels; NORMAL (default) measures a limited number of parts",
    )
    add(
        "--frames",
        type=_frames,
        metavar="LIST",
        help="compute depths on these frames: 1-250, 1-250/5 for every fifth, 1,5,9, or scene for its range",
    )
    add("--no-modifiers", dest="use_modifiers", action="store_false", default=None, help="leave modifiers out")


def _add_actions(parser: Parser) -> None:
    add = parser.add_argument_group("what to do instead of computing depths").add_argument
    add("--levels", action="store_true", help="set the level of Subdivision Surface modifiers")
    add("--subdivide", action="store_true", help="make adaptive meshes")
    add(
        "--lods",
        dest="count",
        type=whole_number,
        metavar="N",
        help="make levels of detail: adaptive meshes, each coarser than the one before",
    )
    add(
        "--measure",
        action="store_true",
        help="measure how far the shown meshes are from their limit surfaces; with --levels or --subdivide, measure "
        "the meshes written, read back from the file, as a report does",
    )
    add(
        "--accuracy",
        type=number_from("greater than zero", LEAST),
        help="how far apart the proved and the reached distance may be, as a part of the reached distance (0.05)",
    )
    add(
        "--time-limit",
        type=number_from("of seconds", 0.0),
        metavar="SECONDS",
        help="the most seconds to measure; 0 for no limit",
    )
    add = parser.add_argument_group("adaptive subdivision").add_argument
    for name, default in (("shading", 5), ("facet", 0)):
        text = f"largest {name} angle in degrees, 0 for no limit; {default} unless a .blend file says otherwise"
        add(f"--{name}-angle", type=angle, metavar="DEGREES", help=text)
    text = "largest length of an edge in the scene, 0 for no limit; 0 unless a .blend file says otherwise"
    add("--longest-edge", type=number_from("of 0 or more", 0.0), metavar="LENGTH", help=text)
    add(
        "--tolerance-by",
        type=_name,
        choices=[name for name, *_ in TOLERANCE_BY_ITEMS],
        help="what the tolerance varies by",
    )
    add("--vertex-group", metavar="NAME", help="the vertex group with the weights")
    add(
        "--coarsest",
        type=number_from("of 1 or more", 1.0),
        help="how many times the tolerance is allowed where the weight is 0 (10)",
    )
    add("--mode", type=_name, choices=list(Mode), help="how the faces are divided")
    add(
        "--in-place",
        dest="output_kind",
        action="store_const",
        const="IN_PLACE",
        help="let the results take the place of the objects' meshes, instead of hiding the objects",
    )
    add("--exact-normals", action="store_true", default=None, help="shade with the normals of the limit surface")
    add(
        "--reduce",
        action="store_true",
        default=None,
        help="make the fewest triangles that can be proved to be within the tolerance",
    )
    add("--max-faces", type=face_limit, help="the largest number of faces to make")
    add(
        "--lod-step",
        dest="step",
        type=number_from("greater than zero", LEAST),
        metavar="FACTOR",
        help="how many times the tolerance of each level of detail is that of the level before (4)",
    )
    add(
        "--view-angle",
        type=angle,
        metavar="DEGREES",
        help="the vertical field of view that switch distances are for; by default that of the scene's camera, or 50",
    )
    add(
        "--view-height",
        type=whole_number,
        metavar="PIXELS",
        help="the height of the view that switch distances are for; by default that of the scene's render",
    )


def _add_outputs(parser: Parser) -> None:
    add = parser.add_argument_group("files to write").add_argument
    add(
        "--output",
        type=Path,
        metavar="FILE",
        help=f"write the results: {BLEND}, or the meshes made: {names_of(OUTPUTS[1:])}",
    )
    add("--output-folder", type=Path, metavar="FOLDER", help="where to write the result of each file, under its name")
    add("--format", type=_suffix, choices=OUTPUTS, metavar="EXT", help="the format of files in the folder (blend)")
    add(
        "--picture",
        type=Path,
        metavar="PNG",
        help="render the heat map of the depths; with --subdivide, of the distances proved",
    )
    add("--json", metavar="FILE", help="write a report that can be checked again; - for standard output")
    add("--csv", metavar="FILE", help="write a table with a row for each object; - for standard output")
    add(
        "--html",
        metavar="FILE",
        help="write the report as a page with pictures, which opens in any browser; - for standard output",
    )
    add("--pictures", action="store_true", help="let the JSON report hold the pictures of the page, for --gather")
    add("--overwrite", action="store_true", help="replace files that exist")


def _add_runs(parser: Parser) -> None:
    parser.add_argument(
        "--jobs",
        type=whole_number,
        metavar="N",
        help="how many files are done at a time, each by another Blender: a file that crashes Blender fails alone",
    )
    parser.add_argument(
        "--verify", type=Path, metavar="REPORT", help="check all that a JSON report says, and do nothing else"
    )
    parser.add_argument(
        "--gather", type=Path, metavar="FOLDER", help="make one report of all JSON reports in a folder, in their order"
    )
    parser.add_argument(
        "--file-timeout",
        type=number_from("of seconds greater than zero", LEAST),
        metavar="SECONDS",
        help="the most seconds for one file: a file that takes longer fails; with --jobs, 1 by default",
    )
    # The folder of a window that lets this Blender measure what it has written.
    parser.add_argument("--written", type=Path, help=argparse.SUPPRESS)
    # The file that another process lets this one do, by its number, and the report to write.
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)


def action_of(options: argparse.Namespace) -> str:
    """The action on each object."""
    if options.count is not None:
        return LODS
    if options.subdivide:
        return SUBDIVIDE
    if options.levels:
        return LEVELS
    return MEASURE if options.measure else DEPTHS


def output_of(source: Path | None, options: argparse.Namespace) -> Path | None:
    """The path for the results of a file."""
    if options.output_folder is None:
        return options.output
    name = "Suzanne" if source is None else source.stem
    return options.output_folder / f"{name}{options.format or BLEND}"


def is_measured(options: argparse.Namespace) -> bool:
    """Whether to measure made meshes as written."""
    return bool(options.measure or options.json or options.csv or options.html)


def _fault(options: argparse.Namespace, given: set[str]) -> str | None:
    """The fault of the command line, if there is one. given: the names of the given options."""
    sources: list[Path | None] = options.files or [None]
    outputs = [output_of(source, options) for source in sources]
    action, reports = action_of(options), [options.json, options.csv, options.html]
    swallowed = [name for name in options.objects or () if Path(name).suffix.lower() in INPUTS and not options.files]
    is_gathered = options.gather is not None
    faults = {
        "--verify takes a report and nothing else": options.verify is not None and given != {"verify"},
        "--gather takes a folder of reports and nothing else but --json, --csv, --html, --pictures and --overwrite": (
            is_gathered and given - GATHERING
        ),
        "--gather writes a report: use --json, --csv or --html as well": is_gathered and not any(reports),
        "--pictures is for --json": options.pictures and options.json is None,
        "--objects takes all that follows it for names: put the files before it": swallowed,
        "--file-timeout is for files": options.file_timeout is not None and not options.files,
        "--levels, --subdivide and --lods cannot be used together": (
            sum((options.levels, options.subdivide, options.count is not None)) > 1
        ),
        "--lod-step, --view-angle and --view-height are for --lods": (
            given & {"step", "view_angle", "view_height"} and action != LODS
        ),
        "--lods keeps the objects, so --in-place is not for it": action == LODS and options.output_kind is not None,
        "--picture is not for --lods, whose meshes are in one place": options.picture and action == LODS,
        "--frames is for depths and --levels": options.frames is not None and action not in OVER_FRAMES,
        "--output and --output-folder cannot be used together": options.output and options.output_folder,
        "--format is for --output-folder": options.format and not options.output_folder,
        "--output and --picture are for a single file; use --output-folder for several": (
            len(sources) > 1 and (options.output or options.picture)
        ),
        "--picture draws depths and adaptive meshes, and --measure makes none": options.picture and action == MEASURE,
        "only one report can go to the standard output": reports.count(STANDARD_OUTPUT) > 1,
    }
    return next((text for text, is_so in faults.items() if is_so), None) or _output_fault(options, outputs)


def _output_fault(options: argparse.Namespace, outputs: list[Path | None]) -> str | None:
    suffixes = {output.suffix.lower() for output in outputs if output is not None}
    unknown = suffixes - set(OUTPUTS)
    if unknown:
        return f"{options.output}: its name must end in {names_of(OUTPUTS)}"
    makes = action_of(options) in MAKING
    if suffixes - {BLEND} and not makes:
        return f"{suffixes.pop()} files hold meshes that are made: use --subdivide, --lods or --levels as well"
    if makes and options.measure and not suffixes:
        return "--measure measures what was written: use --output as well"
    reports = [Path(name) for name in (options.json, options.csv, options.html) if name not in (None, STANDARD_OUTPUT)]
    others = [_place(path) for path in (*reports, options.picture) if path is not None]
    written = [output for output in outputs if output is not None]
    belonging = [output.with_suffix(each) for output in written for each in COMPANIONS.get(output.suffix.lower(), ())]
    places = [*map(_place, (*written, *belonging)), *others]
    twice = next((place for place in places if places.count(place) > 1), None)
    if twice is not None:
        return f"several files would be written to {twice}"
    read = options.files if options.gather is None else reports_in(options.gather)
    sources = {place for source in read for place in (_place(source), Path(os.path.realpath(source)))}
    # A report names read files by their checksums.
    kept = places if options.json or options.csv or options.html else others
    replaced = next((place for place in kept if place in sources), None)
    return None if replaced is None else f"{replaced} is read, and would be replaced"


def _place(path: Path) -> Path:
    """The place of a file, independent of links to its folder. Writing to a link replaces the link."""
    return Path(os.path.realpath(path.parent)) / path.name


def _name(text: str) -> str:
    """The name of an item from a word: second-order → SECOND_ORDER"""
    return text.upper().replace("-", "_")


def _frames(text: str) -> str:
    """Frames as typed, or the word for the scene's own range."""
    if text != SCENE_RANGE:
        try:
            typed_frames(text)
        except ComputeError as fault:
            raise argparse.ArgumentTypeError(str(fault)) from fault
    return text


def _suffix(text: str) -> str:
    """The suffix of a format: STL → .stl"""
    return "." + text.lower().removeprefix(".")
