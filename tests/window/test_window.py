# SPDX-License-Identifier: GPL-3.0-or-later
"""A person presses the buttons: Blender's real window, the installed extension, and the mouse.

``CCDEPTH_BLENDER`` names the Blender to start and ``CCDEPTH_EXTENSION`` the built extension; without them there is
nothing to test. ``CCDEPTH_SCREENSHOT`` names a PNG file to keep what the window looks like at the end.
"""

import json
import os
import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.state.colors import RAMP_COLORS, depth_colors
from scripts.virtual_display import virtual_display

BLENDER = os.environ.get("CCDEPTH_BLENDER", "")
EXTENSION = os.environ.get("CCDEPTH_EXTENSION", "")
SCREENSHOT = os.environ.get("CCDEPTH_SCREENSHOT", "")

WIDTH, HEIGHT = 1440, 900
SECONDS_TO_START = 90.0
SECONDS_TO_ANSWER = 90.0
SECONDS_TO_BEGIN = 3.0
SECONDS_TO_SETTLE = 5.0
# It takes a minute at most, and then tells what it has.
SECONDS_TO_MEASURE = 90.0

INSIDE_BLENDER = Path(__file__).with_name("inside_blender.py")

# The mouse looks for buttons in steps of so many pixels; a button is 20 high.
SEARCH_STEP = 14

# The height at which each button was found last.
found_at: dict[str, int] = {}

pytestmark = pytest.mark.skipif(
    not (BLENDER and EXTENSION), reason="needs CCDEPTH_BLENDER and CCDEPTH_EXTENSION: a real Blender, and the built zip"
)

# How wide the strip is that the legend stands in, at the right of the viewport, and how far its colours may be off.
LEGEND_WIDTH = 180
COLOR_TOLERANCE = 7

# How far colours of faces may be off, which are lit, and encoded by the graphics card.
TRUE_COLOR_TOLERANCE = 5

# A place in the window of the file browser.
FILE_BROWSER = (600, 250)

# How high the status bar is, and how wide what it tells of a run may be.
STATUS_BAR, STATUS_WIDTH = 20, 300

Image = NDArray[np.int16]


@dataclass
class Window:
    """Blender's window on a display of its own."""

    display: str
    report_path: Path
    process: subprocess.Popen[bytes]

    def report(self) -> dict[str, Any]:
        """What Blender told last; empty before it has told anything."""
        return json.loads(self.report_path.read_text()) if self.report_path.exists() else {}

    def wait_for(self, condition: Callable[[dict[str, Any]], Any], seconds: float, what: str) -> dict[str, Any]:
        """The first report that meets the condition."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            assert self.process.poll() is None, "Blender ended by itself"
            report = self.report()
            if report and condition(report):
                return report
            time.sleep(0.1)
        raise AssertionError(f"waited {seconds:.0f} s in vain: {what}; the last report was {self.report()}")

    def move_mouse(self, x: int, y: int) -> None:
        self._run("xdotool", "mousemove", str(x), str(y))

    def nudge_mouse(self) -> None:
        """Move it by a pixel, and let Blender see that."""
        self._run("xdotool", "mousemove_relative", "1", "0")
        self.settle()

    def click(self) -> None:
        """Press and release as slowly as a hand does, and as Blender is: a faster click is not noticed."""
        self.settle()
        self._run("xdotool", "mousedown", "1")
        time.sleep(0.2)
        self.settle()
        self._run("xdotool", "mouseup", "1")

    def settle(self) -> None:
        """Wait until Blender has told twice: what it told first may be older than the mouse's last move."""
        for _ in range(2):
            before, until = self._told_at(), time.monotonic() + SECONDS_TO_SETTLE
            while self._told_at() == before and time.monotonic() < until:
                time.sleep(0.02)

    def _told_at(self) -> int:
        return self.report_path.stat().st_mtime_ns if self.report_path.exists() else 0

    def type_number(self, number: int) -> None:
        """Type it into the field under the mouse, in place of what is there."""
        self.click()
        for key in ("ctrl+a", *str(number), "Return"):
            time.sleep(0.2)
            self.press(key)

    def press(self, key: str) -> None:
        self._run("xdotool", "key", key)

    def ask(self, what: str, value: float | str) -> None:
        """Have the scene's relative tolerance changed, and results kept updated (``change``); or a state of the
        3D View, by its name (``state``)."""
        unfinished = self.report_path.with_suffix(".asked")
        unfinished.write_text(str(value))
        unfinished.replace(self.report_path.with_suffix(f".{what}"))

    def look(self, path: Path) -> Image:
        """(height, width, 3): a screenshot, which is also written to a PNG file."""
        self._run("import", "-window", "root", str(path))
        pixels = self._run("convert", str(path), "-depth", "8", "rgb:-")
        return np.frombuffer(pixels, dtype=np.uint8).reshape(HEIGHT, WIDTH, 3).astype(np.int16)

    def _run(self, *command: str) -> bytes:
        environment = {**os.environ, "DISPLAY": self.display}
        return subprocess.run(command, check=True, env=environment, stdout=subprocess.PIPE, timeout=60).stdout


@pytest.fixture(scope="module")
def resources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A user's folder with the extension installed."""
    for program in ("Xvfb", "xdotool", "import", "convert"):
        assert shutil.which(program), f"{program} is missing: install xvfb, xdotool and imagemagick"
    folder = tmp_path_factory.mktemp("resources")
    install = [BLENDER, "--command", "extension", "install-file", "-e", "-r", "user_default", EXTENSION]
    subprocess.run(install, check=True, env={**os.environ, "BLENDER_USER_RESOURCES": str(folder)}, timeout=120)
    return folder


@pytest.fixture
def window(request: pytest.FixtureRequest, resources: Path, tmp_path: Path) -> Iterator[Window]:
    """The window; a parameter says what the scene is to begin with, by the names of the variables for it."""
    settings = {f"CCDEPTH_WINDOW_{name}": value for name, value in getattr(request, "param", {}).items()}
    environment = {
        **os.environ,
        "BLENDER_USER_RESOURCES": str(resources),
        "CCDEPTH_WINDOW_REPORT": str(tmp_path / "report.json"),
        **settings,
        "LIBGL_ALWAYS_SOFTWARE": "1",
    }
    with virtual_display(WIDTH, HEIGHT) as display, (tmp_path / "blender.log").open("wb") as log:
        command = [BLENDER, "-p", "0", "0", str(WIDTH), str(HEIGHT), "--python", str(INSIDE_BLENDER)]
        process = subprocess.Popen(command, env={**environment, "DISPLAY": display}, stdout=log, stderr=log)
        try:
            yield Window(display, tmp_path / "report.json", process)
        finally:
            process.kill()
            process.wait(timeout=20)
            print((tmp_path / "blender.log").read_text(errors="replace")[-4000:])


def find_button(window: Window, sidebar: list[int], command: str, across: float = 0.6, *, press: bool = False) -> None:
    """Move the mouse down the sidebar, at this part of its width, until the button of that command is under it, or the
    field of that setting; and press it."""
    left, top, right, bottom = sidebar
    rows, last = range(top + SEARCH_STEP, bottom, SEARCH_STEP), found_at.get(command, top)
    # Where it was found before, it is mostly found again.
    for y in sorted(rows, key=lambda row: abs(row - last)):
        # Where two buttons share a row, the second is found as well.
        window.move_mouse(round(left + (right - left) * across), y)
        window.settle()
        if command in window.report()["hovered"]:
            found_at[command] = y
            if press:
                window.click()
            return
    raise AssertionError(f"there is no button for {command} in the sidebar")


def count_color(image: Image, color: tuple[float, ...]) -> int:
    """How many pixels have this sRGB colour, as near as the overlay's blending leaves it."""
    return int((np.abs(image - np.array(color) * 255).max(axis=2) <= COLOR_TOLERANCE).sum())


def colorful_part(image: Image) -> float:
    """The part of the pixels that are clearly not grey, however dark."""
    brightest = image.max(axis=2)
    return float((brightest - image.min(axis=2) > np.maximum(0.3 * brightest, 15)).mean())


def part_in_colors(image: Image, colors: Sequence[Sequence[float]]) -> float:
    """The part of the colourful pixels that have just these sRGB colours, and no lighter or darker ones."""
    brightest = image.max(axis=2)
    colorful = image[brightest - image.min(axis=2) > np.maximum(0.3 * brightest, 15)]
    differences = np.abs(colorful[:, None] - np.array(colors)[None] * 255).max(axis=2).min(axis=1)
    return float((differences <= TRUE_COLOR_TOLERANCE).mean())


def find_first(window: Window, command: str, across: float = 0.6, *, press: bool = False) -> dict[str, Any]:
    """Wait for the tab and put the mouse over that button, and press it; what Blender told at the beginning."""
    started = window.wait_for(lambda report: report["category"] == "CC Depth", SECONDS_TO_START, "the CC Depth tab")
    find_button(window, started["sidebar"], command, across, press=press)
    return started


def leave_sidebar(window: Window, started: dict[str, Any], seconds: float) -> None:
    """Put the mouse into the viewport, and let Blender draw."""
    window.move_mouse(started["viewport"][0] + 300, started["viewport"][1] + 300)
    time.sleep(seconds)
    window.settle()


@pytest.mark.parametrize("window", [{"TOLERANCE": "2e-4"}], indirect=True)
def test_a_click_on_compute_depth_shows_the_heat_map(window: Window, tmp_path: Path) -> None:
    started = find_first(window, "bpy.ops.ccdepth.compute")
    assert not started["has_result"]
    before = window.look(tmp_path / "before.png")

    window.click()
    report = window.wait_for(lambda report: report["has_result"], SECONDS_TO_ANSWER, "a result")
    time.sleep(1.0)
    # Where the bar was, a button is found when the mouse is moved.
    window.nudge_mouse()
    assert "bpy.ops.ccdepth.compute" in window.report()["hovered"], "the button has moved away from under the mouse"
    # The next button is there without scrolling.
    find_button(window, started["sidebar"], "bpy.ops.ccdepth.subdivide")
    leave_sidebar(window, started, 2.0)
    picture = Path(SCREENSHOT or tmp_path / "after.png")
    after = window.look(picture)

    assert report["attributes"] == {"ccdepth": ["INT", "FACE"], "ccdepth_bound": ["FLOAT", "FACE"]}
    depths, counts = np.unique(report["depths"], return_counts=True)
    assert report["rows"] == {str(depth): count for depth, count in zip(depths, counts, strict=True)}
    assert len(depths) > 3
    assert report["viewports"] == started["viewports"]

    left, top, right, bottom = report["viewport"]
    right = report["sidebar"][0]
    seen_before, seen = before[top:bottom, left:right], after[top:bottom, left:right]
    assert colorful_part(seen) > colorful_part(seen_before) + 0.05, "no heat map in the viewport"
    colors = depth_colors(depths)
    for depth, color in zip(depths, colors, strict=True):
        assert count_color(seen[:, -LEGEND_WIDTH:], color) > 200, f"no swatch of depth {depth} in the legend"
        assert count_color(seen_before[:, -LEGEND_WIDTH:], color) < 50
    # Faces are a little darker where they are turned away; the rest are edges, and the gizmo that navigates.
    lit = np.concatenate([shade * colors for shade in np.linspace(0.6, 1.0, 60)])
    assert part_in_colors(seen[:, :-LEGEND_WIDTH], lit) > 0.5

    window.ask("state", "cleared")
    cleared = window.wait_for(lambda report: not report["has_result"], SECONDS_TO_ANSWER, "the result gone")
    assert cleared["viewports"] == started["viewports"]
    leave_sidebar(window, started, 2.0)
    gone = window.look(tmp_path / "cleared.png")[top:bottom, left:right]
    assert colorful_part(gone) < colorful_part(seen_before) + 0.01


def test_a_click_on_measure_deviation_shows_a_heat_map_and_its_scale(window: Window, tmp_path: Path) -> None:
    started = find_first(window, "bpy.ops.ccdepth.measure")
    before = window.look(tmp_path / "before.png")

    window.click()
    report = window.wait_for(lambda report: report["deviation"][1] > 0, SECONDS_TO_MEASURE, "a measurement")
    leave_sidebar(window, started, 2.0)
    after = window.look(tmp_path / "after.png")

    assert report["deviation"][0] <= report["deviation"][1]
    assert report["attributes"] == {"ccdepth_deviation": ["FLOAT", "FACE"]}
    left, top, right, bottom = started["viewport"]
    right = started["sidebar"][0]
    seen_before, seen = before[top:bottom, left:right], after[top:bottom, left:right]
    assert colorful_part(seen) > colorful_part(seen_before) + 0.05, "no heat map in the viewport"
    for color in RAMP_COLORS[1:-1]:
        assert count_color(seen[:, -LEGEND_WIDTH:], tuple(color)) > 20, "not all colours of the scale are there"


@pytest.mark.parametrize("window", [{"TOLERANCE": "2e-4"}], indirect=True)
def test_the_heat_map_is_there_in_every_mode_and_gone_with_overlays(window: Window, tmp_path: Path) -> None:
    """And it comes back: nothing of the viewport's is needed for it."""
    started = find_first(window, "bpy.ops.ccdepth.compute", press=True)
    window.wait_for(lambda report: report["has_result"], SECONDS_TO_ANSWER, "a result")
    left, top, _, bottom = started["viewport"]

    def colorful(name: str) -> float:
        leave_sidebar(window, started, 2.0)
        seen = window.look(tmp_path / f"{name}.png")[top:bottom, left : started["sidebar"][0] - LEGEND_WIDTH]
        return colorful_part(seen)

    def comes(state: str, is_there: Callable[[float], bool]) -> bool:
        # A busy machine draws late, and shows less while Blender compiles shaders.
        return any(is_there(colorful(state)) for _ in range(15))

    shown = colorful("shown")
    for state, is_shown in (("hidden", False), ("shown", True), ("no overlays", False), ("overlays", True)):
        window.ask("state", state)
        assert comes(state, lambda part, is_shown=is_shown: (part > 0.9 * shown) == is_shown), state
    for state in ("material", "in front", "edit", "quad", "x-ray", "wireframe"):
        window.ask("state", state)
        # Half of it is enough, as Edit Mode and X-Ray show through; views of Quad View are smaller, and two of the four
        # are half behind the sidebar.
        least = (0.4 if state == "quad" else 0.5) * shown
        assert comes(state, lambda part, least=least: part > least), state
    window.ask("state", "none")
    assert comes("none", lambda part: part < 0.1 * shown)
    assert "Traceback" not in (tmp_path / "blender.log").read_text(errors="replace")


def test_a_click_on_apply_adaptive_subdivision_makes_an_object_and_undo_takes_it_back(
    window: Window, tmp_path: Path
) -> None:
    started = find_first(window, "bpy.ops.ccdepth.subdivide", press=True)
    made = window.wait_for(lambda report: len(report["objects"]) == 2, SECONDS_TO_ANSWER, "a second object")["objects"]
    original, result = made["Suzanne"], made["Suzanne Adaptive"]
    assert (original["visible"], original["selected"], original["attributes"]) == (False, False, [])
    assert (result["visible"], result["selected"]) == (True, True)
    assert set(result["attributes"]) == {"ccdepth", "ccdepth_bound"}
    assert result["faces"] > 2 * original["faces"]
    leave_sidebar(window, started, 2.0)
    left, top, _, bottom = started["viewport"]
    seen = window.look(tmp_path / "made.png")[top:bottom, left : started["sidebar"][0] - LEGEND_WIDTH]
    assert part_in_colors(seen, RAMP_COLORS[1:-1]) < 0.01, "a heat map hides the mesh"
    window.press("ctrl+z")
    undone = window.wait_for(lambda report: len(report["objects"]) == 1, SECONDS_TO_ANSWER, "the undoing")
    assert undone["objects"] == started["objects"]


def wait_for_object(window: Window, name: str, what: str, condition: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    """The first report on an object that meets the condition."""

    def is_met(report: dict[str, Any]) -> Any:
        return name in report["objects"] and condition(report["objects"][name])

    return window.wait_for(is_met, SECONDS_TO_ANSWER, what)["objects"][name]


def made_by_mouse(window: Window) -> dict[str, Any]:
    """Press Apply Adaptive Subdivision; what Blender told at the beginning."""
    started = find_first(window, "bpy.ops.ccdepth.subdivide", press=True)
    window.wait_for(lambda report: "Suzanne Adaptive" in report["objects"], SECONDS_TO_ANSWER, "a result")
    leave_sidebar(window, started, 1.0)
    return started


def test_update_result_stands_in_place_of_apply_makes_the_result_anew_and_is_undone(window: Window) -> None:
    started = made_by_mouse(window)
    with pytest.raises(AssertionError, match="no button"):
        find_button(window, started["sidebar"], "bpy.ops.ccdepth.subdivide")
    before = window.report()["objects"]
    window.ask("change", 0.0002)
    find_button(window, started["sidebar"], "bpy.ops.ccdepth.update(", press=True)
    faces = before["Suzanne Adaptive"]["faces"]
    updated = wait_for_object(window, "Suzanne Adaptive", "a finer result", lambda found: found["faces"] > 2 * faces)
    assert (updated["visible"], updated["selected"]) == (True, True)
    assert set(window.report()["objects"]) == set(before)
    leave_sidebar(window, started, 0.5)
    window.press("ctrl+z")
    wait_for_object(window, "Suzanne Adaptive", "the undoing", lambda found: found["faces"] == faces)


def test_a_source_is_shown_and_edited_and_its_result_follows(window: Window) -> None:
    started = made_by_mouse(window)
    window.ask("change", 0.001)
    find_button(window, started["sidebar"], "bpy.ops.ccdepth.before_after", press=True)
    wait_for_object(window, "Suzanne", "the source", lambda found: found["visible"] and found["selected"])
    hidden = wait_for_object(window, "Suzanne Adaptive", "it being hidden", lambda found: not found["visible"])
    time.sleep(1.0)
    window.nudge_mouse()
    assert "bpy.ops.ccdepth.before_after" in window.report()["hovered"], "the button has moved away"
    window.move_mouse(started["viewport"][0] + 300, started["viewport"][1] + 300)
    for key in ("Tab", "a", "g", "z", "3", "Return"):
        time.sleep(0.5)
        window.press(key)
    time.sleep(2.0)
    assert window.report()["objects"]["Suzanne Adaptive"]["top"] == hidden["top"], "not before Edit Mode is left"
    window.press("Tab")
    followed = wait_for_object(
        window, "Suzanne Adaptive", "it following", lambda found: found["top"] > hidden["top"] + 2
    )
    assert abs(followed["faces"] - hidden["faces"]) < 0.01 * hidden["faces"]
    assert window.report()["objects"]["Suzanne"]["mode"] == "OBJECT"

    find_button(window, started["sidebar"], "bpy.ops.ccdepth.before_after", press=True)
    wait_for_object(window, "Suzanne Adaptive", "the result", lambda found: found["visible"] and found["selected"])


@pytest.mark.parametrize("window", [{"TOLERANCE": "1e-4", "FACE_LIMIT": "20000"}], indirect=True)
def test_a_click_on_find_tolerance_after_a_refusal_sets_one_that_fits(window: Window) -> None:
    started = find_first(window, "bpy.ops.ccdepth.subdivide", press=True)
    # Until the refusal there is no such button, and its message is in the way of the mouse.
    time.sleep(SECONDS_TO_BEGIN)
    window.wait_for(lambda report: not report["running"], SECONDS_TO_ANSWER, "the refusal")
    window.press("Escape")
    time.sleep(1.0)
    find_button(window, started["sidebar"], "face_budget=20000", across=0.75, press=True)
    # Than 1e-4: one that 20,000 faces are enough for.
    offered = window.wait_for(lambda report: report["tolerance"] > 1.1e-4, SECONDS_TO_ANSWER, "a coarser tolerance")
    assert offered["objects"] == started["objects"]

    find_button(window, started["sidebar"], "bpy.ops.ccdepth.subdivide", press=True)
    made = wait_for_object(window, "Suzanne Adaptive", "a result", lambda found: found["visible"])
    assert 5_000 < made["faces"] <= 20_000


@pytest.mark.parametrize("window", [{"TOLERANCE": "1e-4"}], indirect=True)
def test_find_tolerance_sets_the_tolerance_for_a_number_of_faces_that_was_typed(window: Window) -> None:
    started = find_first(window, ".face_budget")
    window.type_number(9000)
    window.wait_for(lambda report: report["face_budget"] == 9000, SECONDS_TO_ANSWER, "the number of faces")
    find_button(window, started["sidebar"], "bpy.ops.ccdepth.find_tolerance(", across=0.83, press=True)
    found = window.wait_for(lambda report: report["tolerance"] > 2e-4, SECONDS_TO_ANSWER, "a coarser tolerance")
    assert found["objects"] == started["objects"]

    # The row that tells how many faces there will be.
    find_button(window, started["sidebar"], "How many faces Apply Adaptive Subdivision makes", across=0.52)
    told = re.search(r'value="([\d,]+) faces"', window.report()["hovered"])
    assert told is not None
    faces = int(told[1].replace(",", ""))
    assert 4_500 < faces <= 9_000

    find_button(window, started["sidebar"], "bpy.ops.ccdepth.subdivide", press=True)
    made = wait_for_object(window, "Suzanne Adaptive", "a result", lambda found: found["visible"])
    assert made["faces"] == faces


def status_bar(image: Image) -> Image:
    """The part of it that tells of a run."""
    return image[-STATUS_BAR:, :STATUS_WIDTH]


@pytest.mark.parametrize("window", [{"TOLERANCE": "2e-6"}], indirect=True)
def test_escape_stops_a_long_run_that_shows_how_far_it_is_and_nothing_is_changed(
    window: Window, tmp_path: Path
) -> None:
    started = find_first(window, "bpy.ops.ccdepth.subdivide")
    before = window.look(tmp_path / "before.png")
    window.click()
    window.wait_for(lambda report: "CCDEPTH_OT_subdivide" in report["running"], SECONDS_TO_ANSWER, "work in steps")
    until = time.monotonic() + SECONDS_TO_ANSWER
    while np.array_equal(status_bar(window.look(tmp_path / "running.png")), status_bar(before)):
        assert time.monotonic() < until, "nothing in the status bar"
    window.press("Escape")
    stopped = window.wait_for(lambda report: not report["running"], SECONDS_TO_ANSWER, "the end of it")
    assert stopped["objects"] == started["objects"]
    time.sleep(1.0)
    ended = window.look(tmp_path / "ended.png")
    assert np.abs(status_bar(ended) - status_bar(before)).max() < COLOR_TOLERANCE


@pytest.mark.parametrize("window", [{"TOLERANCE": "2e-6"}], indirect=True)
def test_during_a_run_its_button_has_cancel_and_no_other_button_works(window: Window) -> None:
    started = find_first(window, "bpy.ops.ccdepth.subdivide", press=True)
    assert started["can_measure"]
    window.wait_for(lambda report: "CCDEPTH_OT_subdivide" in report["running"], SECONDS_TO_ANSWER, "work in steps")
    assert not window.wait_for(lambda report: report["running"], SECONDS_TO_BEGIN, "the run")["can_measure"]
    find_button(window, started["sidebar"], "bpy.ops.ccdepth.cancel", across=0.83, press=True)
    stopped = window.wait_for(lambda report: not report["running"], SECONDS_TO_ANSWER, "the end of it")
    assert (stopped["objects"], stopped["can_measure"]) == (started["objects"], True)


@pytest.mark.parametrize("window", [{"TOLERANCE": "2e-6"}], indirect=True)
def test_a_run_ends_with_the_window_that_it_was_started_in(window: Window) -> None:
    started = find_first(window, "bpy.ops.ccdepth.compute")
    window.ask("state", "run in second window")
    window.wait_for(lambda report: not report["can_measure"], SECONDS_TO_ANSWER, "the run")
    window.ask("state", "second window closed")
    ended = window.wait_for(lambda report: report["can_measure"], SECONDS_TO_ANSWER, "the end of it")
    assert (ended["objects"], ended["running"]) == (started["objects"], [])
    assert "Traceback" not in window.report_path.with_name("blender.log").read_text(errors="replace")


@pytest.mark.parametrize("window", [{"TOLERANCE": "2e-6"}], indirect=True)
def test_a_file_can_be_saved_while_a_run_goes_on_and_a_deleted_object_ends_it(window: Window) -> None:
    started = find_first(window, "bpy.ops.ccdepth.subdivide")
    saved = window.report_path.with_suffix(".blend")
    window.ask("state", "saved")
    window.wait_for(lambda _: saved.exists(), SECONDS_TO_ANSWER, "the file")
    before = saved.stat().st_mtime_ns
    window.click()
    window.wait_for(lambda report: "CCDEPTH_OT_subdivide" in report["running"], SECONDS_TO_ANSWER, "work in steps")
    leave_sidebar(window, started, 0.5)
    window.press("ctrl+s")
    going_on = window.wait_for(lambda _: saved.stat().st_mtime_ns > before, SECONDS_TO_ANSWER, "the saving")
    assert going_on["running"] == ["CCDEPTH_OT_subdivide"]
    window.ask("state", "deleted")
    window.wait_for(lambda report: not report["running"], SECONDS_TO_BEGIN, "the end of it")


def export_by_mouse(window: Window, started: dict[str, Any]) -> None:
    """Press Export Within Tolerance, and accept the name in the file browser, a window of its own."""
    find_button(window, started["sidebar"], "bpy.ops.ccdepth.export_within", press=True)
    window.wait_for(lambda report: report["running"] == ["CCDEPTH_OT_export_within"], SECONDS_TO_ANSWER, "file browser")
    time.sleep(SECONDS_TO_BEGIN)
    # Without a window manager, keys go to the window under the mouse.
    window.move_mouse(*FILE_BROWSER)
    time.sleep(0.5)
    window.press("Return")


def test_a_file_is_exported_and_measured_and_the_scene_stays_and_escape_leaves_the_old_file(
    window: Window, tmp_path: Path
) -> None:
    started = find_first(window, "bpy.ops.ccdepth.export_within")
    saved, path = window.report_path.with_suffix(".blend"), tmp_path / "Suzanne.stl"
    window.ask("state", "saved")
    window.wait_for(lambda _: saved.exists(), SECONDS_TO_ANSWER, "the saved file, whose folder is the first choice")
    export_by_mouse(window, started)
    window.wait_for(lambda _: path.exists(), SECONDS_TO_ANSWER, "the exported file")
    ended = window.wait_for(lambda report: not report["running"], SECONDS_TO_ANSWER, "the end of it")
    assert ended["objects"] == started["objects"]
    content = path.read_bytes()
    triangles = int.from_bytes(content[80:84], "little")
    assert len(content) == 84 + 50 * triangles
    told = (tmp_path / "blender.log").read_text(errors="replace")
    assert f"Suzanne.stl: {triangles:,} triangles, at most " in told
    assert "m from the surface (measured in the file)" in told

    files = sorted(each.name for each in tmp_path.iterdir() if each.suffix != ".unfinished")
    window.ask("change", 2e-6)
    window.wait_for(lambda report: report["tolerance"] < 1e-5, SECONDS_TO_ANSWER, "a finer tolerance")
    export_by_mouse(window, started)
    time.sleep(SECONDS_TO_BEGIN)
    assert window.report()["running"] == ["CCDEPTH_OT_export_within"]
    window.move_mouse(started["viewport"][0] + 300, started["viewport"][1] + 300)
    window.press("Escape")
    stopped = window.wait_for(lambda report: not report["running"], SECONDS_TO_ANSWER, "the end of it")
    assert stopped["objects"] == started["objects"]
    assert path.read_bytes() == content
    assert sorted(each.name for each in tmp_path.iterdir() if each.suffix != ".unfinished") == files


@pytest.mark.parametrize("window", [{"LAST_FRAME": "2000"}], indirect=True)
def test_escape_stops_a_run_over_frames_and_the_scene_is_as_it_was(window: Window) -> None:
    started = find_first(window, "bpy.ops.ccdepth.compute", press=True)
    away = window.wait_for(lambda report: report["frame"] != started["frame"], SECONDS_TO_ANSWER, "another frame")
    assert away["running"] == ["CCDEPTH_OT_compute"]
    assert away["objects"] != started["objects"], "nothing moves"
    window.press("Escape")
    stopped = window.wait_for(lambda report: not report["running"], SECONDS_TO_ANSWER, "the end of it")
    assert (stopped["frame"], stopped["objects"]) == (started["frame"], started["objects"])
    assert (stopped["has_result"], stopped["viewports"]) == (False, started["viewports"])
    time.sleep(2.0)
    later = window.report()
    assert {**later, "hovered": ""} == {**stopped, "hovered": ""}, "something goes on"
