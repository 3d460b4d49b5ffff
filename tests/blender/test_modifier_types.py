# SPDX-License-Identifier: GPL-3.0-or-later
"""Modifiers of every type this Blender has: fresh ones are described without a fault, and every change is noticed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.test_modifiers import node_group
from tests.blender.test_staleness import MESH_LINE, stale_line

pytestmark = pytest.mark.every_blender

TYPES = [item.identifier for item in bpy.types.Modifier.bl_rna.properties["type"].enum_items]

# Of all modifiers, and only about where they are shown.
COMMON = set(bpy.types.Modifier.bl_rna.properties.keys())

# Of the Subdivision Surface modifier whose surface is meant, these alone shape the surface.
SHAPING_SUBSURF = {"boundary_smooth", "use_creases"}


def with_modifier(kind: str) -> bpy.types.Object | None:
    """A cube with a fresh modifier, unless Blender has none of this type for meshes."""
    holder = scene.add_object(meshes.creased_cube())
    holder.vertex_groups.new(name="Group")
    # An error for some types, nothing for others.
    with suppress(RuntimeError, TypeError):
        if holder.modifiers.new(kind.title(), kind) is not None:
            return holder
    bpy.data.objects.remove(holder)
    return None


def fresh() -> Iterator[tuple[str, bpy.types.Object]]:
    """An object with a modifier of each type, one after another."""
    for kind in TYPES:
        holder = with_modifier(kind)
        if holder is not None:
            yield kind, holder
            bpy.data.objects.remove(holder)


def test_every_operator_copes_with_fresh_modifiers(capfd: pytest.CaptureFixture[str]) -> None:
    """Either it is done, or it is refused with a reason; and what was done holds until something changes."""
    bpy.context.scene.ccdepth.relative_tolerance = 0.2
    state = addon.module("exchange.object_state").object_state
    done: set[str] = set()
    refusals: list[str] = []
    for kind, holder in fresh():
        addon.select(holder)
        assert state(holder, use_modifiers=True).checksum == state(holder, use_modifiers=True).checksum, kind
        try:
            bpy.ops.ccdepth.compute()
        except RuntimeError as refusal:
            refusals.append(str(refusal))
            continue
        done.add(kind)
        assert stale_line(holder) == "", kind
        assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}, kind
    assert len(done) + len(refusals) > 50
    assert "Traceback" not in " ".join(refusals)
    assert {"NODES", "BEVEL", "WAVE", "HOOK", "WARP", "SUBSURF"} <= done
    assert "Traceback" not in capfd.readouterr().err


def other_value(field: bpy.types.Property, value: Any) -> Any:
    """A value of a simple property that is another one; None when there is none."""
    if field.type == "BOOLEAN":
        return [not each for each in value] if field.is_array else not value
    if field.type in {"INT", "FLOAT"}:
        if field.is_array:
            return None
        return field.hard_min if value != field.hard_min else field.hard_max
    if field.type == "ENUM" and not field.is_enum_flag:
        return next((item.identifier for item in field.enum_items if item.identifier != value), None)
    return None


def test_every_simple_setting_of_every_modifier_is_noticed() -> None:
    state = addon.module("exchange.object_state").object_state
    refused = addon.module("exchange.modifiers").SIMULATIONS | addon.module("exchange.modifiers").NOT_SHAPING
    interface = addon.module("exchange.object_state").DISPLAY_FIELDS
    settings = 0
    for kind, holder in fresh():
        if kind in refused:
            continue
        [modifier] = holder.modifiers
        for field in modifier.bl_rna.properties:
            name = field.identifier
            if field.is_readonly or name in COMMON | interface or name.startswith("open_"):
                continue
            if kind == "SUBSURF" and name not in SHAPING_SUBSURF:
                continue
            value = getattr(modifier, name)
            changed = other_value(field, value)
            if changed is None:
                continue
            before = state(holder, use_modifiers=True).checksum
            try:
                setattr(modifier, name, changed)
            except (TypeError, RuntimeError):
                continue
            if getattr(modifier, name) == value:
                continue
            settings += 1
            assert state(holder, use_modifiers=True).checksum != before, f"{kind}.{name}"
            if kind == "SUBSURF" and name == "subdivision_type":
                break
    # So many that a walk which finds nothing would not do.
    assert settings > 300


def computed_with(kind: str, **settings: Any) -> tuple[bpy.types.Object, bpy.types.Modifier]:
    holder = scene.add_suzanne()
    modifier = holder.modifiers.new("Modifier", kind)
    for name, value in settings.items():
        setattr(modifier, name, value)
    addon.compute(holder)
    assert stale_line(holder) == ""
    return holder, modifier


def expect_change(holder: bpy.types.Object) -> None:
    assert stale_line(holder) == MESH_LINE
    with pytest.raises(RuntimeError, match="out of date"):
        bpy.ops.ccdepth.set_levels()


def test_what_modifiers_hold_is_noticed() -> None:
    holder, modifier = computed_with("NODES")
    modifier.node_group = node_group()
    expect_change(holder)
    # These are called like something of a node.
    for name in ("height", "width"):
        holder, wave = computed_with("WAVE")
        setattr(wave, name, 0.125)
        expect_change(holder)
    holder, hook = computed_with("HOOK", falloff_type="CURVE")
    hook.falloff_curve.curves[0].points[0].location.y = 0.5
    hook.falloff_curve.update()
    holder.update_tag()
    expect_change(holder)
    holder, bevel = computed_with("BEVEL", profile_type="CUSTOM")
    bevel.custom_profile.preset = "STEPS"
    bevel.custom_profile.update()
    holder.update_tag()
    expect_change(holder)


def linked(data: bpy.types.ID) -> bpy.types.Object:
    found = bpy.data.objects.new(data.name, data)
    bpy.context.scene.collection.objects.link(found)
    return found


def test_what_modifiers_refer_to_is_noticed() -> None:
    """A texture, members of a collection, the modifiers of a target mesh, the points of a lattice and of a curve."""
    texture = bpy.data.textures.new("Clouds", "CLOUDS")
    holder, _ = computed_with("DISPLACE", texture=texture)
    texture.noise_scale = 2.0
    assert stale_line(holder) == MESH_LINE
    operand = scene.add_object(meshes.cube(), "Operand")
    cutters = bpy.data.collections.new("Cutters")
    bpy.context.scene.collection.children.link(cutters)
    cutters.objects.link(operand)
    holder, _ = computed_with("BOOLEAN", operand_type="COLLECTION", collection=cutters)
    operand.location.x = 0.5
    assert stale_line(holder) == MESH_LINE
    target = scene.add_object(meshes.cube(), "Target")
    holder, _ = computed_with("BOOLEAN", object=target)
    target.modifiers.new("Cast", "CAST")
    assert stale_line(holder) == MESH_LINE
    lattice = linked(bpy.data.lattices.new("Lattice"))
    holder, _ = computed_with("LATTICE", object=lattice)
    lattice.data.points[0].co_deform.x -= 1.0
    lattice.data.update_tag()
    assert stale_line(holder) == MESH_LINE
    path = linked(bpy.data.curves.new("Path", "CURVE"))
    path.data.splines.new("POLY").points.add(2)
    for index, point in enumerate(path.data.splines[0].points):
        point.co = (float(index), 0.0, 0.0, 1.0)
    holder, _ = computed_with("CURVE", object=path)
    path.data.splines[0].points[1].co = (1.0, 1.0, 0.0, 1.0)
    path.data.update_tag()
    assert stale_line(holder) == MESH_LINE


def test_objects_that_look_at_each_other() -> None:
    first, second = scene.add_object(meshes.cube(), "First"), scene.add_object(meshes.cube(), "Second")
    first.modifiers.new("Mirror", "MIRROR").mirror_object = second
    second.modifiers.new("Mirror", "MIRROR").mirror_object = first
    addon.compute(first, second)
    assert stale_line(first) == stale_line(second) == ""
