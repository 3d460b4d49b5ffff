# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes with shape keys: loose parts keep their places in every key, and no key data-block is left behind.

Before Blender 5.2 a copy of a mesh with keys counts one user of its Key too many, so that removing the keys leaves the
Key in the file, and saving a file with such a Key fails.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import refused, subdivide

LOOSE = (7.0, 8.0, 9.0)
LOOSE_IN_KEY = (-7.0, 5.0, 3.0)


def plane_with_loose_parts(loose_edge: bool = False) -> bpy.types.Object:
    """6 × 6 quads, a loose vertex, the last one, or a loose edge with it, and two keys."""
    data = meshes.grid(6, 6)
    count = len(data.positions)
    loose = [(6.0, 8.0, 9.0), LOOSE] if loose_edge else [LOOSE]
    data = replace(data, positions=np.concatenate([data.positions, loose]))
    if loose_edge:
        data = replace(data, loose_edges=[(count, count + 1)])
    return with_keys(scene.add_object(data))


def with_keys(holder: bpy.types.Object) -> bpy.types.Object:
    for name in ("Basis", "Key"):
        key = holder.shape_key_add(name=name, from_mix=False)
    key.value = 0.5
    key.points[0].co.z += 1.0
    key.points[len(key.points) - 1].co = LOOSE_IN_KEY
    return holder


def points(holder: bpy.types.Object, name: str) -> np.ndarray:
    """(V, 3): where a key has the vertices."""
    key = holder.data.shape_keys.key_blocks[name]
    found = np.empty(3 * len(key.points), dtype=np.float32)
    key.points.foreach_get("co", found)
    return found.reshape(-1, 3)


def used(holder: bpy.types.Object) -> np.ndarray:
    """(V,) bool: the vertices with faces."""
    found = np.zeros(len(holder.data.vertices), dtype=bool)
    found[[loop.vertex_index for loop in holder.data.loops]] = True
    return found


# Loose parts.


@pytest.mark.parametrize("loose_edge", [False, True])
@pytest.mark.parametrize("exact_normals", [False, True])
def test_loose_parts_stay_where_every_key_has_them(loose_edge: bool, exact_normals: bool) -> None:
    holder = plane_with_loose_parts(loose_edge)
    [result] = subdivide(holder, exact_normals=exact_normals)
    [loose] = np.flatnonzero(~used(result))[-1:]
    assert tuple(points(result, "Basis")[loose]) == LOOSE
    assert tuple(points(result, "Key")[loose]) == LOOSE_IN_KEY
    assert np.count_nonzero(~used(result)) == 1 + loose_edge


def test_loose_parts_change_nothing_elsewhere() -> None:
    alone = with_keys(scene.add_object(meshes.grid(6, 6), "Alone"))
    # Its last vertex is one of the plane's, and no loose one.
    alone.data.shape_keys.key_blocks["Key"].points[len(alone.data.vertices) - 1].co = points(alone, "Basis")[-1]
    [plain] = subdivide(alone)
    [result] = subdivide(plane_with_loose_parts())
    for name in ("Basis", "Key"):
        np.testing.assert_array_equal(points(result, name)[used(result)], points(plain, name))


@pytest.mark.parametrize(
    "data_type", ["FLOAT", "FLOAT_VECTOR", "FLOAT_COLOR", "BYTE_COLOR", "INT", "BOOLEAN", "STRING"]
)
def test_loose_vertices_keep_their_values(data_type: str) -> None:
    """Even where the last corner of the mesh, which a loose vertex does not have, holds no number."""
    holder = plane_with_loose_parts()
    items = holder.data.attributes.new("Values", data_type, "POINT").data
    name = {"FLOAT_VECTOR": "vector", "FLOAT_COLOR": "color", "BYTE_COLOR": "color"}.get(data_type, "value")
    value = {"vector": (1, 2, 3), "color": (1, 0, 1, 1)}.get(name, {"STRING": b"loose"}.get(data_type, 1))
    setattr(items[len(items) - 1], name, value)
    [result] = subdivide(holder)
    kept = getattr(result.data.attributes["Values"].data[int(np.flatnonzero(~used(result))[0])], name)
    assert (tuple(kept) if name != "value" else kept) == value


# Key data-blocks.


def save_twice(folder: Path) -> None:
    """The second time there is a file to compare with and to back up."""
    for _ in range(2):
        assert bpy.ops.wm.save_as_mainfile(filepath=str(folder / "saved.blend")) == {"FINISHED"}


def key_owners() -> list[str]:
    """The meshes that the keys of the file belong to; every key belongs to one, which holds it."""
    for key in bpy.data.shape_keys:
        assert key.user is not None, f"{key.name} belongs to no mesh"
        assert key.user.shape_keys == key
    return sorted(key.user.name for key in bpy.data.shape_keys)


@pytest.mark.parametrize("times", [1, 3])
def test_new_objects_leave_no_other_keys(tmp_path: Path, times: int) -> None:
    holder = with_keys(scene.add_object(meshes.cube(), "Cube"))
    for _ in range(times):
        holder.hide_set(False)
        subdivide(holder)
    assert len(key_owners()) == 1 + times
    save_twice(tmp_path)


def test_in_place_leaves_no_other_keys(tmp_path: Path) -> None:
    holder = with_keys(scene.add_object(meshes.cube(), "Cube"))
    for tolerance in (0.1, 0.05):
        subdivide(holder, output="IN_PLACE", tolerance=tolerance, subdivide_results=True)
    assert key_owners() == [holder.data.name]
    save_twice(tmp_path)


def test_in_place_keeps_the_keys_of_a_mesh_others_use(tmp_path: Path) -> None:
    holder = with_keys(scene.add_object(meshes.cube(), "Cube"))
    other = scene.add_mesh(holder.data)
    subdivide(holder, output="IN_PLACE")
    assert key_owners() == sorted([holder.data.name, other.data.name])
    save_twice(tmp_path)


def with_modifier(holder: bpy.types.Object) -> bpy.types.Object:
    holder.modifiers.new("Bevel", "BEVEL")
    return holder


@pytest.mark.parametrize("operator", ["compute", "count_faces", "subdivide"])
@pytest.mark.parametrize("modifier", [False, True])
@pytest.mark.parametrize("editing", [False, True])
def test_temporary_copies_leave_no_keys(tmp_path: Path, operator: str, modifier: bool, editing: bool) -> None:
    holder = with_keys(scene.add_object(meshes.cube(), "Cube"))
    if modifier:
        with_modifier(holder)
    addon.select(holder)
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    assert getattr(bpy.ops.ccdepth, operator)(tolerance=0.05, tolerance_mode="ABSOLUTE") == {"FINISHED"}
    if bpy.context.mode == "EDIT_MESH":
        bpy.ops.object.mode_set(mode="OBJECT")
    # Modifiers that are counted in have the keys applied.
    assert len(key_owners()) == 1 + (operator == "subdivide" and not modifier)
    save_twice(tmp_path)


def test_refused_runs_leave_no_keys(tmp_path: Path) -> None:
    holder = with_modifier(with_keys(scene.add_object(meshes.cube(), "Cube")))
    refused(holder, match="are allowed", max_faces=7)
    holder.modifiers.clear()
    refused(holder, match="are allowed", max_faces=7)
    refused(holder, match="greater than zero", tolerance=0.0)
    assert key_owners() == [holder.data.name]
    save_twice(tmp_path)


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("exchange.adaptive_mesh", "write_groups"),
        ("exchange.adaptive_mesh", "write_shape_keys"),
        ("exchange.shape_keys", "_copy_animation"),
        ("operators.adaptive_objects", "_place_beside"),
        ("state.results", "write_adaptive"),
    ],
)
def test_runs_that_fail_half_way_leave_no_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, name: str
) -> None:
    holder = with_keys(scene.add_object(meshes.cube(), "Cube"))

    def fail(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(addon.module(module), name, fail)
    refused(holder, match="not enough memory")
    assert key_owners() == [holder.data.name]
    assert [mesh.name for mesh in bpy.data.meshes] == [holder.data.name]
    save_twice(tmp_path)


def test_a_mesh_made_by_modifiers_leaves_no_keys_when_it_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    holder = with_modifier(with_keys(scene.add_object(meshes.cube(), "Cube")))

    def fail(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(addon.module("exchange.control_mesh"), "mesh_arrays", fail)
    refused(holder, match="not enough memory")
    assert key_owners() == [holder.data.name]
    save_twice(tmp_path)
