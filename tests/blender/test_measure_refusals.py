# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure Deviation and Select Worst Face refuse bad input with a clear report, and change nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.test_bad_input import linked_suzanne
from tests.blender.updating import refuses

pytestmark = pytest.mark.every_blender


def cube(name: str = "Cube", modifier: str = "", size: float = 1.0) -> bpy.types.Object:
    holder = scene.add_object(meshes.cube(), name)
    holder.scale = (size, size, size)
    if modifier:
        holder.modifiers.new(modifier.title(), modifier)
    return holder


def empty(name: str = "Empty") -> bpy.types.Object:
    return scene.add_mesh(bpy.data.meshes.new(name))


def nowhere(value: float) -> bpy.types.Object:
    """Suzanne with one coordinate that is no finite number."""
    holder = scene.add_suzanne()
    positions = np.empty(3 * len(holder.data.vertices), dtype=np.float32)
    holder.data.attributes["position"].data.foreach_get("vector", positions)
    positions[16] = value
    holder.data.attributes["position"].data.foreach_set("vector", positions)
    return holder


def hollow() -> bpy.types.Object:
    holder = cube("Hollow", "MASK")
    holder.modifiers[0].vertex_group = holder.vertex_groups.new(name="Nothing").name
    return holder


def attribute(data_type: str, domain: str) -> bpy.types.Object:
    holder = cube()
    holder.data.attributes.new("ccdepth_deviation", data_type, domain)
    return holder


def measured() -> bpy.types.Object:
    holder = cube()
    addon.measure(holder, time_limit=0.1)
    return holder


def in_sculpt_mode() -> None:
    addon.select(cube())
    bpy.ops.object.mode_set(mode="SCULPT")


def none_active() -> None:
    addon.select(cube(), cube(), cube())
    bpy.context.view_layer.objects.active.select_set(False)


def hidden() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    holder.hide_set(True)


def edited_since() -> bpy.types.Object:
    """A measured cube with another number of faces."""
    holder = measured()
    with addon.edit_mode(holder):
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.mesh.subdivide()
    return holder


# What makes and returns the objects, or selects them itself; the operator and its settings; and what it says.
Refusal = tuple[Callable[[], Any], str, dict[str, object], str]
NAN, INF = float("nan"), float("inf")
NOWHERE = "Suzanne: it shows 1 vertex at no finite position"
SAME_NAME = "Cube: .*called “ccdepth_deviation”"
REFUSALS: dict[str, Refusal] = {
    **{
        f"{mode} tolerance {value}": (cube, "measure", {"tolerance": value, "tolerance_mode": mode}, match)
        for mode in ("ABSOLUTE", "RELATIVE")
        for value, match in ((0.0, "greater than zero"), (-0.1, "greater than zero"), (NAN, "not a finite number"))
    },
    **{
        f"accuracy {value}": (cube, "measure", {"accuracy": value}, "The accuracy must be")
        for value in (0.0, -1.0, NAN)
    },
    "measured before": (measured, "measure", {"tolerance": 0.0}, "greater than zero"),
    "nothing selected": (addon.select, "measure", {}, "Select a mesh object"),
    "another mode": (in_sculpt_mode, "measure", {}, "Object Mode and in Edit Mode"),
    "none of several is active": (none_active, "measure", {}, "none of them is the active one"),
    "hidden": (hidden, "measure", {}, "Suzanne: the object is hidden"),
    "no faces": (empty, "measure", {}, "Empty: the object shows no faces"),
    "no faces on one": (lambda: [empty("Measured"), cube()], "measure", {}, "Measured: the object shows no faces"),
    "no surface": (lambda: [cube(), empty("Target")], "measure", {}, "Target: the mesh has no faces"),
    "modifiers that leave no faces": (lambda: [hollow(), cube()], "measure", {}, "Hollow: the object shows no faces"),
    "not a number": (lambda: nowhere(NAN), "measure", {}, NOWHERE),
    "infinite": (lambda: [nowhere(INF), cube()], "measure", {}, NOWHERE),
    "infinite surface": (lambda: [cube(), nowhere(-INF)], "measure", {}, "Suzanne: 1 vertex at no finite position"),
    "no extent": (lambda: [cube(), cube("Flat", size=0.0)], "measure", {}, "Flat: all its faces are at one point"),
    "simulation": (
        lambda: cube(modifier="CLOTH"),
        "measure",
        {},
        "the modifier “Cloth” is a simulation, which cannot be measured",
    ),
    "every bad object": (lambda: [empty("First"), empty("Second"), cube()], "measure", {}, "(?s)First: .*Second: "),
    "attribute of another type": (lambda: attribute("INT", "FACE"), "measure", {}, SAME_NAME),
    "attribute of another domain": (lambda: attribute("FLOAT", "POINT"), "measure", {}, SAME_NAME),
    "the same with depths": (lambda: attribute("INT", "FACE"), "compute", {}, SAME_NAME),
    "the same with depths on points": (lambda: attribute("FLOAT", "POINT"), "compute", {}, SAME_NAME),
    "no measurement": (cube, "select_worst", {}, "Measure Deviation first"),
    "edited since": (edited_since, "select_worst", {}, "the mesh has changed; measure it again"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_input_is_refused_and_nothing_changed(case: str) -> None:
    make, operator, settings, match = REFUSALS[case]
    objects = make()
    if objects:
        addon.select(*(objects if isinstance(objects, list) else [objects]))
    refuses(operator, match, **settings)
    if bpy.context.object is not None:
        bpy.ops.object.mode_set(mode="OBJECT")


def test_a_loose_vertex_nowhere_does_not_matter() -> None:
    data = meshes.cube()
    positions = np.concatenate([data.positions, [[np.nan, 0.0, 0.0]]])
    holder = scene.add_object(meshes.MeshData(positions, data.face_sizes, data.corner_vertices))
    addon.measure(holder, time_limit=0.1)
    assert holder.data.ccdepth.has_deviation


def test_linked_meshes_are_measured_against_and_not_measured(tmp_path: Path) -> None:
    linked = linked_suzanne(tmp_path)
    addon.select(linked)
    refuses("measure", "Suzanne: the mesh is linked from another file")
    own = cube()
    addon.measure(own, linked, time_limit=0.1)
    assert own.data.ccdepth.measurement.against == "Suzanne"
    override = linked.override_create(remap_local_usages=True)
    override.data = override.data.override_create()
    addon.select(override)
    refuses("measure", "Suzanne: the mesh is a library override")


def test_deviations_that_are_not_kept_on_a_later_mesh_leave_all_as_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blender drops the values of the second of two meshes that are measured together."""
    first, second, target = (cube(name) for name in ("First", "Second", "Target"))
    module = addon.module("exchange.bulk_writing")
    colors = []

    def forget(items: object, name: str, values: np.ndarray, _step: float) -> None:
        if name == "color":
            colors.append(name)
        if len(colors) == 2:
            raise module.WriteError("Blender did not keep what was written to the mesh")
        items.foreach_set(name, values.ravel())

    monkeypatch.setattr(module, "write_values", forget)
    addon.select(first, second, target)
    refuses("measure", "Blender did not keep what was written", tolerance=1.0, tolerance_mode="ABSOLUTE")
    assert len(colors) == 2
    assert addon.is_untouched([first, second, target])
