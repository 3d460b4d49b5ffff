# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels, legend, heat map, colours, and how numbers and names are written."""
