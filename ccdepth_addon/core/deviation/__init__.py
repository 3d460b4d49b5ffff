# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance of any mesh from the limit surface of a control mesh, both ways."""

from .kept_proofs import KeptProofs
from .measure import Deviation, measure_deviation
from .sampled_angles import SampledSurface

__all__ = ["Deviation", "KeptProofs", "SampledSurface", "measure_deviation"]
