# SPDX-License-Identifier: GPL-3.0-or-later
"""Unregistering takes everything back out of Blender, and registering again puts it there once."""

from __future__ import annotations

from importlib import import_module

import bpy
import pytest

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
