# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: quadtree, planner, templates, tessellation."""
