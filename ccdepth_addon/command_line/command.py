# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute Depth and Apply Adaptive Subdivision from the command line: ``blender -b --command ccdepth MESH``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from math import isfinite
from pathlib import Path
from typing import Any

import bpy

from ..core import METHODS, VERTICES, Mode, Transitions
from ..state.properties import METHOD_TEXTS, VERTEX_ITEMS, tolerance_name
from ..tasks.surfaces import LARGEST_TOLERANCE, TOO_LARGE
from ..ui.panels import exact_text
from ..ui.printable import printable, printable_lines
from . import picture
from .whole_files import UnwrittenError, written_whole

COMMAND = "ccdepth"
PROGRAM = f"blender -b --command {COMMAND}"

IMPORTERS = {".obj": "obj_import", ".ply": "ply_import", ".stl": "stl_import"}

VERTEX_TEXTS = {name: text for name, text, _ in VERTEX_ITEMS}

# The options that are settings of the scene under the same names.
GIVEN = (
    "tolerance_mode",
    "method",
    "vertices",
    "use_modifiers",
    "mode",
    "transitions",
    "exact_normals",
    "reduce",
    "max_faces",
)

EXIT_FAILURE = 1

# Blender's integers have 32 bits.
LARGEST_FACE_LIMIT = 2**31 - 1

_handle: Any = None


class CommandError(Exception):
    """The command cannot be run; the message says why."""


def run(arguments: Sequence[str], program: str = PROGRAM) -> int:
    """Run a command line; returns the exit status. Errors go to the standard error."""
    try:
        options = _parser(program).parse_args(arguments)
    except SystemExit as finished:
        return int(finished.code or 0)
    try:
        _execute(options)
        sys.stdout.flush()
    except (CommandError, picture.PictureError, OSError) as fault:
        # What was to be printed may be what cannot be written.
        with suppress(OSError):
            sys.stdout.flush()
        print(f"{program}: {printable_lines(str(fault))}", file=sys.stderr, flush=True)
        return EXIT_FAILURE
    return 0


def _parser(program: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=program,
        description="How many Catmull-Clark levels does each face of a mesh need to be within a tolerance of the limit "
        "surface? Computes it for all mesh objects of a file, and prints how many faces have which depth; or makes the "
        "meshes that are within the tolerance with few faces.",
        epilog="Without a mesh, Blender's Suzanne is used. Options that are not given come from the scene of a .blend "
        "file, or have the panel's defaults.",
    )
    parser.add_argument("mesh", nargs="?", type=Path, help=".blend, .obj, .ply or .stl file")
    parser.add_argument("--tolerance", type=float, help="largest distance allowed to the limit surface")
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument(
        "--relative",
        dest="tolerance_mode",
        action="store_const",
        const="RELATIVE",
        help="the tolerance is a part of the diagonal of each object's dimensions (default)",
    )
    mode.add_argument(
        "--absolute",
        dest="tolerance_mode",
        action="store_const",
        const="ABSOLUTE",
        help="the tolerance is a distance in the scene",
    )
    parser.add_argument("--method", type=_name, choices=METHODS, help="how the distance is bounded")
    parser.add_argument("--vertices", type=_name, choices=VERTICES, help="where the subdivided mesh has its vertices")
    parser.add_argument(
        "--no-modifiers", dest="use_modifiers", action="store_false", default=None, help="leave modifiers out"
    )
    _add_adaptive_options(parser)
    parser.add_argument("--output", type=Path, metavar="BLEND", help="write a .blend file with the results")
    parser.add_argument(
        "--picture",
        type=Path,
        metavar="PNG",
        help="render the heat map of the depths with its legend; with --subdivide, of the distances proved",
    )
    return parser


def _add_adaptive_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("adaptive subdivision")
    group.add_argument("--subdivide", action="store_true", help="make the meshes instead of measuring depths")
    group.add_argument("--mode", type=_name, choices=list(Mode), help="how the faces are divided")
    group.add_argument(
        "--transitions", type=_name, choices=list(Transitions), help="how faces beside finer ones are drawn"
    )
    group.add_argument(
        "--in-place",
        dest="output_kind",
        action="store_const",
        const="IN_PLACE",
        help="let the results take the place of the objects' meshes, instead of hiding the objects",
    )
    group.add_argument(
        "--exact-normals", action="store_true", default=None, help="shade with the normals of the limit surface"
    )
    group.add_argument(
        "--reduce",
        action="store_true",
        default=None,
        help="make the fewest triangles that can be proved to be within the tolerance",
    )
    group.add_argument("--max-faces", type=_face_limit, help="refuse to make more faces than this")


def _face_limit(text: str) -> int:
    """A number of faces that Blender can hold."""
    limit = int(text)
    if not 1 <= limit <= LARGEST_FACE_LIMIT:
        raise argparse.ArgumentTypeError(f"{limit} is not between 1 and {LARGEST_FACE_LIMIT:,}")
    return limit


def _name(text: str) -> str:
    """second-order → SECOND_ORDER"""
    return text.upper().replace("-", "_")


def _execute(options: argparse.Namespace) -> None:
    _refuse_impossible_paths(options)
    _refuse_impossible_tolerance(options.tolerance)
    objects = _load(options.mesh)
    _change_settings(bpy.context.scene.ccdepth, options)
    if options.subdivide:
        objects = _subdivide(objects)
        _print_adaptive_meshes(objects)
    else:
        with bpy.context.temp_override(selected_objects=objects, active_object=objects[0]):
            _call(bpy.ops.ccdepth.compute)
        _print_report(objects)
    if options.output is not None:
        with _written(options.output, backups=bpy.context.preferences.filepaths.save_version) as path:
            _call(bpy.ops.wm.save_as_mainfile, filepath=str(path), copy=True, check_existing=False)
    if options.picture is not None:
        title = objects[0].name if options.mesh is None else options.mesh.stem
        with _written(options.picture) as path:
            picture.render(bpy.context, objects, path, title, _subtitle(objects))


@contextmanager
def _written(path: Path, backups: int = 0) -> Iterator[Path]:
    """Where to write the file; it is there as a whole afterwards, or CommandError is raised."""
    try:
        with written_whole(path, backups=backups) as beside:
            yield beside
    except (UnwrittenError, CommandError) as fault:
        # What Blender itself says of a failure need not name the file.
        raise CommandError(f"{path}: {fault}") from fault
    print(f"Written: {printable(str(path))}")


def _subdivide(objects: list[bpy.types.Object]) -> list[bpy.types.Object]:
    """The objects that have the results."""
    in_place = bpy.context.scene.ccdepth.output == "IN_PLACE"
    before = set(bpy.data.objects)
    with bpy.context.temp_override(selected_objects=objects, active_object=objects[0]):
        _call(bpy.ops.ccdepth.subdivide)
    return objects if in_place else [obj for obj in bpy.data.objects if obj not in before]


def _refuse_impossible_paths(options: argparse.Namespace) -> None:
    if options.mesh is not None:
        if options.mesh.suffix.lower() not in {".blend", *IMPORTERS}:
            raise CommandError(f"{options.mesh}: not a .blend, .obj, .ply or .stl file")
        if not options.mesh.is_file():
            raise CommandError(f"{options.mesh}: there is no such file")
    for path, suffix in ((options.output, ".blend"), (options.picture, ".png")):
        if path is None:
            continue
        if path.suffix.lower() != suffix:
            raise CommandError(f"{path}: its name must end in {suffix}")
        if not path.absolute().parent.is_dir():
            raise CommandError(f"{path}: there is no folder {path.parent}")


def _refuse_impossible_tolerance(tolerance: float | None) -> None:
    """Blender would take what it cannot hold for the largest number it can."""
    if tolerance is not None and not abs(tolerance) < LARGEST_TOLERANCE:
        raise CommandError("The tolerance is not a finite number" if not isfinite(tolerance) else TOO_LARGE)


def _load(mesh: Path | None) -> list[bpy.types.Object]:
    """Open or import the file, in place of what is open; returns its mesh objects."""
    if mesh is not None and mesh.suffix.lower() == ".blend":
        _call(bpy.ops.wm.open_mainfile, filepath=str(mesh.absolute()), use_scripts=False)
        if bpy.context.mode != "OBJECT":
            _call(bpy.ops.object.mode_set, mode="OBJECT")
    else:
        _call(bpy.ops.wm.read_homefile, use_empty=True)
        if mesh is None:
            _call(bpy.ops.mesh.primitive_monkey_add)
        else:
            _call(getattr(bpy.ops.wm, IMPORTERS[mesh.suffix.lower()]), filepath=str(mesh.absolute()))
    return _visible_meshes(mesh)


def _visible_meshes(path: Path | None) -> list[bpy.types.Object]:
    found = [obj for obj in bpy.context.view_layer.objects if obj.type == "MESH"]
    visible = [obj for obj in found if obj.visible_get()]
    for hidden in set(found) - set(visible):
        print(f"Left out because it is hidden: {printable(hidden.name)}")
    if not visible:
        raise CommandError(f"{path}: there is no mesh object in it" + (" that is not hidden" if found else ""))
    return visible


def _change_settings(settings: bpy.types.PropertyGroup, options: argparse.Namespace) -> None:
    """Put what was given into the scene, so that a file written holds the settings of its results."""
    for name in GIVEN:
        value = getattr(options, name)
        if value is not None:
            setattr(settings, name, value)
    if options.output_kind is not None:
        settings.output = options.output_kind
    if options.tolerance is not None:
        setattr(settings, tolerance_name(settings.tolerance_mode), options.tolerance)


def _call(operator: Any, **properties: Any) -> None:
    """Call an operator, and turn its error reports into an exception of ours."""
    try:
        result = operator(**properties)
    except RuntimeError as fault:
        raise CommandError(str(fault).replace("Error: ", "").strip()) from fault
    if "FINISHED" not in result:
        raise CommandError(f"{operator.idname_py()} did not finish")


def _print_report(objects: list[bpy.types.Object]) -> None:
    print(_subtitle(objects))
    for mesh, names in _names_by_mesh(objects).items():
        print(f"\n{names}\n{depth_table(mesh.ccdepth)}\n")


def _names_by_mesh(objects: list[bpy.types.Object]) -> dict[bpy.types.Mesh, str]:
    """The names of the objects that use each mesh, as they can be printed."""
    names: dict[bpy.types.Mesh, list[str]] = {}
    for blender_object in objects:
        names.setdefault(blender_object.data, []).append(printable(blender_object.name))
    return {mesh: ", ".join(users) for mesh, users in names.items()}


def _print_adaptive_meshes(objects: list[bpy.types.Object]) -> None:
    for mesh, names in _names_by_mesh(objects).items():
        record = mesh.ccdepth
        reduced = f"; {record.unreduced_triangles:,} triangles without Reduce" if record.unreduced_triangles else ""
        print(f"{names}: {record.faces:,} faces made from {record.base_faces:,}{reduced}")
        print(f"  largest distance proved: {record.largest_bound:.4g}; tolerance: {record.world_tolerance:.4g}")
        print(f"  all of it at depth {record.deepest}: {int(record.uniform_faces):,} faces")


def depth_table(record: bpy.types.PropertyGroup) -> str:
    """How many faces of a mesh have which depth, as lines of text."""
    lines = [f"{'depth':>8}{'faces':>14}{'share':>9}"]
    lines += [f"{row.depth:>8}{row.faces:>14,}{row.faces / record.faces:>9.1%}" for row in record.rows]
    lines.append(f"{'all':>8}{record.faces:>14,}")
    if record.uniform_level >= 0:
        lines.append(f"  all of it at level {record.uniform_level}: {int(record.uniform_faces):,} faces")
    else:
        lines.append("  the level for all of it is not known: the depths are from an earlier version of CC Depth")
    if record.method == "CERTIFIED":
        lines.append(f"  no lesser depth would do {exact_text(record.exact_faces, record.faces).lower()}")
    return "\n".join(lines)


def _subtitle(objects: list[bpy.types.Object]) -> str:
    """The settings of the results, in a line."""
    record = objects[0].data.ccdepth
    tolerance = f"{record.tolerance:.4g}"
    if record.tolerance_mode == "RELATIVE":
        tolerance += " of the diagonal"
        lengths = {obj.data.ccdepth.world_tolerance for obj in objects}
        if len(lengths) == 1:
            tolerance += f" ({record.world_tolerance:.4g})"
    if record.subdivision:
        largest = max(obj.data.ccdepth.largest_bound for obj in objects)
        faces = sum(mesh.ccdepth.faces for mesh in {obj.data for obj in objects})
        return f"Tolerance {tolerance} · {faces:,} faces · Largest distance proved: {largest:.4g}"
    return f"Tolerance {tolerance} · {METHOD_TEXTS[record.method][0]} · Vertices: {VERTEX_TEXTS[record.vertices]}"


def register() -> None:
    global _handle
    _handle = bpy.utils.register_cli_command(COMMAND, run)


def unregister() -> None:
    global _handle
    bpy.utils.unregister_cli_command(_handle)
    _handle = None
