# SPDX-License-Identifier: GPL-3.0-or-later
"""The strongest reduction that is proved to be within a limit of the limit surface, by an external decimator."""

from .sampled_distances import Places
from .search import Attempt, Proof, Reduction, TriangleMesh

__all__ = ["Attempt", "Places", "Proof", "Reduction", "TriangleMesh"]
