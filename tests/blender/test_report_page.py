# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of a report: what it says, that it loads nothing, and what a browser makes of it."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from tests import meshes
from tests.blender import addon, scene
from tests.blender.command_line_runs import CHECKOUT, run, save

picture = addon.module("command_line.picture")
report = addon.module("command_line.report")
report_reading = addon.module("command_line.report_reading")
report_page = addon.module("command_line.report_page")

LINE = ["--absolute", "--tolerance", "50mm", "--method", "certified"]

# What must come out as text, whatever it looks like.
NASTY = "<img src=\"http://other.test/a.png\"> & 'Cube'"

# What pictures begin with, in the page and as files.
IMAGE = "data:image/webp;base64," if picture.has_webp() else "data:image/png;base64,"
SIGNATURE = b"RIFF" if picture.has_webp() else b"\x89PNG"

VOID = {"meta", "img", "input"}

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture, "SAMPLES", 1)
    monkeypatch.setattr(picture, "SMALL", 0.2)


class Parsed(HTMLParser):
    """The elements of a page with their attributes, and its text; every element must be closed in its place."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attributes)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attributes)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] == "style":
            assert "url(" not in data
            assert "@import" not in data
        else:
            self.text += data

    def pictures(self) -> list[bytes]:
        sources = [attributes["src"] or "" for tag, attributes in self.elements if tag == "img"]
        return [b64decode(source.removeprefix(IMAGE), validate=True) for source in sources]


def parsed(text: str) -> Parsed:
    """A page, which must load nothing and run nothing."""
    result = Parsed(text)
    assert not {tag for tag, _ in result.elements} & {"script", "link", "iframe", "object", "embed", "base", "form"}
    for _, attributes in result.elements:
        assert not [name for name in attributes if name.startswith("on")]
        assert (attributes.get("src") or IMAGE).startswith(IMAGE)
        assert (attributes.get("href") or "#file-0").startswith("#file-")
    return result


def save_nasty(folder: Path) -> Path:
    scene.clear()
    scene.add_object(meshes.cube(), NASTY)
    other = scene.add_object(meshes.cube(), "Other")
    other.location.x = 5.0
    return save(folder / "cubes & <b>'bold'.blend")


@pytest.mark.parametrize("action", ["", "--subdivide", "--levels", "--measure"])
def test_a_page_has_all_that_was_found(tmp_path: Path, action: str) -> None:
    source, html = save_nasty(tmp_path), tmp_path / "report.html"
    writes = ["--output", tmp_path / "out.stl"] if action in ("--subdivide", "--levels") else []
    # A tolerance at which a cube is far from its limit surface itself.
    run(source, *LINE, *action.split(), *writes, "--html", html, "--json", tmp_path / "report.json")
    page = parsed(html.read_text(encoding="utf-8"))
    # A page that exists is not touched.
    written = html.read_bytes()
    assert run(source, *LINE, "--html", html) == 1
    assert html.read_bytes() == written
    [entry] = report_reading.read_report(tmp_path / "report.json").files
    for text in (NASTY, "cubes & <b>'bold'.blend", entry.source.sha256, "0.05"):
        assert text in page.text
    if entry.output is not None:
        assert entry.output.sha256 in page.text
    pictures = page.pictures()
    assert len(pictures) == 4
    assert all(each.startswith(SIGNATURE) for each in pictures)
    assert len(set(pictures)) == 4
    alts = {attributes["alt"] for tag, attributes in page.elements if tag == "img"}
    shown = [each.result or each.name for each in entry.objects]
    assert alts == {f"{look} of {name}" for look in ("Heat map", "Wireframe") for name in shown}
    words = {None: "Not measured", True: "Tolerance met", False: "Tolerance not met"}
    for each in entry.objects:
        assert words[each.met] in page.text
        for number in (each.result_faces, each.triangles):
            assert number is None or f"{number:,}" in page.text
        for distance in (each.measured.proved, each.measured.reached) if each.measured else (each.proved,):
            assert f"{distance!r} m" in page.text


def test_the_numbers_of_a_page_are_those_of_compute_depth(tmp_path: Path) -> None:
    scene.add_suzanne()
    source = save(tmp_path / "suzanne.blend")
    run(source, "--absolute", "--tolerance", "10mm", "--method", "sharp", "--html", tmp_path / "report.html")
    page = parsed((tmp_path / "report.html").read_text(encoding="utf-8"))
    bpy.ops.wm.open_mainfile(filepath=str(source))
    [suzanne] = [each for each in bpy.data.objects if each.type == "MESH"]
    addon.compute(suzanne, tolerance=0.01, method="SHARP")
    counts = addon.histogram(suzanne)
    assert len(counts) > 2
    for depth, faces in counts.items():
        assert f"{depth}{faces:,} ({faces / sum(counts.values()):.1%})" in page.text


@pytest.mark.skipif(bool(bpy.app.binary_path), reason="Blender is no module here")
def test_other_processes_make_the_same_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene.add_object(meshes.cube())
    save(tmp_path / "one.blend")
    monkeypatch.chdir(tmp_path)
    pages = []
    for jobs in ([], ["--jobs", "1"]):
        line = ["one.blend", "missing.obj", *LINE, *jobs, "--html", "report.html", "--overwrite"]
        assert run(*line, process=quick_program(tmp_path)) == 1
        pages.append((tmp_path / "report.html").read_text(encoding="utf-8"))
    # Pictures say how long they took.
    texts = [re.sub(r'src="[^"]*"', "", page) for page in pages]
    assert texts[0] == texts[1]
    page = parsed(pages[1])
    assert len(page.pictures()) == 2
    assert "there is no such file" in page.text
    assert "1 file failed" in page.text


def quick_program(folder: Path) -> list[str]:
    """The command line in another process, whose pictures are quick, where Blender is a module."""
    script = folder / "quick.py"
    script.write_text(
        f"import runpy, sys\nsys.path.insert(0, {str(CHECKOUT)!r})\n"
        "from ccdepth_addon.command_line import picture\npicture.SAMPLES = 1\n"
        f"runpy.run_path({str(CHECKOUT / 'scripts' / 'heat_map.py')!r})",
        encoding="utf-8",
    )
    return [sys.executable, str(script)]


def test_a_page_without_pictures_tells_of_failures(tmp_path: Path) -> None:
    settings = {"tolerance": 0.05}
    missed = report.ObjectEntry("Part", settings, 0.05, 6, measured=report.Distances(0.06, 0.04), met=False)
    stamp = report.FileStamp(Path("part.blend"), None, 1.0)
    error = "<script>alert(1)</script>\n\x1b[31m second"
    failed = report.FileEntry(replace(stamp, path=Path("bad <b>.blend")), error=error)
    whole = report.Report("measure", (report.FileEntry(stamp, (missed,)), failed))
    page = parsed(report_page.page(whole))
    for text in ("Tolerance not met", "Not met", "Failed", "<script>alert(1)</script>", "\\x1b[31m", "cannot be read"):
        assert text in page.text
    # In the table of files, and above what is told of the file.
    assert page.text.count("bad <b>.blend") == 2
    assert not page.pictures()


@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
def test_a_browser_shows_it(tmp_path: Path) -> None:
    html = tmp_path / "report & more.html"
    assert run(save_nasty(tmp_path), *LINE, "--html", html) == 0
    light = screenshot(html, tmp_path / "light.png", (1200, 900))
    dark = screenshot(html, tmp_path / "dark.png", (1200, 900), "--blink-settings=preferredColorScheme=0")
    narrow = screenshot(html, tmp_path / "narrow.png", (500, 900))
    # The corner is the page's background: light grey, nearly black.
    assert light[0, 0].min() > 0.9
    assert dark[0, 0].max() < 0.15
    for each in (light, dark, narrow):
        # Heat maps are the only colours of this strength; a depth of 3 or 4 is green.
        assert (each.max(axis=2) - each.min(axis=2) > 0.3).mean() > 0.01
        # Nothing is cut off at the right: the last columns are background down the page.
        assert np.ptp(each[:, -8:], axis=(0, 1)).max() < 0.05
    document = browser(tmp_path, "--dump-dom", html.as_uri()).stdout
    assert len(re.findall("<img ", document)) == 4
    assert NASTY in parsed(document.replace("<tbody></tbody>", "")).text


def screenshot(html: Path, path: Path, size: tuple[int, int], *options: str) -> NDArray[np.float32]:
    """(height, width, 3): what a browser shows of the top of a page, the top row first."""
    width, height = size
    browser(path.parent, f"--screenshot={path}", f"--window-size={width},{height}", *options, html.as_uri())
    image = bpy.data.images.load(str(path))
    pixels = np.empty(width * height * 4, dtype=np.float32)
    assert image.size[:] == size
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[::-1, :, :3]


def browser(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Chromium without a window, without a network and without anything that it knew before."""
    assert CHROMIUM is not None
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={folder / 'user'}"]
    command = [CHROMIUM, *options, "--host-resolver-rules=MAP * ~NOTFOUND", *arguments]
    return subprocess.run(command, timeout=120, capture_output=True, text=True, encoding="utf-8", check=True)
