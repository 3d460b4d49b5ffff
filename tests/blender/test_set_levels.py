# SPDX-License-Identifier: GPL-3.0-or-later
"""Set Subdivision Levels: the modifier gets the uniform level, the vertices that were measured, and the Quality."""

from collections.abc import Callable

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import known_count, refuses
from tests.blender.updating import move_vertex, set_scene

pytestmark = pytest.mark.every_blender

TOLERANCE = 0.05


@pytest.fixture(autouse=True)
def few_levels() -> None:
    """Blender makes what is set here, so it must not be much."""
    bpy.context.scene.ccdepth.method = "CERTIFIED"


def levels(holder: bpy.types.Object) -> list[tuple[int, int, bool]]:
    found = [modifier for modifier in holder.modifiers if modifier.type == "SUBSURF"]
    return [(each.levels, each.render_levels, each.use_limit_surface) for each in found]


@pytest.mark.parametrize("vertices", ["CONTROL", "LIMIT"])
@pytest.mark.parametrize("present", [False, True])
def test_the_modifier_gets_the_uniform_level(vertices: str, present: bool) -> None:
    holder = scene.add_suzanne()
    if present:
        scene.add_subdivision(holder, 1, boundary="PRESERVE_CORNERS").use_limit_surface = vertices == "CONTROL"
    addon.compute(holder, tolerance=TOLERANCE, vertices=vertices)
    level = holder.data.ccdepth.uniform_level
    assert level >= int(addon.depths(holder).max())
    assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
    assert levels(holder) == [(level, level, vertices == "LIMIT")]
    if present:
        assert holder.modifiers[0].boundary_smooth == "PRESERVE_CORNERS"
    addon.examine_touched()
    assert not addon.module("state.out_of_date").noted(holder.data).is_stale


@pytest.mark.parametrize("kind", ["MULTIRES", "SOFT_BODY"])
def test_modifiers_that_stay_first_are_told(kind: str) -> None:
    holder = scene.add_object(meshes.cube())
    holder.modifiers.new("First", kind)
    addon.compute(holder, tolerance=TOLERANCE, use_modifiers=False)
    refuses("set_levels", "above a Multiresolution or Soft Body one; turn Include Modifiers on")
    assert [each.name for each in holder.modifiers] == ["First"]


@pytest.mark.parametrize("use_modifiers", [False, True])
def test_a_new_modifier_stands_where_the_surface_was_measured(use_modifiers: bool) -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    holder.modifiers.new("Mirror", "MIRROR")
    addon.compute(holder, tolerance=TOLERANCE, use_modifiers=use_modifiers)
    bpy.ops.ccdepth.set_levels()
    kinds = [modifier.type for modifier in holder.modifiers]
    assert kinds == (["MIRROR", "SUBSURF"] if use_modifiers else ["SUBSURF", "MIRROR"])


def test_faces_that_modifiers_add_count() -> None:
    holder, other = scene.add_object(meshes.cube()), scene.add_suzanne()
    other.location = (0.5, 0.5, 0.5)
    other.scale = (4.0, 4.0, 4.0)
    boolean = holder.modifiers.new("Boolean", "BOOLEAN")
    boolean.object, boolean.operation = other, "UNION"
    addon.compute(holder, tolerance=TOLERANCE)
    record = holder.data.ccdepth
    assert record.added_deepest > 0
    bpy.ops.ccdepth.set_levels()
    assert levels(holder)[0][0] >= max(record.added_deepest, record.deepest)


def test_objects_of_one_mesh_get_a_level_that_is_enough_for_each() -> None:
    first = scene.add_suzanne()
    second = scene.add_mesh(first.data)
    second.scale = (1.0, 5.0, 0.5)
    addon.compute(second, tolerance=TOLERANCE)
    alone = second.data.ccdepth.uniform_level
    addon.compute(first, second, tolerance=TOLERANCE)
    bpy.ops.ccdepth.set_levels()
    assert levels(first)[0][0] == levels(second)[0][0] == first.data.ccdepth.uniform_level >= alone


@pytest.mark.parametrize(("own", "expected"), [(3, 9), (10, 10)])
def test_the_quality_is_what_the_creases_need(own: int, expected: int) -> None:
    """A crease of 0.9 is a sharpness of 8.1, which has run out after nine levels. What is higher is left."""
    holder = scene.add_object(meshes.cube_creased_around_the_top(0.9))
    modifier = scene.add_subdivision(holder, 1)
    modifier.quality = own
    addon.compute(holder, tolerance=TOLERANCE, vertices="LIMIT")
    bpy.ops.ccdepth.set_levels()
    assert modifier.quality == expected
    modifier.quality = own
    addon.compute(holder, tolerance=TOLERANCE, vertices="CONTROL")
    bpy.ops.ccdepth.set_levels()
    assert (modifier.use_limit_surface, modifier.quality) == (False, own)


@pytest.mark.parametrize(("quality", "shows_limits", "noted"), [(3, True, True), (9, True, False), (3, False, False)])
def test_compute_tells_of_a_quality_that_is_too_low(
    quality: int, shows_limits: bool, noted: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    holder = scene.add_object(meshes.cube_creased_around_the_top(0.9), "Cube")
    modifier = scene.add_subdivision(holder, 4)
    # Levels of the render count as well.
    modifier.quality, modifier.use_limit_surface, modifier.levels = quality, shows_limits, 1
    addon.compute(holder, tolerance=TOLERANCE)
    note = "Cube: at its 4 levels, Use Limit Surface needs a Quality of 9 to show the limit surface; it is 3"
    assert (note in capfd.readouterr().out) == noted


def test_several_objects_and_edit_mode() -> None:
    first, second = scene.add_suzanne(), scene.add_object(meshes.creased_cube())
    addon.compute(first, second, tolerance=TOLERANCE)
    wanted = [int(addon.depths(holder).max()) for holder in (first, second)]
    with addon.edit_mode(first, second):
        assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
    assert [levels(holder)[0][0] for holder in (first, second)] == wanted


def recorded(name: str, value: int) -> Callable[[bpy.types.Object], None]:
    return lambda holder: setattr(holder.data.ccdepth, name, value)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (recorded("quality", 11), "with Use Limit Surface it needs a higher Quality than the 10"),
        (lambda _: bpy.ops.ccdepth.clear(), "it has no depths"),
        (lambda holder: move_vertex(holder.data), "its depths are out of date"),
        (lambda holder: setattr(holder, "scale", (2.0, 1.0, 1.0)), "its depths are out of date"),
        (recorded("uniform_level", 12), "it needs 12 levels, and a Subdivision Surface modifier has 11 at most"),
        (lambda _: set_scene(max_faces=1000), ".* levels would make .* faces, and the Face Limit is 1,000"),
    ],
)
def test_what_cannot_be_set_is_refused(spoil: Callable[[bpy.types.Object], None], message: str) -> None:
    good, bad = scene.add_object(meshes.cube(), "Good"), scene.add_suzanne()
    addon.compute(good, bad, tolerance=TOLERANCE)
    addon.select(bad)
    spoil(bad)
    refuses("set_levels", f"Suzanne: {message}", good, bad)


def test_a_result_whose_own_depths_were_computed_gets_no_levels_unless_results_are_subdivided() -> None:
    source, other = scene.add_object(meshes.cube(), "Cage"), scene.add_object(meshes.cube(), "Other")
    addon.select(source)
    assert not bpy.ops.ccdepth.set_levels.poll()
    bpy.ops.ccdepth.subdivide(tolerance=TOLERANCE)
    assert not bpy.ops.ccdepth.set_levels.poll()
    result = bpy.context.active_object
    addon.compute(result, other, tolerance=TOLERANCE)
    refuses("set_levels", f"{result.name}: it is a result, made from “Cage”; set the levels of the source")
    refuses("set_levels", "set the levels of its source", result)
    bpy.context.scene.ccdepth.subdivide_results = True
    assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
    assert levels(result) == [(result.data.ccdepth.uniform_level,) * 2 + (True,)]


def test_a_refusal_names_the_faces_that_are_the_cause_and_what_divides_the_others_less() -> None:
    holder, settings = scene.add_suzanne(), bpy.context.scene.ccdepth
    addon.compute(holder)
    record, depths = holder.data.ccdepth, addon.depths(holder)
    fitting = record.uniform_level - 2
    settings.max_faces = int(record.uniform_faces) // 4**2
    beyond = int((depths > fitting).sum())
    assert 0 < beyond < len(depths)
    cause = f"{beyond} faces need more than {fitting} levels: Apply Adaptive Subdivision divides the others less"
    refusal = f"the Face Limit is {settings.max_faces:,}; {cause}"
    refuses("set_levels", refusal)
    bpy.ops.ccdepth.count_faces()
    refuses("set_levels", f"{refusal}, and makes {known_count(holder).faces:,} faces")
    # What the button in the panel selects.
    assert bpy.ops.ccdepth.select(depth=fitting + 1, comparison="AT_LEAST") == {"FINISHED"}
    assert sum(face.select for face in holder.data.polygons) == beyond


def drive(modifier: bpy.types.Modifier) -> None:
    modifier.driver_add("render_levels").driver.expression = "1"


def key(modifier: bpy.types.Modifier) -> None:
    modifier.keyframe_insert("levels", frame=1)


def key_on_a_track(modifier: bpy.types.Modifier) -> None:
    key(modifier)
    animation = modifier.id_data.animation_data
    animation.nla_tracks.new().strips.new("Strip", 1, animation.action)
    animation.action = None


def key_in_a_meta_strip(modifier: bpy.types.Modifier) -> None:
    key_on_a_track(modifier)
    addon.select(modifier.id_data)
    [track] = modifier.id_data.animation_data.nla_tracks
    track.select = track.strips[0].select = True
    window = bpy.context.window_manager.windows[0]
    area = window.screen.areas[0]
    kind, area.type = area.type, "NLA_EDITOR"
    with bpy.context.temp_override(window=window, area=area, region=area.regions[-1]):
        assert bpy.ops.nla.meta_add() == {"FINISHED"}
    area.type = kind
    assert [strip.action for strip in track.strips] == [None]


@pytest.mark.parametrize(
    ("animate", "subject"),
    [
        (drive, "a driver sets"),
        (key, "keyframes set"),
        (key_on_a_track, "keyframes set"),
        (key_in_a_meta_strip, "keyframes set"),
    ],
)
def test_levels_that_animation_would_undo_are_refused(
    animate: Callable[[bpy.types.Modifier], None], subject: str
) -> None:
    holder, other = scene.add_object(meshes.cube()), scene.add_suzanne()
    animate(scene.add_subdivision(holder, 1))
    scene.animate(other, "location", {1: (0.0, 0.0, 0.0)})
    addon.compute(holder, other)
    refuses("set_levels", f"{subject} the levels", holder)
    addon.select(other)
    assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}


@pytest.mark.parametrize(("viewport", "render"), [(0, 6), (6, 1), (6, 6)])
def test_simplify_that_shows_less_is_told(viewport: int, render: int, capfd: pytest.CaptureFixture[str]) -> None:
    addon.compute(scene.add_suzanne(), tolerance=TOLERANCE / 10)
    settings = bpy.context.scene.render
    settings.use_simplify = True
    settings.simplify_subdivision, settings.simplify_subdivision_render = viewport, render
    assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
    # The status bar shows the last report.
    last = capfd.readouterr().out.splitlines()[-1]
    assert ("Warning: Simplify shows at most" in last) == (min(viewport, render) < 6)
