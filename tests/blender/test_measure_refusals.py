# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure Deviation refuses bad input with a clear report, and changes nothing; stale measurements are recognised."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.test_bad_input import linked_suzanne


def refused(*objects: bpy.types.Object, match: str, **settings: object) -> None:
    addon.select(*objects)
    with pytest.raises(RuntimeError, match=match):
        bpy.ops.ccdepth.measure(**settings)
    assert addon.is_untouched(objects)


@pytest.mark.parametrize("mode", ["ABSOLUTE", "RELATIVE"])
@pytest.mark.parametrize(
    ("tolerance", "match"),
    [(0.0, "greater than zero"), (-0.1, "greater than zero"), (float("nan"), "not a finite number")],
)
def test_tolerance(mode: str, tolerance: float, match: str) -> None:
    refused(scene.add_suzanne(), match=match, tolerance=tolerance, tolerance_mode=mode)


@pytest.mark.parametrize("accuracy", [0.0, -1.0, float("nan")])
def test_accuracy(accuracy: float) -> None:
    refused(scene.add_suzanne(), match="The accuracy must be", accuracy=accuracy)


def test_nothing_selected() -> None:
    addon.select()
    with pytest.raises(RuntimeError, match="Select a mesh object"):
        bpy.ops.ccdepth.measure()


def test_other_modes() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    bpy.ops.object.mode_set(mode="SCULPT")
    with pytest.raises(RuntimeError, match="Object Mode and in Edit Mode"):
        bpy.ops.ccdepth.measure()
    bpy.ops.object.mode_set(mode="OBJECT")


def empty(name: str = "Empty") -> bpy.types.Object:
    return scene.add_mesh(bpy.data.meshes.new(name))


def test_no_faces() -> None:
    refused(empty(), match="Empty: the object shows no faces")
    refused(empty("Measured"), scene.add_object(meshes.cube()), match="Measured: the object shows no faces")
    refused(scene.add_object(meshes.cube()), empty("Target"), match="Target: the mesh has no faces")


def test_modifiers_that_leave_no_faces() -> None:
    holder = scene.add_object(meshes.cube(), "Hollow")
    holder.modifiers.new("Mask", "MASK").vertex_group = holder.vertex_groups.new(name="Nothing").name
    refused(holder, scene.add_object(meshes.cube()), match="Hollow: the object shows no faces")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_vertices_nowhere(value: float) -> None:
    holder = scene.add_suzanne()
    positions = np.empty(3 * len(holder.data.vertices), dtype=np.float32)
    holder.data.attributes["position"].data.foreach_get("vector", positions)
    positions[16] = value
    holder.data.attributes["position"].data.foreach_set("vector", positions)
    refused(holder, match="Suzanne: it shows 1 vertex at no finite position")
    refused(holder, scene.add_object(meshes.cube()), match="Suzanne: it shows 1 vertex at no finite position")
    refused(scene.add_object(meshes.cube()), holder, match="Suzanne: 1 vertex at no finite position")


def test_a_loose_vertex_nowhere_does_not_matter() -> None:
    data = meshes.cube()
    positions = np.concatenate([data.positions, [[np.nan, 0.0, 0.0]]])
    holder = scene.add_object(meshes.MeshData(positions, data.face_sizes, data.corner_vertices))
    addon.measure(holder, time_limit=0.1)
    assert holder.data.ccdepth.has_deviation


def test_control_mesh_without_extent() -> None:
    target = scene.add_object(meshes.cube(), "Flat")
    target.scale = (0.0, 0.0, 0.0)
    refused(scene.add_suzanne(), target, match="Flat: all its faces are at one point")


def test_none_of_several_is_active() -> None:
    first, second, other = (scene.add_object(meshes.cube()) for _ in range(3))
    addon.select(first, second, other)
    other.select_set(False)
    with pytest.raises(RuntimeError, match="none of them is the active one"):
        bpy.ops.ccdepth.measure()


def test_hidden_object() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    holder.hide_set(True)
    with pytest.raises(RuntimeError, match="Suzanne: the object is hidden"):
        bpy.ops.ccdepth.measure()


def test_linked_mesh(tmp_path: object) -> None:
    linked = linked_suzanne(tmp_path)
    refused(linked, match="Suzanne: the mesh is linked from another file")
    own = scene.add_object(meshes.cube())
    addon.measure(own, linked, time_limit=0.1)
    assert own.data.ccdepth.measurement.against == "Suzanne"


def test_library_override_of_the_mesh(tmp_path: object) -> None:
    override = linked_suzanne(tmp_path).override_create(remap_local_usages=True)
    override.data = override.data.override_create()
    refused(override, match="Suzanne: the mesh is a library override")


@pytest.mark.parametrize(("data_type", "domain"), [("INT", "FACE"), ("FLOAT", "POINT")])
def test_attribute_of_the_same_name(data_type: str, domain: str) -> None:
    holder = scene.add_suzanne()
    holder.data.attributes.new("ccdepth_deviation", data_type, domain)
    addon.select(holder)
    for operator in (bpy.ops.ccdepth.measure, bpy.ops.ccdepth.compute):
        with pytest.raises(RuntimeError, match=r"Suzanne: .*called “ccdepth_deviation”"):
            operator()
    kept = holder.data.attributes["ccdepth_deviation"]
    assert (kept.data_type, kept.domain) == (data_type, domain)


def test_simulation() -> None:
    holder = scene.add_suzanne()
    holder.modifiers.new("Cloth", "CLOTH")
    refused(holder, match="Suzanne: the modifier “Cloth” is a simulation, which cannot be measured")


def test_every_bad_object_is_named() -> None:
    first, second = empty("First"), empty("Second")
    refused(first, second, scene.add_object(meshes.cube()), match=r"(?s)First: .*Second: ")


def test_a_bad_run_leaves_an_earlier_measurement_alone() -> None:
    holder = scene.add_object(meshes.cube())
    addon.measure(holder, time_limit=0.1)
    before, record = addon.deviations(holder), holder.data.ccdepth.deviation
    with pytest.raises(RuntimeError, match="greater than zero"):
        bpy.ops.ccdepth.measure(tolerance=0.0)
    np.testing.assert_array_equal(addon.deviations(holder), before)
    assert holder.data.ccdepth.deviation == record


# Stale measurements

OBJECTS_LINE = "Out of date: objects changed"


def stale_line(holder: bpy.types.Object) -> str:
    bpy.context.view_layer.update()
    addon.module("state.staleness").check_touched()
    return addon.module("ui.deviation_panel").stale_line(bpy.context.scene.ccdepth, holder.data)


def measured() -> tuple[bpy.types.Object, bpy.types.Object]:
    """An object, and the one that it was measured against."""
    source = scene.add_object(meshes.cube(), "Source")
    scene.add_subdivision(source, 2)
    other = scene.add_object(scene.evaluated_mesh_data(source), "Other")
    other.modifiers.new("Triangulate", "TRIANGULATE")
    bpy.context.scene.ccdepth.time_limit = 0.1
    addon.measure(other, source)
    assert stale_line(other) == ""
    return other, source


def move_a_vertex(other: bpy.types.Object, _source: bpy.types.Object) -> None:
    other.data.vertices[0].co.x += 0.01
    other.data.update()


def move_a_vertex_of_the_source(_other: bpy.types.Object, source: bpy.types.Object) -> None:
    source.data.vertices[0].co.x += 0.01
    source.data.update()


def move_the_source(_other: bpy.types.Object, source: bpy.types.Object) -> None:
    source.location.y += 0.001


def scale_both(other: bpy.types.Object, source: bpy.types.Object) -> None:
    other.scale = source.scale = (2.0, 2.0, 2.0)


def add_a_modifier(other: bpy.types.Object, _source: bpy.types.Object) -> None:
    other.modifiers.new("Solidify", "SOLIDIFY")


def change_the_deviations(other: bpy.types.Object, _source: bpy.types.Object) -> None:
    other.data.attributes["ccdepth_deviation"].data[0].value = 0.0
    other.data.update()


def remove_the_source(_other: bpy.types.Object, source: bpy.types.Object) -> None:
    bpy.data.objects.remove(source)
    addon.module("state.staleness").touch(_other.data)


@pytest.mark.parametrize(
    "change",
    [
        move_a_vertex,
        move_a_vertex_of_the_source,
        move_the_source,
        scale_both,
        add_a_modifier,
        change_the_deviations,
        remove_the_source,
    ],
)
def test_changes_are_noticed(change: Callable[[bpy.types.Object, bpy.types.Object], None]) -> None:
    other, source = measured()
    change(other, source)
    assert stale_line(other) == OBJECTS_LINE


def move_both(other: bpy.types.Object, source: bpy.types.Object) -> None:
    for holder in (other, source):
        holder.location = (5.0, 1.0, 2.0)
        holder.rotation_euler = (0.4, 1.0, -0.3)


def levels_of_the_source(_other: bpy.types.Object, source: bpy.types.Object) -> None:
    source.modifiers[0].levels = 1


def compute_depths(other: bpy.types.Object, _source: bpy.types.Object) -> None:
    settings = bpy.context.scene.ccdepth
    addon.compute(other, tolerance=settings.tolerance)


@pytest.mark.parametrize("change", [move_both, levels_of_the_source, compute_depths])
def test_what_does_not_matter_is_not(change: Callable[[bpy.types.Object, bpy.types.Object], None]) -> None:
    other, source = measured()
    change(other, source)
    assert stale_line(other) == ""


def test_levels_of_the_measured_object_matter() -> None:
    holder = scene.add_object(meshes.cube())
    modifier = scene.add_subdivision(holder, 1)
    addon.measure(holder, time_limit=0.1)
    assert stale_line(holder) == ""
    modifier.levels = 2
    assert stale_line(holder) == OBJECTS_LINE


def test_a_measurement_leaves_depths_current() -> None:
    holder = scene.add_object(meshes.cube())
    addon.compute(holder)
    addon.measure(holder, time_limit=0.1)
    bpy.context.view_layer.update()
    addon.module("state.staleness").check_touched()
    assert addon.module("ui.panels").stale_line(bpy.context.scene.ccdepth, holder.data) == ""


@pytest.mark.parametrize(
    ("name", "value"),
    [("relative_tolerance", 0.5), ("tolerance_mode", "ABSOLUTE"), ("accuracy", 0.2), ("use_modifiers", False)],
)
def test_other_settings_are_noticed(name: str, value: object) -> None:
    other, _ = measured()
    setattr(bpy.context.scene.ccdepth, name, value)
    assert stale_line(other) == "Out of date: settings changed"


def test_deviations_that_are_not_kept_on_a_later_mesh_leave_all_as_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blender drops the values of the second of two meshes that are measured together."""
    first, second, target = (scene.add_object(meshes.cube(), name) for name in ("First", "Second", "Target"))
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
    before = snapshot.take()
    with pytest.raises(RuntimeError, match="Blender did not keep what was written"):
        bpy.ops.ccdepth.measure(tolerance=1.0, tolerance_mode="ABSOLUTE")
    assert len(colors) == 2
    assert addon.is_untouched([first, second, target])
    assert snapshot.differences(before, snapshot.take()) == []
