# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: the tree, the planner, the templates and the tessellation."""
