# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances in pixels of an image."""
