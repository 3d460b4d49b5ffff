# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail of Suzanne in three.js, rendered by Chromium at both sides of each switch distance: how many pixels
outlines differ by.

    npm install three
    python benchmarks/lod_pixels.py node_modules/three [PICTURE.png]

For each level, from directions all around: whether THREE.LOD shows the level before just in front of the switch
distance, and the level just behind; and with the nearest point where the level is said to be under a pixel, the largest
distance between its outline and those of the level before and of the finest. A level is within a pixel of the limit
surface there, the level before within a quarter, and LOD0 within a 4th, a 16th and so on. A render has 8 × 8 pixels for
each of the view, so an outline is off by √2/8 pixels at most.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tests.farm.files import blender

CHECKOUT = Path(__file__).resolve().parent.parent

VIEW = {"angle": 50, "height": 240, "finer": 8, "directions": 12}

TYPES = {".js": "text/javascript", ".html": "text/html", ".glb": "model/gltf-binary"}

SECONDS = 300


class Exchange(BaseHTTPRequestHandler):
    """What the page is given, and what it answers. answers: by their names; is_done: once all are there."""

    def __init__(self, three: Path, model: Path, answers: dict[str, bytes], is_done: Event, *given: object) -> None:
        self.places = {"/three": three, "/examples": CHECKOUT / "examples", "/model.glb": model}
        self.answers, self.is_done = answers, is_done
        super().__init__(*given)

    def do_GET(self) -> None:
        if self.path == "/settings":
            return self._send(json.dumps(VIEW).encode(), "application/json")
        place = next((name for name in self.places if self.path.startswith(name)), None)
        page = CHECKOUT / "benchmarks" / "lod_pixels.html"
        file = page if place is None else Path(f"{self.places[place]}{self.path.removeprefix(place)}")
        return self._send(file.read_bytes(), TYPES[file.suffix])

    def do_POST(self) -> None:
        self.answers[self.path.strip("/")] = self.rfile.read(int(self.headers["Content-Length"]))
        self._send(b"", "text/plain")
        if "rows" in self.answers:
            self.is_done.set()

    def _send(self, content: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Say nothing of each request."""


def rendered(three: Path, model: Path, folder: Path) -> dict[str, bytes]:
    """What the page answers about a model."""
    answers: dict[str, bytes] = {}
    is_done = Event()
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Exchange, three, model, answers, is_done))
    Thread(target=server.serve_forever, daemon=True).start()
    chromium = shutil.which("chromium") or shutil.which("google-chrome") or "chromium"
    options = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    line = [chromium, *options, f"--user-data-dir={folder / 'browser'}", f"http://127.0.0.1:{server.server_port}/"]
    with (folder / "browser.log").open("wb") as log:
        browser = subprocess.Popen([*line, "--enable-logging=stderr"], stdout=log, stderr=log)
    try:
        if not is_done.wait(SECONDS):
            raise TimeoutError((folder / "browser.log").read_text(errors="replace")[-3000:])
    finally:
        browser.terminate()
        browser.wait()
        server.shutdown()
    return answers


def main(three: Path, picture: Path | None) -> None:
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        model = folder / "suzanne.glb"
        view = ["--view-angle", str(VIEW["angle"]), "--view-height", str(VIEW["height"])]
        line = ["--lods", "3", "--tolerance", "0.1%", "--shading-angle", "0", *view, "--output", str(model)]
        subprocess.run([str(blender(folder)), "-b", "--command", "ccdepth", *line], capture_output=True, check=True)
        answers = rendered(three, model, folder)
    if picture is not None:
        picture.write_bytes(answers["picture"])
    print(f"{'':<6}{'pixel from':>12}{'switch at':>12}{'switches':>10}{'to level before':>17}{'to LOD0':>10}")
    for row in json.loads(answers["rows"]):
        lengths = f"{row['pixelFrom']:>10.2f} m{row['distance']:>10.2f} m"
        pixels = f"{row['toBefore']:>14.2f} px{row['toFinest']:>7.2f} px"
        print(f"LOD{row['number']:<3}{lengths}{'yes' if row['switches'] else 'NO':>10}{pixels}")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]) if len(sys.argv) > 2 else None)
