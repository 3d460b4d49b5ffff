# SPDX-License-Identifier: GPL-3.0-or-later
"""CC Depth: how many Catmull-Clark levels each face needs, with a proof.

``core`` works without Blender, so nothing here imports Blender before registration.
"""

import tomllib
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

MANIFEST = Path(__file__).resolve().parent.parent / "blender_manifest.toml"

# The modules in the order of their dependencies.
MODULES = (
    "state.record",
    "state.watch",
    "operators",
    "ui.manual",
    "ui.tolerances",
    "ui.panels",
    "ui.adaptive_panel",
    "ui.levels_panel",
    "ui.deviation_panel",
    "command_line.command",
)

# The modules for a window.
WINDOW_MODULES = ("ui.overlay", "ui.legend")


@cache
def version() -> str:
    """The version of the extension, from its manifest alone."""
    return str(tomllib.loads(MANIFEST.read_text(encoding="utf-8"))["version"])


def _modules() -> list[ModuleType]:
    import bpy

    names = MODULES if bpy.app.background else (*MODULES, *WINDOW_MODULES)
    return [import_module(f".{name}", __package__) for name in names]


def register() -> None:
    """Register everything with Blender."""
    for module in _modules():
        module.register()


def unregister() -> None:
    """Take everything back out of Blender."""
    for module in reversed(_modules()):
        module.unregister()
