# SPDX-License-Identifier: GPL-3.0-or-later
"""The printed text about depths, adaptive meshes and measurements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from decimal import Decimal

import bpy

from ..tasks.deviation_task import verdict_of
from ..ui.facts import deviation_text, facts_of
from ..ui.lengths import DIGITS, METRIC, Rounding, enough_digits, number_text, printable
from .report import FileEntry


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
            text = deviation_text(most, least, metres_text(each.tolerance, digits=digits), verdict)
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
