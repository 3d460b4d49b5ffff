# SPDX-License-Identifier: GPL-3.0-or-later
"""Subdivision depth of Catmull-Clark surfaces: numpy arrays in, numpy arrays out, nothing of Blender."""
