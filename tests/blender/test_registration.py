# SPDX-License-Identifier: GPL-3.0-or-later
"""Unregistering takes everything back out of Blender, and registering again puts it there once."""

from __future__ import annotations

from importlib import import_module

import bpy
import pytest

from tests.blender import addon

HOLDERS = (bpy.types.Scene, bpy.types.Mesh, bpy.types.Object, bpy.types.View3DShading)
PACKAGE = bpy.types.CCDEPTH_OT_compute.__module__.rpartition(".operators.")[0]
MENUS = ("VIEW3D_MT_object", "VIEW3D_MT_edit_mesh")


def of_the_add_on() -> list[str]:
    """Handlers, by the names of their lists and their own, what menus draw, and classes."""
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    lists |= {menu: getattr(bpy.types, menu).draw._draw_funcs for menu in MENUS}
    return sorted(
        f"{name} {each.__module__}.{each.__name__}"
        for name, found in lists.items()
        if isinstance(found, list)
        for each in found
        if getattr(each, "__module__", "").startswith(f"{PACKAGE}.")
    ) + [name for name in dir(bpy.types) if name.startswith("CCDEPTH_")]


@pytest.mark.every_blender
def test_nothing_is_left_behind_and_everything_comes_back_once() -> None:
    package, before = import_module(PACKAGE), of_the_add_on()
    assert len(set(before)) == len(before) > 10
    assert all(sum(each.startswith(f"{menu} ") for each in before) == 1 for menu in MENUS)
    package.unregister()
    try:
        assert not of_the_add_on()
        assert not any(hasattr(holder, "ccdepth") for holder in HOLDERS)
    finally:
        package.register()
    assert of_the_add_on() == before


# Menus


# The manual's sections of buttons and settings.
SECTIONS = {
    "bpy.ops.ccdepth.compute": "compute-depth",
    "bpy.ops.ccdepth.subdivide": "adaptive-subdivision",
    "bpy.ops.ccdepth.before_after": "results",
    "bpy.types.scenesettings.relative_tolerance": "tolerance",
    "bpy.types.scenesettings.heat_map": "heat-map-and-legend",
}


def test_the_menu_has_every_operator_that_people_start() -> None:
    entries = [entry[0] for entry in addon.module("ui.menus").ENTRIES if entry is not None]
    assert len(set(entries)) == len(entries)
    hidden = {"update_kept", "use_tolerance", "tolerance_preset_add", "copy_value", "open_manual"}
    assert {name.partition(".")[2] for name in entries} == set(dir(bpy.ops.ccdepth)) - hidden
    labels = [getattr(bpy.ops.ccdepth, name.partition(".")[2]).get_rna_type().name for name in entries]
    assert any("Adaptive" in label for label in labels)
    assert any("Tolerance" in label for label in labels)


def test_tooltips_and_copies_of_values() -> None:
    operator = bpy.types.CCDEPTH_OT_copy_value
    properties = bpy.context.window_manager.operator_properties_last("ccdepth.copy_value")
    properties.meaning = "How many faces there are"
    assert operator.description(bpy.context, properties).startswith("How many faces there are.")
    assert bpy.ops.ccdepth.copy_value(value="5,800") == {"FINISHED"}


@pytest.mark.every_blender
def test_online_manual_of_a_button_is_our_own_and_has_every_section(monkeypatch: pytest.MonkeyPatch) -> None:
    manual, opened = addon.module("ui.manual"), []
    for button, section in SECTIONS.items():
        url = bpy.types.WM_OT_doc_view_manual._lookup_rna_url(button, verbose=False)
        assert url.startswith("file://")
        assert url.endswith(f"index.html#{section}")
    page = manual.PAGE.read_text(encoding="utf-8")
    assert all(f'id="{section}"' in page for _, section in manual.SECTIONS)
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert bpy.ops.ccdepth.open_manual() == {"FINISHED"}
    assert opened == [manual.PAGE.as_uri()]
    assert "manual of CC Depth" in bpy.ops.ccdepth.open_manual.get_rna_type().description
    # The preferences belong to the add-on.
    assert PACKAGE.removesuffix(".ccdepth_addon") == manual.CCDEPTH_AP_preferences.bl_idname
