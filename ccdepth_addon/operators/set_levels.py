# SPDX-License-Identifier: GPL-3.0-or-later
"""Set Subdivision Levels."""

from collections.abc import Iterator

import bpy

from ..exchange.modifiers import OF_OBJECT, shown_vertices, simplified_levels, subdivision_modifier
from ..state import known, mesh_values, out_of_date, result_record
from ..state.chosen import chosen
from ..ui.lengths import count_text
from .mesh_operators import QuickOperator
from .refusals import LINKED, refuse

# Modifiers that no other one can be moved above; Blender says that they require original data.
ALWAYS_FIRST = {"MULTIRES", "SOFT_BODY"}


class CCDEPTH_OT_set_levels(QuickOperator):
    """Set the Subdivision Surface modifiers to the first level with every face within the tolerance, with the Use
    Limit Surface and the Quality of the proof. Levels are about distance alone, not about shading and facets"""

    bl_idname = "ccdepth.set_levels"
    bl_label = "Set Subdivision Levels"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        with_depths = [obj for obj in chosen(context) if _has_depths(obj)]
        if not with_depths:
            return "Compute Depth first"
        if all(_is_left_alone(obj, context.scene.ccdepth) for obj in with_depths):
            return "Levels would subdivide the result itself: set the levels of its source"
        return None

    def act(self, context: bpy.types.Context) -> set[str]:
        objects = chosen(context)
        note = levels_set(context, objects)
        levels = ", ".join(sorted({str(obj.data.ccdepth.uniform_level) for obj in objects}))
        self.report({"INFO"}, f"{count_text(len(objects), 'object', 'objects')}, level {levels}")
        # Blender's status bar shows the last report alone.
        if note:
            self.report({"WARNING"}, note)
        return {"FINISHED"}


def levels_set(context: bpy.types.Context, objects: list[bpy.types.Object]) -> str | None:
    """Set the levels of objects with depths; returns a note for the user. Raises ComputeError, with nothing changed."""
    stale, settings = set(out_of_date.out_of_date(context, objects)), context.scene.ccdepth
    refuse(objects, lambda obj: _levels_fault(obj, obj in stale, settings))
    for blender_object in objects:
        _set_levels(blender_object)
    return simplify_note(context.scene, max(each.data.ccdepth.uniform_level for each in objects))


def simplify_note(scene: bpy.types.Scene, level: int) -> str | None:
    """A note that the scene's Simplify shows less than the level; None where it shows the level."""
    limits = simplified_levels(scene)
    if limits is None or min(limits) >= level:
        return None
    viewport, render = (count_text(each, "level", "levels") for each in limits)
    return (
        f"Simplify shows at most {viewport} in the viewport and {render} in renders: raise its Max Subdivision in the "
        f"render properties to {level}, or turn Simplify off"
    )


def _has_depths(blender_object: bpy.types.Object) -> bool:
    mesh = blender_object.data
    return mesh_values.has_depths(mesh) and not mesh.ccdepth.subdivision


def _is_left_alone(blender_object: bpy.types.Object, settings: bpy.types.PropertyGroup) -> bool:
    """Whether the object is a result of Apply Adaptive Subdivision, not to be subdivided itself."""
    return result_record.is_result(blender_object) and not settings.subdivide_results


def _levels_fault(blender_object: bpy.types.Object, is_stale: bool, settings: bpy.types.PropertyGroup) -> str | None:
    """The reason why the object's levels cannot be set, or None."""
    if not _has_depths(blender_object):
        return "it has no depths; compute them first"
    if _is_left_alone(blender_object, settings):
        return (
            f"it is a result, made from “{blender_object.ccdepth.source_name}”; set the levels of the source, or turn "
            "Subdivide Results on to subdivide the result itself"
        )
    if not blender_object.is_editable:
        return LINKED
    if is_stale:
        return "its depths are out of date; compute them again"
    if (animated := _animated_levels(blender_object)) is not None:
        return animated
    record, limits = blender_object.data.ccdepth, bpy.types.SubsurfModifier.bl_rna.properties
    is_new = subdivision_modifier(blender_object) is None
    if is_new and not record.use_modifiers and any(each.type in ALWAYS_FIRST for each in blender_object.modifiers):
        return (
            "Blender lets no Subdivision Surface modifier be above a Multiresolution or Soft Body one; turn Include "
            "Modifiers on, and compute its depths again"
        )
    if deep := mesh_values.too_deep(record, settings.max_faces):
        return f"{deep.reason}{_way_out(blender_object, deep, settings)}"
    if record.quality > limits["quality"].hard_max:
        return (
            f"with Use Limit Surface it needs a higher Quality than the {limits['quality'].hard_max} that a "
            "Subdivision Surface modifier has at most; compute its depths with Vertices set to Control Mesh"
        )
    return None


def _animated_levels(blender_object: bpy.types.Object) -> str | None:
    """The animation that would undo what is set on the object's Subdivision Surface modifier, as a reason; or None."""
    modifier, animation = subdivision_modifier(blender_object), blender_object.animation_data
    if modifier is None or animation is None:
        return None
    paths = {modifier.path_from_id(name) for name in ("levels", "render_levels", "use_limit_surface", "quality")}
    if any(curve.data_path in paths for curve in animation.drivers):
        return "a driver sets the levels of its Subdivision Surface modifier; delete the driver first"
    if any(curve.data_path in paths for curve in _keyframes(animation)):
        return "keyframes set the levels of its Subdivision Surface modifier; delete the keyframes first"
    return None


def _keyframes(animation: bpy.types.AnimData) -> Iterator[bpy.types.FCurve]:
    """The curves of the object's action, and of the actions on its tracks."""
    users = [animation, *(strip for track in animation.nla_tracks for strip in track.strips)]
    for user in users:
        # A meta strip has strips of its own.
        users.extend(getattr(user, "strips", ()))
        if user.action is None:
            continue
        if not hasattr(user, "action_slot"):
            # Before Blender 4.4, actions have curves of one object alone.
            yield from user.action.fcurves
        elif user.action_slot is not None:
            for strip in (strip for layer in user.action.layers for strip in layer.strips):
                bag = strip.channelbag(user.action_slot)
                yield from bag.fcurves if bag is not None else ()


def _way_out(blender_object: bpy.types.Object, deep: mesh_values.TooDeep, settings: bpy.types.PropertyGroup) -> str:
    """A hint at the faces that need the level, and at the operator for dividing the others less."""
    if not deep.faces_beyond:
        return ""
    cause = count_text(deep.faces_beyond, "face needs", "faces need")
    count = known.count_to_make([blender_object], settings)
    faces = "" if count is None else f", and makes {count.faces:,} faces"
    fitting = count_text(deep.fitting, "level", "levels")
    return f"; {cause} more than {fitting}: Apply Adaptive Subdivision divides the others less{faces}"


def _set_levels(blender_object: bpy.types.Object) -> None:
    record = blender_object.data.ccdepth
    modifier = subdivision_modifier(blender_object)
    if modifier is None:
        modifier = blender_object.modifiers.new("Subdivision", "SUBSURF")
        if not record.use_modifiers:
            blender_object.modifiers.move(len(blender_object.modifiers) - 1, 0)
    modifier.levels = modifier.render_levels = record.uniform_level
    vertices = OF_OBJECT if record.follows_objects else record.vertices
    modifier.use_limit_surface = shown_vertices(blender_object, vertices) == "LIMIT"
    # Without Use Limit Surface the Quality has no effect. A higher one is the user's choice.
    modifier.quality = max(modifier.quality, record.quality)
