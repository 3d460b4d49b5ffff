# SPDX-License-Identifier: GPL-3.0-or-later
"""Between Blender and arrays: control meshes in; new meshes, attributes, groups, normals and shape keys out."""

import bpy  # noqa: F401 — the bpy wheel has bmesh only afterwards.
