# SPDX-License-Identifier: GPL-3.0-or-later
"""What faces and vertices carry: interpolation at points of the surface, and face-varying (UV) surfaces."""
