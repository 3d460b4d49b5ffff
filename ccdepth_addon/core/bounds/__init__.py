# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds on the distance between a control mesh and its limit surface."""
