# SPDX-License-Identifier: GPL-3.0-or-later
"""Facts about depths, adaptive meshes and measurements, for panels and the terminal: names, values and meanings; and
the selected objects that have any."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal
from math import degrees
from typing import NamedTuple

import bpy

from ..state import heat_map, known, mesh_values, result_record
from ..state.chosen import chosen
from ..state.heat_map import Shown
from ..state.properties import METHOD_TEXTS, VERTEX_TEXTS
from ..tasks.deviation_task import Verdict
from .lengths import DEGREES, DIGITS, Rounding, Unit, bound_texts, common_unit, count_text, length_text, number_text
from .sidebar import NAME_PART, closed_panel

# Larger counts of faces are written as powers of ten.
LARGEST_COUNT_IN_FULL = 10**10

OWN_FACES = "How many faces the mesh itself has, before modifiers; a mesh of several objects counts once"
CONTROL_FACES = "How many faces the control mesh has: the mesh with the included modifiers"
AT_SAMPLES = "The largest angle found at dense samples, which proves nothing, from the limit surface:"
ALLOWED = "The allowed distance from the limit surface, in the scene's unit"


SHADING = "The proved largest angle between the shown normals and those of the limit surface, of the allowed angle"
FACETS = (
    "The proved largest angle between triangles and the limit surface, where no shading angle counts, of the allowed "
    "angle"
)
NARROW = "How many faces have parts narrower than the tolerance, where angles do not count"


RATIO = "The largest proved distance in parts of the tolerance at its place, which varies"


class Fact(NamedTuple):
    """A value with its name. meaning: for the tooltip. is_detail: whether it is of interest to few."""

    name: str
    value: str
    meaning: str
    is_detail: bool = False


def draw_facts(layout: bpy.types.UILayout, facts: Sequence[Fact], panel: str = "") -> None:
    """Names and values beside each other, like properties, with tooltips; details in a closed panel of this name."""
    _draw_rows(layout, [fact for fact in facts if not fact.is_detail])
    details = [fact for fact in facts if fact.is_detail]
    if details:
        body = closed_panel(layout, f"CCDEPTH_{panel}_details", "Details")
        if body is not None:
            _draw_rows(body, details)


def _draw_rows(layout: bpy.types.UILayout, facts: Iterable[Fact]) -> None:
    column = layout.column(align=True)
    for name, value, meaning, _ in facts:
        split = column.split(factor=NAME_PART)
        for text, alignment in ((name, "RIGHT"), (value, "LEFT")):
            row = split.row()
            row.alignment = alignment
            button = row.operator("ccdepth.copy_value", text=text, translate=False, emboss=False)
            button.value, button.meaning = value, meaning


def facts_of(scene: bpy.types.Scene, record: bpy.types.PropertyGroup) -> list[Fact]:
    """The facts about the depths on a mesh, or about an adaptive mesh."""
    if record.subdivision:
        faces = Fact("Faces", f"{record.faces:,}", "How many faces the result has")
        return [faces, *_of_adaptive_mesh(scene, record)]
    return [Fact("Mesh Faces", f"{record.faces:,}", OWN_FACES, is_detail=True), *_of_depths(scene, record)]


def _of_depths(scene: bpy.types.Scene, record: bpy.types.PropertyGroup) -> list[Fact]:
    facts = [_deepest([record]), Fact("Tolerance", length_text(scene, record.world_tolerance), ALLOWED, is_detail=True)]
    facts += [*_seen_from(record), *_varied_by(record)]
    if record.frames:
        meaning = "The computed frames: each face has its deepest depth"
        facts.insert(1, Fact("Frames", record.frames, meaning))
    facts += ways([record])
    meaning = "How many faces the whole mesh has at the first level that is enough for all faces"
    faces = f"{short_count(int(record.uniform_faces))} faces"
    facts.append(Fact(f"At Level {record.uniform_level}", faces, meaning))
    # A depth that is disproved at equal parameters may be enough all the same.
    if record.method == "DISTANCE":
        meaning = "The number of faces for which no lesser depth is enough, as proved"
        facts.append(Fact("Proved Minimal", _exact_text(record.exact_faces, record.faces), meaning))
    if record.faces_left:
        meaning = "The number of faces for which lesser depths were not measured; Effort Full measures them"
        facts.append(Fact("Might Need Less", f"{record.faces_left:,}", meaning))
    return facts


def _seen_from(record: bpy.types.PropertyGroup) -> list[Fact]:
    """The camera of a tolerance in pixels, with the pixels."""
    meaning = "The camera that sees the tolerance as this many pixels, and its frames"
    text = f"{record.tolerance:.3g} px of {record.seen_from}"
    return [Fact("Seen From", text, meaning)] if record.seen_from else []


def _varied_by(record: bpy.types.PropertyGroup) -> list[Fact]:
    """What the tolerance of depths, or of a measurement, varies by."""
    texts = {"VERTEX_GROUP": f"{record.vertex_group}, up to {record.coarsest:.3g} times", "MATERIAL": "Materials"}
    meaning = "What the tolerance varies by: every face is within its own tolerance"
    return [Fact("Vary by", texts[record.tolerance_by], meaning)] if record.tolerance_by in texts else []


def _deepest(records: Sequence[bpy.types.PropertyGroup]) -> Fact:
    """The deepest depth; over frames, with a frame that has it."""
    record = max(records, key=lambda each: each.deepest)
    at_frame = f" at frame {record.deepest_frame}" if record.frames and len(records) == 1 else ""
    meaning = "The largest number of levels that a face needs to be within the tolerance of the limit surface"
    return Fact("Deepest Depth", f"{record.deepest}{at_frame}", meaning)


def ways(records: Sequence[bpy.types.PropertyGroup]) -> list[Fact]:
    """The methods of the depths, and the places of the vertices of the subdivided mesh."""
    methods = dict.fromkeys(METHOD_TEXTS[record.method][0] for record in records)
    vertices = dict.fromkeys(VERTEX_TEXTS[record.vertices][0] for record in records)
    return [
        Fact("Method", ", ".join(methods), "How the distance to the limit surface was bounded", is_detail=True),
        Fact("Vertices", ", ".join(vertices), "Where the subdivided mesh has its vertices", is_detail=True),
    ]


def _of_adaptive_mesh(scene: bpy.types.Scene, record: bpy.types.PropertyGroup) -> list[Fact]:
    unit = common_unit(scene, (record.world_tolerance, record.largest_bound))
    before = f"{record.unreduced_triangles:,} triangles"
    unreduced = [Fact("Without Reduce", before, "How many triangles there were before Reduce")]
    largest, tolerance = bound_texts(scene, record.largest_bound, record.world_tolerance, unit)
    proved = "The proved largest distance between the mesh and the limit surface, both ways"
    angles = [
        Fact(name, " of ".join(bound_texts(scene, found, allowed, DEGREES)), meaning)
        for name, found, allowed, meaning in (
            ("Shading Angle", record.largest_shading_angle, record.shading_angle, SHADING),
            ("Facet Angle", record.largest_facet_angle, record.facet_angle, FACETS),
        )
        if allowed
    ]
    narrow = count_text(record.narrow_leaves, "face", "faces")
    return [
        *(unreduced if record.unreduced_triangles else []),
        Fact("Control Faces", f"{record.base_faces:,}", CONTROL_FACES, is_detail=True),
        Fact(
            "Most Divided",
            str(record.deepest),
            "How many times the most divided part of a face was halved each way",
            is_detail=True,
        ),
        Fact("Tolerance", tolerance, ALLOWED, is_detail=True),
        *_seen_from(record),
        Fact("Distance", largest, proved),
        *([Fact("Of Tolerance", _percent(record.largest_ratio), RATIO)] if record.largest_ratio else []),
        *angles,
        *([Fact("Narrow Parts", narrow, NARROW, is_detail=True)] if record.narrow_leaves else []),
    ]


def totals(scene: bpy.types.Scene, objects: Sequence[bpy.types.Object]) -> list[Fact]:
    """The facts about several objects together; each mesh counts once."""
    records = [mesh.ccdepth for mesh in {each.data for each in objects}]
    depths = [record for record in records if not record.subdivision]
    return [
        Fact("Objects", f"{len(objects):,}", "How many of the selected objects have a result"),
        Fact("Mesh Faces", f"{sum(record.faces for record in records):,}", OWN_FACES, is_detail=True),
        _deepest(records),
        Fact("Tolerance", lengths_text(scene, (each.world_tolerance for each in records)), ALLOWED, is_detail=True),
        *(ways(depths) if depths else []),
    ]


def facts_of_measurement(scene: bpy.types.Scene, record: bpy.types.PropertyGroup) -> tuple[str, list[Fact]]:
    """The tolerance of the measurement on a mesh, as text, and the facts about the measurement."""
    found = record.measurement
    factors = tuple(found.factors) if found.factors[1] else None
    lengths = record.deviation, record.deviation_reached, found.world_tolerance
    most, least, tolerance = deviation_texts(scene, *lengths, factors)
    reached = "The distance of one point; the largest distance is between At Least and At Most"
    return tolerance, [
        Fact("At Most", most, "The proved largest distance, both ways"),
        Fact("At Least", least, reached),
        *_seen_from(found),
        *_varied_by(found),
        Fact("Facets", angle_text(record.deviation_facet_angle), f"{AT_SAMPLES} of the triangles"),
        Fact("Shading", angle_text(record.deviation_shading_angle), f"{AT_SAMPLES} of the shading"),
    ]


def counts_of(mesh: bpy.types.Mesh, source: bpy.types.Mesh | None) -> list[Fact]:
    """The size of an adaptive mesh besides its faces, and these in parts of the level at which all faces of its source
    are as near."""
    faces, record = len(mesh.polygons), None if source is None else source.ccdepth
    share = []
    if record is not None and record.uniform_level > 0 and record.world_tolerance == mesh.ccdepth.world_tolerance:
        meaning = "The faces in parts of those of the whole mesh at the first level that is enough for all faces"
        share = [Fact(f"Of Level {record.uniform_level}", _percent(faces / int(record.uniform_faces)), meaning)]
    triangles = f"{len(mesh.loops) - 2 * faces:,}"
    return [
        *share,
        Fact("Triangles", triangles, "How many triangles Blender and exporters make of the faces"),
        Fact("Vertices", f"{len(mesh.vertices):,}", "How many vertices the result has", is_detail=True),
    ]


def angle_text(angle: float) -> str:
    """The text of an angle in radians that was found at samples."""
    return f"{degrees(angle):.2f}° at samples"


def deviation_texts(
    scene: bpy.types.Scene, proved: float, reached: float, tolerance: float, factors: Sequence[float] | None
) -> tuple[str, str, str]:
    """A measurement's proved and reached distance and the tolerance, as texts: lengths in the scene, or where the
    tolerance varies by factors, distances in parts of the tolerance at their place."""
    unit = common_unit(scene, (proved, reached, tolerance))
    most, allowed = bound_texts(scene, proved, tolerance, unit)
    if factors:
        return *ratio_texts(proved, reached, tolerance), f"{allowed} {factors_text(factors)}"
    return most, length_text(scene, reached, Rounding.DOWN, unit=unit), allowed


def ratio_texts(proved: float, reached: float, tolerance: float) -> tuple[str, str]:
    """A proved and a reached distance in parts of the tolerance at their place."""
    texts = (
        number_text(Decimal(length) / Decimal(tolerance), rounding)
        for length, rounding in ((proved, Rounding.UP), (reached, Rounding.DOWN))
    )
    most, least = (f"{text} of its tolerance" for text in texts)
    return most, least


def factors_text(factors: Sequence[float]) -> str:
    """The factors on a tolerance that varies."""
    least, greatest = factors
    return f"× {least:.3g} to {greatest:.3g}"


def deviation_text(most: str, least: str, tolerance: str, verdict: Verdict) -> str:
    """The measurement as a sentence, from texts of its distances and the tolerance."""
    joined = "; the tolerance is" if verdict is Verdict.UNDECIDED else " of"
    return f"Deviation at most {most}, at least {least}: {verdict.value}{joined} {tolerance}"


def angles_fact(faces: int, by_distance: int) -> Fact:
    """The faces that angles cost. by_distance: the number of faces without angles."""
    more = f"{faces - by_distance:+,} faces"
    return Fact("For Angles", more, "How many faces are made for the shading angle and the facet angle")


def count_fact(faces: int, *, reduced: bool = False) -> Fact:
    """The number of faces to be made. reduced: whether Reduce merges most faces."""
    if reduced:
        return Fact("Before Reduce", f"{faces:,} faces", "How many faces there are before Reduce merges most faces")
    return Fact("Will Make", f"{faces:,} faces", "How many faces Apply Adaptive Subdivision makes with these settings")


def _exact_text(exact: int, faces: int) -> str:
    """The share of faces without a lesser depth that is enough; never rounded up to all faces."""
    if exact == faces:
        return "All faces"
    return f"{min(100 * exact / faces, 99.9):.1f} % of faces"


def share_text(faces: int, total: int) -> str:
    """A number of faces and its share, neither rounded down to none nor up to all."""
    share = faces / total
    return f"{faces:,}  ({_percent(min(share, 0.999) if faces < total else share)})"


def _percent(share: float) -> str:
    return "< 0.1 %" if 0 < share < 0.001 else f"{share:.1%}".replace("%", " %")


def short_count(count: int) -> str:
    """A count with separators, or as a power of ten when it is too long for the sidebar."""
    if count < LARGEST_COUNT_IN_FULL:
        return f"{count:,}"
    mantissa, exponent = f"{count:.2e}".split("e+")
    return f"{mantissa} × 10{exponent.lstrip('0').translate(str.maketrans('0123456789', '⁰¹²³⁴⁵⁶⁷⁸⁹'))}"


# Without anything selected, the legend looks through no more objects than this.
MOST_SEARCHED = 1000


def with_depths(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected or edited objects with depths that were not made by subdivision."""
    return _selected(context, lambda each: mesh_values.has_depths(each.data) and not each.data.ccdepth.subdivision)


def made_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected objects that Apply Adaptive Subdivision made, from others or in place."""
    return _selected(context, result_record.is_adaptive)


def refused_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected objects with faces that the last run could not use."""
    return _selected(context, lambda holder: known.faces_at_fault(holder.data) > 0)


def colored_objects(context: bpy.types.Context, kind: Shown) -> list[bpy.types.Object]:
    """The objects of the legend: the selected objects that show a heat map; or else all objects that show one."""

    def is_colored(holder: bpy.types.Object) -> bool:
        return heat_map.has_shown(holder.data, kind) and bool(holder.visible_get())

    found = _selected(context, is_colored)
    objects = context.view_layer.objects
    if found or len(objects) > MOST_SEARCHED:
        return found
    return [each for each in objects if each.type == "MESH" and is_colored(each)]


def _selected(context: bpy.types.Context, wanted: Callable[[bpy.types.Object], bool]) -> list[bpy.types.Object]:
    return [each for each in chosen(context) if wanted(each)]


def faces_by_depth(objects: Iterable[bpy.types.Object]) -> Counter[int]:
    """The number of faces of each depth; each mesh counts once."""
    counts = Counter[int]()
    for mesh in {each.data for each in objects}:
        for row in mesh.ccdepth.rows:
            counts[row.depth] += row.faces
    return counts


def lengths_text(
    scene: bpy.types.Scene, lengths: Iterable[float], digits: int = DIGITS, unit: Unit | None = None
) -> str:
    """One length, or the least and the largest of several, to some significant digits. unit: None for the unit that
    suits them."""
    found = {*lengths}
    unit = unit or common_unit(scene, found)
    least, largest = (length_text(scene, each, digits=digits, unit=unit) for each in (min(found), max(found)))
    if least == largest:
        return least
    return f"{least if unit is None else least.removesuffix(unit.name).rstrip()}–{largest}"
