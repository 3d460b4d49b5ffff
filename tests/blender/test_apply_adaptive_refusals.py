# SPDX-License-Identifier: GPL-3.0-or-later
"""What Apply Adaptive Subdivision refuses, with nothing changed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import TOLERANCE, refused


def with_odd_crease(holder: bpy.types.Object, name: str, domain: str) -> None:
    holder.data.attributes.new(name, "FLOAT", domain).data[5].value = np.nan


def with_odd_key(holder: bpy.types.Object, value: float) -> None:
    """Which is not mixed in."""
    holder.shape_key_add(name="Basis")
    key = holder.shape_key_add(name="Odd")
    key.value = 0.0
    key.data.foreach_set("co", np.full(3 * len(key.data), value, dtype=np.float32))


@pytest.mark.every_blender
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda holder: holder.data.clear_geometry(), "the mesh has no faces"),
        (lambda holder: setattr(holder, "scale", (0.0, 0.0, 0.0)), "all its faces are at one point"),
        (lambda holder: setattr(holder.data.vertices[0].co, "x", np.nan), "1 vertex"),
        (lambda holder: holder.modifiers.new("Cloth", "CLOTH"), "“Cloth” is a simulation"),
        (lambda holder: holder.data.attributes.new("ccdepth", "FLOAT", "POINT"), "called “ccdepth”"),
        (partial(with_odd_key, value=np.nan), "the shape key “Odd” has a vertex at no finite position"),
        (partial(with_odd_key, value=np.inf), "the shape key “Odd” has a vertex at no finite position"),
        (
            partial(with_odd_crease, name="crease_edge", domain="EDGE"),
            r"1 edge with a crease that is not a number \(first: edge 5\)",
        ),
        (
            partial(with_odd_crease, name="crease_vert", domain="POINT"),
            r"1 vertex with a crease that is not a number \(first: vertex 5\)",
        ),
    ],
)
def test_bad_meshes_are_refused(spoil: Callable[[bpy.types.Object], object], message: str) -> None:
    good, bad = scene.add_object(meshes.cube(), "Good"), scene.add_suzanne()
    spoil(bad)
    refused(good, bad, match=f"Suzanne: .*{message}")
    if "crease" in message:
        with pytest.raises(RuntimeError, match=message):
            bpy.ops.ccdepth.compute()


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


def test_an_object_that_could_not_be_edited_again_stays_in_edit_mode() -> None:
    hidden, other = scene.add_object(meshes.cube(), "Hidden"), scene.add_object(meshes.cube(), "Other")
    with addon.edit_mode(hidden, other):
        hidden.hide_viewport = True
        with pytest.raises(RuntimeError, match="Hidden: it is edited while it is hidden"):
            bpy.ops.ccdepth.count_faces(tolerance=TOLERANCE)
        assert (hidden.mode, other.mode) == ("EDIT", "EDIT")
        hidden.hide_viewport = False


@pytest.mark.every_blender
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
