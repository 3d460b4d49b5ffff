# SPDX-License-Identifier: GPL-3.0-or-later
"""What Apply Adaptive Subdivision refuses, with nothing changed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import TOLERANCE, refused


def no_faces() -> bpy.types.Object:
    return scene.add_mesh(bpy.data.meshes.new("Empty"))


def not_finite() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.data.vertices[0].co.x = np.nan
    return holder


def simulated() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.modifiers.new("Cloth", "CLOTH")
    return holder


def with_attribute_of_the_same_name() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.data.attributes.new("ccdepth", "FLOAT", "POINT")
    return holder


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (no_faces, "the mesh has no faces"),
        (not_finite, "1 vertex"),
        (simulated, "“Cloth” is a simulation"),
        (with_attribute_of_the_same_name, "called “ccdepth”"),
    ],
)
def test_bad_meshes_are_refused(make: Callable[[], bpy.types.Object], message: str) -> None:
    good, bad = scene.add_object(meshes.cube(), "Good"), make()
    refused(good, bad, match=f"{bad.name}: .*{message}")


@pytest.mark.parametrize(
    ("tolerance", "message"),
    [
        (0.0, "greater than zero"),
        (-1.0, "greater than zero"),
        (float("nan"), "not a finite number"),
        (1e-12, "Suzanne: the tolerance 1e-12 is finer than the mesh's single-precision coordinates can show"),
    ],
)
def test_bad_tolerances_are_refused(tolerance: float, message: str) -> None:
    refused(scene.add_suzanne(), match=message, tolerance=tolerance)


def test_objects_without_extent_are_refused() -> None:
    holder = scene.add_suzanne()
    holder.scale = (0.0, 0.0, 0.0)
    refused(holder, match="Suzanne: all its faces are at one point")


def test_hidden_objects_are_refused() -> None:
    shown, hidden = scene.add_object(meshes.cube(), "Shown"), scene.add_suzanne()
    addon.select(shown)
    hidden.hide_set(True)
    with (
        bpy.context.temp_override(selected_objects=[shown, hidden], active_object=shown),
        pytest.raises(RuntimeError, match="Suzanne: the object is hidden; show it first"),
    ):
        bpy.ops.ccdepth.subdivide(tolerance=TOLERANCE)
    assert len(bpy.data.objects) == 2


def test_linked_objects_are_refused(tmp_path: Path) -> None:
    holder = scene.add_suzanne()
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {holder})
    scene.clear()
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (source, target):
        target.objects = list(source.objects)
    [linked] = target.objects
    bpy.context.scene.collection.objects.link(linked)
    refused(linked, match="Suzanne: the object is linked from another file")


def test_without_a_mesh_object_it_is_not_offered() -> None:
    addon.select()
    assert not bpy.ops.ccdepth.subdivide.poll()
    assert not bpy.ops.ccdepth.count_faces.poll()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_shape_keys_at_no_finite_position_are_refused(value: float) -> None:
    """Even where they are not mixed in."""
    holder = scene.add_suzanne()
    holder.shape_key_add(name="Basis")
    key = holder.shape_key_add(name="Odd")
    key.value = 0.0
    key.data.foreach_set("co", np.full(3 * len(key.data), value, dtype=np.float32))
    refused(holder, match="Suzanne: the shape key “Odd” has a vertex at no finite position")


@pytest.mark.parametrize(("name", "domain"), [("crease_edge", "EDGE"), ("crease_vert", "POINT")])
def test_creases_that_are_no_numbers_are_refused(name: str, domain: str) -> None:
    holder = scene.add_suzanne()
    holder.data.attributes.new(name, "FLOAT", domain).data[5].value = np.nan
    refused(holder, match=r"1 (edge|vertex) with a crease that is not a number \(first: (edge|vertex) 5\)")
    with pytest.raises(RuntimeError, match="with a crease that is not a number"):
        bpy.ops.ccdepth.compute()
