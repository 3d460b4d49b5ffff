# SPDX-License-Identifier: GPL-3.0-or-later
"""The Catmull-Clark surface: the step and its rules, patches, stencils, limit positions and normals, evaluation."""
