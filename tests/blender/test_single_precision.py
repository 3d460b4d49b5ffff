# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's single precision against the law (``rounding.modifier_rounding``): two thirds of it are never exceeded."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from benchmarks.single_precision import MOST, SHAPES, random_offsets, ratios
from tests import meshes
from tests.blender import addon, scene
from tests.blender.measuring import BlenderLevels
from tests.brute_force import Levels
from tests.thorough import each

pytestmark = pytest.mark.every_blender


def placed(data: meshes.MeshData, stretch: float) -> bpy.types.Object:
    """An object of it, turned under a parent that is stretched."""
    child, parent = scene.add_object(data), scene.add_object(meshes.cube())
    child.matrix_basis = Euler((0, 0, np.pi / 4)).to_matrix().to_4x4()
    parent.matrix_basis = Matrix.Diagonal((stretch, 1, 1, 1))
    child.parent = parent
    bpy.context.view_layer.update()
    return child


@pytest.mark.parametrize("stretch", each((1.0, 20.0, 100.0, 1e4), short=(20.0, 100.0)))
@pytest.mark.parametrize("offset", each(((300, 300, 300), (300, -300, 10)), short=[(300, 300, 300)]))
def test_sheared_objects(offset: tuple[float, float, float], stretch: float) -> None:
    """The scene may take away most of the coordinates that Blender rounds."""
    data = meshes.single_precision(meshes.moved(scene.suzanne(), *offset))
    shown = BlenderLevels(data, "ALL")
    exact = Levels(shown.subdivided(0))
    control = addon.module("exchange.control_mesh").read_control_mesh(
        bpy.context, placed(data, stretch), use_modifiers=False
    )
    law = addon.module("core.bounds.rounding").modifier_rounding
    for level in (1, 2):
        off = (shown.shown(level) - exact.mesh(level).positions) @ control.world.T
        assert np.linalg.norm(off, axis=1).max() <= MOST * law(control.in_world, level)


# In the short suite the worst that were found.
CASES = each(
    [(name, size, level) for name in SHAPES for size in (3, 5, 23, 40, 48, 61, 96) for level in (1, 2)],
    short=[("prism", 48, 1), ("prism", 40, 1), ("fan", 96, 2), ("bipyramid", 61, 2), ("wheel", 23, 1)],
)


@pytest.mark.parametrize("case", CASES)
def test_errors_are_at_most_two_thirds_of_the_law(case: tuple[str, int, int]) -> None:
    name, size, level = case
    found = ratios(SHAPES[name](size), level, random_offsets(6, seed=size))
    assert max(found.values()) <= MOST
