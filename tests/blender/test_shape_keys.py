# SPDX-License-Identifier: GPL-3.0-or-later
"""Shape keys of a mesh are on its subdivision, each as the limit surface of that key; loose parts keep their places in
every key, and no key data-block is left behind.

Before Blender 5.2 a copy of a mesh with keys counts one user of its Key too many, so that removing the keys leaves the
Key in the file, and saving a file with such a Key fails.
"""

from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import bpy
import numpy as np
import pytest

from tests import meshes, uniform
from tests.blender import addon, scene
from tests.blender.full_mesh import LEVEL, ROUNDING, Comparison, compare, everything, weights_of
from tests.blender.subdividing import refused, subdivide

pytestmark = pytest.mark.every_blender

LOOSE = (7.0, 8.0, 9.0)
LOOSE_IN_KEY = (-7.0, 5.0, 3.0)


def with_keys(holder: bpy.types.Object) -> bpy.types.Object:
    key = scene.add_key(holder, value=0.5)
    key.points[0].co.z += 1.0
    key.points[len(key.points) - 1].co = LOOSE_IN_KEY
    return holder


def points(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """(V, 3): where a key has the vertices."""
    return scene.values_of(mesh.shape_keys.key_blocks[name].points, "co", np.float32, 3)


def test_shape_keys_stay_with_their_settings(comparison: Comparison) -> None:
    old, new = comparison.base.shape_keys, comparison.mesh.shape_keys
    assert new != old
    assert [key.name for key in new.key_blocks] == ["Basis", "Wide", "Tall"]
    for one, other in zip(old.key_blocks, new.key_blocks, strict=True):
        for name in ("value", "slider_min", "slider_max", "mute", "vertex_group", "interpolation"):
            assert getattr(one, name) == getattr(other, name)
        assert one.relative_key.name == other.relative_key.name
        # Every key is the limit surface of that key.
        positions = points(comparison.base, one.name).astype(np.float64)
        limits = uniform.fine_values(comparison.control, positions, LEVEL, limit=True)
        np.testing.assert_allclose(points(comparison.mesh, one.name), limits, atol=ROUNDING, rtol=0)
    assert [driver.data_path for driver in new.animation_data.drivers] == ['key_blocks["Wide"].value']


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
    # Where the next key is put.
    keys.eval_time = 47.0
    holder.shape_key_add(name="Late", from_mix=False)
    frames = [key.frame for key in keys.key_blocks]
    assert frames[-1] == pytest.approx(47.0)
    keys.eval_time = 14.0
    new = compare(holder).mesh.shape_keys
    assert not new.use_relative
    assert new.eval_time == 14.0
    assert [key.frame for key in new.key_blocks] == pytest.approx(frames)


def plane_with_loose_parts(loose_edge: bool = False) -> bpy.types.Object:
    """6 × 6 quads, a loose vertex, the last one, or a loose edge with it, and two keys."""
    data = meshes.grid(6, 6)
    count = len(data.positions)
    loose = [(6.0, 8.0, 9.0), LOOSE] if loose_edge else [LOOSE]
    edges = [(count, count + 1)] if loose_edge else []
    data = replace(data, positions=np.concatenate([data.positions, loose]), loose_edges=edges)
    return with_keys(scene.add_object(data))


def used(holder: bpy.types.Object) -> np.ndarray:
    """(V,) bool: the vertices with faces."""
    return np.isin(np.arange(len(holder.data.vertices)), scene.mesh_data(holder.data).corner_vertices)


@pytest.mark.parametrize("loose_edge", [False, True])
@pytest.mark.parametrize("exact_normals", [False, True])
def test_loose_parts_stay_where_every_key_has_them(loose_edge: bool, exact_normals: bool) -> None:
    holder = plane_with_loose_parts(loose_edge)
    holder.vertex_groups.new(name="Group").add([len(holder.data.vertices) - 1], 0.5, "REPLACE")
    [result] = subdivide(holder, exact_normals=exact_normals)
    assert not result.data.validate()
    loose = np.flatnonzero(~used(result))
    assert len(loose) == 1 + loose_edge
    wires = [tuple(edge.vertices) for edge in result.data.edges if edge.vertices[0] in loose]
    assert wires == [tuple(loose)] * loose_edge
    assert [weights for weights in weights_of(result.data) if weights] == [{0: 0.5}]
    assert tuple(points(result.data, "Basis")[loose[-1]]) == LOOSE
    assert tuple(points(result.data, "Key")[loose[-1]]) == LOOSE_IN_KEY


def test_loose_parts_change_nothing_elsewhere() -> None:
    alone = with_keys(scene.add_object(meshes.grid(6, 6), "Alone"))
    # Its last vertex is one of the plane's, and no loose one.
    alone.data.shape_keys.key_blocks["Key"].points[len(alone.data.vertices) - 1].co = points(alone.data, "Basis")[-1]
    [plain] = subdivide(alone)
    [result] = subdivide(plane_with_loose_parts())
    for name in ("Basis", "Key"):
        np.testing.assert_array_equal(points(result.data, name)[used(result)], points(plain.data, name))


def test_loose_vertices_keep_their_values() -> None:
    """Even where the last corner of the mesh, which a loose vertex does not have, holds no number."""
    values = {
        "FLOAT": ("value", 1.0),
        "FLOAT_VECTOR": ("vector", (1, 2, 3)),
        "FLOAT_COLOR": ("color", (1, 0, 1, 1)),
        "BYTE_COLOR": ("color", (1, 0, 1, 1)),
        "INT": ("value", 1),
        "BOOLEAN": ("value", True),
        "STRING": ("value", b"loose"),
    }
    holder = plane_with_loose_parts()
    last = len(holder.data.vertices) - 1
    for data_type, (name, value) in values.items():
        setattr(holder.data.attributes.new(data_type, data_type, "POINT").data[last], name, value)
    [result] = subdivide(holder)
    [loose] = np.flatnonzero(~used(result)).tolist()
    for data_type, (name, value) in values.items():
        kept = getattr(result.data.attributes[data_type].data[loose], name)
        assert (kept if name == "value" else tuple(kept)) == value, data_type


def check_keys(folder: Path, owners: list[str] | int) -> None:
    """The keys of the file belong to these meshes, or to so many, which hold them; and the file can be saved."""
    for key in bpy.data.shape_keys:
        assert key.user is not None, f"{key.name} belongs to no mesh"
        assert key.user.shape_keys == key
    found = sorted(key.user.name for key in bpy.data.shape_keys)
    assert (len(found) if isinstance(owners, int) else found) == owners
    # The second time there is a file to compare with and to back up.
    for _ in range(2):
        assert bpy.ops.wm.save_as_mainfile(filepath=str(folder / "saved.blend")) == {"FINISHED"}


def cube_with_keys(modifier: bool = False) -> bpy.types.Object:
    holder = with_keys(scene.add_object(meshes.cube(), "Cube"))
    if modifier:
        holder.modifiers.new("Bevel", "BEVEL")
    return holder


def test_results_leave_no_other_keys_whatever_uses_the_mesh(tmp_path: Path) -> None:
    holder = cube_with_keys()
    for times in (1, 2, 3):
        subdivide(holder)
        check_keys(tmp_path, 1 + times)
    other = scene.add_mesh(holder.data)
    for tolerance in (0.1, 0.05):
        subdivide(holder, output="IN_PLACE", tolerance=tolerance, subdivide_results=True)
        assert holder.data != other.data
        check_keys(tmp_path, 5)


@pytest.mark.parametrize("operator", ["compute", "count_faces", "subdivide"])
@pytest.mark.parametrize("modifier", [False, True])
@pytest.mark.parametrize("editing", [False, True])
def test_temporary_copies_leave_no_keys(tmp_path: Path, operator: str, modifier: bool, editing: bool) -> None:
    """Creases of a kind that must be converted take copies of evaluated meshes, whose keys belong to no mesh, and crash
    Blender once they are looked at."""
    holder = cube_with_keys(modifier)
    holder.data.attributes.new("crease_edge", "FLOAT", "POINT").data[0].value = 0.5
    holder.data.attributes.new("crease_vert", "INT", "CORNER")
    with addon.edit_mode(holder, editing=editing):
        assert getattr(bpy.ops.ccdepth, operator)(tolerance=0.05, tolerance_mode="ABSOLUTE") == {"FINISHED"}
    # Modifiers that are counted in have the keys applied.
    check_keys(tmp_path, 1 + (operator == "subdivide" and not modifier))
    bpy.context.scene.frame_set(2)
    assert all(key.points[0].co.length > 0 for keys in bpy.data.shape_keys for key in keys.key_blocks)


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("exchange.adaptive_mesh", "write_groups"),
        ("exchange.adaptive_mesh", "write_shape_keys"),
        ("exchange.adaptive_mesh", "_copy_animation"),
        ("operators.place_results", "_copy_of"),
        ("state.mesh_values", "write_adaptive"),
        ("exchange.control_mesh", "mesh_arrays"),
    ],
)
def test_runs_that_fail_leave_no_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, name: str) -> None:
    holder = cube_with_keys(modifier=name == "mesh_arrays")
    monkeypatch.setattr(addon.module(module), name, Mock(side_effect=MemoryError))
    refused(holder, match="not enough memory")
    assert [mesh.name for mesh in bpy.data.meshes] == [holder.data.name]
    check_keys(tmp_path, [holder.data.name])
