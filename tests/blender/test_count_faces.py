# SPDX-License-Identifier: GPL-3.0-or-later
"""Count Faces counts what Apply Adaptive Subdivision makes; more than the Face Limit are refused."""

from __future__ import annotations

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import TOLERANCE, everything_in_the_file, faces, known_count, refused, subdivide


def test_the_count_is_what_is_made() -> None:
    first, second = scene.add_object(meshes.landscape(3, 3), "One"), scene.add_object(meshes.creased_cube(), "Two")
    scene.add_subdivision(first, 1)
    before = everything_in_the_file()
    for mode, transitions in (("ADAPTIVE", "TRIANGLES"), ("PER_FACE", "NGONS")):
        for obj in (first, second):
            obj.hide_set(False)
        addon.select(first, second)
        settings = bpy.context.scene.ccdepth
        settings.tolerance_mode, settings.tolerance = "ABSOLUTE", TOLERANCE
        settings.mode, settings.transitions = mode, transitions
        assert bpy.ops.ccdepth.count_faces() == {"FINISHED"}
        counts = [known_count(obj).faces for obj in (first, second)]
        results = subdivide(first, second, mode=mode, transitions=transitions)
        assert [faces(result) for result in results] == counts
        bpy.data.batch_remove([result.data for result in results])
    assert set(everything_in_the_file()) == set(before)


def test_counting_changes_nothing() -> None:
    holder = scene.add_suzanne()
    holder.modifiers.new("Mirror", "MIRROR")
    addon.select(holder)
    before = everything_in_the_file()
    assert bpy.ops.ccdepth.count_faces(tolerance=TOLERANCE) == {"FINISHED"}
    assert everything_in_the_file() == before


@pytest.mark.parametrize("change", ["mesh", "scale", "settings"])
def test_a_count_is_forgotten_when_something_changes(change: str) -> None:
    holder = scene.add_suzanne()
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance = "ABSOLUTE", TOLERANCE
    addon.select(holder)
    bpy.ops.ccdepth.count_faces()
    bpy.context.view_layer.update()
    assert known_count(holder) is not None
    if change == "mesh":
        holder.data.vertices[0].co.x += 1.0
        holder.data.update()
    elif change == "scale":
        holder.scale.x = 2.0
    else:
        settings.tolerance *= 2
    bpy.context.view_layer.update()
    assert known_count(holder) is None


@pytest.mark.parametrize("tolerance_mode", ["ABSOLUTE", "RELATIVE"])
def test_too_many_faces_are_refused_with_a_tolerance_that_fits(tolerance_mode: str) -> None:
    holder = scene.add_suzanne()
    holder.scale = (3.0, 3.0, 3.0)
    settings = {"tolerance": 0.0005, "tolerance_mode": tolerance_mode, "max_faces": 3000}
    refused(holder, match="Suzanne: the result would have about .* 3,000 are allowed", **settings)
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.ccdepth.subdivide(**settings)
    words = str(caught.value).partition("a tolerance of ")[2].split()
    assert ("of the diagonal" in str(caught.value)) == (tolerance_mode == "RELATIVE")
    [result] = subdivide(holder, **{**settings, "tolerance": float(words[0])})
    assert faces(result) <= 3000


def named_tolerance(*objects: bpy.types.Object, **settings: object) -> float:
    """That which the refusal says would fit."""
    addon.select(*objects)
    with pytest.raises(RuntimeError, match="would fit") as caught:
        bpy.ops.ccdepth.subdivide(tolerance_mode="RELATIVE", **settings)
    return float(str(caught.value).partition("a tolerance of ")[2].split()[0])


@pytest.mark.parametrize("mode", ["ADAPTIVE", "PER_FACE"])
@pytest.mark.mathematics
@pytest.mark.parametrize("name", ["cylinder", "pole", "Suzanne"])
def test_the_tolerance_named_fits_large_results_too(name: str, mode: str) -> None:
    """These are too large to be tried from the start; a pole may be as deep as its whole face."""
    data = {"cylinder": lambda: meshes.cylinder(32), "pole": lambda: meshes.fan(12, 2)}
    holder = scene.add_object(data[name]()) if name in data else scene.add_suzanne()
    settings = {"mode": mode, "max_faces": 60_000}
    tolerance = named_tolerance(holder, tolerance=1e-6, **settings)
    [result] = subdivide(holder, tolerance=tolerance, tolerance_mode="RELATIVE", **settings)
    assert faces(result) <= 60_000


@pytest.mark.parametrize("most", [2_000, 20_000])
def test_the_tolerance_named_makes_at_least_half_of_the_faces_allowed(most: int) -> None:
    holder = scene.add_suzanne()
    tolerance = named_tolerance(holder, tolerance=1e-6, max_faces=most)
    [result] = subdivide(holder, tolerance=tolerance, tolerance_mode="RELATIVE", max_faces=most)
    assert most / 2 <= faces(result) <= most


def test_no_tolerance_fits_where_the_mesh_itself_has_too_many_faces() -> None:
    refused(scene.add_suzanne(), match="no tolerance would fit", max_faces=100)


@pytest.mark.parametrize("max_faces", [500, 600])
def test_a_tolerance_fits_where_the_mesh_itself_has_hardly_fewer_faces(max_faces: int) -> None:
    """Suzanne has 500."""
    holder = scene.add_suzanne()
    tolerance = named_tolerance(holder, tolerance=1e-4, max_faces=max_faces)
    [result] = subdivide(holder, tolerance=tolerance, tolerance_mode="RELATIVE", max_faces=max_faces)
    assert faces(result) <= max_faces


def test_the_limit_is_for_all_objects_together() -> None:
    objects = [scene.add_object(meshes.cube()), scene.add_object(meshes.cube())]
    [alone] = subdivide(objects[0])
    objects[0].hide_set(False)
    refused(*objects, match="The 2 results together .* are allowed", max_faces=int(1.5 * faces(alone)))


@pytest.mark.mathematics
@pytest.mark.parametrize("max_faces", [1100, 2000, 3000])
def test_the_tolerance_named_fits_all_objects_together(max_faces: int) -> None:
    objects = [scene.add_suzanne(), scene.add_suzanne()]
    objects[1].scale = (2.0, 2.0, 2.0)
    tolerance = named_tolerance(*objects, tolerance=0.002, max_faces=max_faces)
    results = subdivide(*objects, tolerance=tolerance, tolerance_mode="RELATIVE", max_faces=max_faces)
    assert sum(map(faces, results)) <= max_faces


def test_counting_tells_when_all_objects_together_have_too_many_faces(capfd: pytest.CaptureFixture[str]) -> None:
    objects = [scene.add_object(meshes.cube()), scene.add_object(meshes.cube())]
    [alone] = subdivide(objects[0])
    objects[0].hide_set(False)
    addon.select(*objects)
    bpy.ops.ccdepth.count_faces(tolerance=TOLERANCE, tolerance_mode="ABSOLUTE", max_faces=int(1.5 * faces(alone)))
    assert f"The 2 results together would have about {2 * faces(alone):,} faces" in capfd.readouterr().out
