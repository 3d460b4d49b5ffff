# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells: nodes of a quadtree, each with a representation of its surface."""
