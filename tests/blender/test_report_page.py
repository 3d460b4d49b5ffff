# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of a report: what it says, that it loads nothing, and what a browser makes of it; and the picture of a heat
map, as a file of its own."""

import re
import shutil
import subprocess
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.runs import LINE, run, save
from tests.blender.subdividing import subdivide

picture = addon.module("command_line.picture")
report = addon.module("command_line.report")
report_reading = addon.module("command_line.report_reading")
report_page = addon.module("command_line.report_page")

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
    """The elements of a page with their attributes, and its text; every element must be closed in its place, and load
    nothing and run nothing."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        found = dict(attributes)
        assert tag not in {"script", "link", "iframe", "object", "embed", "base", "form"}
        assert not [name for name in found if name.startswith("on")]
        assert (found.get("src") or IMAGE).startswith(IMAGE)
        assert (found.get("href") or "#file-0").startswith("#file-")
        self.elements.append((tag, found))
        if tag not in VOID:
            self._open.append(tag)

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


def save_nasty(folder: Path) -> Path:
    scene.clear()
    scene.add_object(meshes.cube(), NASTY)
    other = scene.add_object(meshes.cube(), "Other")
    other.location.x = 5.0
    other.scale.z = 2.0
    return save(folder / "cubes & <b>'bold'.blend")


@pytest.mark.parametrize("action", ["", "--subdivide", "--levels", "--measure"])
def test_a_page_has_all_that_was_found(tmp_path: Path, action: str) -> None:
    source, html = save_nasty(tmp_path), tmp_path / "report.html"
    writes = ["--output", tmp_path / "out.stl"] if action in ("--subdivide", "--levels") else []
    # A tolerance at which a cube is far from its limit surface itself.
    run(source, *LINE, *action.split(), *writes, "--html", html, "--json", tmp_path / "report.json")
    page = Parsed(html.read_text(encoding="utf-8"))
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


def test_a_page_without_pictures_tells_of_failures(tmp_path: Path) -> None:
    settings = {"tolerance": 0.05}
    missed = report.ObjectEntry("Part", settings, 0.05, 6, measured=report.Distances(0.06, 0.04), met=False)
    stamp = report.FileStamp(Path("part.blend"), None, 1.0)
    error = "<script>alert(1)</script>\n\x1b[31m second"
    failed = report.FileEntry(replace(stamp, path=Path("bad <b>.blend")), error=error)
    whole = report.Report("measure", (report.FileEntry(stamp, (missed,), lost=("UV maps",)), failed))
    page = Parsed(report_page.page(whole))
    texts = ("Tolerance not met", "Not met", "1 file failed", "Failed", "<script>alert(1)</script>", "\\x1b[31m")
    for text in (*texts, "cannot be read", "UV maps"):
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
    assert NASTY in Parsed(document.replace("<tbody></tbody>", "")).text


def screenshot(html: Path, path: Path, size: tuple[int, int], *options: str) -> NDArray[np.float32]:
    """(height, width, 3): what a browser shows of the top of a page, the top row first."""
    browser(path.parent, f"--screenshot={path}", f"--window-size={size[0]},{size[1]}", *options, html.as_uri())
    return pixels_of(path, size)


def pixels_of(path: Path, size: tuple[int, int]) -> NDArray[np.float32]:
    """(height, width, 3): the sRGB colours of a picture of this width and height, the top row first."""
    image = bpy.data.images.load(str(path))
    assert image.size[:] == size
    pixels = np.array(image.pixels[:], dtype=np.float32)
    bpy.data.images.remove(image)
    return pixels.reshape(*size[::-1], 4)[::-1, :, :3]


def browser(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Chromium without a window, without a network and without anything that it knew before."""
    assert CHROMIUM is not None
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={folder / 'user'}"]
    command = [CHROMIUM, *options, "--host-resolver-rules=MAP * ~NOTFOUND", *arguments]
    return subprocess.run(command, timeout=120, capture_output=True, text=True, encoding="utf-8", check=True)


materials = addon.module("command_line.picture")
colors = addon.module("state.colors")

# Between a face in the light and one turned away from it.
SHADES = np.linspace(materials.SHADOW, 1.0, 21)


def render(path: Path, holder: bpy.types.Object, size: float = 1.0) -> NDArray[np.float32]:
    """(height, width, 3): the sRGB colours of a picture, the top row first."""
    picture.render(bpy.context, [holder], path, size=size)
    return pixels_of(path, (round(size * picture.WIDTH), round(size * picture.HEIGHT)))


def colorful(pixels: NDArray[np.float32]) -> NDArray[np.bool_]:
    return pixels.max(axis=2) - pixels.min(axis=2) > 0.2


@pytest.mark.every_blender
def test_the_file_of_a_picture_stays_as_it_is(tmp_path: Path) -> None:
    suzanne = scene.add_suzanne()
    suzanne.modifiers.new("Mirror", "MIRROR")
    scene.add_subdivision(suzanne, 1)
    addon.compute(suzanne, tolerance=0.01)
    engine = bpy.context.scene.render.engine
    with snapshot.unchanged():
        assert colorful(render(tmp_path / "picture.png", suzanne)).any()
    assert bpy.context.scene.render.engine == engine


def test_faces_have_the_hues_of_their_depths(tmp_path: Path) -> None:
    cube = scene.add_object(meshes.cube())
    addon.compute(cube, tolerance=0.01)
    objects = render(tmp_path / "picture.png", cube)
    [depth] = addon.histogram(cube)
    [color] = colors.depth_colors([depth])
    seen = objects[colorful(objects)]
    assert len(seen) > 0.05 * objects.shape[0] * objects.shape[1]
    linear = colors.to_linear
    shades = linear(seen.astype(np.float64)) / linear(color)
    # Every face is evenly darkened, by no more than the shading may take.
    assert np.median(np.ptp(shades, axis=1)) < 0.02
    assert np.quantile(shades, 0.02) > materials.SHADOW - 0.02
    assert np.quantile(shades, 0.98) < 1.02


def test_an_adaptive_mesh_has_the_colours_of_its_distances(tmp_path: Path) -> None:
    [result] = subdivide(scene.add_object(meshes.cube()), tolerance=0.2)
    objects = render(tmp_path / "picture.png", result)
    bounds = addon.bounds(result).astype(np.float64)
    lit = colors.to_linear(colors.scale_colors(bounds / result.data.ccdepth.world_tolerance))
    shades = (lit[:, None] * SHADES[:, None]).reshape(-1, 3)
    seen = colors.to_linear(objects[colorful(objects)].astype(np.float64))[::200]
    nearest = np.abs(seen[:, None] - shades[None]).max(axis=2).min(axis=1)
    assert len(seen) > 100
    assert np.quantile(nearest, 0.9) < 0.02


def test_all_objects_are_in_the_picture_whatever_their_size(tmp_path: Path) -> None:
    size = 0.5
    for scale in (1e-4, 1.0, 1e4):
        cube = scene.add_object(meshes.cube())
        cube.scale = (scale, scale, scale)
        cube.location = (1e3 * scale, 0.0, 0.0)
        addon.compute(cube, tolerance=0.01 * scale)
        shown = colorful(render(tmp_path / "picture.png", cube, size))
        rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
        # Edges may stand out by a pixel or two.
        assert rows[-1] <= size * (picture.HEIGHT - picture.MARGIN) + 2
        assert columns[0] >= size * picture.MARGIN - 2
        assert np.ptp(rows) > size * picture.HEIGHT / 2


@pytest.mark.every_blender
@pytest.mark.parametrize("folder", ["", "{blend_name}"])
def test_its_name_is_taken_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str) -> None:
    """In a new file, which has no folder either. Braces are variables in the output of Blender 5."""
    (tmp_path / folder).mkdir(exist_ok=True)
    monkeypatch.chdir(tmp_path)
    holder = scene.add_object(meshes.cube())
    addon.compute(holder)
    path = Path(folder) / "picture.png"
    picture.render(bpy.context, [holder], path, size=picture.SMALL)
    assert [each for each in Path().rglob("*") if each.is_file()] == [path]


def test_one_face_of_many_is_not_told_as_none_on_the_page() -> None:
    histogram = addon.module("command_line.report_page")._histogram
    assert "&lt; 0.1 %" in histogram([(1, 125_000), (2, 1)])
