# SPDX-License-Identifier: GPL-3.0-or-later
"""Count Faces counts what Apply Adaptive Subdivision makes; more than the Face Limit are refused."""

from __future__ import annotations

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import TOLERANCE, everything_in_the_file, faces, known_count, refused, subdivide
from tests.blender.updating import set_scene


def test_the_count_is_what_is_made_and_counting_changes_nothing() -> None:
    first, second = scene.add_object(meshes.landscape(2, 2), "One"), scene.add_object(meshes.creased_cube(), "Two")
    scene.add_subdivision(first, 1)
    first.modifiers.new("Mirror", "MIRROR")
    for mode, transitions in (("ADAPTIVE", "TRIANGLES"), ("PER_FACE", "NGONS")):
        for obj in (first, second):
            obj.hide_set(False)
        addon.select(first, second)
        before = everything_in_the_file()
        set_scene(tolerance=0.03, mode=mode, transitions=transitions)
        assert bpy.ops.ccdepth.count_faces() == {"FINISHED"}
        assert everything_in_the_file() == before
        counts = [known_count(obj).faces for obj in (first, second)]
        results = subdivide(first, second, tolerance=0.03, mode=mode, transitions=transitions)
        assert [faces(result) for result in results] == counts
        bpy.data.batch_remove([result.data for result in results])
        assert set(everything_in_the_file()) == set(before)


@pytest.mark.parametrize("change", ["mesh", "scale", "settings"])
def test_a_count_is_forgotten_when_something_changes(change: str) -> None:
    holder = scene.add_object(meshes.cube())
    set_scene(tolerance=TOLERANCE)
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
        bpy.context.scene.ccdepth.tolerance *= 2
    bpy.context.view_layer.update()
    assert known_count(holder) is None


def named_tolerance(
    *objects: bpy.types.Object, tolerance_mode: str = "RELATIVE", match: str = "", **settings: object
) -> float:
    """That which the refusal says would fit; nothing is changed."""
    addon.select(*objects)
    before = everything_in_the_file()
    with pytest.raises(RuntimeError, match=f"{match}.* would fit") as caught:
        bpy.ops.ccdepth.subdivide(tolerance_mode=tolerance_mode, **settings)
    assert everything_in_the_file() == before
    assert ("of the diagonal" in str(caught.value)) == (tolerance_mode == "RELATIVE")
    return float(str(caught.value).partition("a tolerance of ")[2].split()[0])


@pytest.mark.parametrize("tolerance_mode", ["ABSOLUTE", "RELATIVE"])
def test_too_many_faces_are_refused_with_a_tolerance_that_fits(tolerance_mode: str) -> None:
    holder = scene.add_object(meshes.landscape(3, 3), "Hills")
    holder.scale = (3.0, 3.0, 3.0)
    settings = {"tolerance_mode": tolerance_mode, "max_faces": 1000}
    match = "Hills: the result would have about .* 1,000 are allowed"
    tolerance = named_tolerance(holder, tolerance=0.0001, match=match, **settings)
    [result] = subdivide(holder, tolerance=tolerance, **settings)
    assert 500 <= faces(result) <= 1000


@pytest.mark.parametrize(
    ("name", "mode", "max_faces"),
    [
        ("pole", "PER_FACE", 8_000),
        ("cylinder", "PER_FACE", 8_000),
        ("cylinder", "ADAPTIVE", 8_000),
        # Where the mesh itself has hardly fewer faces: Suzanne has 500.
        ("Suzanne", "ADAPTIVE", 500),
        ("Suzanne", "ADAPTIVE", 600),
        *(
            pytest.param(name, mode, 60_000, marks=pytest.mark.thorough)
            for name in ("cylinder", "pole", "Suzanne")
            for mode in ("ADAPTIVE", "PER_FACE")
        ),
    ],
)
def test_the_tolerance_named_fits_small_and_large_results(name: str, mode: str, max_faces: int) -> None:
    """The large ones are too large to be tried from the start; a pole may be as deep as its whole face. At least half
    of the faces allowed are made, where not whole faces are subdivided."""
    data = {"cylinder": lambda: meshes.cylinder(32), "pole": lambda: meshes.fan(12, 2)}
    holder = scene.add_object(data[name]()) if name in data else scene.add_suzanne()
    settings = {"mode": mode, "max_faces": max_faces}
    tolerance = named_tolerance(holder, tolerance=1e-6 if max_faces > 1000 else 1e-4, **settings)
    [result] = subdivide(holder, tolerance=tolerance, tolerance_mode="RELATIVE", **settings)
    least = max_faces / 2 if mode == "ADAPTIVE" else 1
    assert least <= faces(result) <= max_faces


def test_no_tolerance_fits_where_the_mesh_itself_has_too_many_faces() -> None:
    refused(scene.add_suzanne(), match="no tolerance would fit", max_faces=100)


def test_the_limit_is_for_all_objects_together(capfd: pytest.CaptureFixture[str]) -> None:
    objects = [scene.add_object(meshes.cube()), scene.add_object(meshes.cube())]
    [alone] = subdivide(objects[0])
    objects[0].hide_set(False)
    most = int(1.5 * faces(alone))
    refused(*objects, match="The 2 results together .* are allowed", max_faces=most)
    bpy.ops.ccdepth.count_faces(tolerance=TOLERANCE, tolerance_mode="ABSOLUTE", max_faces=most)
    assert f"The 2 results together would have about {2 * faces(alone):,} faces" in capfd.readouterr().out


@pytest.mark.parametrize("max_faces", [20, 400])
def test_the_tolerance_named_fits_all_objects_together(max_faces: int) -> None:
    objects = [scene.add_object(meshes.landscape(3, 3), "Hills"), scene.add_object(meshes.creased_cube(), "Cube")]
    objects[1].scale = (2.0, 2.0, 2.0)
    tolerance = named_tolerance(*objects, tolerance=0.001, max_faces=max_faces)
    results = subdivide(*objects, tolerance=tolerance, tolerance_mode="RELATIVE", max_faces=max_faces)
    assert sum(map(faces, results)) <= max_faces
