# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance between drawn triangles and the limit surface as sets, independent of parameters. docs/distance.md"""
