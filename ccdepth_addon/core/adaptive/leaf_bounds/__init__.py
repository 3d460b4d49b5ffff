# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds on the distance between leaves as they are drawn and the surface, one file for each kind."""
