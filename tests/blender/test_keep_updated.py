# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep Updated: results are made anew when edits of their sources leave Edit Mode, and at no other time.

Timers do not run without a window, so what they call is called here.
"""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.blender import addon
from tests.blender.subdividing import TOLERANCE, faces, shape
from tests.blender.updating import made_result, move_vertex, set_scene

pytestmark = pytest.mark.every_blender

Kept = tuple[bpy.types.Object, bpy.types.Object]


@pytest.fixture
def kept() -> Kept:
    """Suzanne, shown beside her result, which is kept updated."""
    source, result = made_result()
    source.hide_set(False)
    result.ccdepth.keep_updated = True
    bpy.context.view_layer.update()
    addon.select(source)
    return source, result


def due() -> list[bpy.types.Object]:
    """What is to be made anew once everything touched has been examined."""
    bpy.context.view_layer.update()
    sources = addon.module("state.sources")
    sources.check_touched()
    return sources.due_results()


def edit(*objects: bpy.types.Object, distance: float = 3.0) -> None:
    with addon.edit_mode(*objects):
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.transform.translate(value=(distance, 0.0, 0.0))
        assert not due()


def make_due() -> None:
    assert bpy.ops.ccdepth.update_kept() == {"FINISHED"}


def test_an_edit_is_followed(kept: Kept) -> None:
    source, result = kept
    edit(source)
    assert due() == [result]
    make_due()
    assert shape(result)[:, 0].max() > 3.0
    assert not due()
    assert bpy.context.view_layer.objects.active == source


def test_it_is_off_by_default() -> None:
    source, result = made_result()
    assert not result.ccdepth.keep_updated
    source.hide_set(False)
    edit(source)
    assert not due()
    assert not bpy.ops.ccdepth.update_kept.poll()


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
    make_due()
    assert abs(faces(result) - before) < 0.01 * before
    assert result.data.ccdepth.tolerance == pytest.approx(TOLERANCE)
    assert result.data.ccdepth.subdivision == "ADAPTIVE"
    assert bpy.context.scene.ccdepth.mode == "PER_FACE"


def test_results_with_other_settings_have_their_turn(kept: Kept) -> None:
    source, result = kept
    coarse = result.copy()
    coarse.data = result.data.copy()
    bpy.context.scene.collection.objects.link(coarse)
    addon.select(coarse)
    bpy.ops.ccdepth.update(tolerance=0.05, tolerance_mode="ABSOLUTE")
    edit(source)
    assert set(due()) == {result, coarse}
    make_due()
    make_due()
    assert not due()
    for each, tolerance in ((result, TOLERANCE), (coarse, 0.05)):
        assert shape(each)[:, 0].max() > 3.0
        assert addon.bounds(each).max() <= np.float32(tolerance)
    assert faces(coarse) < faces(result)


def test_a_result_that_was_edited_itself_is_left_alone(kept: Kept) -> None:
    source, result = kept
    move_vertex(result.data)
    edit(source)
    assert not due()


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
