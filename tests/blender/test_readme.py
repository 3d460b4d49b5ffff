# SPDX-License-Identifier: GPL-3.0-or-later
"""README's numbers of faces are what a user gets."""

from __future__ import annotations

import re
from pathlib import Path

import bpy

from tests.blender import addon, scene

README = Path(__file__).resolve().parent.parent.parent / "README.md"

# A part of her size, as README says.
TOLERANCE = 1e-3


def test_numbers_of_faces_are_what_is_made() -> None:
    """With subdivision levels, with CC Depth, in the picture of both, and with the limit surface, in README's order."""
    text = re.sub(r"\s+", " ", README.read_text(encoding="utf-8"))
    found = re.findall(r"([\d,]+)(?: faces| with CC Depth)", text)
    suzanne = scene.add_suzanne()
    uniform = []
    for vertices in ("CONTROL", "LIMIT"):
        addon.compute(suzanne, tolerance=TOLERANCE, tolerance_mode="RELATIVE", vertices=vertices, method="CERTIFIED")
        # Of a triangle three quads are made first, of a quad four, and of each of these four at every later level.
        uniform.append(len(suzanne.data.loops) * 4 ** (suzanne.data.ccdepth.uniform_level - 1))
    bpy.ops.ccdepth.subdivide(tolerance=TOLERANCE, tolerance_mode="RELATIVE", output="IN_PLACE")
    made = len(bpy.context.object.data.polygons)
    assert [int(number.replace(",", "")) for number in found] == [uniform[0], made, uniform[0], made, uniform[1]]
