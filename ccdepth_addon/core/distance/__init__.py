# SPDX-License-Identifier: GPL-3.0-or-later
"""How far drawn triangles and the limit surface are from each other, whatever their parameters. docs/distance.md"""
