# SPDX-License-Identifier: GPL-3.0-or-later
"""Unregistering takes everything back out of Blender, and registering again puts it there once."""

from __future__ import annotations

from importlib import import_module

import bpy

HOLDERS = (bpy.types.Scene, bpy.types.Mesh, bpy.types.Object, bpy.types.View3DShading)


def handlers(package: str) -> list[tuple[str, str]]:
    """The add-on's handlers, by the names of their lists and their own."""
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    return [
        (name, f"{handler.__module__}.{handler.__name__}")
        for name, found in lists.items()
        if isinstance(found, list)
        for handler in found
        if getattr(handler, "__module__", "").startswith(f"{package}.")
    ]


def classes() -> set[str]:
    return {name for name in dir(bpy.types) if name.startswith("CCDEPTH_")}


def test_nothing_is_left_behind_and_everything_comes_back_once() -> None:
    name = bpy.types.CCDEPTH_OT_compute.__module__.rpartition(".operators.")[0]
    package = import_module(name)
    before = sorted(handlers(name)), classes()
    assert len(set(before[0])) == len(before[0]) > 10
    package.unregister()
    try:
        assert not handlers(name)
        assert not classes()
        assert not any(hasattr(holder, "ccdepth") for holder in HOLDERS)
    finally:
        package.register()
    assert (sorted(handlers(name)), classes()) == before
