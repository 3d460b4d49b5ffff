# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance of any mesh from the limit surface of a control mesh, both ways."""

from .measure import Deviation, measure_deviation
from .sampled_angles import SampledSurface

__all__ = ["Deviation", "SampledSurface", "measure_deviation"]
