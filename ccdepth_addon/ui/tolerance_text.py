# SPDX-License-Identifier: GPL-3.0-or-later
"""The tolerance in other words: in full where its field shows too few digits, and as the other mode would have it."""

from __future__ import annotations

from decimal import Decimal

import bpy

from ..state.diagonals import known_diagonal
from ..state.properties import tolerance_name
from ..state.result_record import control_object
from ..tasks.surfaces import as_typed
from .lengths import length_text, number_text

# A field shows as many decimals as Blender has at most, and is wrong by no more than this part of a number.
DECIMALS = 6
LARGEST_ERROR = 1e-3

DIGITS = 3


def tolerance_text(scene: bpy.types.Scene, active: bpy.types.Object | None) -> str:
    """What the tolerance of the scene is on the active object, as far as that is known; empty when there is nothing to
    add to its field."""
    settings = scene.ccdepth
    relative = settings.tolerance_mode == "RELATIVE"
    tolerance = as_typed(getattr(settings, tolerance_name(settings.tolerance_mode)))
    texts = []
    if abs(round(tolerance, DECIMALS) - tolerance) > LARGEST_ERROR * abs(tolerance):
        texts.append(f"{tolerance:.6g}" if relative else length_text(scene, tolerance, digits=6))
    diagonal = None
    if active is not None and active.type == "MESH":
        diagonal = known_diagonal(control_object(active), use_modifiers=settings.use_modifiers)
    if diagonal is not None:
        other = tolerance * diagonal if relative else tolerance / diagonal
        text = length_text(scene, other, digits=DIGITS) if relative else f"{fraction_text(other)} of the size"
        texts.append(f"= {text}")
    return " ".join(texts)


def fraction_text(fraction: float) -> str:
    """A part of a size, with few digits."""
    return number_text(Decimal(fraction), digits=DIGITS)
