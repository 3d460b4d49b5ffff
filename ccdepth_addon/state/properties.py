# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Settings with their labels and tooltips, each declared once: scenes, operators and records inherit them."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import radians
from typing import Any, Self

from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ..core import METHODS
from ..tasks.surfaces import shortest_decimal, typed_values

# A thousandth of the bounding box is about one pixel when the object fills the screen, whatever its size.
DEFAULT_RELATIVE_TOLERANCE = 0.001
DEFAULT_ABSOLUTE_TOLERANCE = 0.001

# Half a pixel is hardly seen in a still image.
DEFAULT_PIXELS = 0.5

# The place of presets in folders of presets, and the settings that a preset holds.
PRESETS = "ccdepth/tolerance"
PRESET_SETTINGS = (
    "tolerance_mode",
    "relative_tolerance",
    "tolerance",
    "pixels",
    "shading_angle",
    "facet_angle",
    "reduce",
    "tolerance_by",
    "coarsest",
    "vertex_group",
)

# In radians: at 5° hardly anyone tells highlights from those of the limit surface.
DEFAULT_SHADING_ANGLE = radians(5)

TOLERANCE_DESCRIPTION = "Largest distance allowed between the subdivided faces and the limit surface"

TOLERANCE_MODES = (
    ("RELATIVE", "Relative", "The tolerance is a fraction of the diagonal of the object's dimensions"),
    ("ABSOLUTE", "Absolute", "The tolerance is a distance in the scene, with the object's scale included"),
    ("PIXELS", "Pixels", "The tolerance is a distance in the image of a camera, by default the scene's"),
)
TOLERANCE_NAMES = {"RELATIVE": "relative_tolerance", "ABSOLUTE": "tolerance", "PIXELS": "pixels"}
AT_EQUAL_PARAMETERS = (
    ". Points are compared at equal parameters, with quads as bilinear patches. By Distance can ask for fewer levels, "
    "or for more on twisted quads"
)
METHOD_TEXTS = {
    "DISTANCE": (
        "By Distance",
        "Depth from the distance between the triangles that Blender draws and the limit surface, in both directions",
    ),
    "CERTIFIED": ("Certified", "Depth from the mesh itself, in less time than By Distance" + AT_EQUAL_PARAMETERS),
    "SHARP": (
        "Sharp",
        "Depth from second differences of the control points, with the least factors that hold for every mesh"
        + AT_EQUAL_PARAMETERS,
    ),
    "SECOND_ORDER": (
        "Second Order (Published)",
        "Depth from second differences of the control points, after Cheng, Chen and Yong (2006)" + AT_EQUAL_PARAMETERS,
    ),
    "FIRST_ORDER": (
        "First Order",
        "Depth from the distances between control points, for comparison" + AT_EQUAL_PARAMETERS,
    ),
}
# Files store numbers, so later items have later numbers.
METHOD_NUMBERS = {"CERTIFIED": 0, "SHARP": 1, "SECOND_ORDER": 2, "FIRST_ORDER": 3, "DISTANCE": 4}
METHOD_ITEMS = tuple((method, *METHOD_TEXTS[method], "NONE", METHOD_NUMBERS[method]) for method in METHODS)
VERTEX_TEXTS = {
    "OBJECT": (
        "From Modifier",
        "As set by Use Limit Surface in each object's own Subdivision Surface modifier; on the limit surface without "
        "the modifier",
    ),
    "CONTROL": ("Control Mesh", "The subdivided mesh as it is (Use Limit Surface off)"),
    "LIMIT": (
        "Limit Surface",
        "The subdivided mesh with its vertices moved to the limit surface (Use Limit Surface on)",
    ),
}
VERTEX_NUMBERS = {"CONTROL": 0, "LIMIT": 1, "OBJECT": 2}
VERTEX_ITEMS = tuple((name, *texts, "NONE", VERTEX_NUMBERS[name]) for name, texts in VERTEX_TEXTS.items())

EFFORT_ITEMS = (
    ("QUICK", "Quick", "Measure nothing: some faces get more levels than they need"),
    ("NORMAL", "Normal", "Measure a limited number of parts, and then the deepest faces"),
    ("FULL", "Full", "Measure whatever might save faces, however long it takes"),
)

CAMERA_FRAMES_ITEMS = (
    ("CURRENT", "Current Frame", "The scene as it is"),
    ("SCENE", "Scene Range", "From the scene's first frame to its last, and between: the least distance counts"),
)

FRAMES_ITEMS = (
    ("CURRENT", "Current Frame", "The scene as it is"),
    ("SCENE", "Scene Range", "From the scene's first frame to its last, by its frame step"),
    ("CUSTOM", "Frame List", "The frames of a list"),
)

TOLERANCE_BY_ITEMS = (
    ("NONE", "Nothing", "The tolerance is the same everywhere"),
    ("VERTEX_GROUP", "Vertex Group", "A weight of 1 has the tolerance, a weight of 0 the coarsest one"),
    ("MATERIAL", "Material", "Each material has a factor on the tolerance"),
)
SUBDIVISION_MODES = (
    ("ADAPTIVE", "Adaptive", "Divide each part of a face only as far as the part needs: the fewest faces"),
    ("PER_FACE", "Per Face", "Divide each face evenly, as far as its most demanding part needs"),
)
OUTPUT_ITEMS = (
    ("NEW_OBJECT", "New Object", "The result is a new object in the same place, and the original is hidden"),
    (
        "IN_PLACE",
        "In Place",
        "The result takes the place of the object's mesh; objects that are not selected keep a shared mesh",
    ),
)

HEAT_MAP_ITEMS = (
    (
        "DEPTH",
        "Depth",
        "How many levels each face needs",
        1,
    ),
    ("DISTANCE", "Distance", "The proved largest distance of each face from the limit surface", 2),
    ("DEVIATION", "Deviation", "The measured largest distance of each face from the limit surface", 3),
    ("ANGLE", "Angle", "The proved largest angle of each face, of shading where that counts, and else of facets", 4),
    ("NONE", "None", "Show no heat map", 0),
)
# Files store numbers: 0 was another range.
COLOR_RANGE_ITEMS = (
    ("TOLERANCE", "Up to the Tolerance", "The last colour is the tolerance, and faces beyond the tolerance are red", 1),
    ("FIXED", "Fixed", "The last colour is one distance on every mesh, and faces beyond the distance are red", 2),
)


def tolerance_name(tolerance_mode: str) -> str:
    """The name of the scene's setting that holds the tolerance."""
    return TOLERANCE_NAMES[tolerance_mode]


def scene_tolerance(settings: Any) -> float:
    """The tolerance of the scene's settings in their mode, as it is typed."""
    return shortest_decimal(getattr(settings, tolerance_name(settings.tolerance_mode)))


def set_scene_tolerance(settings: Any, tolerance: float) -> None:
    """Set the tolerance of the scene's settings in their mode."""
    setattr(settings, tolerance_name(settings.tolerance_mode), tolerance)


def absolute_tolerance_property() -> Any:
    """A distance without a hard minimum, so that a bad one can be refused with a report."""
    return FloatProperty(
        name="Tolerance",
        description=TOLERANCE_DESCRIPTION,
        default=DEFAULT_ABSOLUTE_TOLERANCE,
        soft_min=1e-6,
        soft_max=10.0,
        step=0.1,
        precision=6,
        subtype="DISTANCE",
    )


def relative_tolerance_property(**others: Any) -> Any:
    """A fraction of the diagonal, likewise without a hard minimum. others: further arguments of the property."""
    return FloatProperty(
        name="Tolerance",
        description=TOLERANCE_DESCRIPTION + ", as a fraction of the diagonal of the object's dimensions",
        soft_min=1e-6,
        soft_max=0.1,
        step=0.01,
        precision=6,
        **others,
    )


def pixels_property() -> Any:
    """A number of pixels, likewise without a hard minimum."""
    return FloatProperty(
        name="Tolerance",
        description="Largest distance allowed between the images of the subdivided faces and of the limit surface, in "
        "pixels of the camera at the render size",
        default=DEFAULT_PIXELS,
        soft_min=0.01,
        soft_max=10.0,
        step=10,
        precision=3,
        subtype="PIXEL",
    )


class ToleranceProperties:
    """Settings of all computations, beside the tolerance itself."""

    tolerance_mode: EnumProperty(
        name="Tolerance Mode", description="How the tolerance is given", items=TOLERANCE_MODES, default="RELATIVE"
    )
    use_modifiers: BoolProperty(
        name="Include Modifiers",
        description="Include the modifiers above the Subdivision Surface modifier; without that modifier, all "
        "modifiers. Apply Adaptive Subdivision applies the included modifiers, and keeps all others",
        default=True,
    )
    camera: StringProperty(
        name="Camera", description="The camera of a tolerance in pixels; empty for the scene's camera"
    )
    camera_frames: EnumProperty(
        name="Camera Frames",
        description="When the camera looks at the objects, for a tolerance in pixels. Objects keep their present shape",
        items=CAMERA_FRAMES_ITEMS,
        default="CURRENT",
    )
    # Without a hard minimum, so that a bad one can be refused with a report.
    off_screen_scale: FloatProperty(
        name="Off-Screen Scale",
        description="How many times the tolerance in pixels is allowed on what is off screen by more than a tenth of "
        "the image",
        default=4.0,
        soft_min=1.0,
        soft_max=25.0,
    )


class VariationProperties:
    """Settings by which the tolerance of depths and results varies."""

    tolerance_by: EnumProperty(name="Vary by", description="What the tolerance depends on", items=TOLERANCE_BY_ITEMS)
    vertex_group: StringProperty(
        name="Vertex Group", description="The name of the vertex group of each object whose weights vary the tolerance"
    )
    # Without a hard minimum, so that a bad one can be refused with a report.
    coarsest: FloatProperty(
        name="Coarsest",
        description="How many times the tolerance is allowed where the weight is 0",
        default=10.0,
        soft_min=1.0,
        soft_max=100.0,
    )


class DepthProperties:
    """Settings of Compute Depth."""

    method: EnumProperty(
        name="Method",
        description="How the distance to the limit surface is bounded",
        items=METHOD_ITEMS,
        default="DISTANCE",
    )
    vertices: EnumProperty(
        name="Vertices",
        description="Where the vertices of the subdivided mesh are",
        items=VERTEX_ITEMS,
        default="OBJECT",
    )
    effort: EnumProperty(
        name="Effort",
        description="How long By Distance looks for fewer levels; levels are proved with any effort",
        items=EFFORT_ITEMS,
        default="NORMAL",
    )
    frames: EnumProperty(
        name="Frames",
        description="The frames to compute depths on: each face gets its deepest depth",
        items=FRAMES_ITEMS,
        default="CURRENT",
    )
    frame_list: StringProperty(
        name="Frame List",
        description="Frames to compute depths on: 1-250, 1-250/5 for every fifth, or 1,5,9",
        default="1-250",
    )


class DivisionProperties:
    """Settings of the division of faces."""

    mode: EnumProperty(
        name="Division", description="How the faces are divided", items=SUBDIVISION_MODES, default="ADAPTIVE"
    )
    # Without a hard minimum, so that a bad one can be refused with a report.
    shading_angle: FloatProperty(
        name="Shading Angle",
        description="Largest angle allowed between the normals that smooth faces are shaded with and the normals of "
        "the limit surface; the normals of the limit surface are stored. 0 for no limit",
        default=DEFAULT_SHADING_ANGLE,
        soft_min=0.0,
        soft_max=radians(45),
        step=100,
        precision=3,
        subtype="ANGLE",
    )
    facet_angle: FloatProperty(
        name="Facet Angle",
        description="Largest angle allowed between a triangle and the limit surface, as of CAD exporters. 0 for no "
        "limit",
        default=0.0,
        soft_min=0.0,
        soft_max=radians(45),
        step=100,
        precision=3,
        subtype="ANGLE",
    )
    longest_edge: FloatProperty(
        name="Longest Edge",
        description="Largest length allowed of an edge of the result, a distance in the scene. 0 for no limit",
        default=0.0,
        soft_min=0.0,
        soft_max=10.0,
        step=1,
        precision=4,
        subtype="DISTANCE",
    )


class FaceLimitProperties:
    """The setting of the largest number of faces."""

    max_faces: IntProperty(
        name="Face Limit",
        description="The largest number of faces of all selected objects together. A larger result is refused, and "
        "Find Tolerance finds a tolerance that fits",
        default=5_000_000,
        min=1,
        soft_min=1000,
        soft_max=100_000_000,
    )


class MakingProperties:
    """Settings of the mesh to make."""

    exact_normals: BoolProperty(
        name="Exact Normals",
        description="Shade smooth faces with the normals of the limit surface, as custom normals, however few faces "
        "there are. With a shading angle they are always stored",
        default=False,
    )
    reduce: BoolProperty(
        name="Reduce",
        description="Make few triangles, where quads do not matter: Blender's Decimate merges triangles of a finer "
        "mesh as long as the tolerance is proved to hold. Seams, sharp edges, and borders of materials and UV "
        "islands stay in place; shape keys cannot be kept",
        default=False,
    )


class OutputProperties:
    """Settings of the objects that get results, and of the places of results."""

    output: EnumProperty(name="Output", description="Where the result goes", items=OUTPUT_ITEMS, default="NEW_OBJECT")
    subdivide_results: BoolProperty(
        name="Subdivide Results",
        description="Treat results of adaptive subdivision as control meshes, with limit surfaces of their own, "
        "and subdivide them once more. Update Result instead makes results anew from their sources",
        default=False,
    )


class LevelProperties:
    """Settings of levels of detail."""

    # Without hard limits, so that a bad number can be refused with a report.
    count: IntProperty(
        name="Levels",
        description="How many levels of detail to make of each object",
        default=4,
        soft_min=1,
        soft_max=8,
    )
    step: FloatProperty(
        name="Step",
        description="How many times the tolerance of each level is that of the level before; angles grow by the "
        "square root, up to 30°",
        default=4.0,
        soft_min=1.5,
        soft_max=16.0,
        step=50,
        precision=2,
    )


class ViewProperties:
    """The view that switch distances of levels of detail are for."""

    view_angle: FloatProperty(
        name="Field of View",
        description="The vertical field of view that switch distances are for. 0 for that of the scene's camera, "
        "and 50° without a perspective camera",
        default=0.0,
        min=0.0,
        max=radians(170),
        step=100,
        precision=1,
        subtype="ANGLE",
    )
    view_height: IntProperty(
        name="View Height",
        description="The height, in pixels, of the view that switch distances are for. 0 for that of the scene's "
        "render",
        default=0,
        min=0,
        soft_max=4320,
        subtype="PIXEL",
    )


class BudgetProperties:
    """The setting of Find Tolerance."""

    face_budget: IntProperty(
        name="Budget",
        description="How many faces the adaptive meshes of all selected objects may have together, before Reduce",
        default=50_000,
        min=1,
        soft_min=100,
        soft_max=10_000_000,
    )


class MeasureProperties:
    """Settings of Measure Deviation."""

    # A fraction without a hard minimum, so that a bad one can be refused with a report.
    accuracy: FloatProperty(
        name="Accuracy",
        description="The largest difference of proved and reached distance, as a fraction of the reached distance",
        default=0.05,
    )
    time_limit: FloatProperty(
        name="Time Limit",
        description="Seconds after which the measurement ends, with the distance proved by then; 0 for no limit",
        default=60.0,
        min=0.0,
        soft_max=3600.0,
        step=1000,
        precision=0,
        unit="TIME_ABSOLUTE",
    )


GROUPS = (
    *(ToleranceProperties, VariationProperties, DepthProperties, DivisionProperties, FaceLimitProperties),
    *(MakingProperties, OutputProperties, LevelProperties, ViewProperties, BudgetProperties, MeasureProperties),
)


def setting_names(*holders: type) -> tuple[str, ...]:
    """The names of the settings that classes inherit."""
    groups = [group for group in GROUPS if any(issubclass(holder, group) for holder in holders)]
    return tuple(name for group in groups for name in group.__annotations__)


@dataclass(frozen=True)
class Settings:
    """The tolerance and other settings of a scene, an operator or a record, by their names, all numbers as typed."""

    values: dict[str, Any]

    @classmethod
    def of(cls, holder: Any, names: Iterable[str] = ()) -> Self:
        """The tolerance, its mode, whether modifiers count, and the settings of these names."""
        is_scene = hasattr(holder, "relative_tolerance")
        tolerance = scene_tolerance(holder) if is_scene else shortest_decimal(holder.tolerance)
        return cls({"tolerance": tolerance, **typed_values(holder, (*ToleranceProperties.__annotations__, *names))})
