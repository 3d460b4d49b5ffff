# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""The settings on the scene, and what happens at once when one of them changes."""

from collections.abc import Callable

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, PointerProperty

from ..exchange.bulk_writing import is_writable
from . import deviation_results, properties, results, viewports

# Called with the context when the heat map is switched on or off; the interface registers here.
heat_map_listeners: list[Callable[[bpy.types.Context], None]] = []


def _heat_map_switched(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    for listener in heat_map_listeners:
        listener(context)


def _color_range_changed(settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    meshes = {obj.data for obj in context.scene.objects if obj.type == "MESH" and is_writable(obj.data)}
    for mesh in meshes:
        if results.shows_deviation(mesh):
            deviation_results.write_colors(mesh, settings.deviation_range)
    viewports.redraw(context)


def _redraw(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    viewports.redraw(context)


class SceneSettings(bpy.types.PropertyGroup):
    """The defaults of the operators' arguments, and how results are displayed."""

    tolerance: properties.absolute_tolerance_property()
    relative_tolerance: FloatProperty(
        name="Tolerance",
        description=properties.RELATIVE_DESCRIPTION,
        default=properties.DEFAULT_RELATIVE_TOLERANCE,
        soft_min=1e-6,
        soft_max=0.1,
        step=0.01,
        precision=5,
    )
    tolerance_mode: properties.tolerance_mode_property()
    method: properties.method_property()
    vertices: properties.vertices_property()
    use_modifiers: properties.use_modifiers_property()
    mode: properties.mode_property()
    transitions: properties.transitions_property()
    output: properties.output_property()
    exact_normals: properties.exact_normals_property()
    reduce: properties.reduce_property()
    max_faces: properties.max_faces_property()
    accuracy: properties.accuracy_property()
    time_limit: properties.time_limit_property()
    deviation_range: EnumProperty(
        name="Colors",
        description="Which deviations the colours stand for",
        items=properties.COLOR_RANGE_ITEMS,
        default="LARGEST",
        update=_color_range_changed,
    )
    show_heat_map: BoolProperty(
        name="Heat Map",
        description="Show the depths or the deviations as colours in Solid shading",
        default=True,
        update=_heat_map_switched,
    )
    show_legend: BoolProperty(
        name="Legend",
        description="Show which colour stands for which depth or deviation in the 3D View",
        default=True,
        update=_redraw,
    )


def register() -> None:
    bpy.utils.register_class(SceneSettings)
    bpy.types.Scene.ccdepth = PointerProperty(type=SceneSettings)


def unregister() -> None:
    del bpy.types.Scene.ccdepth
    bpy.utils.unregister_class(SceneSettings)
