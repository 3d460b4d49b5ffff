# SPDX-License-Identifier: GPL-3.0-or-later
"""The polygon mesh and its half-edges, parts of it, and what is refused."""
