# SPDX-License-Identifier: GPL-3.0-or-later
"""README's numbers of faces are what a user gets."""

from __future__ import annotations

import re
from pathlib import Path

import bpy
import pytest

from tests.blender import addon, scene

README = Path(__file__).resolve().parent.parent.parent / "README.md"

# A part of her size, as README says.
TOLERANCE = 1e-3


@pytest.fixture(scope="module")
def numbers_of_faces() -> list[int]:
    """With subdivision levels, with CC Depth, in the picture of both, and with the limit surface, in README's order."""
    text = re.sub(r"\s+", " ", README.read_text(encoding="utf-8"))
    return [int(number.replace(",", "")) for number in re.findall(r"([\d,]+)(?: faces| with CC Depth)", text)]


def test_the_levels_it_compares_with_are_those_that_are_set(numbers_of_faces: list[int]) -> None:
    suzanne = scene.add_suzanne()
    for vertices, faces in (("CONTROL", numbers_of_faces[0]), ("LIMIT", numbers_of_faces[-1])):
        addon.compute(suzanne, tolerance=TOLERANCE, tolerance_mode="RELATIVE", vertices=vertices, method="CERTIFIED")
        # Of a triangle three quads are made first, of a quad four, and of each of these four at every later level.
        assert faces == len(suzanne.data.loops) * 4 ** (suzanne.data.ccdepth.uniform_level - 1)


def test_adaptive_subdivision_makes_as_many_as_it_says(numbers_of_faces: list[int]) -> None:
    addon.select(scene.add_suzanne())
    bpy.ops.ccdepth.subdivide(tolerance=TOLERANCE, tolerance_mode="RELATIVE", output="IN_PLACE")
    made = len(bpy.context.object.data.polygons)
    assert numbers_of_faces == [numbers_of_faces[0], made, numbers_of_faces[0], made, numbers_of_faces[-1]]
