# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels, legend and heat map, and numbers and names as text."""
