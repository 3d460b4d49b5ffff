# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells: nodes of a quadtree with what is known of the surface there."""
