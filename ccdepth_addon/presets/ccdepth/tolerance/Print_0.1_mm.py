# SPDX-License-Identifier: GPL-3.0-or-later
"""What a good printer resolves, in the scene's units."""

import bpy

scene = bpy.context.scene
scene.ccdepth.tolerance_mode = "ABSOLUTE"
scene.ccdepth.tolerance = 0.0001 / scene.unit_settings.scale_length
