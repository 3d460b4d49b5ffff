# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of faces and vertices: interpolation at points of the surface, and face-varying (UV) surfaces."""
