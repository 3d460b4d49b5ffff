# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance between drawn triangles and the limit surface, whatever their parameters. docs/distance.md"""
