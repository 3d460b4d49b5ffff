# SPDX-License-Identifier: GPL-3.0-or-later
"""The tolerance in other words: in full if its field shows too few digits, and in the other mode."""

from __future__ import annotations

from decimal import Decimal

import bpy

from ..state.known import known_diagonal, objects_for_tolerance
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
    diagonals = _known_diagonals(context)
    if diagonals and relative:
        texts.append(f"= {lengths_text(scene, (tolerance * each for each in diagonals))}")
    elif diagonals:
        parts = sorted(tolerance / each for each in diagonals)
        least, largest = (number_text(Decimal(each)) for each in (parts[0], parts[-1]))
        texts.append(f"= {least if least == largest else f'{least}–{largest}'} of the size")
    return " ".join(texts)


def _known_diagonals(context: bpy.types.Context) -> list[float]:
    """The diagonals of the objects of the tolerance; empty if one is unknown."""
    holders = objects_for_tolerance(context)
    if len(holders) > MOST_OBJECTS:
        return []
    use_modifiers = context.scene.ccdepth.use_modifiers
    found = [known_diagonal(each, use_modifiers=use_modifiers) for each in holders]
    return [] if None in found else [each for each in found if each is not None]
