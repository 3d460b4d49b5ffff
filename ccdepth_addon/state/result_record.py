# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""The record on a result of Apply Adaptive Subdivision: its source and its settings. Results that took the place of a
mesh have no record."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..exchange.dependencies import compared, object_state
from ..exchange.mesh_arrays import content_checksum, own_checksum
from ..exchange.modifiers import applied_modifiers, counted_modifiers
from ..tasks.adaptive_task import FINEST, Level
from ..tasks.surfaces import shortest_decimal
from . import properties
from .properties import Settings

# Settings without effect when triangles are merged.
WITHOUT_REDUCE = {"mode"}


class AppliedModifier(bpy.types.PropertyGroup):
    """A modifier of the source that was counted in, by name."""


class SourceMaterial(bpy.types.PropertyGroup):
    """A material that the result had when it was made."""

    material: PointerProperty(type=bpy.types.Material)


class ResultRecord(
    properties.ToleranceProperties,
    properties.VariationProperties,
    properties.DivisionProperties,
    properties.MakingProperties,
    bpy.types.PropertyGroup,
):
    """The source and the settings of a result; and of any object, the object it was measured against."""

    source: PointerProperty(type=bpy.types.Object, description="The source: the object that the result was made from")
    source_name: StringProperty(description="The name of the source; empty on objects that are no results")
    source_is_adaptive: BoolProperty(description="Whether the source was an adaptive mesh itself")
    source_checksum: StringProperty(description="Checksum of the source as it was")
    mesh_checksum: StringProperty(description="Checksum of the mesh that was made")
    keep_updated: BoolProperty(
        name="Keep Updated",
        description="Make the result anew, with its own settings, whenever an edited source leaves Edit Mode "
        "or is made anew. Other work or Esc stops the run, and the result is out of date then",
    )
    result_left_render: BoolProperty(description="Whether the result was taken out of the render as it was hidden")
    source_left_render: BoolProperty(description="Whether the source was taken out of the render as it was hidden")
    tolerance: FloatProperty(description="The tolerance as it was given; of levels of detail that of level 0")
    level: IntProperty(description="The number of a level of detail; -1 for others", default=-1)
    level_step: FloatProperty(description="How many times the tolerance of each level is that of the level before")
    applied: CollectionProperty(type=AppliedModifier)
    is_measured: BoolProperty(description="Whether this object was measured, among the objects that use its mesh")
    # Not on the mesh: Blender 5.0 leaves pointers of meshes to objects that are gone, and crashes.
    measured_against: PointerProperty(
        type=bpy.types.Object, description="The object with the limit surface of the measurement"
    )
    materials: CollectionProperty(type=SourceMaterial)


# The settings that a result is made with, beside the tolerance. The Face Limit changes no result.
SETTINGS = properties.setting_names(ResultRecord)


def is_result(blender_object: bpy.types.Object) -> bool:
    """Whether the object is a result of another object, even a deleted one."""
    return blender_object.type == "MESH" and bool(blender_object.ccdepth.source_name)


def is_adaptive(blender_object: bpy.types.Object) -> bool:
    """Whether the object is a result, with a source or without."""
    return is_result(blender_object) or bool(blender_object.data.ccdepth.subdivision)


def source_of(result: bpy.types.Object) -> bpy.types.Object | None:
    """The source of the result; None when the source is gone."""
    source = result.ccdepth.source
    return None if source == result else source


def control_object(blender_object: bpy.types.Object) -> bpy.types.Object:
    """The object that tolerance and counts are about: the source of a result, otherwise the object."""
    source = source_of(blender_object) if is_result(blender_object) else None
    return blender_object if source is None or source.type != "MESH" else source


def results_of(source: bpy.types.Object) -> list[bpy.types.Object]:
    """The results of a source, from a look at all objects of the file."""
    return [each for each in bpy.data.objects if each.type == "MESH" and each.ccdepth.source == source != each]


def is_level(blender_object: bpy.types.Object) -> bool:
    """Whether the object is a level of detail of another object."""
    return is_result(blender_object) and blender_object.ccdepth.level >= 0


def level_of(result: bpy.types.Object) -> Level:
    """The level of detail of a result, and for any other result the level that changes no settings."""
    record = result.ccdepth
    return Level(record.level, shortest_decimal(record.level_step)) if record.level >= 0 else FINEST


def levels_beside(result: bpy.types.Object) -> list[bpy.types.Object]:
    """All levels of detail in the collections of one of them, from the finest on; of any other result itself alone."""
    if not is_level(result):
        return [result]
    beside = {each for collection in result.users_collection for each in collection.objects if is_level(each)}
    return sorted((each for each in beside if each.ccdepth.source == result.ccdepth.source), key=level_of)


def settings_have_changed(result: bpy.types.Object, settings: bpy.types.PropertyGroup) -> bool:
    """Whether the scene's settings differ from the settings of the result."""
    names = [name for name in SETTINGS if name not in WITHOUT_REDUCE or not (settings.reduce and result.ccdepth.reduce)]
    return Settings.of(result.ccdepth, names) != Settings.of(settings, names)


def remember(
    result: bpy.types.Object,
    source: bpy.types.Object,
    settings: Settings,
    materials: Iterable[bpy.types.Material | None],
    checksum: str,
) -> None:
    """Record source and settings on the result; the source had these materials, and this checksum when it was read. The
    user's choices for the result stay."""
    record = result.ccdepth
    record.source, record.source_name = source, source.name
    record.source_is_adaptive = is_adaptive(source)
    for name, value in settings.values.items():
        setattr(record, name, value)
    record.source_checksum = checksum
    record.mesh_checksum = f"{content_checksum(result.data):08x}"
    record.applied.clear()
    for modifier in applied_modifiers(source, use_modifiers=record.use_modifiers):
        record.applied.add().name = modifier.name
    record.materials.clear()
    for material in materials:
        record.materials.add().material = material


def forget(blender_object: bpy.types.Object) -> None:
    """Remove the record of a source from an object."""
    blender_object.property_unset("ccdepth")


def source_checksum(source: bpy.types.Object, *, use_modifiers: bool) -> str:
    """A checksum of everything in a source that shapes its results, without materials, and without weights read by no
    modifier; not in Edit Mode."""
    content = own_checksum(source, content_checksum)
    return f"{content:08x}-{object_state(source, use_modifiers=use_modifiers).checksum}"


def source_is_same(result: bpy.types.Object, source: bpy.types.Object) -> bool | None:
    """Whether the source, outside Edit Mode, is as it was when the result was made; None if that is not known, as other
    data may have changed before the file was opened."""
    record = result.ccdepth
    return compared(record.source_checksum, source_checksum(source, use_modifiers=record.use_modifiers))


def is_edited(result: bpy.types.Object) -> bool:
    """Whether the result's mesh, outside Edit Mode, has changed since it was made."""
    return f"{own_checksum(result, content_checksum):08x}" != result.ccdepth.mesh_checksum


def modifier_fault(result: bpy.types.Object, source: bpy.types.Object, *, use_modifiers: bool) -> str | None:
    """The reason why the result cannot keep its modifiers beside a new mesh: a modifier would count twice, or not at
    all; None without a reason."""
    before = {applied.name for applied in result.ccdepth.applied}
    counted = counted_modifiers(source, use_modifiers=use_modifiers)
    own = {modifier.name: modifier.type for modifier in result.modifiers}
    for modifier in counted:
        if modifier.name not in before and own.get(modifier.name) == modifier.type:
            return (
                f"the modifier “{modifier.name}” of “{source.name}” is included now, and the result has it as well; "
                "remove it from the result, or turn Include Modifiers off"
            )
    missed = before - {modifier.name for modifier in applied_modifiers(source, use_modifiers=use_modifiers)}
    for modifier in source.modifiers:
        if modifier.name in missed and modifier.show_viewport and modifier.name not in own:
            return (
                f"the modifier “{modifier.name}” of “{source.name}” was included and is not any more, and the result "
                "does not have it; turn Include Modifiers on, or add it to the result"
            )
    return None
