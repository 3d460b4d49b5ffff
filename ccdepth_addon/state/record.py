# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""The record on the mesh: the outcomes of computations and measurements, and their inputs; and the registration of all
our data, on scenes, meshes and objects, as ``ccdepth``."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from . import properties
from .result_record import AppliedModifier, ResultRecord, SourceMaterial
from .settings import SceneSettings


class DepthRow(bpy.types.PropertyGroup):
    """One line of the histogram."""

    depth: IntProperty()
    faces: IntProperty()


class Contributor(bpy.types.PropertyGroup):
    """An object of the computation of depths: its scale as AᵀA (upper triangle), and a checksum of the rest.

    Over frames, on one of these frames, or on the current frame of the computation.
    """

    gram: FloatVectorProperty(size=6)
    checksum: StringProperty()
    frame: IntProperty()


class Inputs:
    """The inputs of a computation, and its time."""

    tolerance: FloatProperty(description="The tolerance as it was given")
    tolerance_mode: StringProperty()
    world_tolerance: FloatProperty(description="The tolerance as a distance in the scene", subtype="DISTANCE")
    camera: StringProperty(description="The name of the camera as it was given; empty for the scene's")
    camera_frames: StringProperty(default="CURRENT")
    off_screen_scale: FloatProperty(default=4.0)
    seen_from: StringProperty(description="Camera and frames of a tolerance in pixels; empty for other tolerances")
    use_modifiers: BoolProperty()
    version: StringProperty(description="The version of CC Depth")
    faces: IntProperty()


class Measurement(Inputs, properties.VariationProperties, bpy.types.PropertyGroup):
    """A measurement on this mesh: inputs, verdict and worst place."""

    measured: StringProperty(description="The name of the measured object at the time")
    against: StringProperty(
        description="The name of the object with the limit surface at the time; empty for the measured object itself"
    )
    verdict: StringProperty(description="Whether the tolerance is met: MET, NOT_MET or UNDECIDED")
    factors: FloatVectorProperty(description="The least and the greatest factor on a tolerance that varies", size=2)
    accuracy: FloatProperty(description="The accuracy as it was given")
    accuracy_met: BoolProperty(description="Whether the two distances are within the accuracy of each other")
    worst_face: IntProperty(
        description="The face of the mesh with the largest deviation; -1 for a face that modifiers added"
    )
    worst_point: FloatVectorProperty(
        description="The place of the largest deviation in the scene", subtype="TRANSLATION"
    )
    fingerprint: StringProperty(description="Checksum of the objects and of the deviations")
    placement: FloatVectorProperty(
        description="Where the two objects are to each other, and how the second is scaled", size=18
    )


class MaterialSettings(bpy.types.PropertyGroup):
    """The settings of a material."""

    # Without a hard minimum, so that a bad one can be refused with a report.
    tolerance_factor: FloatProperty(
        name="Tolerance Factor",
        description="How many times the tolerance is allowed on faces of this material, where the tolerance varies by "
        "materials",
        default=1.0,
        soft_min=0.01,
        soft_max=100.0,
    )


class MeshRecord(Inputs, properties.VariationProperties, bpy.types.PropertyGroup):
    """The outcomes on this mesh, and their inputs.

    On an adaptive mesh ``subdivision`` is set, and the depth of a face is the depth of its base face.
    """

    has_result: BoolProperty()
    subdivision: StringProperty(description="How the mesh was made by subdivision; empty when it was not")
    base_faces: IntProperty(description="Faces of the control mesh")
    unreduced_triangles: IntProperty(description="Triangles of the adaptive mesh without Reduce; 0 when not reduced")
    largest_bound: FloatProperty(description="The largest distance proved", subtype="DISTANCE")
    largest_ratio: FloatProperty(
        description="The largest ratio of a proved distance to the tolerance there; 0 where that is the same everywhere"
    )
    shading_angle: FloatProperty(
        description="The shading angle as it was given; 0 without faces where it counts", subtype="ANGLE"
    )
    facet_angle: FloatProperty(
        description="The facet angle as it was given; 0 without faces where it counts alone", subtype="ANGLE"
    )
    largest_shading_angle: FloatProperty(
        description="The largest angle proved where the shading angle counts", subtype="ANGLE"
    )
    largest_facet_angle: FloatProperty(description="The largest angle proved on other faces", subtype="ANGLE")
    narrow_leaves: IntProperty(description="Parts narrower than the tolerance, where angles do not count")
    method: StringProperty()
    vertices: StringProperty(
        description="Where the subdivided mesh has its vertices: CONTROL or LIMIT; OBJECT where objects have both"
    )
    follows_objects: BoolProperty(description="Whether the objects' own modifiers said where the vertices are")
    frames: StringProperty(description="The computed frames; empty for the scene as it was")
    deepest_frame: IntProperty(description="A frame with the deepest depth")
    exact_faces: IntProperty(description="Faces with a depth that is proved minimal")
    faces_left: IntProperty(description="Faces that might need less, with more effort")
    deepest: IntProperty()
    added_deepest: IntProperty(description="The deepest depth of faces that modifiers add from no face of the mesh")
    rows: CollectionProperty(type=DepthRow)
    # A decimal number: it soon outgrows Blender's 32-bit integers.
    uniform_faces: StringProperty(description="Faces of the mesh subdivided to the uniform level")
    uniform_level: IntProperty(
        description="The first level at which all faces are within the tolerance; -1 where it is not known", default=-1
    )
    quality: IntProperty(description="The Quality that Use Limit Surface needs at the uniform level; 0 without it")
    fingerprint: StringProperty(description="Checksum of the mesh and of its depths")
    contributors: CollectionProperty(type=Contributor)
    has_deviation: BoolProperty()
    shows_deviation: BoolProperty(description="Whether the deviations are newer than the depths")
    deviation: FloatProperty(
        description="The largest distance proved, both ways, between the shown mesh and the limit surface",
        subtype="DISTANCE",
    )
    deviation_reached: FloatProperty(description="A distance that was found", subtype="DISTANCE")
    deviation_facet_angle: FloatProperty(
        description="The largest angle found at samples between the shown triangles and the limit surface",
        subtype="ANGLE",
    )
    deviation_shading_angle: FloatProperty(
        description="The largest angle found at samples between the shading and the limit surface", subtype="ANGLE"
    )
    measurement: PointerProperty(type=Measurement)


HOLDERS = {"Scene": SceneSettings, "Mesh": MeshRecord, "Object": ResultRecord, "Material": MaterialSettings}

# Groups held by other groups come first.
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (DepthRow, Contributor, Measurement, AppliedModifier, SourceMaterial, *HOLDERS.values())
)


def register() -> None:
    _register_classes()
    for holder, group in HOLDERS.items():
        getattr(bpy.types, holder).ccdepth = PointerProperty(type=group)


def unregister() -> None:
    for holder in HOLDERS:
        del getattr(bpy.types, holder).ccdepth
    _unregister_classes()
