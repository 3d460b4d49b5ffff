# SPDX-License-Identifier: GPL-3.0-or-later
"""The tolerance in the sidebar: in other words, and its presets."""

from __future__ import annotations

import re
from ast import literal_eval
from contextlib import suppress
from decimal import Decimal
from math import radians
from pathlib import Path
from typing import NamedTuple

import bpy
from bl_ui.utils import PresetPanel

from ..state.known import objects_for_tolerance, shown_diagonal
from ..state.properties import TOLERANCE_PRESETS, scene_tolerance, tolerance_name
from ..tasks.surfaces import shortest_decimal
from ..tasks.views import camera_name
from .facts import lengths_text
from .lengths import length_text, number_text

# Some five pixels when the object fills the screen, one, and a fifth; each with its shading angle in degrees.
FRACTIONS = {"Draft": (0.005, 10.0), "Standard": (0.001, 5.0), "Fine": (0.0002, 2.0)}

# The resolution of a good printer, in metres, and facets that are not felt, in degrees.
PRINTED, PRINTED_FACETS = 0.0001, 15.0


ANGLES = ("shading_angle", "facet_angle")


class Preset(NamedTuple):
    """A tolerance by a name, as it is typed in its mode. angles: of shading and facets, in radians; None where the
    tolerance is alone. is_own: whether a user added it."""

    name: str
    mode: str
    tolerance: float
    angles: tuple[float, float] | None
    is_own: bool = False


class CCDEPTH_PT_tolerance_presets(PresetPanel, bpy.types.Panel):
    bl_label = "Tolerance Presets"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.ccdepth
        layout.emboss = "PULLDOWN_MENU"
        layout.operator_context = "EXEC_DEFAULT"
        column = layout.column(align=True)
        current = settings.tolerance_mode, scene_tolerance(settings)
        angles = tuple(map(shortest_decimal, (settings.shading_angle, settings.facet_angle)))
        for preset in presets(context.scene):
            row = column.row(align=True)
            row.alignment = "LEFT"
            is_current = current == (preset.mode, shortest_decimal(preset.tolerance)) and (
                preset.angles is None or angles == tuple(map(shortest_decimal, preset.angles))
            )
            button = row.operator(
                "ccdepth.use_tolerance", text=preset.name, translate=False, icon="CHECKMARK" if is_current else "BLANK1"
            )
            button.tolerance_mode, button.tolerance = preset.mode, preset.tolerance
            if preset.angles is not None:
                button.shading_angle, button.facet_angle = preset.angles
            if preset.is_own:
                button = row.operator("ccdepth.tolerance_preset_add", text="", icon="REMOVE")
                button.name, button.remove_name = preset.name, True
        layout.separator()
        row, manager = layout.row(), context.window_manager
        field = row.row()
        field.emboss = "NORMAL"
        field.prop(manager, "preset_name", text="")
        row.operator("ccdepth.tolerance_preset_add", text="", icon="ADD").name = manager.preset_name


def presets(scene: bpy.types.Scene) -> list[Preset]:
    """All presets, fractions before distances, each from coarse to fine."""
    found = [Preset(name, "RELATIVE", fraction, (radians(angle), 0.0)) for name, (fraction, angle) in FRACTIONS.items()]
    printed = PRINTED / scene.unit_settings.scale_length
    found.append(Preset("Print 0.1 mm", "ABSOLUTE", printed, (0.0, radians(PRINTED_FACETS))))
    for path in [path for folder in bpy.utils.preset_paths(TOLERANCE_PRESETS) for path in Path(folder).glob("*.py")]:
        # A file with other contents is no preset.
        with suppress(KeyError, ValueError, SyntaxError):
            values = dict(re.findall(r"ccdepth\.(\w+) = (.+)", path.read_text(encoding="utf-8")))
            mode = literal_eval(values["tolerance_mode"])
            tolerance = float(values[tolerance_name(mode)])
            # Others hold a tolerance alone.
            own = [float(values[name]) for name in ANGLES if name in values]
            angles = (own[0], own[1]) if len(own) == len(ANGLES) else None
            name = bpy.path.display_name(path.name, title_case=False)
            found.append(Preset(name, mode, tolerance, angles, is_own=True))
    return sorted(found, key=lambda each: (each.mode == "ABSOLUTE", -each.tolerance))


register, unregister = bpy.utils.register_classes_factory((CCDEPTH_PT_tolerance_presets,))


# A field shows as many decimals as Blender has at most, and is wrong by no more than this part of a number.
DECIMALS = 6
LARGEST_ERROR = 1e-3

# Above this count of selected objects the conversion is hidden: it would measure every object.
MOST_OBJECTS = 8


def tolerance_text(context: bpy.types.Context) -> str:
    """The scene's tolerance as a length or a part of the active object, or of the selected objects if the active one is
    no mesh; empty if the sizes are unknown and the field shows all digits. Of pixels, the camera."""
    scene, settings = context.scene, context.scene.ccdepth
    if settings.tolerance_mode == "PIXELS":
        camera = camera_name(scene, settings)
        return f"of “{camera}”" if camera else "The scene has no camera"
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
