# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators, one file each, and the common code of long runs."""

import bpy

from ..state import watch
from . import job
from .apply_adaptive import CCDEPTH_OT_subdivide
from .bake_colors import CCDEPTH_OT_bake_colors
from .before_after import CCDEPTH_OT_before_after
from .clear import CCDEPTH_OT_clear
from .compute_depth import CCDEPTH_OT_compute
from .copy_value import CCDEPTH_OT_copy_value
from .count_faces import CCDEPTH_OT_count_faces
from .edit_faces import CCDEPTH_OT_edit_faces
from .find_tolerance import CCDEPTH_OT_find_tolerance
from .invalid_faces import CCDEPTH_OT_repair, CCDEPTH_OT_select_invalid
from .measure_deviation import CCDEPTH_OT_measure
from .open_manual import CCDEPTH_OT_open_manual
from .select_by_depth import CCDEPTH_OT_select
from .select_worst import CCDEPTH_OT_select_worst
from .set_levels import CCDEPTH_OT_set_levels
from .tolerances import CCDEPTH_OT_tolerance_preset_add, CCDEPTH_OT_use_tolerance
from .update_result import KEEPING_UPDATED, CCDEPTH_OT_update, CCDEPTH_OT_update_kept

CLASSES = (
    CCDEPTH_OT_compute,
    CCDEPTH_OT_clear,
    CCDEPTH_OT_bake_colors,
    CCDEPTH_OT_select,
    CCDEPTH_OT_set_levels,
    CCDEPTH_OT_subdivide,
    CCDEPTH_OT_update,
    CCDEPTH_OT_update_kept,
    CCDEPTH_OT_before_after,
    CCDEPTH_OT_count_faces,
    CCDEPTH_OT_find_tolerance,
    CCDEPTH_OT_use_tolerance,
    CCDEPTH_OT_tolerance_preset_add,
    CCDEPTH_OT_measure,
    CCDEPTH_OT_select_worst,
    CCDEPTH_OT_edit_faces,
    CCDEPTH_OT_select_invalid,
    CCDEPTH_OT_repair,
    CCDEPTH_OT_copy_value,
    CCDEPTH_OT_open_manual,
)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    watch.clients.append(KEEPING_UPDATED)


def unregister() -> None:
    watch.clients.remove(KEEPING_UPDATED)
    job.stop_all()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
