# SPDX-License-Identifier: GPL-3.0-or-later
"""The tolerance in the sidebar in other words, and the presets of settings."""

from __future__ import annotations

import re
from ast import literal_eval
from contextlib import suppress
from decimal import Decimal
from math import degrees, isfinite, radians
from pathlib import Path
from typing import Any, NamedTuple

import bpy
from bl_ui.utils import PresetPanel

from ..state.known import objects_for_tolerance, shown_diagonal
from ..state.properties import PRESET_SETTINGS, PRESETS, scene_tolerance, tolerance_name
from ..tasks.surfaces import shortest_decimal, typed_values
from ..tasks.views import camera_name
from .facts import lengths_text
from .lengths import DIGITS, digits_within, length_text, number_text

# Settings by the names of presets: the tolerance as a fraction, angles of shading and facets in degrees, and Reduce.
# Draft, Standard and Fine are some five pixels when the object fills the screen, one, and a fifth.
FRACTIONS = {
    "Draft": (0.005, 10.0, 0.0, False),
    "Game LOD0": (0.002, 10.0, 0.0, True),
    "Standard": (0.001, 5.0, 0.0, False),
    "Fine": (0.0002, 2.0, 0.0, False),
    "Render Close-Up": (0.00005, 1.0, 0.0, False),
}

# The same with tolerances in metres: two resolutions of printers with facets that are not felt, and of CAD exporters.
DISTANCES = {
    "Print 0.1 mm": (0.0001, 0.0, 15.0, False),
    "Print 0.05 mm": (0.00005, 0.0, 10.0, False),
    "CAD Exchange": (0.00001, 0.0, 10.0, False),
}


VARIATIONS = {
    "NONE": "the same everywhere",
    "VERTEX_GROUP": "coarser by weights",
    "MATERIAL": "by factors of materials",
}


class Preset(NamedTuple):
    """Values of the scene's settings by a name, as they are typed. is_own: whether a user added it; one of an earlier
    version may lack settings, which then stay."""

    name: str
    values: dict[str, Any]
    is_own: bool = False

    @property
    def mode(self) -> str:
        """The mode of the tolerance."""
        return str(self.values["tolerance_mode"])

    @property
    def tolerance(self) -> float:
        return float(self.values[tolerance_name(self.mode)])

    def told(self, scene: bpy.types.Scene) -> str:
        """The settings in words."""
        parts = {"RELATIVE": "of the size", "PIXELS": "pixels"}
        tolerance = length_text(scene, self.tolerance, digits=6)
        if self.mode in parts:
            tolerance = f"{self.tolerance:.6g} {parts[self.mode]}"
        texts = [f"Tolerance {tolerance}"]
        for name, text in (("shading_angle", "shading angle"), ("facet_angle", "facet angle")):
            if name in self.values:
                texts.append(f"{text} {degrees(self.values[name]):.4g}°" if self.values[name] else f"no {text}")
        if "reduce" in self.values:
            texts.append("Reduce on" if self.values["reduce"] else "Reduce off")
        if "tolerance_by" in self.values:
            texts.append(VARIATIONS[self.values["tolerance_by"]])
        return ", ".join(texts)


class CCDEPTH_PT_tolerance_presets(PresetPanel, bpy.types.Panel):
    bl_label = "Presets"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.ccdepth
        layout.emboss = "PULLDOWN_MENU"
        layout.operator_context = "EXEC_DEFAULT"
        column = layout.column(align=True)
        for preset in presets(context.scene):
            row = column.row(align=True)
            row.alignment = "LEFT"
            values = {name: _as_typed(value) for name, value in preset.values.items()}
            icon = "CHECKMARK" if typed_values(settings, preset.values) == values else "BLANK1"
            row.operator("ccdepth.use_preset", text=preset.name, translate=False, icon=icon).name = preset.name
            if preset.is_own:
                button = row.operator("ccdepth.tolerance_preset_add", text="", icon="REMOVE")
                button.name, button.remove_name = preset.name, True
        layout.separator()
        row, manager = layout.row(), context.window_manager
        field = row.row()
        field.emboss = "NORMAL"
        field.prop(manager, "preset_name", text="")
        row.operator("ccdepth.tolerance_preset_add", text="", icon="ADD").name = manager.preset_name


def preset_by_name(scene: bpy.types.Scene, name: str) -> Preset | None:
    """The preset of this name; of several, the user's own."""
    found = [each for each in presets(scene) if each.name == name]
    return max(found, key=lambda each: each.is_own, default=None)


def presets(scene: bpy.types.Scene) -> list[Preset]:
    """All presets, fractions before distances, each from coarse to fine."""
    found = [_shipped(name, "RELATIVE", *numbers, reduce=reduce) for name, (*numbers, reduce) in FRACTIONS.items()]
    for name, (metres, *angles, reduce) in DISTANCES.items():
        found.append(_shipped(name, "ABSOLUTE", metres / scene.unit_settings.scale_length, *angles, reduce=reduce))
    for path in [path for folder in bpy.utils.preset_paths(PRESETS) for path in Path(folder).glob("*.py")]:
        # A file with other contents is no preset.
        with suppress(KeyError, ValueError, SyntaxError):
            texts = dict(re.findall(r"ccdepth\.(\w+) = (.+)", path.read_text(encoding="utf-8")))
            unused = {"relative_tolerance", "tolerance", "pixels"} - {
                tolerance_name(literal_eval(texts["tolerance_mode"]))
            }
            names = [name for name in PRESET_SETTINGS if name in texts and name not in unused]
            own = Preset("", {name: literal_eval(texts[name]) for name in names}, is_own=True)
            if isfinite(own.tolerance):
                found.append(own._replace(name=bpy.path.display_name(path.name, title_case=False)))
    return sorted(found, key=lambda each: (each.mode == "ABSOLUTE", -each.tolerance))


def _shipped(name: str, mode: str, tolerance: float, shading: float, facets: float, *, reduce: bool) -> Preset:
    """A preset of our own, with angles in degrees."""
    angles = {"shading_angle": radians(shading), "facet_angle": radians(facets)}
    return Preset(name, {"tolerance_mode": mode, tolerance_name(mode): tolerance, **angles, "reduce": reduce})


def _as_typed(value: Any) -> Any:
    return shortest_decimal(value) if isinstance(value, float) else value


register, unregister = bpy.utils.register_classes_factory((CCDEPTH_PT_tolerance_presets,))


# A field shows as many decimals as Blender has at most, and is wrong by no more than this part of a number.
DECIMALS = 6
LARGEST_ERROR = 1e-3

# The most selected objects that are listed, and that the conversion is shown for, which measures each of them.
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
    digits = _digits_beside_distances(context)
    texts = []
    is_beyond_field = abs(round(tolerance, DECIMALS) - tolerance) > LARGEST_ERROR * abs(tolerance)
    if is_beyond_field or (digits > DIGITS and not relative):
        texts.append(f"{tolerance:.6g}" if relative else length_text(scene, tolerance, digits=max(digits, 6)))
    diagonals, is_exact = _shown_diagonals(context)
    sign = "=" if is_exact else "≈"
    if diagonals and relative:
        texts.append(f"{sign} {lengths_text(scene, (tolerance * each for each in diagonals), digits)}")
    elif diagonals:
        parts = sorted(tolerance / each for each in diagonals)
        least, largest = (number_text(Decimal(each)) for each in (parts[0], parts[-1]))
        texts.append(f"{sign} {least if least == largest else f'{least}–{largest}'} of the size")
    return " ".join(texts)


def _digits_beside_distances(context: bpy.types.Context) -> int:
    """The digits with which no proved distance of the objects seems beyond the tolerance that it is within."""
    records = [each.data.ccdepth for each in objects_for_tolerance(context)[:MOST_OBJECTS]]
    found = [(each.largest_bound, each.world_tolerance) for each in records]
    found += [(each.deviation, each.measurement.world_tolerance) for each in records]
    return max((digits_within(context.scene, *lengths) for lengths in found), default=DIGITS)


def _shown_diagonals(context: bpy.types.Context) -> tuple[list[float], bool]:
    """The diagonals of the objects of the tolerance, and whether all are exact; none if one is unknown."""
    holders = objects_for_tolerance(context)
    if len(holders) > MOST_OBJECTS:
        return [], False
    use_modifiers = context.scene.ccdepth.use_modifiers
    found = [shown_diagonal(each, use_modifiers=use_modifiers) for each in holders]
    known = [each for each in found if each is not None]
    return [diagonal for diagonal, _ in known] if len(known) == len(found) else [], all(exact for _, exact in known)
