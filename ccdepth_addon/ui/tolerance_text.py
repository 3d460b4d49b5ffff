# SPDX-License-Identifier: GPL-3.0-or-later
"""The tolerance in other words: in full if its field shows too few digits, and in the other mode."""

from __future__ import annotations

from decimal import Decimal

import bpy

from ..state.known import objects_for_tolerance, shown_diagonal
from ..state.properties import scene_tolerance
from .lengths import length_text, number_text
from .selected_objects import lengths_text

# A field shows as many decimals as Blender has at most, and is wrong by no more than this part of a number.
DECIMALS = 6
LARGEST_ERROR = 1e-3

# Above this count of selected objects the conversion is hidden: it would measure every object.
MOST_OBJECTS = 8


def tolerance_text(context: bpy.types.Context) -> str:
    """The scene's tolerance as a length or a part of the active object, or of the selected objects if the active one is
    no mesh; empty if the sizes are unknown and the field shows all digits."""
    scene, settings = context.scene, context.scene.ccdepth
    relative = settings.tolerance_mode == "RELATIVE"
    tolerance = scene_tolerance(settings)
    texts = []
    if abs(round(tolerance, DECIMALS) - tolerance) > LARGEST_ERROR * abs(tolerance):
        texts.append(f"{tolerance:.6g}" if relative else length_text(scene, tolerance, digits=6))
    diagonals, is_exact = _shown_diagonals(context)
    sign = "=" if is_exact else "≈"
    if diagonals and relative:
        texts.append(f"{sign} {lengths_text(scene, (tolerance * each for each in diagonals))}")
    elif diagonals:
        parts = sorted(tolerance / each for each in diagonals)
        least, largest = (number_text(Decimal(each)) for each in (parts[0], parts[-1]))
        texts.append(f"{sign} {least if least == largest else f'{least}–{largest}'} of the size")
    return " ".join(texts)


def _shown_diagonals(context: bpy.types.Context) -> tuple[list[float], bool]:
    """The diagonals of the objects of the tolerance, and whether all are exact; none if one is unknown."""
    holders = objects_for_tolerance(context)
    if len(holders) > MOST_OBJECTS:
        return [], False
    use_modifiers = context.scene.ccdepth.use_modifiers
    found = [shown_diagonal(each, use_modifiers=use_modifiers) for each in holders]
    known = [each for each in found if each is not None]
    return [diagonal for diagonal, _ in known] if len(known) == len(found) else [], all(exact for _, exact in known)
