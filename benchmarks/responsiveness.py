# SPDX-License-Identifier: GPL-3.0-or-later
"""The time that Blender's window stands still while the long operators run: the gaps between the ticks of a timer.

xvfb-run blender --factory-startup --python benchmarks/responsiveness.py -- [CASE…]

CASE: DEPTH (a million quads, Compute Depth), ADAPTIVE (126,000 quads to a million faces), CREASES (31,488 quads, a
tenth of their edges creased by up to 0.3, adaptive); all by default. The operators run as from their buttons, with
progress and Esc. The 3D view makes room for another editor first, as drawing a million faces takes seconds without a
graphics card.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np

from benchmarks.compute_depth import add_grid
from tests.blender import scene

SECONDS_BETWEEN_TICKS = 0.005
# The shortest gap that a person notices, in seconds.
NOTICEABLE = 0.2

SIDE = 1000


def subdivided_suzanne(levels: int) -> bpy.types.Object:
    """Suzanne after some levels, as an object of its own, active and selected."""
    base = scene.add_suzanne()
    scene.add_subdivision(base, levels)
    made = scene.add_object(scene.evaluated_mesh_data(base), "Base")
    bpy.data.objects.remove(base)
    bpy.context.view_layer.objects.active = made
    made.select_set(True)
    return made


def creased_suzanne() -> None:
    mesh = subdivided_suzanne(3).data
    generator = np.random.default_rng(1)
    creases = np.where(generator.random(len(mesh.edges)) < 0.1, 0.3 * generator.random(len(mesh.edges)), 0.0)
    mesh.attributes.new("crease_edge", "FLOAT", "EDGE").data.foreach_set("value", creases.astype(np.float32))


CASES: dict[str, tuple[Callable[[], object], Callable[[], set[str]]]] = {
    "DEPTH": (
        lambda: add_grid(SIDE, 0),
        lambda: bpy.ops.ccdepth.compute("INVOKE_DEFAULT", tolerance=1e-6, tolerance_mode="RELATIVE"),
    ),
    "ADAPTIVE": (
        lambda: subdivided_suzanne(4),
        lambda: bpy.ops.ccdepth.subdivide(
            "INVOKE_DEFAULT", tolerance=5.3e-6, tolerance_mode="RELATIVE", max_faces=10_000_000
        ),
    ),
    "CREASES": (
        creased_suzanne,
        lambda: bpy.ops.ccdepth.subdivide(
            "INVOKE_DEFAULT", tolerance=1e-4, tolerance_mode="RELATIVE", max_faces=10_000_000
        ),
    ),
}


class Watch:
    """Runs the cases one after the other, and notes when the timer ticks meanwhile."""

    def __init__(self, names: list[str]) -> None:
        self._waiting = names
        self._running = ""
        self._ticks: list[float] = []

    def tick(self) -> float:
        window = bpy.context.window_manager.windows[0]
        self._ticks.append(perf_counter())
        if self._running and not any(item.bl_idname.startswith("CCDEPTH") for item in window.modal_operators):
            self._report()
            self._running = ""
        elif not self._running:
            if not self._waiting:
                sys.stdout.flush()
                os._exit(0)
            self._start(window, self._waiting.pop(0))
        return SECONDS_BETWEEN_TICKS

    def _start(self, window: bpy.types.Window, name: str) -> None:
        bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes])
        prepare, run = CASES[name]
        area = max(window.screen.areas, key=lambda each: each.width * each.height)
        area.type = "TEXT_EDITOR"
        region = next(region for region in area.regions if region.type == "WINDOW")
        with bpy.context.temp_override(window=window, area=area, region=region):
            prepare()
            self._running, self._ticks = name, [perf_counter()]
            run()

    def _report(self) -> None:
        gaps = np.diff(self._ticks)
        longest = ", ".join(f"{gap:.2f}" for gap in np.sort(gaps)[:-4:-1])
        print(
            f"{self._running:<10}{gaps.sum():7.2f} s   longest gaps {longest} s   "
            f"{np.count_nonzero(gaps > NOTICEABLE)} over {NOTICEABLE} s",
            flush=True,
        )


def main(names: list[str]) -> None:
    if not hasattr(bpy.types.Scene, "ccdepth"):
        import ccdepth_addon

        ccdepth_addon.register()
    bpy.context.preferences.view.show_splash = False
    print(f"Blender {bpy.app.version_string}, numpy {np.__version__}")
    bpy.app.timers.register(Watch(names or list(CASES)).tick, first_interval=2.0, persistent=True)


main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
