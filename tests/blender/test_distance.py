# SPDX-License-Identifier: GPL-3.0-or-later
"""What depths by distance take Blender to draw; the method as it is chosen and stored, and that it is the default."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.blender import addon, scene

pytestmark = pytest.mark.every_blender

# Triangles that are looked for.
SOME = 1000

MESHES: dict[str, Callable[[], bpy.types.Object]] = {
    "landscape": lambda: scene.add_object(meshes.landscape(5, 4, 3)),
    "hexagons": lambda: scene.add_object(meshes.hexagons(3, 3, 0.2)),
    "suzanne": scene.add_suzanne,
}


def middles_of_drawn(holder: bpy.types.Object, level: int) -> FloatArray:
    """(T, 3): of the triangles that Blender draws with its modifier at a level."""
    scene.add_subdivision(holder, level).use_limit_surface = False
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    middles = scene.mesh_data(mesh).positions[scene.triangles_of(mesh)].mean(axis=1)
    evaluated.to_mesh_clear()
    holder.modifiers.clear()
    return middles


@pytest.mark.parametrize("level", [1, 2])
@pytest.mark.parametrize("name", MESHES)
def test_triangles_are_those_that_blender_draws(name: str, level: int) -> None:
    """All but those of quads that may be folded, which count with both diagonals."""
    holder = MESHES[name]()
    mesh = apply_boundary_rule(scene.polygon_mesh_of(holder.data), smooth_corners=True)
    level_quads = addon.module("core.mesh.level_quads")
    refinement = addon.module("core.surface.refinement").Refinement.start(mesh, np.arange(mesh.face_count))
    is_turned = np.zeros(mesh.face_count, dtype=bool)
    for _ in range(level):
        is_turned = level_quads.turned_children(is_turned, refinement.mesh.face_sizes[: len(is_turned)])
        refinement = refinement.refined()
    leaves = addon.module("core.deviation.leaf_deviations").DrawnLeaves.of(
        refinement, is_turned, addon.module("core.bounds.norm_bounds").Vertices.CONTROL, None
    )
    drawn = level_quads.QUAD_TRIANGLES[is_turned.astype(int)]
    corners = np.take_along_axis(leaves.points[:, None], drawn[..., None], axis=2).reshape(-1, 3, 3)
    certain = np.repeat(~leaves.is_folded, 2)
    found = middles_of_drawn(holder, level)
    assert len(found) == len(corners)
    assert np.count_nonzero(certain) > 0.9 * len(corners)
    middles = np.random.default_rng(1).permutation(corners[certain].mean(axis=1))[:SOME]
    # Single precision at coordinates of some ten; middles along the other diagonal are farther off by far.
    for middle in middles:
        assert np.linalg.norm(found - middle, axis=1).min() < 1e-5


def test_methods_of_earlier_files_keep_their_numbers() -> None:
    """Files hold the number alone."""
    items = addon.module("state.properties").METHOD_ITEMS
    numbers = {identifier: number for identifier, *_, number in items}
    assert [numbers[each] for each in ("CERTIFIED", "SHARP", "SECOND_ORDER", "FIRST_ORDER")] == [0, 1, 2, 3]
    assert len(set(numbers.values())) == len(items)


def test_by_default_depths_are_by_distance_and_the_panel_says_so() -> None:
    holder = scene.add_object(meshes.torus(8, 6))
    bpy.context.scene.ccdepth.property_unset("method")
    addon.compute(holder, tolerance=0.05)
    assert holder.data.ccdepth.method == "DISTANCE"
    facts = addon.facts(holder)
    assert (facts["Method"], facts["Proved Minimal"]) == ("By Distance", "All faces")
    assert "By Distance" in addon.module("command_line.report_text").settings_text([holder])
    addon.compute(holder, tolerance=0.05, method="CERTIFIED")
    assert "Proved Minimal" not in addon.facts(holder)


def test_the_other_methods_say_what_they_compare_and_where_they_are_off() -> None:
    for method, (_, text) in addon.module("state.properties").METHOD_TEXTS.items():
        for words in ("equal parameters", "By Distance can ask for fewer levels", "more on twisted quads"):
            assert (words in text) == (method != "DISTANCE")


# Of these no lesser depth is enough on any face, at this part of the diagonal.
LEAST: dict[str, tuple[Callable[[], meshes.MeshData], float]] = {
    "cube": (meshes.cube, 0.01),
    "creased cube": (meshes.creased_cube, 0.03),
    "torus": (lambda: meshes.torus(8, 6), 0.01),
}


@pytest.mark.parametrize("vertices", ["CONTROL", "LIMIT"])
@pytest.mark.parametrize("name", LEAST)
def test_the_level_that_is_set_is_measured_to_be_enough_and_the_one_before_is_not(name: str, vertices: str) -> None:
    """By Measure Deviation."""
    make, tolerance = LEAST[name]
    holder, near = scene.add_object(make()), {"tolerance": tolerance, "tolerance_mode": "RELATIVE"}
    addon.compute(holder, **near, method="DISTANCE", vertices=vertices)
    record = holder.data.ccdepth
    assert record.exact_faces == record.faces
    bpy.ops.ccdepth.set_levels()
    [modifier] = holder.modifiers
    for verdict in ("MET", "NOT_MET"):
        addon.measure(holder, **near, accuracy=1.0, time_limit=20)
        assert record.measurement.verdict == verdict
        modifier.levels -= 1


def test_several_objects_in_edit_mode_get_depths_by_distance() -> None:
    holders = [scene.add_object(meshes.cube()), scene.add_object(meshes.landscape(3, 3))]
    holders[1].scale = (1.0, 2.0, 0.02)
    with addon.edit_mode(*holders):
        addon.compute(*holders, tolerance=0.05, method="DISTANCE", vertices="LIMIT")
    for holder in holders:
        assert holder.data.ccdepth.method == "DISTANCE"
        assert np.all(addon.bounds(holder) <= np.float32(0.05))
        assert addon.depths(holder).min() >= 0
