# SPDX-License-Identifier: GPL-3.0-or-later
"""``blender -b --command ccdepth``: arguments, runs, files and pictures."""

import bpy  # noqa: F401 — the bpy wheel has bmesh only afterwards.
