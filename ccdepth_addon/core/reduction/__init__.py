# SPDX-License-Identifier: GPL-3.0-or-later
"""The fewest triangles within a limit of the limit surface, by attempts of any program that merges triangles."""

from .search import Attempt, Reduction, TriangleMesh

__all__ = ["Attempt", "Reduction", "TriangleMesh"]
