# SPDX-License-Identifier: GPL-3.0-or-later
"""Deviations on the mesh: the attribute and the record, in Object Mode and in Edit Mode."""

from __future__ import annotations

from contextlib import ExitStack

import bpy

from .. import version
from ..exchange.result_attributes import DEVIATION_KIND, rounded_up, write_face_values
from ..tasks.deviation_task import MeasureSettings, MeshDeviation
from . import results
from .measured_state import target_of


def write_deviations(mesh: bpy.types.Mesh, answer: MeshDeviation, undo: ExitStack) -> None:
    """Write the answer to its mesh as an attribute.

    undo: when it is closed, the mesh has its old attributes again. Raises WriteError, with nothing changed, when
    Blender does not keep them.
    """
    write_face_values(mesh, {DEVIATION_KIND: rounded_up(answer.deviations)}, undo)


def write_record(mesh: bpy.types.Mesh, answer: MeshDeviation, settings: MeasureSettings) -> None:
    """Write the record of the answer to its mesh, which has the attribute."""
    record = mesh.ccdepth
    record.has_deviation = record.shows_deviation = True
    record.deviation = float(rounded_up(answer.proved))
    # Rounded down: the distance is really there.
    record.deviation_reached = -float(rounded_up(-answer.reached))
    found = record.measurement
    found.measured, found.against = answer.measured, answer.against
    found.tolerance, found.tolerance_mode = settings.tolerance, settings.tolerance_mode
    found.world_tolerance = answer.tolerance
    found.verdict = answer.verdict.name
    found.accuracy, found.accuracy_met = settings.accuracy, answer.accuracy_met
    found.use_modifiers = settings.use_modifiers
    found.version = version()
    found.faces = len(answer.deviations)
    found.worst_face = answer.worst_face
    found.worst_point = answer.worst_point


def shown_object(context: bpy.types.Context) -> bpy.types.Object | None:
    """The object whose deviation is shown: the worst of the selected ones that were measured against the active one; or
    the active one; or the worst of the selected ones."""
    active = context.active_object
    measured = [
        each for each in context.selected_objects if each.type == "MESH" and results.is_deviation_last(each.data)
    ]
    if active is not None and active.type == "MESH":
        others = [each for each in measured if each != active and target_of(each) == active]
        if not others and results.is_deviation_last(active.data):
            return active
        measured = others or measured
    return max(measured, key=lambda each: each.data.ccdepth.deviation, default=None)
