# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances that vary by weights and by materials, against distances of samples from Blender's own modifier."""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from tests import meshes
from tests.blender import addon, scene
from tests.blender.runs import run, save
from tests.blender.subdividing import faces, known_count, refused, refuses, subdivide

TOLERANCE, COARSEST = 0.01, 10.0

# For less time.
COARSE = 0.03


@pytest.fixture(autouse=True)
def without_angles() -> None:
    bpy.context.scene.ccdepth.shading_angle = 0.0


def painted(weights: Callable[[np.ndarray], np.ndarray]) -> bpy.types.Object:
    """Hills with a vertex group called Detail, by the positions of the vertices (V, 3)."""
    holder = scene.add_object(meshes.landscape(8, 6))
    group = holder.vertex_groups.new(name="Other"), holder.vertex_groups.new(name="Detail")
    for vertex, weight in enumerate(weights(scene.mesh_data(holder.data).positions).tolist()):
        group[1].add([vertex], weight, "REPLACE")
    return holder


def by_group(**settings: object) -> dict[str, object]:
    return {"tolerance": TOLERANCE, "tolerance_by": "VERTEX_GROUP", "vertex_group": "Detail", **settings}


def front(positions: np.ndarray) -> np.ndarray:
    """1 on one side, 0 on the other."""
    return np.clip(1.25 - positions[:, 0] / 5, 0.0, 1.0)


def deep_level(holder: bpy.types.Object) -> tuple[np.ndarray, list[list[int]], np.ndarray]:
    """The positions and the faces of the fourth level on the limit surface, and the weights of its vertices: Blender
    interpolates them like vertices, and an attribute at corners linearly over each face."""
    mesh, weights = holder.data, np.zeros(len(holder.data.vertices))
    for vertex in mesh.vertices:
        for entry in vertex.groups:
            if holder.vertex_groups[entry.group].name == "Detail":
                weights[vertex.index] = entry.weight
    corners = scene.mesh_data(mesh).corner_vertices
    layer = mesh.uv_layers.new(name="weights")
    layer.data.foreach_set("uv", np.column_stack([weights[corners], np.zeros(len(corners))]).ravel())
    modifier = scene.add_subdivision(holder, 4)
    modifier.use_limit_surface, modifier.uv_smooth = True, "NONE"
    holder.hide_set(False)
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    data = scene.mesh_data(evaluated)
    uvs = scene.values_of(evaluated.uv_layers["weights"].data, "uv", np.float32, 2).reshape(-1, 2)
    found = np.zeros(len(data.positions))
    found[data.corner_vertices] = uvs[:, 0]
    quads = [data.corner_vertices[a:b].tolist() for a, b in pairwise(np.cumsum([0, *data.face_sizes]))]
    return data.positions, quads, found


def test_every_sample_is_within_its_own_tolerance() -> None:
    holder = painted(front)
    [fine] = subdivide(holder, tolerance=TOLERANCE)
    many = faces(fine)
    [result] = subdivide(holder, **by_group())
    assert faces(result) < 0.7 * many
    assert 0.5 < result.data.ccdepth.largest_ratio <= 1.0
    assert addon.facts(result)["Of Tolerance"].endswith("%")
    positions, quads, weights = deep_level(holder)
    own = TOLERANCE * COARSEST ** (1 - weights)
    drawn = scene.mesh_data(result.data).positions
    tree = BVHTree.FromPolygons(drawn.tolist(), scene.triangles_of(result.data).tolist())
    # Every point of the surface has a drawn point within its own tolerance. Positions are in single precision.
    distances = np.array([tree.find_nearest(Vector(each))[3] for each in positions])
    assert np.all(distances <= own * (1 + 1e-5))
    # It is coarser where that is allowed.
    assert distances.max() > 1.5 * TOLERANCE
    assert distances[weights == 1].max() <= TOLERANCE * (1 + 1e-5)
    # And every drawn vertex is near a point of the surface: a face of the deep level is off by far less than a tenth.
    surface = BVHTree.FromPolygons(positions.tolist(), quads)
    for point in drawn:
        _, _, face, distance = surface.find_nearest(Vector(point))
        assert distance <= 1.1 * own[quads[face]].max()


@pytest.mark.parametrize("reduce", [False, True])
def test_measured_distances_are_divided_by_the_factors(reduce: bool) -> None:
    """Of meshes that Reduce made as well, which it judges so."""
    holder = painted(front)
    [result] = subdivide(holder, **by_group(tolerance=COARSE, reduce=reduce))
    assert bool(result.data.ccdepth.unreduced_triangles) == reduce
    assert 0.5 < result.data.ccdepth.largest_ratio <= 1.0
    bounds = scene.values_of(result.data.attributes["ccdepth_bound"].data, "value", np.float32)
    assert bounds.max() == pytest.approx(result.data.ccdepth.largest_ratio * COARSE)
    addon.measure(result, holder, **by_group(tolerance=COARSE, time_limit=0.0, accuracy=0.2))
    record = result.data.ccdepth
    assert record.measurement.verdict == "MET"
    assert [*record.measurement.factors] == pytest.approx([1.0, COARSEST])
    assert 0.3 * COARSE < record.deviation_reached <= record.deviation <= COARSE
    positions, _, weights = deep_level(holder)
    tree = BVHTree.FromPolygons(
        scene.mesh_data(result.data).positions.tolist(), scene.triangles_of(result.data).tolist()
    )
    distances = np.array([tree.find_nearest(Vector(each))[3] for each in positions])
    # Positions are in single precision.
    assert np.all(distances <= record.deviation * COARSEST ** (1 - weights) * (1 + 1e-5))
    tolerance, facts = addon.module("ui.facts").facts_of_measurement(bpy.context.scene, record)
    assert tolerance.endswith("× 1 to 10")
    assert facts[0].value.endswith("of its tolerance")
    addon.measure(result, holder, tolerance=COARSE, tolerance_by="NONE", time_limit=0.0, accuracy=0.2)
    assert record.measurement.verdict == "NOT_MET"
    assert record.deviation > 1.5 * COARSE


def test_a_measurement_by_other_weights_is_out_of_date() -> None:
    holder, panel = painted(front), addon.module("ui.deviation_panel")
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance = "ABSOLUTE", TOLERANCE
    settings.tolerance_by, settings.vertex_group = "VERTEX_GROUP", "Detail"
    addon.measure(holder)
    assert panel.stale_line(settings, holder.data) == ""
    settings.coarsest = 5.0
    assert "settings changed" in panel.stale_line(settings, holder.data)
    settings.coarsest = COARSEST
    holder.vertex_groups["Detail"].add([0], 0.123, "REPLACE")
    assert "changed" in addon.module("state.still_holds").change_since_measured(holder.data, [holder])


def test_equal_weights_are_one_tolerance() -> None:
    for weight, tolerance in ((1.0, TOLERANCE), (0.0, TOLERANCE * COARSEST)):
        holder = painted(lambda positions, weight=weight: np.full(len(positions), weight))
        [result] = subdivide(holder, **by_group())
        [uniform] = subdivide(holder, tolerance=tolerance)
        assert faces(result) == faces(uniform)


def test_materials_have_factors() -> None:
    holder = scene.add_object(meshes.landscape(6, 6))
    for name, factor in (("Fine", 1.0), ("Coarse", 20.0)):
        material = bpy.data.materials.new(name)
        material.ccdepth.tolerance_factor = factor
        holder.data.materials.append(material)
    [fine] = subdivide(holder, tolerance=TOLERANCE, tolerance_by="MATERIAL")
    many = faces(fine)
    half = len(holder.data.polygons) // 2
    holder.data.polygons.foreach_set("material_index", [0] * half + [1] * half)
    [result] = subdivide(holder, tolerance=TOLERANCE, tolerance_by="MATERIAL")
    counts = np.bincount([each.material_index for each in result.data.polygons])
    assert counts[0] > 2 * counts[1]
    assert faces(result) < many
    # An object's own material counts for that object.
    holder.material_slots[1].link = "OBJECT"
    holder.material_slots[1].material = holder.data.materials[0]
    assert faces(subdivide(holder, tolerance=TOLERANCE, tolerance_by="MATERIAL")[0]) == many


def test_counts_searches_and_updates_vary_as_well() -> None:
    holder, settings = painted(front), bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance = "ABSOLUTE", COARSE
    settings.tolerance_by, settings.vertex_group = "VERTEX_GROUP", "Detail"
    addon.finish("find_tolerance", holder, face_budget=1000)
    count = known_count(holder).faces
    [result] = subdivide(holder, tolerance=settings.tolerance)
    assert faces(result) == count <= 1000
    settings.tolerance_by = "NONE"
    addon.finish("update", result)
    assert faces(result) > count
    assert result.data.ccdepth.largest_ratio == 0


def test_a_set_level_is_within_the_tolerance_of_every_sample() -> None:
    holder, settings = painted(front), bpy.context.scene.ccdepth
    finest = painted(lambda positions: np.ones(len(positions)))
    settings.method = "CERTIFIED"
    modifier = scene.add_subdivision(holder, 1)
    modifier.use_limit_surface = True
    for each in (holder, finest):
        addon.compute(each, **by_group(tolerance=COARSE, tolerance_mode="ABSOLUTE"))
    assert addon.facts(holder)["Vary by"] == "Detail, up to 10 times"
    assert np.all(addon.depths(holder) <= addon.depths(finest))
    # The heat map of distances shows parts of the tolerance at their place.
    for each in (holder, finest):
        bounds = scene.values_of(each.data.attributes["ccdepth_bound"].data, "value", np.float32)
        assert 0.5 * COARSE < bounds.max() <= COARSE * (1 + 1e-6)
        assert bounds.max() == pytest.approx(each.data.ccdepth.largest_ratio * COARSE)
    assert holder.data.ccdepth.largest_bound > COARSE
    assert addon.depths(holder).sum() < 0.8 * addon.depths(finest).sum()
    addon.select(holder)
    assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
    assert modifier.levels == holder.data.ccdepth.uniform_level <= finest.data.ccdepth.uniform_level
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    drawn = scene.mesh_data(evaluated).positions
    tree = BVHTree.FromPolygons(drawn.tolist(), scene.triangles_of(evaluated).tolist())
    holder.modifiers.remove(modifier)
    positions, _, weights = deep_level(holder)
    distances = np.array([tree.find_nearest(Vector(each))[3] for each in positions])
    assert np.all(distances <= COARSE * COARSEST ** (1 - weights) * (1 + 1e-5))


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0])
def test_depths_of_equal_weights_are_those_of_one_tolerance(weight: float) -> None:
    holder = painted(lambda positions: np.full(len(positions), weight))
    holder.modifiers.new("Array", "ARRAY").count = 2
    addon.compute(holder, **by_group(tolerance_mode="ABSOLUTE"))
    found = addon.depths(holder), holder.data.ccdepth.uniform_level
    tolerance = TOLERANCE * COARSEST ** (1 - weight)
    addon.compute(holder, tolerance=tolerance, tolerance_mode="ABSOLUTE")
    assert np.array_equal(addon.depths(holder), found[0])
    assert holder.data.ccdepth.uniform_level == found[1]


def test_objects_of_one_mesh_have_the_depths_of_the_finer_material() -> None:
    first = scene.add_object(meshes.landscape(6, 6))
    for name, factor in (("Fine", 1.0), ("Coarse", 20.0)):
        bpy.data.materials.new(name).ccdepth.tolerance_factor = factor
    first.data.materials.append(bpy.data.materials["Coarse"])
    second = scene.add_mesh(first.data)
    settings = {"tolerance": TOLERANCE, "tolerance_mode": "ABSOLUTE"}
    addon.compute(first, second, **settings, tolerance_by="MATERIAL")
    coarse = addon.depths(first)
    second.material_slots[0].link = "OBJECT"
    second.material_slots[0].material = bpy.data.materials["Fine"]
    addon.compute(first, second, **settings, tolerance_by="MATERIAL")
    both = addon.depths(first)
    addon.compute(first, second, **settings)
    assert np.array_equal(both, addon.depths(first))
    assert both.sum() > coarse.sum()
    # In Edit Mode as well.
    addon.select(second, mode="EDIT")
    bpy.ops.ccdepth.compute(**settings, tolerance_by="MATERIAL")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert np.array_equal(both, addon.depths(first))


def test_depths_of_other_weights_or_factors_are_out_of_date() -> None:
    holder = painted(front)
    material = bpy.data.materials.new("Skin")
    holder.data.materials.append(material)

    def are_stale() -> bool:
        return bool(addon.module("state.out_of_date").out_of_date(bpy.context, [holder]))

    for settings in (by_group(), {"tolerance": TOLERANCE, "tolerance_by": "MATERIAL"}):
        addon.compute(holder, method="CERTIFIED", **settings)
        assert not are_stale()
        holder.vertex_groups["Other"].add([0], 0.5, "REPLACE")
        holder.vertex_groups["Detail"].add([0], 0.123, "REPLACE")
        assert are_stale() == (settings["tolerance_by"] == "VERTEX_GROUP")
        material.ccdepth.tolerance_factor *= 2
        assert are_stale()
        addon.compute(holder, method="CERTIFIED", tolerance=TOLERANCE)
        holder.vertex_groups["Detail"].add([0], 0.7, "REPLACE")
        assert not are_stale()


def test_depths_over_frames_have_the_factors_of_each_frame() -> None:
    holder, material = scene.add_suzanne(), bpy.data.materials.new("Pulsing")
    holder.data.materials.append(material)
    for frame, factor in ((1, 1.0), (2, 10.0), (3, 4.0)):
        material.ccdepth.tolerance_factor = factor
        material.keyframe_insert("ccdepth.tolerance_factor", frame=frame)
    settings = {"tolerance": TOLERANCE, "tolerance_mode": "ABSOLUTE", "method": "CERTIFIED"}
    for frames, factor in (("1-3", 1.0), ("2-3", 4.0), ("2", 10.0)):
        addon.compute(holder, **settings, tolerance_by="MATERIAL", frames="CUSTOM", frame_list=frames)
        found = addon.depths(holder)
        addon.compute(holder, **{**settings, "tolerance": TOLERANCE * factor})
        assert np.array_equal(found, addon.depths(holder))


def test_depths_refuse_what_results_refuse() -> None:
    holder = painted(front)
    refuses("compute", "it has no vertex group called “Nothing”", holder, **by_group(vertex_group="Nothing"))
    refuses("compute", "Coarsest must be 1 or more", holder, **by_group(coarsest=0.5))


def test_groups_of_included_modifiers_count() -> None:
    holder = painted(front)
    holder.modifiers.new("Array", "ARRAY").count = 2
    assert subdivide(holder, **by_group())[0].data.ccdepth.largest_ratio > 0


def test_a_group_without_weights_is_told(capfd: pytest.CaptureFixture[str]) -> None:
    subdivide(painted(lambda positions: np.zeros(len(positions))), **by_group())
    assert "“Detail” has no weight above 0: the tolerance is the coarsest everywhere" in capfd.readouterr().out


def test_refusals_in_one_line() -> None:
    holder = painted(front)
    refused(holder, match="it has no vertex group called “Nothing”", **by_group(vertex_group="Nothing"))
    refused(holder, match="no vertex group is chosen", **by_group(vertex_group=""))
    refused(holder, match="Coarsest must be 1 or more", **by_group(coarsest=0.5))
    material = bpy.data.materials.new("Bad")
    holder.data.materials.append(material)
    material.ccdepth.tolerance_factor = -1.0
    refused(holder, match="“Bad” is -1: it must be greater than zero", tolerance_by="MATERIAL")
    material.ccdepth.tolerance_factor = 1e-6
    refused(holder, match="finer than the mesh's single-precision", tolerance_by="MATERIAL")


def test_the_command_line_varies_the_tolerance(tmp_path: Path) -> None:
    painted(front)
    source, output = save(tmp_path / "painted.blend"), tmp_path / "made.blend"
    arguments = ["--subdivide", "--absolute", "--tolerance", COARSE, "--tolerance-by", "vertex-group"]
    arguments += ["--vertex-group", "Detail", "--coarsest", "20", "--output", output]
    assert run(source, *arguments) == 0
    bpy.ops.wm.open_mainfile(filepath=str(output))
    assert any(mesh.ccdepth.largest_ratio > 0 for mesh in bpy.data.meshes)
    report = tmp_path / "report.json"
    assert run(source, *arguments, "--overwrite", "--json", report) == 0
    content = json.loads(report.read_text())
    [entry] = content["files"][0]["objects"]
    assert entry["met"]
    assert entry["measured"]["proved"] <= COARSE < 10 * entry["measured"]["proved"]
    assert entry["factors"] == pytest.approx([1.0, 20.0])
    assert run("--verify", report) == 0
    entry["factors"][1] = 30.0
    report.write_text(json.dumps(content))
    assert run("--verify", report) == 1
    arguments.remove("--subdivide")
    assert run(source, *arguments, "--levels", "--method", "certified", "--overwrite") == 0
    bpy.ops.wm.open_mainfile(filepath=str(output))
    assert any(mesh.ccdepth.tolerance_by == "VERTEX_GROUP" for mesh in bpy.data.meshes)
    arguments = arguments[: arguments.index("--output")]
    assert run(source, *arguments, "--measure", "--json", report, "--overwrite") == 1
    assert not json.loads(report.read_text())["files"][0]["objects"][0]["met"]
