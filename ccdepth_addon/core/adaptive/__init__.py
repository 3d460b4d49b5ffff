# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: tree, planner, templates, tessellation."""
