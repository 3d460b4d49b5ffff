# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports go one way: command_line → operators → ui → state → tasks → exchange → core, which knows no Blender."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from ccdepth_addon import MODULES, WINDOW_MODULES

ADDON = Path(__file__).resolve().parent.parent / "ccdepth_addon"

# From the bottom to the top: each may import those before it.
LAYERS = ("core", "exchange", "tasks", "state", "ui", "operators", "command_line")

BLENDER = {"bl_math", "blf", "bmesh", "bpy", "bpy_extras", "gpu", "gpu_extras", "mathutils"}


def imports(path: Path) -> Iterator[tuple[int, str]]:
    """The modules a file imports: how many dots stand before the name, and the name. ``from . import x`` is x."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((0, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is None:
            yield from ((node.level, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.level, str(node.module)


def imported_from_the_addon(path: Path) -> Iterator[str]:
    """The add-on's modules a file imports, by their names below ``ccdepth_addon``."""
    package = path.relative_to(ADDON).parts[:-1]
    for level, name in imports(path):
        if level:
            yield ".".join([*package[: len(package) - level + 1], name])
        elif name.split(".")[0] == ADDON.name:
            yield name.partition(".")[2]


def is_allowed(layer: str, name: str) -> bool:
    """Whether a layer may import this module: not of a layer above it, and of the core only the public interface."""
    # ``from .. import version`` names no module.
    others = set() if layer == "core" else {"registration", "version"}
    is_public = layer == "core" or not name.startswith("core.")
    return is_public and name.split(".")[0] in {*LAYERS[: LAYERS.index(layer) + 1], *others}


def test_every_package_is_a_layer() -> None:
    assert {path.parent.name for path in ADDON.glob("*/__init__.py")} == set(LAYERS)


@pytest.mark.parametrize("layer", LAYERS)
def test_a_layer_imports_what_it_may(layer: str) -> None:
    files = sorted((ADDON / layer).rglob("*.py"))
    assert files
    names = [(path.relative_to(ADDON), name) for path in files for name in imported_from_the_addon(path)]
    assert not [f"{path}: {name}" for path, name in names if not is_allowed(layer, name)]


def test_the_core_imports_nothing_of_blender() -> None:
    found = [
        f"{path.relative_to(ADDON)}: {name}"
        for path in (ADDON / "core").rglob("*.py")
        for level, name in imports(path)
        if not level and name.split(".")[0] in BLENDER
    ]
    assert not found


def test_bounds_by_distance_stand_below_all_that_goes_by_them() -> None:
    files = [path for room in ("surface", "distance") for path in (ADDON / "core" / room).rglob("*.py")]
    above = ("core.adaptive", "core.depth", "core.reduction", "core.deviation")
    names = [(path.relative_to(ADDON), name) for path in files for name in imported_from_the_addon(path)]
    assert not [f"{path}: {name}" for path, name in names if name.startswith(above)]


def test_what_draws_in_a_window_is_imported_by_nothing_else() -> None:
    """So nothing of the graphics card is touched in the background."""
    files = [*ADDON.rglob("*.py")]
    drawing = {
        ".".join(path.relative_to(ADDON).with_suffix("").parts)
        for path in files
        if any(not level and name.split(".")[0] in {"blf", "gpu", "gpu_extras"} for level, name in imports(path))
    }
    assert drawing == {*WINDOW_MODULES}
    assert not drawing & {*MODULES}
    assert not drawing & {name for path in files for name in imported_from_the_addon(path)}


def test_settings_of_tools_are_read_from_the_scene() -> None:
    """In Blender 4.2 and 4.3 reading them from the context leaves it the scene as its owner. Opening another file frees
    that scene, and what then sets a property of the window, as the glTF writer does, writes into what was freed."""
    read = re.compile(r"\bcontext\.(tool_settings|layer_collection)\b")
    sources = [*ADDON.rglob("*.py"), *(ADDON.parent / "tests" / "blender").rglob("*.py")]
    assert [path.name for path in sources if read.search(path.read_text(encoding="utf-8"))] == []
