# SPDX-License-Identifier: GPL-3.0-or-later
"""The fewest triangles within a limit of the limit surface, by attempts of any program that merges triangles."""

from .sampled_distances import Places
from .search import Attempt, Proof, Reduction, TriangleMesh

__all__ = ["Attempt", "Places", "Proof", "Reduction", "TriangleMesh"]
