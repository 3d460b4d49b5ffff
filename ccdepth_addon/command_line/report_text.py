# SPDX-License-Identifier: GPL-3.0-or-later
"""What is printed of results."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

import bpy

from ..state import deviation_results, results
from ..state.properties import METHOD_TEXTS, VERTEX_TEXTS
from ..ui.lengths import METRIC, PLAIN, Rounding, bound_text, number_text
from ..ui.panels import exact_text
from ..ui.printable import printable
from .report import FileEntry


def print_depths(objects: Sequence[bpy.types.Object]) -> None:
    """How many faces of each mesh have which depth."""
    print(settings_text(objects))
    for mesh, names in _names_by_mesh(objects).items():
        print(f"\n{names}\n{depth_table(mesh.ccdepth)}\n")


def print_adaptive_meshes(objects: Sequence[bpy.types.Object]) -> None:
    """What adaptive meshes are like."""
    for mesh, names in _names_by_mesh(objects).items():
        record = mesh.ccdepth
        reduced = f"; {record.unreduced_triangles:,} triangles without Reduce" if record.unreduced_triangles else ""
        print(f"{names}: {record.faces:,} faces made from {record.base_faces:,}{reduced}")
        proved = _proved_text(record.largest_bound, record.world_tolerance)
        print(f"  largest distance proved: {proved}; tolerance: {record.world_tolerance:.4g}")
        print(f"  all of it at depth {record.deepest}: {int(record.uniform_faces):,} faces")


def print_levels(objects: Sequence[bpy.types.Object]) -> None:
    """Which levels were set."""
    for mesh, names in _names_by_mesh(objects).items():
        at_frame = f"; the worst frame is {mesh.ccdepth.worst_frame}" if mesh.ccdepth.frames else ""
        print(f"{names}: level {mesh.ccdepth.uniform_level}, {int(mesh.ccdepth.uniform_faces):,} faces{at_frame}")


def print_measured(entry: FileEntry) -> None:
    """How far meshes are from their limit surfaces."""
    for each in entry.objects:
        if each.measured is not None:
            verdict = deviation_results.verdict(each.measured.proved, each.measured.reached, each.tolerance)
            most = metres_text(each.measured.proved, Rounding.UP)
            least = metres_text(each.measured.reached, Rounding.DOWN)
            tolerance = metres_text(each.tolerance)
            name = printable(each.result or each.name)
            print(f"{name}: deviation at most {most}, at least {least}: {verdict.value}; the tolerance is {tolerance}")


def _proved_text(length: float, tolerance: float) -> str:
    """A proved length of the scene, rounded up."""
    return bound_text(bpy.context.scene, length, tolerance, PLAIN)


def metres_text(length: float, rounding: Rounding = Rounding.NEAREST) -> str:
    """A length in metres, in the unit that suits it."""
    *others, smallest = METRIC.values()
    unit = next((unit for unit in others if length >= unit.length), smallest)
    return f"{number_text(Decimal(length) / unit.length, rounding)} {unit.name}"


def depth_table(record: bpy.types.PropertyGroup) -> str:
    """How many faces of a mesh have which depth, as lines of text."""
    lines = [f"{'depth':>8}{'faces':>14}{'share':>9}"]
    lines += [f"{row.depth:>8}{row.faces:>14,}{row.faces / record.faces:>9.1%}" for row in record.rows]
    lines.append(f"{'all':>8}{record.faces:>14,}")
    if record.frames:
        lines.append(f"  deepest at frame {record.worst_frame}, of frames {record.frames}")
    if record.uniform_level >= 0:
        lines.append(f"  all of it at level {record.uniform_level}: {int(record.uniform_faces):,} faces")
    else:
        lines.append("  the level for all of it is not known: the depths are from an earlier version of CC Depth")
    if record.method == "DISTANCE":
        lines.append(f"  no lesser depth would do {exact_text(record.exact_faces, record.faces).lower()}")
    return "\n".join(lines)


def settings_text(objects: Sequence[bpy.types.Object]) -> str:
    """The settings of the results, in a line."""
    record = objects[0].data.ccdepth
    if results.shows_deviation(objects[0].data):
        records = [obj.data.ccdepth for obj in objects]
        deviation, length = max((each.deviation, each.measurement.world_tolerance) for each in records)
        return f"Tolerance {length:.4g} · Largest deviation proved: {_proved_text(deviation, length)}"
    tolerance = f"{record.tolerance:.4g}"
    if record.tolerance_mode == "RELATIVE":
        tolerance += " of the diagonal"
        lengths = {obj.data.ccdepth.world_tolerance for obj in objects}
        if len(lengths) == 1:
            tolerance += f" ({record.world_tolerance:.4g})"
    if record.subdivision:
        records = [obj.data.ccdepth for obj in objects]
        proved = _proved_text(*max((each.largest_bound, each.world_tolerance) for each in records))
        faces = sum(mesh.ccdepth.faces for mesh in {obj.data for obj in objects})
        return f"Tolerance {tolerance} · {faces:,} faces · Largest distance proved: {proved}"
    return f"Tolerance {tolerance} · {METHOD_TEXTS[record.method][0]} · Vertices: {VERTEX_TEXTS[record.vertices][0]}"


def _names_by_mesh(objects: Sequence[bpy.types.Object]) -> dict[bpy.types.Mesh, str]:
    """The names of the objects that use each mesh, as they can be printed."""
    names: dict[bpy.types.Mesh, list[str]] = {}
    for blender_object in objects:
        names.setdefault(blender_object.data, []).append(printable(blender_object.name))
    return {mesh: ", ".join(users) for mesh, users in names.items()}
