# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type, misc"
"""The settings on the scene, and the immediate effects of their changes."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from ..registration import redraw
from . import known, properties, result_record

MODES = tuple(mode for mode, *_ in properties.TOLERANCE_MODES)


def _redraw(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    redraw(context)


def _switch_mode(settings: bpy.types.PropertyGroup, chosen: int) -> None:
    """Switch the mode and carry the distance over, where there is one object."""
    mode = MODES[chosen]
    if mode == settings.tolerance_mode:
        return
    # A distance in the image is none on the object.
    holders = [] if "PIXELS" in (mode, settings.tolerance_mode) else known.objects_for_tolerance(bpy.context)
    if len(holders) == 1:
        source = result_record.control_object(holders[0])
        diagonal = known.measured_diagonal(bpy.context, source, use_modifiers=settings.use_modifiers)
        if diagonal is not None:
            _carry_over(settings, mode, diagonal)
    settings.tolerance_mode = mode


def _carry_over(settings: bpy.types.PropertyGroup, mode: str, diagonal: float) -> None:
    before = properties.scene_tolerance(settings)
    tolerance = before / diagonal if mode == "RELATIVE" else before * diagonal
    # Back and forth makes no noise in the last digits.
    setattr(settings, properties.tolerance_name(mode), float(f"{tolerance:.6g}"))


class SceneSettings(*properties.GROUPS, bpy.types.PropertyGroup):
    """The defaults of the operators' arguments, and the display of values."""

    tolerance: properties.absolute_tolerance_property()
    relative_tolerance: properties.relative_tolerance_property(default=properties.DEFAULT_RELATIVE_TOLERANCE)
    pixels: properties.pixels_property()
    shown_tolerance_mode: EnumProperty(
        name="Tolerance Mode",
        description="How the tolerance is given. Switching between Relative and Absolute keeps the distance, for the "
        "active object or the selected one",
        items=properties.TOLERANCE_MODES,
        get=lambda self: MODES.index(self.tolerance_mode),
        set=_switch_mode,
        options={"HIDDEN", "SKIP_SAVE"},
    )
    heat_map: EnumProperty(
        name="Heat Map",
        description="The values shown over the faces in the 3D View, as an overlay",
        items=properties.HEAT_MAP_ITEMS,
        default="DEPTH",
        update=_redraw,
    )
    heat_map_opacity: FloatProperty(
        name="Opacity",
        description="Opacity of the heat map; in Edit Mode the map never hides edges and selection",
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=_redraw,
    )
    heat_map_playing: BoolProperty(
        name="While Playing",
        description="Show the heat map also while an animation plays, at the cost of speed",
        default=False,
        update=_redraw,
    )
    distance_range: EnumProperty(
        name="Colors",
        description="Which distances the colours stand for; colours of depths always stand for 0 to 8",
        items=properties.COLOR_RANGE_ITEMS,
        default="TOLERANCE",
        update=_redraw,
    )
    distance_top: FloatProperty(
        name="Last Color",
        description="The distance shown in the last colour",
        default=properties.DEFAULT_ABSOLUTE_TOLERANCE,
        min=1e-9,
        soft_max=10.0,
        step=0.1,
        precision=5,
        subtype="DISTANCE",
        update=_redraw,
    )
    shown_accuracy: FloatProperty(
        name="Accuracy",
        description="The largest difference of proved and reached distance, in percent of the reached distance",
        get=lambda self: 100 * self.accuracy,
        set=lambda self, percent: setattr(self, "accuracy", percent / 100),
        soft_min=1.0,
        soft_max=100.0,
        precision=1,
        subtype="PERCENTAGE",
        options={"HIDDEN", "SKIP_SAVE"},
    )
    show_legend: BoolProperty(
        name="Legend",
        description="Show the colours and their depths or distances in the 3D View",
        default=True,
        update=_redraw,
    )
