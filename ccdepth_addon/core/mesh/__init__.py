# SPDX-License-Identifier: GPL-3.0-or-later
"""The polygon mesh with its half-edges, submeshes, boxes around the surface of faces, and validation."""
