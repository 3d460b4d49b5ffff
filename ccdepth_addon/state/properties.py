# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Settings on the scene, the record of a result on the mesh, and what a viewport looked like before the heat map."""

from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..core import METHODS
from ..exchange.bulk_writing import is_writable
from ..ui import heat_map
from . import deviation_results, results

# A thousandth of the bounding box is about one pixel when the object fills the screen, whatever its size.
DEFAULT_RELATIVE_TOLERANCE = 0.001
DEFAULT_ABSOLUTE_TOLERANCE = 0.001

DEFAULT_ACCURACY = 0.05
DEFAULT_TIME_LIMIT = 60.0

TOLERANCE_DESCRIPTION = "Largest distance allowed between the subdivided faces and the limit surface"
RELATIVE_DESCRIPTION = TOLERANCE_DESCRIPTION + ", as a part of the diagonal of the object's dimensions"

TOLERANCE_MODES = (
    ("RELATIVE", "Relative", "The tolerance is a part of the diagonal of the object's dimensions"),
    ("ABSOLUTE", "Absolute", "The tolerance is a distance in the scene, with the object's scale counted in"),
)
METHOD_TEXTS = {
    "CERTIFIED": (
        "Certified",
        "The least depth that can be proved from the mesh itself, on nearly all faces the least that is true",
    ),
    "SHARP": (
        "Sharp",
        "Depth from second differences of the control points, with the least factors that hold for every mesh; "
        "far lower around poles than as published",
    ),
    "SECOND_ORDER": (
        "Second Order (Published)",
        "Depth from second differences of the control points, after Cheng, Chen and Yong (2006)",
    ),
    "FIRST_ORDER": (
        "First Order",
        "Depth from how far apart the control points are; needs far more levels, and is here for comparison",
    ),
}
METHOD_ITEMS = tuple((method, *METHOD_TEXTS[method]) for method in METHODS)
VERTEX_ITEMS = (
    ("CONTROL", "Control Mesh", "The subdivided mesh as it is (Use Limit Surface off)"),
    ("LIMIT", "Limit Surface", "The subdivided mesh with its vertices moved to the limit surface (Use Limit Surface)"),
)


SUBDIVISION_MODES = (
    ("ADAPTIVE", "Adaptive", "Divide each part of a face only as far as it needs: the fewest faces"),
    ("PER_FACE", "Per Face", "Divide each face evenly, as far as the part of it that needs most"),
)
TRANSITION_ITEMS = (
    ("TRIANGLES", "Triangles", "As a few well-shaped triangles"),
    ("NGONS", "N-Gons", "As one polygon with more than four corners"),
)
OUTPUT_ITEMS = (
    ("NEW_OBJECT", "New Object", "The result is a new object in the same place, and the original is hidden"),
    (
        "IN_PLACE",
        "In Place",
        "The result takes the place of the object's mesh; objects that are not selected keep a mesh they share with it",
    ),
)


COLOR_RANGE_ITEMS = (
    ("LARGEST", "Up to the Largest", "The last colour is the largest deviation of the objects measured together"),
    ("TOLERANCE", "Up to the Tolerance", "The last colour is the tolerance, and faces beyond it are red"),
)


def tolerance_name(tolerance_mode: str) -> str:
    """The setting of the scene that holds the tolerance."""
    return "relative_tolerance" if tolerance_mode == "RELATIVE" else "tolerance"


def absolute_tolerance_property() -> Any:
    """A distance without a hard minimum, so that a bad one can be refused with a report."""
    return FloatProperty(
        name="Tolerance",
        description=TOLERANCE_DESCRIPTION,
        default=DEFAULT_ABSOLUTE_TOLERANCE,
        soft_min=1e-6,
        soft_max=10.0,
        step=0.1,
        precision=5,
        subtype="DISTANCE",
    )


def tolerance_mode_property() -> Any:
    return EnumProperty(
        name="Tolerance Mode", description="How the tolerance is given", items=TOLERANCE_MODES, default="RELATIVE"
    )


def method_property() -> Any:
    return EnumProperty(
        name="Method",
        description="How the distance to the limit surface is bounded",
        items=METHOD_ITEMS,
        default="CERTIFIED",
    )


def vertices_property() -> Any:
    return EnumProperty(
        name="Vertices",
        description="Where the vertices of the subdivided mesh are",
        items=VERTEX_ITEMS,
        default="CONTROL",
    )


def use_modifiers_property() -> Any:
    return BoolProperty(
        name="Modifiers",
        description="Count in the modifiers above the Subdivision Surface modifier, or all of them when there is none. "
        "A subdivision has those counted in applied, and keeps all others",
        default=True,
    )


def mode_property() -> Any:
    return EnumProperty(
        name="Division", description="How the faces are divided", items=SUBDIVISION_MODES, default="ADAPTIVE"
    )


def transitions_property() -> Any:
    return EnumProperty(
        name="Transitions",
        description="How a face beside finer ones is drawn",
        items=TRANSITION_ITEMS,
        default="TRIANGLES",
    )


def output_property() -> Any:
    return EnumProperty(name="Output", description="Where the result goes", items=OUTPUT_ITEMS, default="NEW_OBJECT")


def exact_normals_property() -> Any:
    return BoolProperty(
        name="Exact Normals",
        description="Shade with the normals of the limit surface, as custom normals, however few faces there are",
        default=False,
    )


def max_faces_property() -> Any:
    return IntProperty(
        name="Face Limit",
        description="Refuse to make more faces than this, of all selected objects together, and tell a tolerance that "
        "would fit",
        default=5_000_000,
        min=1,
        soft_min=1000,
        soft_max=100_000_000,
    )


def accuracy_property() -> Any:
    """A part without a hard minimum, so that a bad one can be refused with a report."""
    return FloatProperty(
        name="Accuracy",
        description="How far apart the distance that is proved and the one that is reached may be, as a part of the "
        "reached one",
        default=DEFAULT_ACCURACY,
        soft_min=0.01,
        soft_max=1.0,
        step=1,
        precision=3,
        subtype="FACTOR",
    )


def time_limit_property() -> Any:
    return FloatProperty(
        name="Time Limit",
        description="Seconds after which the measuring ends with what it has proved by then; 0 for no limit",
        default=DEFAULT_TIME_LIMIT,
        min=0.0,
        soft_max=3600.0,
        step=1000,
        precision=0,
        unit="TIME_ABSOLUTE",
    )


def _heat_map_switched(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    heat_map.synchronise(context)


def _color_range_changed(settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    meshes = {obj.data for obj in context.scene.objects if obj.type == "MESH" and is_writable(obj.data)}
    for mesh in meshes:
        if results.shows_deviation(mesh):
            deviation_results.write_colors(mesh, settings.deviation_range)
    heat_map.redraw_viewports(context)


def _redraw(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    heat_map.redraw_viewports(context)


class SceneSettings(bpy.types.PropertyGroup):
    """What Compute Depth and Apply Adaptive Subdivision use when they are called without arguments of their own."""

    tolerance: absolute_tolerance_property()
    relative_tolerance: FloatProperty(
        name="Tolerance",
        description=RELATIVE_DESCRIPTION,
        default=DEFAULT_RELATIVE_TOLERANCE,
        soft_min=1e-6,
        soft_max=0.1,
        step=0.01,
        precision=5,
    )
    tolerance_mode: tolerance_mode_property()
    method: method_property()
    vertices: vertices_property()
    use_modifiers: use_modifiers_property()
    mode: mode_property()
    transitions: transitions_property()
    output: output_property()
    exact_normals: exact_normals_property()
    max_faces: max_faces_property()
    accuracy: accuracy_property()
    time_limit: time_limit_property()
    deviation_range: EnumProperty(
        name="Colors",
        description="Which deviations the colours stand for",
        items=COLOR_RANGE_ITEMS,
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


class DepthRow(bpy.types.PropertyGroup):
    """One line of the histogram."""

    depth: IntProperty()
    faces: IntProperty()


class Contributor(bpy.types.PropertyGroup):
    """One object the result was computed for: its scale as AᵀA (upper triangle), and a checksum of the rest."""

    gram: FloatVectorProperty(size=6)
    checksum: StringProperty()


class Measurement(bpy.types.PropertyGroup):
    """What was measured on this mesh, with what, and where it is worst."""

    measured: StringProperty(description="The object that was measured")
    against: StringProperty(description="The object to whose limit surface it was measured")
    tolerance: FloatProperty(description="The tolerance as it was given")
    tolerance_mode: StringProperty()
    world_tolerance: FloatProperty(description="The tolerance as a distance in the scene", subtype="DISTANCE")
    verdict: StringProperty(description="Whether the tolerance is met: MET, NOT_MET or UNDECIDED")
    accuracy: FloatProperty(description="The accuracy as it was given")
    accuracy_met: BoolProperty(description="Whether the two distances are as near to each other as was asked")
    use_modifiers: BoolProperty()
    version: StringProperty(description="The version of CC Depth that measured it")
    faces: IntProperty()
    worst_face: IntProperty(description="The face of the mesh where it is worst; -1 when modifiers added that face")
    worst_point: FloatVectorProperty(description="The place in the scene where it is worst", subtype="TRANSLATION")
    largest_shown: FloatProperty(description="The largest deviation of all meshes measured together")
    fingerprint: StringProperty(description="Checksum of the objects and of the deviations")
    placement: FloatVectorProperty(
        description="Where the two objects are to each other, and how the second is scaled", size=18
    )


class MeshRecord(bpy.types.PropertyGroup):
    """What was computed on this mesh, from what, and what to restore when it is cleared.

    On a subdivision: what it was made with. ``deepest`` and ``rows`` are about the depths of its faces' base faces.
    """

    has_result: BoolProperty()
    subdivision: StringProperty(description="How the mesh was made by subdivision; empty when it was not")
    base_faces: IntProperty(description="Faces of the mesh that was subdivided")
    largest_bound: FloatProperty(description="The largest distance proved", subtype="DISTANCE")
    tolerance: FloatProperty(description="The tolerance as it was given")
    tolerance_mode: StringProperty()
    world_tolerance: FloatProperty(description="The tolerance as a distance in the scene", subtype="DISTANCE")
    method: StringProperty()
    vertices: StringProperty()
    use_modifiers: BoolProperty()
    version: StringProperty(description="The version of CC Depth that computed it")
    faces: IntProperty()
    exact_faces: IntProperty(description="Faces whose depth is proved to be the least that is enough")
    deepest: IntProperty()
    added_deepest: IntProperty(description="The deepest depth of faces that modifiers add, which no face stands for")
    least_color_depth: IntProperty(description="The depth shown in the first colour of the heat map")
    deepest_color_depth: IntProperty(description="The depth shown in the last colour of the heat map")
    rows: CollectionProperty(type=DepthRow)
    # A decimal number: it soon outgrows Blender's 32-bit integers.
    uniform_faces: StringProperty(
        description="Faces of the mesh subdivided to the uniform level; on a subdivision, to the deepest depth"
    )
    uniform_level: IntProperty(
        description="The first level at which all faces are within the tolerance; -1 where it is not known", default=-1
    )
    quality: IntProperty(description="The Quality that Use Limit Surface needs at the uniform level; 0 without it")
    fingerprint: StringProperty(description="Checksum of the mesh and of its depths")
    contributors: CollectionProperty(type=Contributor)
    has_deviation: BoolProperty()
    shows_deviation: BoolProperty(description="Whether the colours are those of deviations, not of depths")
    deviation: FloatProperty(
        description="The largest distance proved, both ways, between what the object shows and the limit surface",
        subtype="DISTANCE",
    )
    deviation_reached: FloatProperty(description="A distance that is really there", subtype="DISTANCE")
    measurement: PointerProperty(type=Measurement)
    active_color_taken: BoolProperty()
    previous_active_color: StringProperty()


class ViewportMemory(bpy.types.PropertyGroup):
    """What a viewport's shading was before the heat map; it lives on the shading, so it is saved with the file."""

    is_switched: BoolProperty()
    previous_color_type: StringProperty()


CLASSES = (SceneSettings, DepthRow, Contributor, Measurement, MeshRecord, ViewportMemory)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.ccdepth = PointerProperty(type=SceneSettings)
    bpy.types.Mesh.ccdepth = PointerProperty(type=MeshRecord)
    bpy.types.View3DShading.ccdepth = PointerProperty(type=ViewportMemory)


def unregister() -> None:
    # Without these properties nobody would know any more what the viewports were like.
    heat_map.restore_viewports()
    del bpy.types.View3DShading.ccdepth
    del bpy.types.Mesh.ccdepth
    del bpy.types.Scene.ccdepth
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
