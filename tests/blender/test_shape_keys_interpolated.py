# SPDX-License-Identifier: GPL-3.0-or-later
"""Shape keys of a mesh are on its subdivision, each as the limit surface of that key."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests import uniform
from tests.blender import addon, scene
from tests.blender.full_mesh import (
    LEVEL,
    ROUNDING,
    Comparison,
    compare,
    everything,
)


def test_shape_keys_stay_with_their_settings(comparison: Comparison) -> None:
    old, new = comparison.base.shape_keys, comparison.mesh.shape_keys
    assert new != old
    assert [key.name for key in new.key_blocks] == ["Basis", "Wide", "Tall"]
    for one, other in zip(old.key_blocks, new.key_blocks, strict=True):
        for name in ("value", "slider_min", "slider_max", "mute", "vertex_group", "interpolation"):
            assert getattr(one, name) == getattr(other, name)
        assert one.relative_key.name == other.relative_key.name
    assert [driver.data_path for driver in new.animation_data.drivers] == ['key_blocks["Wide"].value']


def test_every_key_is_the_limit_surface_of_that_key(comparison: Comparison) -> None:
    for key in comparison.base.shape_keys.key_blocks:
        points = np.zeros(3 * len(key.points), dtype=np.float32)
        key.points.foreach_get("co", points)
        limits = uniform.fine_values(comparison.control, points.reshape(-1, 3).astype(np.float64), LEVEL, limit=True)
        found = np.zeros(3 * len(comparison.mesh.vertices), dtype=np.float32)
        comparison.mesh.shape_keys.key_blocks[key.name].points.foreach_get("co", found)
        np.testing.assert_allclose(found.reshape(-1, 3), limits, atol=ROUNDING, rtol=0)


def test_keys_mix_to_the_surface_of_the_mixed_mesh() -> None:
    holder = everything()
    keys = holder.data.shape_keys.key_blocks
    # A vertex group weighs a key by vertex; its weights are not the surface's.
    keys["Tall"].vertex_group, keys["Tall"].mute = "", False
    comparison = compare(holder)
    result = scene.add_mesh(comparison.mesh)
    holder.modifiers.clear()
    mixed, expected = (scene.evaluated_mesh_data(one).positions for one in (result, holder))
    limits = uniform.fine_values(comparison.control, expected, LEVEL, limit=True)
    np.testing.assert_allclose(mixed, limits, atol=2 * ROUNDING, rtol=0)


def test_the_animation_of_keys_stays() -> None:
    holder = everything()
    keys = holder.data.shape_keys
    keys.key_blocks["Tall"].keyframe_insert("value", frame=3)
    action = keys.animation_data.action
    track = keys.animation_data.nla_tracks.new()
    strip = track.strips.new("Strip", 20, action)
    strip.repeat, strip.blend_type, track.mute = 2.0, "ADD", True
    new = compare(holder).mesh.shape_keys.animation_data
    assert new.action == action
    if hasattr(new, "action_slot"):
        assert new.action_slot == keys.animation_data.action_slot
    copied = new.nla_tracks[0].strips[0]
    assert new.nla_tracks[0].mute
    for name in ("name", "action", "frame_start", "frame_end", "repeat", "blend_type"):
        assert getattr(copied, name) == getattr(strip, name)


def test_absolute_keys_keep_their_frames() -> None:
    holder = everything()
    keys = holder.data.shape_keys
    keys.use_relative = False
    addon.select(holder)
    bpy.ops.object.shape_key_retime()
    frames = [key.frame for key in keys.key_blocks]
    keys.eval_time = 14.0
    new = compare(holder).mesh.shape_keys
    assert not new.use_relative
    assert new.eval_time == 14.0
    assert [key.frame for key in new.key_blocks] == pytest.approx(frames)
