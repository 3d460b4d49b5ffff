# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges of results are at most as long in the scene as the Longest Edge, however objects are scaled."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.runs import run, save
from tests.blender.subdividing import faces, known_count, refused, shape, subdivide

COARSE = {"tolerance": 0.2, "tolerance_mode": "ABSOLUTE"}


def longest(holder: bpy.types.Object) -> float:
    """The length of the longest edge in the scene."""
    ends = shape(holder)[[tuple(edge.vertices) for edge in holder.data.edges]]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max())


@pytest.mark.parametrize("mode", ["ADAPTIVE", "PER_FACE"])
def test_no_edge_is_longer_in_the_scene(mode: str) -> None:
    holder = scene.add_suzanne()
    holder.scale, holder.rotation_euler = (1.0, 3.0, -0.4), (0.3, 0.2, 0.1)
    holder.modifiers.new("Mirror", "MIRROR")
    [free] = subdivide(holder, **COARSE, mode=mode)
    allowed = 0.4 * longest(free)
    [result] = subdivide(holder, **COARSE, mode=mode, longest_edge=allowed)
    # The setting is in single precision, and is taken as typed.
    assert longest(result) <= float(f"{np.float32(allowed)}")
    assert faces(result) > faces(free)
    assert result.ccdepth.longest_edge == np.float32(allowed)
    assert result.data.ccdepth.largest_bound <= COARSE["tolerance"]
    assert faces(subdivide(holder, **COARSE, mode=mode, longest_edge=100.0)[0]) == faces(free)


def test_large_coordinates_are_rounded_within_the_length() -> None:
    """Of a flat grid with edges of 1, which rounding changes far from the origin."""
    holder = scene.add_object(meshes.bent(meshes.grid(2, 2), lambda x, y, z: (x + 1e4 / 3, y + 1e4 / 7, z)))
    refused(holder, match="finer than the mesh's single precision", longest_edge=1e-4)
    [result] = subdivide(holder, **COARSE, longest_edge=0.5)
    assert longest(result) <= 0.5


def test_objects_of_one_mesh_have_short_edges_each() -> None:
    """With a relative tolerance one result is enough for both by distance."""
    first = scene.add_suzanne()
    second = scene.add_mesh(first.data)
    second.scale = (4.0, 4.0, 4.0)
    results = subdivide(first, second, tolerance=0.05, tolerance_mode="RELATIVE", longest_edge=0.3)
    assert all(longest(each) <= 0.3 for each in results)


def test_counts_and_updates_keep_edges_short() -> None:
    holder, settings = scene.add_suzanne(), bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance, settings.longest_edge = "ABSOLUTE", 0.2, 0.2
    addon.finish("count_faces", holder)
    count = known_count(holder).faces
    [result] = subdivide(holder, **COARSE, longest_edge=0.2)
    assert faces(result) == count
    settings.longest_edge = 0.1
    addon.finish("update", result)
    assert longest(result) <= 0.1


def test_refusals_in_one_line() -> None:
    holder = scene.add_suzanne()
    refused(holder, match="The Longest Edge must be 0 or more", longest_edge=-1.0)
    refused(holder, match="Reduce keeps no edges short; turn Reduce off", longest_edge=0.1, reduce=True)
    refused(holder, match="a greater Longest Edge makes fewer", longest_edge=0.01, max_faces=10_000)


def test_the_command_line_keeps_edges_short(tmp_path: Path) -> None:
    scene.add_object(meshes.landscape(3, 3))
    source, output = save(tmp_path / "grid.blend"), tmp_path / "made.obj"
    arguments = ["--subdivide", "--absolute", "--tolerance", 0.2, "--longest-edge", 0.25, "--output", output]
    report = tmp_path / "report.json"
    assert run(source, *arguments, "--json", report) == 0
    bpy.ops.wm.obj_import(filepath=str(output))
    # The file has six decimals.
    assert longest(bpy.context.selected_objects[0]) <= 0.25 + 1e-5
    assert run("--verify", report) == 0
