# SPDX-License-Identifier: GPL-3.0-or-later
"""The modifiers of an object: the modifiers that shape its control mesh, and the modifier of the surface.

The surface is that of the object's Subdivision Surface modifier at its place in the stack. Among several such modifiers
the first of type Catmull-Clark that shows in the viewport counts, or else the first of that type; type Simple is a
modifier like any other. Without a Subdivision Surface modifier, all modifiers that show in the viewport count, and the
surface has the modifier's default settings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

import bpy

# Vertices as each object's own Subdivision Surface modifier has them, beside the core's CONTROL and LIMIT.
OF_OBJECT = "OBJECT"

# The modifiers that leave the mesh unchanged.
NOT_SHAPING = {"COLLISION", "PARTICLE_SYSTEM"}

# Their cache belongs to the object itself: a copy has none.
SIMULATIONS = {"CLOTH", "EXPLODE", "FLUID", "SOFT_BODY"}


@dataclass(frozen=True)
class SurfaceRule:
    """The settings of a Subdivision Surface modifier that shape its surface, with its defaults."""

    smooth_corners: bool = True
    use_creases: bool = True


def subdivision_modifier(blender_object: bpy.types.Object) -> bpy.types.Modifier | None:
    """The modifier of the surface, or None."""
    found = [
        modifier
        for modifier in blender_object.modifiers
        if modifier.type == "SUBSURF" and modifier.subdivision_type == "CATMULL_CLARK"
    ]
    return next((modifier for modifier in found if modifier.show_viewport), found[0] if found else None)


def surface_rule(blender_object: bpy.types.Object) -> SurfaceRule:
    """The rule of the object's Subdivision Surface modifier."""
    modifier = subdivision_modifier(blender_object)
    if modifier is None:
        return SurfaceRule()
    return SurfaceRule(smooth_corners=modifier.boundary_smooth == "ALL", use_creases=modifier.use_creases)


def shown_vertices(blender_object: bpy.types.Object, vertices: str) -> str:
    """CONTROL or LIMIT: the named vertices, or for OF_OBJECT the vertices of the object's Subdivision Surface modifier;
    without a modifier LIMIT, the modifier's default."""
    if vertices != OF_OBJECT:
        return vertices
    modifier = subdivision_modifier(blender_object)
    return "LIMIT" if modifier is None or modifier.use_limit_surface else "CONTROL"


def simplified_levels(scene: bpy.types.Scene) -> tuple[int, int] | None:
    """The most levels that the scene's Simplify shows, in the viewport and in renders; None where it is off."""
    render = scene.render
    return (render.simplify_subdivision, render.simplify_subdivision_render) if render.use_simplify else None


def counted_modifiers(blender_object: bpy.types.Object, *, use_modifiers: bool) -> list[bpy.types.Modifier]:
    """The modifiers above the Subdivision Surface modifier that shape the shown mesh; none if modifiers do not
    count."""
    last, shown = subdivision_modifier(blender_object), shown_modifiers(blender_object) if use_modifiers else []
    above = {each.name for each in takewhile(lambda each: each != last, blender_object.modifiers)}
    return [each for each in shown if each.name in above]


def shown_modifiers(blender_object: bpy.types.Object) -> list[bpy.types.Modifier]:
    """The modifiers that shape the mesh shown in the viewport; in Edit Mode, those of Object Mode as well."""
    return [each for each in blender_object.modifiers if each.show_viewport and each.type not in NOT_SHAPING]


def is_evaluated(blender_object: bpy.types.Object, counted: Sequence[bpy.types.Modifier]) -> bool:
    """Whether Blender makes the control mesh from the object's own mesh."""
    data = blender_object.data
    # Edit Mode shows and holds the edited shape key; elsewhere keys are mixed.
    return bool(counted) or (data.shape_keys is not None and not data.is_editmode)


def applied_modifiers(blender_object: bpy.types.Object, *, use_modifiers: bool) -> list[bpy.types.Modifier]:
    """The modifiers that an adaptive mesh replaces: the Subdivision Surface modifier, and the counted modifiers."""
    counted = counted_modifiers(blender_object, use_modifiers=use_modifiers)
    subdivision = subdivision_modifier(blender_object)
    return counted if subdivision is None else [*counted, subdivision]


def left_out_sculpting(blender_object: bpy.types.Object, *, use_modifiers: bool) -> list[bpy.types.Modifier]:
    """The Multiresolution modifiers with levels that are not applied. Blender keeps their sculpting on the object's own
    mesh, so they have none beside another mesh."""
    applied = applied_modifiers(blender_object, use_modifiers=use_modifiers)
    return [each for each in sculpted(blender_object) if each not in applied]


def sculpted(blender_object: bpy.types.Object) -> list[bpy.types.Modifier]:
    """The Multiresolution modifiers with levels, which may be sculpted."""
    return [each for each in blender_object.modifiers if each.type == "MULTIRES" and each.total_levels]


def has_own_keys(blender_object: bpy.types.Object, *, use_modifiers: bool) -> bool:
    """Whether the base mesh has shape keys; if modifiers make the mesh, keys are applied."""
    has_keys = blender_object.data.shape_keys is not None
    return has_keys and not counted_modifiers(blender_object, use_modifiers=use_modifiers)
