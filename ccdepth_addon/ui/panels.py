# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's CC Depth tab: settings, and the results of the active object's mesh."""

import bpy
import bpy.utils.previews
import numpy as np

from ..state import results, staleness
from ..state.colors import palette
from ..state.properties import tolerance_name
from ..tasks.surfaces import as_typed
from .lengths import length_text

# Larger counts of faces are written as powers of ten.
LARGEST_COUNT_IN_FULL = 10**10

SWATCH_SIZE = 16

_swatches: bpy.utils.previews.ImagePreviewCollection | None = None


class CCDEPTH_PT_settings(bpy.types.Panel):
    bl_label = "CC Depth"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "CC Depth"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.ccdepth
        button = layout.column()
        button.scale_y = 1.4
        button.operator("ccdepth.compute", icon="MOD_SUBSURF")
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.row().prop(settings, "tolerance_mode", text="Tolerance", expand=True)
        if settings.tolerance_mode == "RELATIVE":
            column.prop(settings, "relative_tolerance", text="Fraction")
        else:
            column.prop(settings, "tolerance", text="Distance")
        column = layout.column()
        column.prop(settings, "method")
        column.prop(settings, "vertices")
        column.prop(settings, "use_modifiers")


class CCDEPTH_PT_results(bpy.types.Panel):
    bl_label = "Results"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "CC Depth"
    bl_parent_id = "CCDEPTH_PT_settings"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        active = context.active_object
        return active is not None and active.type == "MESH" and results.has_result(active.data)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        mesh = context.active_object.data
        record = mesh.ccdepth
        _draw_stale_line(layout, context.scene.ccdepth, context.active_object)
        _draw_numbers(layout, context.scene, record)
        _draw_histogram(layout, mesh)
        row = layout.row(align=True)
        row.operator("ccdepth.select", text="Select by Depth", icon="RESTRICT_SELECT_OFF")
        row.operator("ccdepth.clear", icon="X")
        if not mesh.ccdepth.subdivision:
            layout.operator("ccdepth.set_levels", icon="MOD_SUBSURF")
        if not results.has_heat_map(mesh) or results.shows_deviation(mesh):
            return
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column(heading="Show")
        column.prop(context.scene.ccdepth, "show_heat_map")
        column.prop(context.scene.ccdepth, "show_legend")


def stale_line(settings: bpy.types.PropertyGroup, mesh: bpy.types.Mesh, holder: bpy.types.Object | None = None) -> str:
    """Why the result is out of date, or does not hold for an object that uses the mesh; empty when neither is so."""
    if staleness.is_stale(mesh):
        return "Out of date: mesh changed"
    if holder is not None and staleness.is_uncovered(holder):
        return "Not computed for this object"
    record = mesh.ccdepth
    if record.subdivision:
        # It holds for the settings it was made with.
        return ""
    tolerance = getattr(settings, tolerance_name(settings.tolerance_mode))
    # As typed decimals: the two differ by a rounding to single precision.
    current = (as_typed(tolerance), settings.tolerance_mode, settings.method, settings.vertices, settings.use_modifiers)
    computed = (
        as_typed(record.tolerance),
        record.tolerance_mode,
        record.method,
        record.vertices,
        record.use_modifiers,
    )
    return "" if current == computed else "Out of date: settings changed"


def _draw_stale_line(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup, holder: bpy.types.Object) -> None:
    line = stale_line(settings, holder.data, holder)
    if line:
        row = layout.row()
        row.alert = True
        row.label(text=line, icon="ERROR")


def _draw_numbers(layout: bpy.types.UILayout, scene: bpy.types.Scene, record: bpy.types.PropertyGroup) -> None:
    numbers = _numbers_of_adaptive_mesh(scene, record) if record.subdivision else _numbers_of_depths(scene, record)
    draw_rows(layout, numbers)


def draw_rows(layout: bpy.types.UILayout, rows: list[tuple[str, str]]) -> None:
    """Names and values beside each other, like properties."""
    column = layout.column(align=True)
    for name, value in rows:
        split = column.split(factor=0.45)
        label = split.row()
        label.alignment = "RIGHT"
        label.label(text=name)
        split.label(text=value)


def _numbers_of_depths(scene: bpy.types.Scene, record: bpy.types.PropertyGroup) -> list[tuple[str, str]]:
    numbers = [
        ("Faces", f"{record.faces:,}"),
        ("Deepest Depth", str(record.deepest)),
        ("Tolerance", length_text(scene, record.world_tolerance)),
    ]
    # Results of earlier versions have none.
    if record.uniform_level >= 0:
        numbers.append(("Uniform Level", str(record.uniform_level)))
        numbers.append(("Uniform Faces", sidebar_count(int(record.uniform_faces))))
    if record.method == "CERTIFIED":
        numbers.append(("Depth Is Exact", exact_text(record.exact_faces, record.faces)))
    return numbers


def _numbers_of_adaptive_mesh(scene: bpy.types.Scene, record: bpy.types.PropertyGroup) -> list[tuple[str, str]]:
    before = [("Without Reduce", f"{record.unreduced_triangles:,} triangles")] if record.unreduced_triangles else []
    return [
        ("Faces", f"{record.faces:,}"),
        *before,
        ("Base Faces", f"{record.base_faces:,}"),
        ("Uniform Faces", sidebar_count(int(record.uniform_faces))),
        ("Deepest Depth", str(record.deepest)),
        ("Tolerance", length_text(scene, record.world_tolerance)),
        ("Proved", length_text(scene, record.largest_bound)),
    ]


def exact_text(exact: int, faces: int) -> str:
    """On how many faces no lesser depth is enough; never rounded up to all of them."""
    if exact == faces:
        return "On all faces"
    return f"On {min(100 * exact / faces, 99.9):.1f} % of faces"


def sidebar_count(count: int) -> str:
    """A count with separators, or as a power of ten when it is too long for the sidebar."""
    if count < LARGEST_COUNT_IN_FULL:
        return f"{count:,}"
    mantissa, exponent = f"{count:.2e}".split("e+")
    return f"{mantissa} × 10{exponent.lstrip('0').translate(str.maketrans('0123456789', '⁰¹²³⁴⁵⁶⁷⁸⁹'))}"


def _draw_histogram(layout: bpy.types.UILayout, mesh: bpy.types.Mesh) -> None:
    record = mesh.ccdepth
    colors: tuple[tuple[float, float, float], ...] = ()
    if not (record.subdivision or results.shows_deviation(mesh)):
        colors = palette(record.least_color_depth, record.deepest_color_depth)
    most = max(row.faces for row in record.rows)
    box = layout.box().column(align=True)
    for row in reversed(record.rows):
        split = box.split(factor=0.22)
        key = split.row(align=True)
        swatch = _swatch(colors[row.depth - record.least_color_depth]) if colors else 0
        key.label(text=str(row.depth), icon_value=swatch)
        value = split.row(align=True)
        value.progress(text=f"{row.faces:,}", factor=row.faces / most)
        button = value.operator("ccdepth.select", text="", icon="RESTRICT_SELECT_OFF", emboss=False)
        button.depth, button.comparison = row.depth, "EQUAL"


def _swatch(color: tuple[float, float, float]) -> int:
    """The icon of a colour. Each is made once: a few hundred bytes."""
    assert _swatches is not None
    name = repr(color)
    if name not in _swatches:
        icon = _swatches.new(name)
        icon.icon_size = (SWATCH_SIZE, SWATCH_SIZE)
        icon.icon_pixels_float = np.tile(np.array((*color, 1.0), dtype=np.float32), SWATCH_SIZE**2)
    return _swatches[name].icon_id


CLASSES = (CCDEPTH_PT_settings, CCDEPTH_PT_results)


def register() -> None:
    global _swatches
    _swatches = bpy.utils.previews.new()
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    global _swatches
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    bpy.utils.previews.remove(_swatches)
    _swatches = None
