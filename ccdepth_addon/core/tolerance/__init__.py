# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances that vary over a mesh: by factors at corners, and by pixels of cameras."""
