# SPDX-License-Identifier: GPL-3.0-or-later
"""CC Depth: how many Catmull-Clark levels each face needs, with a proof.

``core`` works without Blender, so nothing here imports Blender before it is asked to register.
"""

from importlib import import_module
from types import ModuleType

VERSION = "0.1.0"

# In the order in which they depend on each other.
MODULES = (
    "properties",
    "operators",
    "subdivision_operators",
    "measure_operators",
    "staleness",
    "face_counts",
    "panels",
    "deviation_panel",
    "legend",
    "command_line",
)


def _modules() -> list[ModuleType]:
    return [import_module(f".{name}", __package__) for name in MODULES]


def register() -> None:
    """Register everything with Blender."""
    for module in _modules():
        module.register()


def unregister() -> None:
    """Take everything back out of Blender."""
    for module in reversed(_modules()):
        module.unregister()
