# SPDX-License-Identifier: GPL-3.0-or-later
"""The surface meant: modifiers above the Subdivision Surface modifier, its settings, and shape keys;
modifiers of every type are described without a fault, and every change is noticed."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import bpy
import numpy as np
import pytest

from ccdepth_addon.core.depth.face_depths import face_depths
from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.subdividing import TOLERANCE, refuses
from tests.blender.updating import stale_line

pytestmark = pytest.mark.every_blender


def core_depths(mesh: bpy.types.Mesh, *, smooth_corners: bool = True) -> np.ndarray:
    """(F,) int32: what the core says of a Blender mesh with control vertices, by the scene's method."""
    explicit = scene.polygon_mesh_of(mesh, smooth_corners=smooth_corners)
    return face_depths(explicit, TOLERANCE, bpy.context.scene.ccdepth.method, "CONTROL").depths


def evaluated(holder: bpy.types.Object) -> bpy.types.Mesh:
    return holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def computed(holder: bpy.types.Object, **settings: object) -> np.ndarray:
    """(F,) int32: the depths that are computed for control vertices."""
    addon.compute(holder, tolerance=TOLERANCE, vertices="CONTROL", **settings)
    return addon.depths(holder)


def displace(holder: bpy.types.Object, strength: float = 5.0) -> bpy.types.Modifier:
    modifier = holder.modifiers.new("Displace", "DISPLACE")
    modifier.strength = strength
    return modifier


@pytest.mark.parametrize("kind", ["MIRROR", "ARRAY"])
def test_each_face_gets_the_largest_depth_of_its_copies(kind: str) -> None:
    """In Edit Mode modifiers count as well."""
    holder = scene.add_object(meshes.landscape(6, 5))
    modifier = holder.modifiers.new("Copies", kind)
    if kind == "ARRAY":
        modifier.count, modifier.use_merge_vertices = 3, True
    copies = core_depths(evaluated(holder)).reshape(-1, len(holder.data.polygons))
    found = computed(holder)
    np.testing.assert_array_equal(found, copies.max(axis=0))
    assert int(holder.data.ccdepth.uniform_faces) > 4 ** (copies.max() - 1) * len(holder.data.loops)
    bpy.ops.ccdepth.clear()
    with addon.edit_mode(holder):
        bpy.ops.ccdepth.compute(tolerance=TOLERANCE, tolerance_mode="ABSOLUTE", vertices="CONTROL")
    np.testing.assert_array_equal(addon.depths(holder), found)


@pytest.mark.parametrize("kind", ["MIRROR", "ARRAY", "BEVEL", "SOLIDIFY", "TRIANGULATE", "EDGE_SPLIT", "WIREFRAME"])
def test_the_deepest_face_is_that_of_the_modified_mesh(kind: str) -> None:
    holder = scene.add_suzanne()
    holder.modifiers.new("Modifier", kind)
    addon.select(holder)
    with snapshot.unchanged(snapshot.is_ours):
        computed(holder)
    assert holder.data.ccdepth.deepest == core_depths(evaluated(holder)).max()


def test_a_simple_subdivision_is_a_modifier_like_any_other() -> None:
    holder = scene.add_suzanne()
    scene.add_subdivision(holder, 1).subdivision_type = "SIMPLE"
    found = core_depths(evaluated(holder))
    scene.add_subdivision(holder, 2)
    sizes = [polygon.loop_total for polygon in holder.data.polygons]
    np.testing.assert_array_equal(computed(holder), np.maximum.reduceat(found, np.cumsum(sizes) - sizes))


def test_faces_a_modifier_takes_away_need_no_level(capfd: pytest.CaptureFixture[str]) -> None:
    """And a warning names the object, whose name cannot command the terminal."""
    holder = scene.add_object(meshes.landscape(6, 5), "Land\x1b[2J")
    group = holder.vertex_groups.new(name="Shown")
    group.add(range(len(holder.data.vertices) // 2), 1.0, "REPLACE")
    holder.modifiers.new("Mask", "MASK").vertex_group = group.name
    shown = core_depths(evaluated(holder))
    depths, printed = computed(holder), capfd.readouterr().out
    assert ("Land\\x1b[2J: modifiers take" in printed, "\x1b" in printed) == (True, False)
    assert 0 < len(shown) < len(depths)
    assert np.count_nonzero(depths) == np.count_nonzero(shown)
    assert np.count_nonzero(addon.bounds(holder)) <= len(shown)
    # What is not there needs no level at all, so that is proved to be the least.
    assert holder.data.ccdepth.exact_faces >= len(depths) - len(shown)


def test_modifiers_count_that_are_above_the_subdivision_and_shown() -> None:
    holder = scene.add_suzanne()
    modifier = displace(holder)
    np.testing.assert_array_equal(computed(holder), core_depths(evaluated(holder)))
    own = core_depths(holder.data)
    assert not np.array_equal(addon.depths(holder), own)
    np.testing.assert_array_equal(computed(holder, use_modifiers=False), own)
    modifier.show_viewport = False
    np.testing.assert_array_equal(computed(holder), own)
    holder.modifiers.clear()
    scene.add_subdivision(holder, 2)
    displace(holder)
    np.testing.assert_array_equal(computed(holder), own)


def test_the_first_subdivision_shown_in_the_viewport_is_meant() -> None:
    """Where none shows, the first; its vertices are those that it shows."""
    holder = scene.add_object(meshes.landscape(4, 4))
    first, second = (scene.add_subdivision(holder, 1, boundary=each) for each in ("ALL", "PRESERVE_CORNERS"))
    first.use_limit_surface = True
    assert not np.array_equal(core_depths(holder.data), core_depths(holder.data, smooth_corners=False))
    for shown, is_first in (((True, True), True), ((False, True), False), ((False, False), True)):
        first.show_viewport, second.show_viewport = shown
        np.testing.assert_array_equal(computed(holder), core_depths(holder.data, smooth_corners=is_first))
        addon.compute(holder, vertices="OBJECT")
        assert holder.data.ccdepth.vertices == ("LIMIT" if is_first else "CONTROL")
    first.subdivision_type = "SIMPLE"
    addon.compute(holder, vertices="OBJECT")
    assert holder.data.ccdepth.vertices == "CONTROL"


def test_creases_can_be_off() -> None:
    holder = scene.add_object(meshes.with_random_creases(meshes.torus(8, 5), share=0.5))
    scene.add_subdivision(holder, 1)
    np.testing.assert_array_equal(computed(holder), core_depths(holder.data))
    holder.modifiers[0].use_creases = False
    found = computed(holder)
    for name in ("crease_edge", "crease_vert"):
        if name in holder.data.attributes:
            holder.data.attributes.remove(holder.data.attributes[name])
    np.testing.assert_array_equal(found, core_depths(holder.data))


def test_shape_keys_are_mixed() -> None:
    holder = scene.add_suzanne()
    key = scene.add_key(holder, value=0.5)
    for point in key.data:
        point.co.z *= 4.0
    np.testing.assert_array_equal(computed(holder), core_depths(evaluated(holder)))
    assert key.value == 0.5
    assert len(bpy.data.shape_keys) == 1


def test_an_animated_object_is_taken_as_it_is_shown() -> None:
    holder = scene.add_suzanne()
    modifier = displace(holder, 0.0)
    modifier.keyframe_insert("strength", frame=1)
    modifier.strength = 3.0
    shown = core_depths(evaluated(holder))
    np.testing.assert_array_equal(computed(holder), shown)
    assert modifier.strength == 3.0


def limited_by_group(holder: bpy.types.Object) -> None:
    holder.vertex_groups.new(name="None")
    holder.vertex_groups.new(name="Some").add([0, 1], 1.0, "REPLACE")
    modifier = displace(holder, 3.0)
    modifier.vertex_group, modifier.mid_level = "Some", 0.0


def limited_by_material(holder: bpy.types.Object) -> None:
    """Geometry Nodes move the vertices of faces with the second material."""
    for name in ("First", "Second"):
        holder.data.materials.append(bpy.data.materials.new(name))
    holder.data.polygons[0].material_index = 1
    tree = scene.node_tree("GeometryNodeSetPosition")
    move, chosen = tree.nodes["Set Position"], tree.nodes.new("GeometryNodeMaterialSelection")
    chosen.inputs["Material"].default_value = bpy.data.materials["Second"]
    move.inputs["Offset"].default_value = (3.0, 0.0, 0.0)
    tree.links.new(chosen.outputs[0], move.inputs["Selection"])
    holder.modifiers.new("Nodes", "NODES").node_group = tree


@pytest.mark.parametrize("limit", [limited_by_group, limited_by_material])
def test_groups_and_materials_limit_modifiers_in_edit_mode_as_well(limit: Callable[[bpy.types.Object], None]) -> None:
    holder = scene.add_object(meshes.cube())
    limit(holder)
    settings = {"tolerance": TOLERANCE, "tolerance_mode": "ABSOLUTE", "method": "CERTIFIED"}
    addon.compute(holder, **settings, use_modifiers=True)
    in_object_mode = addon.bounds(holder)
    addon.compute(holder, **settings, use_modifiers=False)
    assert not np.array_equal(addon.bounds(holder), in_object_mode)
    with addon.edit_mode(holder):
        assert bpy.ops.ccdepth.compute(**settings, use_modifiers=True) == {"FINISHED"}
    np.testing.assert_array_equal(addon.bounds(holder), in_object_mode)


@pytest.mark.parametrize(
    ("kind", "way"),
    [
        ("REMESH", "replaces all faces"),
        ("SCREW", "replaces all faces"),
        ("DECIMATE", "merges faces"),
        ("NODES", "replaces all faces"),
        ("CLOTH", "is a simulation"),
    ],
)
def test_modifiers_that_lose_the_faces_are_named(kind: str, way: str) -> None:
    """Also where a driver shows them."""
    holder, other = scene.add_suzanne(), scene.add_object(meshes.cube())
    holder.modifiers.new("Innocent", "MIRROR")
    culprit = holder.modifiers.new("The Culprit", kind)
    culprit.driver_add("show_viewport").driver.expression = "True"
    if kind == "DECIMATE":
        culprit.ratio = 0.5
    if kind == "NODES":
        culprit.node_group = scene.node_tree("GeometryNodeConvexHull")
    holder.modifiers.new("Innocent", "TRIANGULATE")
    refuses("compute", f"{holder.name}: the modifier “The Culprit” {way}", other, holder)
    assert bpy.ops.ccdepth.compute(use_modifiers=False) == {"FINISHED"}


def test_faces_that_come_from_no_face_are_not_mistaken_for_copies() -> None:
    holder = scene.add_suzanne()
    boolean = holder.modifiers.new("Boolean", "BOOLEAN")
    boolean.object = scene.add_object(meshes.cube(), "Cutter")
    boolean.object.location = (1.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    control = addon.module("exchange.control_mesh").read_alone(bpy.context, holder, use_modifiers=True)
    assert np.count_nonzero(control.base_faces < 0) > 0
    assert len(computed(holder)) == len(holder.data.polygons)


def test_origins_that_were_averaged_are_not_taken_for_origins() -> None:
    evaluated = addon.module("exchange.evaluated")
    holder = scene.add_object(meshes.landscape(8, 8))
    mesh = holder.data
    name = evaluated._write_origins(holder, mesh)
    averaged = scene.read(mesh, name)
    averaged[0] = (averaged[2] + averaged[4]) // 2
    mesh.attributes[name].data.foreach_set("value", averaged.ravel())
    origins = evaluated._read_origins(mesh, name, len(mesh.polygons))
    assert origins[0] == evaluated.NO_ORIGIN
    np.testing.assert_array_equal(origins[1:], np.arange(1, len(mesh.polygons)))


TYPES = [item.identifier for item in bpy.types.Modifier.bl_rna.properties["type"].enum_items]

# Of all modifiers, and only about where they are shown.
COMMON = set(bpy.types.Modifier.bl_rna.properties.keys())

# Of the Subdivision Surface modifier whose surface is meant, these alone shape the surface.
SHAPING_SUBSURF = {"boundary_smooth", "use_creases"}


def fresh() -> Iterator[tuple[str, bpy.types.Object]]:
    """An object with a modifier of each type, one after another."""
    for kind in TYPES:
        holder = scene.add_object(meshes.creased_cube())
        holder.vertex_groups.new(name="Group")
        # Those that Blender does not have for meshes are an error for some types, nothing for others.
        with suppress(RuntimeError, TypeError):
            holder.modifiers.new(kind.title(), kind)
        if len(holder.modifiers):
            yield kind, holder
        bpy.data.objects.remove(holder)


def test_every_operator_copes_with_fresh_modifiers(capfd: pytest.CaptureFixture[str]) -> None:
    """Either it is done, or it is refused with a reason; and what was done holds until something changes."""
    bpy.context.scene.ccdepth.relative_tolerance = 0.2
    dependencies = addon.module("exchange.dependencies")
    state = dependencies.object_state
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
        # With the least iterations that Blender 4.3 accepts, its Smooth Corrective does not end.
        return field.soft_min if value != field.soft_min else field.soft_max
    if field.type == "ENUM" and not field.is_enum_flag:
        return next((item.identifier for item in field.enum_items if item.identifier != value), None)
    return None


def test_every_simple_setting_of_every_modifier_is_noticed() -> None:
    dependencies = addon.module("exchange.dependencies")
    state = dependencies.object_state
    refused = addon.module("exchange.modifiers").SIMULATIONS | addon.module("exchange.modifiers").NOT_SHAPING
    settings = 0
    for kind, holder in fresh():
        if kind in refused:
            continue
        [modifier] = holder.modifiers
        for field in modifier.bl_rna.properties:
            name = field.identifier
            if field.is_readonly or name in COMMON | dependencies.UNREAD:
                continue
            if name.startswith(dependencies.UNREAD_PREFIXES):
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
    # So many that a walk which finds nothing would not do.
    assert settings > 300


def test_objects_that_look_at_each_other() -> None:
    first, second = scene.add_object(meshes.cube(), "First"), scene.add_object(meshes.cube(), "Second")
    first.modifiers.new("Mirror", "MIRROR").mirror_object = second
    second.modifiers.new("Mirror", "MIRROR").mirror_object = first
    addon.compute(first, second)
    assert stale_line(first) == stale_line(second) == ""


def test_a_simulation_of_rigid_bodies_stands_where_it_stood() -> None:
    """Copies that Blender evaluates are no rigid bodies, and leave the scene before they are removed. Attributes on
    the mesh of a rigid body itself end its cache, as any change of the mesh does."""
    falling, other = scene.add_object(meshes.cube(), "Falling"), scene.add_object(meshes.cube(), "Other")
    for each in (falling, other):
        each.modifiers.new("Bevel", "BEVEL")
        each.modifiers.new("Cast", "CAST")
    falling.location.z = 5.0
    addon.select(falling)
    bpy.ops.rigidbody.object_add()
    shown = bpy.context.scene
    for frame in range(1, 21):
        shown.frame_set(frame)
    height = falling.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world.translation.z
    for operator, holder, settings in (
        ("count_faces", falling, {"shading_angle": 0.0}),
        ("compute", other, {"method": "FIRST_ORDER"}),
    ):
        addon.finish(operator, holder, **settings)
        bpy.context.view_layer.update()
        assert not shown.rigidbody_world.point_cache.is_outdated
    addon.select(falling)
    shown.ccdepth.shown_tolerance_mode = "ABSOLUTE"
    assert shown.ccdepth.tolerance != addon.module("state.properties").DEFAULT_ABSOLUTE_TOLERANCE
    for frame in (19, 20):
        shown.frame_set(frame)
    assert falling.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world.translation.z == height
