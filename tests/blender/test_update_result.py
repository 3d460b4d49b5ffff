# SPDX-License-Identifier: GPL-3.0-or-later
"""Update Result: results are made anew from the objects they came from, and keep everything but their mesh.

test_staleness tests when results are out of date. Timers, which keep results updated, do not run without a window, so
what they call is called here.
"""

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.subdividing import TOLERANCE, faces, refused, refuses, shape, subdivide
from tests.blender.updating import made_result, move_vertex, set_scene, stale_line, update

pytestmark = pytest.mark.every_blender

FINER = {"tolerance": TOLERANCE / 4, "tolerance_mode": "ABSOLUTE"}


def linked_copy(holder: bpy.types.Object, into: bpy.types.Scene | None = None) -> bpy.types.Object:
    """Another object with the same mesh, in a scene."""
    copy = holder.copy()
    (into or bpy.context.scene).collection.objects.link(copy)
    return copy


def move_to_another_scene(holder: bpy.types.Object) -> None:
    bpy.data.scenes.new("Other").collection.objects.link(holder)
    bpy.context.scene.collection.objects.unlink(holder)


@pytest.mark.parametrize(
    "settings",
    [
        {"tolerance": 0.003, "mode": "PER_FACE"},
        {"relative_tolerance": 0.002, "tolerance_mode": "RELATIVE", "exact_normals": True},
        {"reduce": True, "tolerance": 0.05},
    ],
)
def test_it_is_what_applying_anew_would_make(settings: dict[str, object]) -> None:
    source, result = made_result()
    set_scene(**settings)
    update(result)
    assert set(bpy.data.objects) == {source, result}
    assert len(bpy.data.meshes) == 2
    now = bpy.context.scene.ccdepth
    tolerance = now.relative_tolerance if now.tolerance_mode == "RELATIVE" else now.tolerance
    [anew] = subdivide(source, tolerance=tolerance, tolerance_mode=now.tolerance_mode)
    assert np.array_equal(shape(anew), shape(result))
    assert addon.histogram(anew) == addon.histogram(result)
    assert anew.data.has_custom_normals == result.data.has_custom_normals


def test_everything_but_the_mesh_stays() -> None:
    source, result = made_result()
    source.data.materials.append(bpy.data.materials.new("Of the source"))
    update(result)
    parent = scene.add("Parent")
    scene.add_collection("Results", result, alone=True)
    result.parent, result.name, result.data.name = parent, "Hero", "Hero Mesh"
    result.location, result.rotation_euler, result.scale = (1, 2, 3), (0.1, 0.2, 0.3), (0.5, 0.5, 0.5)
    result.modifiers.new("Solidify", "SOLIDIFY").thickness = 0.25
    result.constraints.new("COPY_LOCATION").target = parent
    result.data.materials[0] = bpy.data.materials.new("Of the result")
    result["note"] = "kept"
    addon.select(result)
    with snapshot.unchanged(lambda path: path[:2] == ("meshes", "Hero Mesh") and path[2] != "materials"):
        update(result, **FINER)
    assert bpy.data.objects["Hero"] == result


def test_materials_of_the_source_come_along_where_the_result_has_none_of_its_own() -> None:
    source = scene.add_object(meshes.cube())
    first, second, own, late = (bpy.data.materials.new(name) for name in ("First", "Second", "Own", "Late"))
    source.data.materials.append(first)
    source.data.materials.append(first)
    [result] = subdivide(source)
    result.data.materials[1] = own
    source.data.materials[0] = second
    source.data.materials.append(late)
    update(result)
    assert list(result.data.materials) == [second, own, late]
    for _ in range(2):
        source.data.materials.pop()
    update(result)
    assert list(result.data.materials) == [second, own]
    # One more than the source ever had.
    result.data.materials.append(late)
    update(result)
    assert list(result.data.materials) == [second, own, late]
    # What the object itself has in its slots stays.
    source, result = made_result()
    source.data.materials.append(first)
    update(result)
    result.material_slots[0].link, result.material_slots[0].material = "OBJECT", own
    source.data.materials.clear()
    update(result)
    assert [(slot.link, slot.material) for slot in result.material_slots] == [("OBJECT", own)]


def test_an_edited_result_is_kept_beside_the_new_one() -> None:
    """Also where colours were painted on it."""
    _, result = made_result()
    name = result.data.name
    move_vertex(result.data, 5.0)
    edited = shape(result)
    update(result)
    assert result.data.name == name
    assert shape(result)[:, 0].max() < 2.0
    painted = result.data.color_attributes.new("Painted", "FLOAT_COLOR", "POINT")
    painted.data[3].color = (1.0, 0.0, 0.0, 1.0)
    update(result)
    moved, colored = (mesh for mesh in bpy.data.meshes if mesh.use_fake_user)
    assert [moved.name, colored.name] == [f"Edited {name}", f"Edited {name}.001"]
    assert moved.vertices[0].co.x == pytest.approx(edited[0, 0])
    assert tuple(colored.color_attributes["Painted"].data[3].color) == (1.0, 0.0, 0.0, 1.0)


def test_shape_keys_of_the_source_come_along() -> None:
    source, result = made_result()
    scene.add_key(source, "Smile", 0.5)
    update(result)
    assert [key.name for key in result.data.shape_keys.key_blocks] == ["Basis", "Smile"]
    refuses("update", "shape keys", reduce=True)


def test_several_results_and_a_duplicate_of_one_are_updated_together() -> None:
    sources = [scene.add_object(meshes.cube(), "One"), scene.add_object(meshes.landscape(4, 4), "Two")]
    one, two = subdivide(*sources, tolerance=0.1)
    copy = linked_copy(one)
    copy.data = one.data.copy()
    before = faces(one), faces(two)
    update(copy, two, tolerance=0.03, tolerance_mode="ABSOLUTE")
    assert faces(copy) > faces(one) == before[0]
    assert faces(two) > before[1]
    assert [each.ccdepth.source for each in (copy, two)] == sources


def test_linked_duplicates_go_on_sharing_the_mesh_unless_their_scales_differ() -> None:
    """Whichever is updated, they are all within the tolerance."""
    _, result = made_result()
    duplicate = linked_copy(result)
    for chosen, scale, count in ((duplicate, (1.0, 1.0, 1.0), 2), (result, (4.0, 0.25, 1.0), 3)):
        duplicate.scale = scale
        update(chosen)
        assert (len(bpy.data.meshes), result.data == duplicate.data) == (count, count == 2)
        for each in (result, duplicate):
            assert addon.bounds(each).max() <= np.float32(TOLERANCE)
            assert stale_line(each) == ""


def test_nothing_is_claimed_of_objects_of_other_scales_that_share_the_mesh() -> None:
    """Neither of one that is no result, nor of one whose scale Blender does not know here."""
    _, result = made_result()
    plain, elsewhere = scene.add_mesh(result.data), linked_copy(result, bpy.data.scenes.new("Other"))
    plain.scale = elsewhere.scale = (10.0, 10.0, 10.0)
    update(result)
    assert result.data == plain.data == elsewhere.data
    assert len(bpy.data.meshes) == 2
    assert stale_line(result) == ""
    assert stale_line(plain) == "Not computed for this object"


def test_what_is_in_edit_mode_goes_on_being_edited() -> None:
    source, result = made_result()
    before = faces(result)
    with addon.edit_mode(result):
        assert bpy.ops.ccdepth.update(**FINER) == {"FINISHED"}
        assert result.mode == "EDIT"
    assert faces(result) > before
    source.hide_set(False)
    source.modifiers.new("Mirror", "MIRROR")
    with addon.edit_mode(source):
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.transform.translate(value=(3.0, 0.0, 0.0))
        assert bpy.ops.ccdepth.update() == {"FINISHED"}
        assert (bpy.context.mode, source.mode) == ("EDIT_MESH", "EDIT")
    assert shape(result)[:, 0].max() > 3.0
    assert shape(result)[:, 0].min() < -3.0


def test_a_source_in_another_scene_can_be_read() -> None:
    source, result = made_result()
    move_to_another_scene(source)
    source.modifiers.new("Mirror", "MIRROR").use_axis = (False, True, False)
    source.hide_viewport = True
    update(result, **FINER)
    assert result.data.ccdepth.base_faces == 12


def test_a_result_of_unknown_size_is_left_alone_though_another_one_refers_to_it() -> None:
    """Blender counts what a shown object refers to as evaluated, but computes no place for it."""
    source, result = made_result()
    subdivide(result, subdivide_results=True)
    scene.add_collection("Off", result, alone=True)
    bpy.context.view_layer.layer_collection.children["Off"].exclude = True
    source.hide_set(False)
    refuses("update", "none of its results is shown here", source)


def test_a_deleted_source_is_in_the_file_as_long_as_its_result_is() -> None:
    source, result = made_result()
    source.hide_set(False)
    addon.select(source)
    bpy.ops.object.delete()
    assert not result.ccdepth.source.users_scene
    before = faces(result)
    update(result, **FINER)
    assert faces(result) > before
    refuses("before_after", "it is not in this view layer", result)


def test_without_results_there_is_nothing_to_update() -> None:
    source = scene.add_object(meshes.cube())
    addon.select(source)
    assert not bpy.ops.ccdepth.update.poll()
    subdivide(source, output="IN_PLACE")
    assert not bpy.ops.ccdepth.update.poll()
    assert not bpy.ops.ccdepth.before_after.poll()
    # What was subdivided in place is not subdivided again without asking.
    refused(source, match="subdivided in place already")
    before = faces(source)
    subdivide(source, tolerance=TOLERANCE / 10, output="IN_PLACE", subdivide_results=True)
    assert faces(source) > before


def become_a_curve(source: bpy.types.Object, _result: bpy.types.Object) -> None:
    # Faces would keep it from becoming one.
    source.data.clear_geometry()
    source.data.from_pydata([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [(0, 1)], [])
    addon.select(source)
    bpy.ops.object.convert(target="CURVE")


# What becomes of a source and its result, which of them is selected then, settings, and what Update Result says.
Change = Callable[[bpy.types.Object, bpy.types.Object], object]
REFUSALS: tuple[tuple[Change, str, dict[str, object], str], ...] = (
    (lambda source, _: bpy.data.objects.remove(source), "Cage Adaptive", {}, "source of the result has been removed"),
    (become_a_curve, "Cage Adaptive", {}, "its source “Cage” is not a mesh any more"),
    (lambda source, _: subdivide(source, output="IN_PLACE"), "Cage Adaptive", {}, "was subdivided in place since"),
    (lambda source, result: setattr(source, "data", result.data), "Cage Adaptive", {}, "has the same mesh"),
    (lambda *_: None, "Cage Adaptive", {**FINER, "tolerance": 1e-6, "max_faces": 10_000}, "10,000 are allowed"),
    (lambda *_: None, "Cage Adaptive", {"tolerance": -1.0}, "greater than zero"),
    # Blender does not tell how large it is there.
    (lambda _, result: move_to_another_scene(result), "Cage", {}, "none of its results is shown here"),
)  # fmt: skip


@pytest.mark.parametrize(("change", "chosen", "settings", "match"), REFUSALS)
def test_what_cannot_be_updated_is_told(change: Change, chosen: str, settings: dict[str, object], match: str) -> None:
    source, result = made_result()
    source.hide_set(False)
    change(source, result)
    refuses("update", match, bpy.data.objects[chosen], **settings)
    if "been removed" in match:
        refuses("before_after", "removed from the file")


def test_modifiers_count_once() -> None:
    """A result keeps modifiers that were not counted in, and lacks those that were."""
    set_scene(tolerance=0.1)
    source = scene.add_object(meshes.landscape(3, 3), "Cage")
    source.modifiers.new("Mirror", "MIRROR")
    [with_it] = subdivide(source, tolerance=0.1)
    [without] = subdivide(source, tolerance=0.1, use_modifiers=False)
    refuses("update", "“Mirror” of “Cage” is included now, and the result has it as well")
    refuses("update", "“Mirror” of “Cage” was included and is not any more", with_it, use_modifiers=False)
    update(with_it)
    update(without, use_modifiers=False)
    source.modifiers.new("Bevel", "BEVEL")
    update(with_it)


def test_no_sculpting_is_lost_with_a_mesh(capfd: pytest.CaptureFixture[str]) -> None:
    """A Multiresolution modifier keeps it on the object's own mesh."""
    source = scene.add_object(meshes.cube(), "Cage")
    addon.select(source)
    add_levels(source)
    refused(source, match="sculpting .* would be lost; turn Include", output="IN_PLACE", use_modifiers=False)
    [result] = subdivide(source, use_modifiers=False)
    assert "Cage: its Multiresolution modifier is not included" in capfd.readouterr().out
    assert (len(source.modifiers), len(result.modifiers)) == (1, 0)
    add_levels(result)
    refuses("update", "sculpting .* would be lost; apply or remove", result)
    result.modifiers.clear()
    update(result)
    subdivide(source, output="IN_PLACE")


def add_levels(holder: bpy.types.Object) -> None:
    """Give the active object a Multiresolution modifier that can be sculpted."""
    bpy.ops.object.multires_subdivide(modifier=holder.modifiers.new("Sculpted", "MULTIRES").name)


def test_a_linked_result_is_refused_and_an_appended_one_brings_its_source(tmp_path: Path) -> None:
    made_result()
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.ops.wm.append(directory=f"{path}/Object/", filename="Cage Adaptive")
    result = bpy.data.objects["Cage Adaptive"]
    assert result.ccdepth.source.library is None
    before = faces(result)
    update(result, **FINER)
    assert faces(result) > before
    linked = scene.link(Path(path), "Cage Adaptive")
    bpy.context.scene.collection.objects.link(linked)
    refuses("update", "linked from another file", linked)


def test_a_result_is_not_subdivided_without_asking() -> None:
    _, result = made_result()
    refused(result, match="Update Result to make it anew")
    refused(result, output="IN_PLACE", match="made from “Cage”; use Update Result")
    [again] = subdivide(result, subdivide_results=True)
    assert again.ccdepth.source == result
    assert again.data.ccdepth.base_faces == faces(result)
    update(again)
    result.hide_set(False)
    refuses("update", "is a result as well; update the source first", result, again)
    # What is subdivided in place has no source any more.
    subdivide(again, output="IN_PLACE", subdivide_results=True)
    assert again.ccdepth.source is None
    assert not bpy.ops.ccdepth.update.poll()


def visible(*objects: bpy.types.Object) -> list[tuple[bool, bool, bool]]:
    """Whether each is seen, rendered and selected."""
    return [(each.visible_get(), not each.hide_render, each.select_get()) for each in objects]


SHOWN, HIDDEN = (True, True, True), (False, False, False)


def test_source_and_result_are_swapped_and_swapped_back() -> None:
    """In Object Mode alone."""
    source, result = made_result()
    with addon.edit_mode(result):
        assert not bpy.ops.ccdepth.before_after.poll()
    assert visible(source, result) == [HIDDEN, SHOWN]
    for active, seen in ((source, [SHOWN, HIDDEN]), (result, [HIDDEN, SHOWN])):
        assert bpy.ops.ccdepth.before_after() == {"FINISHED"}
        assert visible(source, result) == seen
        assert bpy.context.view_layer.objects.active == active
    # Removed results are no longer offered.
    bpy.data.objects.remove(result)
    source.hide_set(False)
    addon.select(source)
    assert not bpy.ops.ccdepth.before_after.poll()
    assert not bpy.ops.ccdepth.update.poll()


def test_what_is_not_rendered_stays_so() -> None:
    """Also where other results of the source are rendered, and where objects were shown by hand in between."""
    source = scene.add_object(meshes.cube(), "Cage")
    source.hide_render = True
    [result] = subdivide(source)
    bpy.ops.object.duplicate()
    other = bpy.context.view_layer.objects.active
    other.hide_render = False
    addon.select(result, other)
    for _ in range(2):
        assert bpy.ops.ccdepth.before_after() == {"FINISHED"}
        assert [each.hide_render for each in (source, result, other)] == [True, True, True]
        other.hide_set(False)
        addon.finish("before_after", other)
        assert [each.hide_render for each in (source, result, other)] == [True, True, True]
        addon.finish("before_after", source)
        assert [each.hide_render for each in (source, result, other)] == [True, True, False]


def test_several_are_swapped_together() -> None:
    """And duplicates that the user made of results."""
    sources = [scene.add_object(meshes.cube(), "One"), scene.add_object(meshes.cube(), "Two")]
    results = subdivide(*sources)
    lamp = scene.add_light()
    lamp.select_set(True)
    bpy.context.view_layer.objects.active = results[1]
    assert bpy.ops.ccdepth.before_after() == {"FINISHED"}
    assert visible(*sources, *results, lamp) == [SHOWN, SHOWN, HIDDEN, HIDDEN, SHOWN]
    assert bpy.context.view_layer.objects.active == sources[1]
    addon.finish("before_after", sources[0])
    bpy.ops.object.duplicate()
    copy = bpy.context.view_layer.objects.active
    addon.finish("before_after", results[0], copy)
    addon.finish("before_after")
    assert visible(sources[0], results[0], copy) == [HIDDEN, SHOWN, SHOWN]


@pytest.mark.parametrize("message", ["is not in this view layer", "in a hidden collection"])
def test_a_source_that_cannot_be_shown_is_told(message: str) -> None:
    source, _ = made_result()
    if "layer" in message:
        move_to_another_scene(source)
    else:
        scene.add_collection("Cages", source, alone=True).hide_viewport = True
    refuses("before_after", message)


Kept = tuple[bpy.types.Object, bpy.types.Object]


@pytest.fixture
def kept() -> Kept:
    """A cage, shown beside its result, which is kept updated; by default it is not."""
    source, result = made_result()
    source.hide_set(False)
    edit(source, distance=0.1)
    assert not due()
    assert not bpy.ops.ccdepth.update_kept.poll()
    update(result)
    result.ccdepth.keep_updated = True
    addon.select(source)
    return source, result


def due() -> list[bpy.types.Object]:
    """What is to be made anew once everything touched has been examined."""
    addon.examine_touched()
    return addon.module("state.out_of_date").due_results()


def edit(*objects: bpy.types.Object, distance: float = 3.0) -> None:
    with addon.edit_mode(*objects):
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.transform.translate(value=(distance, 0.0, 0.0))
        assert not due()


def test_an_edit_is_followed_unless_the_result_was_edited_itself(kept: Kept) -> None:
    source, result = kept
    edit(source)
    assert due() == [result]
    assert bpy.ops.ccdepth.update_kept() == {"FINISHED"}
    assert shape(result)[:, 0].max() > 3.0
    assert not due()
    assert bpy.context.view_layer.objects.active == source
    # The mesh is edited on another object.
    edit(linked_copy(source))
    assert due() == [result]
    # So may the result, while it waits.
    move_vertex(result.data)
    edited = result.data
    assert bpy.ops.ccdepth.update_kept() == {"CANCELLED"}
    assert result.data == edited
    edit(source)
    assert not due()


def test_nothing_else_is_followed(kept: Kept) -> None:
    """Edit Mode without edits, changes outside of it, and undo."""
    source, _ = kept
    with addon.edit_mode(source):
        pass
    assert not due()
    move_vertex(source.data)
    source.modifiers.new("Mirror", "MIRROR")
    assert not due()
    bpy.ops.ed.undo_push(message="before")
    edit(source)
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert not due()


def test_it_is_made_with_its_own_settings(kept: Kept) -> None:
    source, result = kept
    set_scene(tolerance=TOLERANCE / 10, mode="PER_FACE", exact_normals=True)
    before = faces(result)
    edit(source)
    assert due()
    assert bpy.ops.ccdepth.update_kept() == {"FINISHED"}
    assert abs(faces(result) - before) < 0.01 * before
    assert result.data.ccdepth.tolerance == pytest.approx(TOLERANCE)
    assert result.data.ccdepth.subdivision == "ADAPTIVE"
    assert bpy.context.scene.ccdepth.mode == "PER_FACE"


def test_results_are_made_with_the_settings_of_each(kept: Kept) -> None:
    source, result = kept
    coarse = linked_copy(result)
    coarse.data = result.data.copy()
    update(coarse, tolerance=0.05)
    edit(source)
    assert set(due()) == {result, coarse}
    assert bpy.ops.ccdepth.update_kept() == {"FINISHED"}
    assert not due()
    for each, tolerance in ((result, TOLERANCE), (coarse, 0.05)):
        assert shape(each)[:, 0].max() > 3.0
        assert addon.bounds(each).max() <= np.float32(tolerance)
    assert faces(coarse) < faces(result)


def test_a_result_of_a_result_follows(kept: Kept) -> None:
    source, result = kept
    [again] = subdivide(result, subdivide_results=True)
    again.ccdepth.keep_updated = True
    edit(source)
    for expected in (result, again):
        assert due() == [expected]
        assert bpy.ops.ccdepth.update_kept() == {"FINISHED"}
    assert not due()
    assert shape(again)[:, 0].max() > 3.0


def test_what_fails_is_not_tried_again(kept: Kept) -> None:
    source, result = kept
    set_scene(max_faces=10)
    edit(source)
    assert due() == [result]
    before = faces(result)
    # It warns and does not raise: nobody has pressed a button.
    assert bpy.ops.ccdepth.update_kept() == {"CANCELLED"}
    assert faces(result) == before
    assert not due()


def test_a_source_that_was_renamed_and_deleted_is_named_by_no_old_name() -> None:
    source, result = made_result()
    source.name = "Renamed"
    bpy.data.objects.remove(source)
    addon.select(result)
    assert not bpy.ops.ccdepth.update.poll()
    refuses("before_after", "its source has been removed", result)
    refuses("measure", "its source has been removed", result)
