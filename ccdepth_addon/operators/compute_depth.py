# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute Depth."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import bpy

from ..exchange.modifiers import subdivision_modifier
from ..state import heat_map, out_of_date, properties
from ..state.chosen import chosen
from ..state.heat_map import Shown
from ..tasks.depth_task import DepthSettings, MeshDepths, compute_depths, prepare_depths
from ..tasks.frames import chosen_frames, typed_frames
from ..tasks.pose_groups import DepthRequest
from ..ui.lengths import count_text, printable
from .mesh_operators import LongOperator, Steps, Work
from .refusals import refuse_what_cannot_be_written, still_there


class CCDEPTH_OT_compute(properties.VariationProperties, properties.DepthProperties, LongOperator):
    """Compute how many Catmull-Clark levels each face needs to be within the tolerance of the limit surface. Depths
    are about distance alone, not about the angles of shading and facets"""

    bl_idname = "ccdepth.compute"
    bl_label = "Compute Depth"

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        objects = chosen(context)
        self.end_without(context, objects)
        answers = yield from depths_computed(context, objects, self, self.tolerance)
        self._report(context, answers)
        return {"FINISHED"}

    def _report(self, context: bpy.types.Context, answers: list[MeshDepths]) -> None:
        self.report_skipped(context)
        for note in depth_notes(answers):
            self.report({"WARNING"}, printable(note))
        faces = count_text(sum(len(answer.depths) for answer in answers), "face", "faces")
        meshes = f"{len(answers)} meshes, " if len(answers) > 1 else ""
        worst = max(answers, key=lambda answer: answer.deepest)
        at_frame = "" if worst.deepest_frame is None else f" at frame {worst.deepest_frame}"
        left = sum(int(answer.might_need_less.sum()) for answer in answers)
        less = f"; {count_text(left, 'face', 'faces')} might need less: Effort Full" if left else ""
        self.report({"INFO"}, f"{meshes}{faces}, deepest depth {worst.deepest}{at_frame}{less}")


def depths_computed(
    context: bpy.types.Context, objects: list[bpy.types.Object], holder: Any, tolerance: float
) -> Steps[list[MeshDepths]]:
    """Compute the depths of objects, and write them. holder: of the settings, an operator or a scene's. Raises
    ComputeError."""
    refuse_what_cannot_be_written(objects)
    frames = chosen_frames(context.scene, holder.frames, holder.frame_list)
    settings = DepthSettings.of(holder, tolerance, frames=frames)
    if holder.frames == "CUSTOM":
        typed_frames(settings.frames)
    work = yield from prepare_depths(context, objects, settings)
    answers: list[MeshDepths]
    answers = yield Work(partial(compute_depths, work), "Computing depth: {:.0%}".format, total=1.0)
    holders = [still_there(each.task.holders, each.task.face_count)[0] for each in answers]
    out_of_date.write_depths(holders, answers, settings)
    heat_map.show(context, Shown.DEPTH)
    return answers


def depth_notes(answers: list[MeshDepths]) -> Iterator[str]:
    """Notes on modifiers with an outcome that would surprise a user."""
    for answer in answers:
        yield from (f"{answer.task.holders[0].name}: {note}" for note in _modifier_notes(answer))
        yield from _quality_notes(answer)


def _modifier_notes(answer: MeshDepths) -> list[str]:
    """Notes on modifiers with faces that the depths on the mesh cannot show."""
    notes = []
    if answer.added_faces:
        faces = count_text(answer.added_faces, "face", "faces")
        notes.append(
            f"modifiers add {faces} that come from no face of the mesh; the deepest needs {answer.added_deepest}"
        )
    if answer.removed_faces:
        faces = count_text(answer.removed_faces, "face", "faces")
        notes.append(f"modifiers take {faces} away; their depth is 0")
    return notes


def _quality_notes(answer: MeshDepths) -> list[str]:
    """The Subdivision Surface modifiers with a Quality too low for Use Limit Surface at their levels."""
    notes = []
    requests: dict[int, list[DepthRequest]] = {}
    for request in answer.task.requests:
        requests.setdefault(request.surface.holder.uid, []).append(request)
    any_uid = answer.task.groups[0].requests[0].surface.holder.uid
    most = bpy.types.SubsurfModifier.bl_rna.properties["quality"].hard_max
    needed_at: dict[tuple[int, int], int] = {}
    for each in still_there(answer.task.holders):
        modifier = subdivision_modifier(each)
        if modifier is None or not modifier.use_limit_surface or modifier.quality == most:
            continue
        # Objects without a surface of their own have the same control mesh as another one.
        alike = each.session_uid if each.session_uid in requests else any_uid
        level = max(modifier.levels, modifier.render_levels)
        key = (alike, level)
        if key not in needed_at:
            needed_at[key] = min(max(one.limit_quality(level) for one in requests[alike]), most)
        if modifier.quality < needed_at[key]:
            notes.append(
                f"{each.name}: at its {count_text(level, 'level', 'levels')}, Use Limit Surface needs a Quality of "
                f"{needed_at[key]} to show the limit surface; it is {modifier.quality}"
            )
    return notes
