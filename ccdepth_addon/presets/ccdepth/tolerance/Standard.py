# SPDX-License-Identifier: GPL-3.0-or-later
"""About a pixel when the object fills the screen."""

import bpy

settings = bpy.context.scene.ccdepth
settings.tolerance_mode = "RELATIVE"
settings.relative_tolerance = 0.001
