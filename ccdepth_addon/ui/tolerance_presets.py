# SPDX-License-Identifier: GPL-3.0-or-later
"""The presets of the tolerance, in the header of the sidebar's panel."""

from pathlib import Path

import bpy
from bl_ui.utils import PresetPanel

from ..state.properties import TOLERANCE_PRESETS

# It has a folder of presets, as Blender expects them.
ADDON = str(Path(__file__).resolve().parent.parent)


class CCDEPTH_PT_tolerance_presets(PresetPanel, bpy.types.Panel):
    bl_label = "Tolerance Presets"
    preset_subdir = TOLERANCE_PRESETS
    preset_operator = "script.execute_preset"
    preset_add_operator = "ccdepth.tolerance_preset_add"


def register() -> None:
    bpy.utils.register_class(CCDEPTH_PT_tolerance_presets)
    bpy.utils.register_preset_path(ADDON)


def unregister() -> None:
    bpy.utils.unregister_preset_path(ADDON)
    bpy.utils.unregister_class(CCDEPTH_PT_tolerance_presets)
