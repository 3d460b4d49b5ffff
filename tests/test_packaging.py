# SPDX-License-Identifier: GPL-3.0-or-later
"""What the extension is packed from, and, where ``CCDEPTH_EXTENSION`` names a built one, what is in it."""

import os
import re
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest

import ccdepth_addon

CHECKOUT = Path(__file__).resolve().parent.parent
EXTENSION = os.environ.get("CCDEPTH_EXTENSION", "")

PACKED = {"LICENSE", "__init__.py", "blender_manifest.toml", "ccdepth_addon"}

# What Blender leaves out when a manifest says nothing.
DEFAULT_PATTERNS = {"__pycache__/", ".*", "/*.zip"}


@pytest.fixture(scope="module")
def manifest() -> dict[str, Any]:
    return tomllib.loads((CHECKOUT / "blender_manifest.toml").read_text(encoding="utf-8"))


def test_the_manifest_says_what_the_extension_platform_asks_for(manifest: dict[str, Any]) -> None:
    assert manifest["schema_version"] == "1.0.0"
    assert manifest["id"] == "ccdepth"
    assert manifest["type"] == "add-on"
    assert manifest["blender_version_min"] == "4.2.0"
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert "Blender" not in manifest["name"]
    for text in (manifest["tagline"], *manifest["permissions"].values()):
        assert len(text) <= 64
        assert not text.endswith(".")


def test_the_version_stands_in_the_manifest_alone(manifest: dict[str, Any]) -> None:
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert "version" not in project
    assert ccdepth_addon.version() == manifest["version"]
    assert f"## {manifest['version']}" in (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_nothing_but_the_add_on_is_packed(manifest: dict[str, Any]) -> None:
    patterns = manifest["build"]["paths_exclude_pattern"]
    assert set(patterns) >= DEFAULT_PATTERNS
    packed = {
        path.name
        for path in CHECKOUT.iterdir()
        if not any(fnmatch(path.name, pattern.strip("/")) for pattern in patterns)
    }
    assert packed == PACKED


@pytest.mark.parametrize("script", ["api_docs.py", "manual_page.py"])
def test_pages_that_are_made_are_those_that_their_sources_make(script: str) -> None:
    """The page about the core is made from its docstrings, and the manual from its own source."""
    subprocess.run([sys.executable, f"scripts/{script}", "--check"], cwd=CHECKOUT, check=True, timeout=60)


def test_the_manual_has_its_pictures_and_links() -> None:
    folder = CHECKOUT / "ccdepth_addon" / "manual"
    page = (folder / "index.html").read_text(encoding="utf-8")
    pictures = re.findall(r'src="([^"]+)"', page)
    assert sorted(pictures) == sorted(path.name for path in folder.glob("*.[jp]*g"))
    assert not re.search(r"\*\*|\]\(|`", page)


def test_the_door_imports_nothing() -> None:
    program = (
        "import sys; from importlib import import_module; door = import_module(sys.argv[1]);"
        "assert callable(door.register) and callable(door.unregister);"
        "found = {name.partition('.')[2] for name in sys.modules if name.startswith(sys.argv[1] + '.')};"
        "assert not found and 'bpy' not in sys.modules and 'numpy' not in sys.modules, found"
    )
    subprocess.run([sys.executable, "-c", program, CHECKOUT.name], cwd=CHECKOUT.parent, check=True, timeout=60)


@pytest.mark.skipif(not EXTENSION, reason="needs CCDEPTH_EXTENSION: the built zip")
def test_the_built_extension_holds_the_add_on_and_nothing_else() -> None:
    folder = CHECKOUT / "ccdepth_addon"
    files = {path.relative_to(CHECKOUT).as_posix() for path in (*folder.rglob("*.py"), *(folder / "manual").iterdir())}
    with ZipFile(EXTENSION) as packed:
        assert {name for name in packed.namelist() if not name.endswith("/")} == files | PACKED - {"ccdepth_addon"}
