# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances at the press of a button, in the sidebar, and for so many faces; Count Faces, and the Face Limit."""

import math
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.subdividing import TOLERANCE, faces, known_count, refuses, subdivide
from tests.blender.updating import made_result, move_vertex, set_scene


def test_after_a_refused_update_as_well() -> None:
    _, result = made_result()
    set_scene(tolerance=1e-4, max_faces=500)
    message = "Cage Adaptive: the result would have about .* faces, and 500 are allowed; Find Tolerance finds one that"
    refuses("update", message, result)
    assert known_count(result).are_too_many
    bpy.ops.ccdepth.find_tolerance(face_budget=500)
    # Of a result it counts what its update makes.
    counted = known_count(result)
    assert bpy.ops.ccdepth.update() == {"FINISHED"}
    assert faces(result) == counted.faces <= 500


SHIPPED = [
    *("Draft", "Game LOD0", "Standard", "Fine", "Render Close-Up"),
    *("Print 0.1 mm", "Print 0.05 mm", "CAD Exchange"),
]


def presets() -> dict[str, Any]:
    """All presets there are, by the names that are shown."""
    return {each.name: each for each in addon.module("ui.tolerances").presets(bpy.context.scene)}


def choose(preset: Any) -> None:
    bpy.ops.ccdepth.use_preset(name=preset.name)


@pytest.mark.every_blender
def test_there_are_presets_from_coarse_to_fine() -> None:
    settings = bpy.context.scene.ccdepth
    found = presets()
    assert [*found] == SHIPPED
    tolerances = []
    for name in ("Draft", "Standard", "Fine", "Render Close-Up"):
        settings.tolerance_mode = "ABSOLUTE"
        choose(found[name])
        assert settings.tolerance_mode == "RELATIVE"
        tolerances.append(settings.relative_tolerance)
    assert tolerances == sorted(tolerances, reverse=True)
    assert tolerances[1] == settings.bl_rna.properties["relative_tolerance"].default


@pytest.mark.parametrize(("scale", "tolerance"), [(1.0, 0.0001), (0.001, 0.1)])
def test_the_preset_for_printing_is_a_tenth_of_a_millimetre_in_any_unit(scale: float, tolerance: float) -> None:
    bpy.context.scene.unit_settings.scale_length = scale
    choose(presets()["Print 0.1 mm"])
    settings = bpy.context.scene.ccdepth
    assert (settings.tolerance_mode, settings.tolerance) == ("ABSOLUTE", pytest.approx(tolerance))


@pytest.mark.every_blender
def test_presets_of_ones_own_are_added_and_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bpy.utils, "user_resource", lambda *_, path="", **__: str(tmp_path / path))
    monkeypatch.setattr(bpy.utils, "preset_paths", lambda folder: [str(tmp_path / "presets" / folder)])
    (tmp_path / "presets/ccdepth/tolerance").mkdir(parents=True)
    set_scene(tolerance=0.123, relative_tolerance=0.0456, tolerance_mode="RELATIVE")
    set_scene(shading_angle=math.radians(7), reduce=True)
    assert bpy.ops.ccdepth.tolerance_preset_add(name="my own") == {"FINISHED"}
    set_scene(tolerance_mode="ABSOLUTE", tolerance=1e-5)
    assert bpy.ops.ccdepth.tolerance_preset_add(name="Yours") == {"FINISHED"}
    (tmp_path / "presets/ccdepth/tolerance/Broken.py").write_text("ccdepth.tolerance_mode = 'RELATIVE'")
    assert [*presets()] == ["my own", *SHIPPED, "Yours"]
    assert presets()["my own"].told(bpy.context.scene) == (
        "Tolerance 0.0456 of the size, shading angle 7°, no facet angle, Reduce on, the same everywhere"
    )
    set_scene(relative_tolerance=1.0, shading_angle=0.0, reduce=False)
    choose(presets()["my own"])
    settings = bpy.context.scene.ccdepth
    assert (math.degrees(settings.shading_angle), settings.reduce) == (pytest.approx(7.0), True)
    assert (settings.tolerance_mode, settings.relative_tolerance) == ("RELATIVE", pytest.approx(0.0456))
    choose(presets()["Yours"])
    assert (settings.tolerance_mode, settings.tolerance) == ("ABSOLUTE", pytest.approx(1e-5))
    assert bpy.ops.ccdepth.tolerance_preset_add(name="my own", remove_name=True) == {"FINISHED"}
    assert [*presets()] == [*SHIPPED, "Yours"]


@pytest.mark.parametrize(
    ("text", "fault"), [("= -1.0", "tolerance"), ("= 0.0", "tolerance"), ("= 1.0", "less than 90")]
)
def test_a_preset_of_an_earlier_version_holds_less_and_a_bad_one_is_refused(
    text: str, fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bpy.utils, "preset_paths", lambda _: [str(tmp_path)])
    begin = "ccdepth.tolerance_mode = 'ABSOLUTE'\nccdepth.tolerance"
    (tmp_path / "Old.py").write_text(f"{begin} = 0.25\nccdepth.relative_tolerance = 0.5")
    (tmp_path / "Bad.py").write_text(f"{begin} {text}\nccdepth.facet_angle = 2.0")
    set_scene(relative_tolerance=0.125, facet_angle=0.5, reduce=True)
    refuses("use_preset", fault, name="Bad")
    refuses("use_preset", "no preset", name="None")
    choose(presets()["Old"])
    settings = bpy.context.scene.ccdepth
    assert (settings.tolerance_mode, settings.tolerance) == ("ABSOLUTE", 0.25)
    assert (settings.relative_tolerance, settings.facet_angle, settings.reduce) == (0.125, 0.5, True)


SIZE = 2 * math.sqrt(3)


def about(value: float) -> object:
    """What is compared with this: settings are in single precision."""
    return pytest.approx(value, rel=1e-5)


@pytest.fixture
def cube() -> bpy.types.Object:
    holder = scene.add_object(meshes.cube())
    addon.select(holder)
    set_scene(tolerance_mode="RELATIVE", relative_tolerance=0.001, tolerance=0.5)
    return holder


def text() -> str:
    """What the sidebar says, as it is drawn."""
    bpy.context.view_layer.update()
    return str(addon.module("ui.tolerances").tolerance_text(bpy.context))


def test_switching_in_the_sidebar_carries_the_distance_over_and_back(cube: bpy.types.Object) -> None:
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode = "ABSOLUTE"
    assert (settings.tolerance, settings.relative_tolerance) == (0.5, about(0.001)), "scripts change the mode alone"
    settings.tolerance_mode = "RELATIVE"
    cube.scale = (3.0, 3.0, 3.0)
    settings.shown_tolerance_mode = "ABSOLUTE"
    assert settings.tolerance_mode == "ABSOLUTE"
    assert settings.tolerance == about(0.003 * SIZE)
    settings.shown_tolerance_mode = "RELATIVE"
    assert settings.tolerance_mode == "RELATIVE"
    assert settings.relative_tolerance == about(0.001)


def test_modifiers_counted_in_are_carried_over_too(cube: bpy.types.Object) -> None:
    """Of modifiers above a Subdivision Surface modifier only the size that was computed is told, as about so much."""
    scene.add_subdivision(cube, 1)
    array = cube.modifiers.new("Array", "ARRAY")
    array.count, array.use_relative_offset, array.use_constant_offset = 2, False, True
    array.constant_offset_displace = (2.0, 0.0, 0.0)
    # Below, it does not count.
    assert text() == "= 0.003464 m"
    cube.modifiers.move(1, 0)
    assert text() == ""
    assert bpy.ops.ccdepth.compute() == {"FINISHED"}
    assert text() == "≈ 0.004899 m"
    array.count += 1
    assert text() == "≈ 0.004899 m"
    array.count = 2
    bpy.context.scene.ccdepth.shown_tolerance_mode = "ABSOLUTE"
    assert bpy.context.scene.ccdepth.tolerance == about(0.001 * math.sqrt(16 + 4 + 4))
    # On a result the size of its source counts.
    bpy.context.scene.ccdepth.tolerance_mode = "RELATIVE"
    assert bpy.ops.ccdepth.subdivide() == {"FINISHED"}
    assert bpy.context.active_object != cube
    assert text() == "≈ 0.004899 m"


def test_a_proved_distance_never_seems_beyond_the_tolerance_above_it(cube: bpy.types.Object) -> None:
    """With four digits the tolerance would be 0.003464 m, and the distance within it 0.0034641 m."""
    record, settings = cube.data.ccdepth, bpy.context.scene.ccdepth
    record.world_tolerance, record.largest_bound = 0.001 * SIZE, 0.00346405
    bound_texts = addon.module("ui.lengths").bound_texts
    texts = bound_texts(bpy.context.scene, record.largest_bound, record.world_tolerance)
    assert texts == ("0.0034641 m", "0.0034641 m")
    assert text() == "= 0.0034641 m"
    # Blender's field has six decimals.
    settings.tolerance_mode, settings.tolerance = "ABSOLUTE", 0.001 * SIZE
    assert text() == "0.0034641 m = 0.001 of the size"
    record.largest_bound, record.deviation, record.measurement.world_tolerance = 0.003, 0.00346405, 0.001 * SIZE
    settings.tolerance_mode = "RELATIVE"
    assert text() == "= 0.0034641 m"
    # A distance that is not within the tolerance needs no more digits.
    record.deviation = 0.0035
    assert text() == "= 0.003464 m"


def test_drawing_and_timers_leave_physics_alone(cube: bpy.types.Object) -> None:
    """A copy of the object would be a new body, and its cache would not hold any more."""
    bpy.ops.rigidbody.object_add()
    cube.modifiers.new("Bevel", "BEVEL")
    for frame in range(1, 21):
        bpy.context.scene.frame_set(frame)
    cache = bpy.context.scene.rigidbody_world.point_cache
    assert not cache.is_outdated
    place = cube.matrix_world.translation.z
    text()
    addon.module("state.watch").examine()
    text()
    assert not cache.is_outdated
    bpy.context.scene.frame_set(1)
    bpy.context.scene.frame_set(20)
    assert cube.matrix_world.translation.z == place


def test_the_size_is_told_at_once_among_many_objects(cube: bpy.types.Object) -> None:
    """No draw and no timer may take more than 5 ms; here of processor time, and the best of three."""
    for _ in range(3000):
        bpy.context.scene.collection.objects.link(bpy.data.objects.new("Other", cube.data))
    addon.select(cube)
    bpy.context.view_layer.update()
    for function in (addon.module("ui.tolerances").tolerance_text, lambda _: addon.module("state.watch").examine()):
        times = []
        for _ in range(3):
            started = process_time()
            function(bpy.context)
            times.append(process_time() - started)
        assert min(times) < 0.005


def test_where_there_is_no_size_the_mode_alone_is_switched(cube: bpy.types.Object) -> None:
    settings = bpy.context.scene.ccdepth
    for chosen in ([], [scene.add_light()], [scene.add_mesh(bpy.data.meshes.new("Empty"))]):
        addon.select(*chosen)
        settings.tolerance_mode = "RELATIVE"
        settings.shown_tolerance_mode = "ABSOLUTE"
        assert (settings.tolerance_mode, settings.tolerance) == ("ABSOLUTE", 0.5)
        assert text() == ""


def test_the_other_one_is_told_for_the_active_object_as_it_is(cube: bpy.types.Object) -> None:
    assert text() == "= 0.003464 m"
    # The size of what is edited is told when Edit Mode is left.
    with addon.edit_mode(cube):
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.transform.resize(value=(2.0, 2.0, 2.0))
        assert text() == ""
    assert text() == "= 0.006928 m"
    cube.scale = (2.0, 2.0, 2.0)
    assert text() == "= 0.01386 m"
    bpy.context.scene.ccdepth.tolerance_mode = "ABSOLUTE"
    assert text() == "= 0.03608 of the size"


def test_with_no_mesh_active_it_is_told_for_the_selected_meshes(cube: bpy.types.Object) -> None:
    other = scene.add_object(meshes.cube(), "Other")
    other.scale = tuple(3.0 * each / size for each, size in zip(cube.dimensions, other.dimensions, strict=True))
    light, settings = scene.add_light(), bpy.context.scene.ccdepth
    for active in (light, None):
        addon.select(cube, light)
        bpy.context.view_layer.objects.active = active
        assert text() == "= 0.003464 m"
        addon.select(cube, other, light)
        bpy.context.view_layer.objects.active = active
        assert text() == "= 0.003464–0.01039 m"
        settings.tolerance_mode = "ABSOLUTE"
        assert text() == "= 0.04811–0.1443 of the size"
        settings.tolerance_mode = "RELATIVE"
    # Of several meshes no distance is carried over, of one it is.
    settings.shown_tolerance_mode = "ABSOLUTE"
    assert settings.tolerance == 0.5
    settings.tolerance_mode = "RELATIVE"
    other.select_set(False)
    settings.shown_tolerance_mode = "ABSOLUTE"
    assert settings.tolerance == about(0.001 * SIZE)
    # Of very many it is not told.
    addon.select(*[scene.add_mesh(cube.data) for _ in range(20)])
    bpy.context.view_layer.objects.active = None
    assert text() == ""


def test_a_fraction_with_too_many_digits_for_its_field_is_told_in_full(cube: bpy.types.Object) -> None:
    for tolerance, begins in ((2e-6, "="), (2.5e-6, "2.5e-06 ="), (8.9e-7, "8.9e-07 ="), (0.001, "=")):
        bpy.context.scene.ccdepth.relative_tolerance = tolerance
        assert text().startswith(begins)


def find(*objects: bpy.types.Object, face_budget: int) -> float:
    """The tolerance found for these objects, which the scene has then."""
    addon.select(*objects)
    settings = bpy.context.scene.ccdepth
    name = "relative_tolerance" if settings.tolerance_mode == "RELATIVE" else "tolerance"
    with snapshot.unchanged(lambda path: path[0] == "scenes" and (path[-1] == name or path[-2] == "custom")):
        assert bpy.ops.ccdepth.find_tolerance(face_budget=face_budget) == {"FINISHED"}
    return float(getattr(settings, name))


def made_with(tolerance: float, *objects: bpy.types.Object) -> int:
    """How many faces the results of these objects have together."""
    mode = bpy.context.scene.ccdepth.tolerance_mode
    return sum(map(faces, subdivide(*objects, tolerance=tolerance, tolerance_mode=mode)))


MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "hills": lambda: meshes.landscape(4, 4),
    "cylinder": lambda: meshes.cylinder(32),
    "pole": lambda: meshes.fan(12, 2),
    "Suzanne": scene.suzanne,
}
PER_FACE = {"mode": "PER_FACE"}

# The tolerance mode, the tolerance before, how faces are divided, and for how many faces. The large ones are too large
# to be tried from the start; a pole may be as deep as its whole face; Suzanne herself has 500 faces.
BUDGETS: list[Any] = [
    ("hills", "RELATIVE", 1e-5, {}, 300),
    ("hills", "ABSOLUTE", 1.0, {}, 1_000),
    ("pole", "RELATIVE", 1e-3, PER_FACE, 2_000),
    ("hills", "RELATIVE", 1e-3, PER_FACE, 300),
    ("Suzanne", "RELATIVE", 1e-4, {}, 500),
    *(
        pytest.param(name, "RELATIVE", 1e-6, division, most, marks=pytest.mark.thorough)
        for most, name in ((4_000, "cylinder"), (60_000, "cylinder"), (60_000, "pole"), (60_000, "Suzanne"))
        for division in ({}, PER_FACE)
    ),
]


@pytest.mark.parametrize(("name", "mode", "start", "division", "budget"), BUDGETS)
def test_it_fits_and_a_finer_one_does_not(
    name: str, mode: str, start: float, division: dict[str, str], budget: int
) -> None:
    """Whatever the tolerance was before, with the scene's other settings; in Edit Mode as well, which stays."""
    set_scene(tolerance_mode="RELATIVE", tolerance=start, relative_tolerance=start, **division)
    holder = scene.add_object(MESHES[name]())
    holder.scale = (3.0, 3.0, 3.0)
    with addon.edit_mode(holder):
        assert bpy.ops.ccdepth.find_tolerance(face_budget=budget, tolerance_mode=mode) == {"FINISHED"}
        assert (holder.mode, bpy.context.scene.ccdepth.tolerance_mode) == ("EDIT", mode)
    tolerance = find(holder, face_budget=budget)
    counted = known_count(holder)
    assert not counted.are_too_many
    assert counted.faces == made_with(tolerance, holder) <= budget
    # A little finer there may be fewer again, so the search ends near the budget, unless faces at a pole are whole.
    is_coarse = name == "pole" and bool(division)
    assert is_coarse or counted.faces >= 0.97 * budget or made_with(tolerance / 1.1, holder) > budget


def test_a_flat_mesh_gets_the_least_tolerance_that_is_taken() -> None:
    """Its corners and its border stay where they are."""
    holder = scene.add_object(meshes.grid(2, 2))
    scene.add_subdivision(holder, 1, "PRESERVE_CORNERS")
    tolerance = find(holder, face_budget=100)
    assert tolerance < 1e-4
    assert made_with(tolerance, holder) <= 100


def test_too_few_faces_are_refused() -> None:
    message = "With any tolerance there would be more than 100 faces"
    refuses("find_tolerance", message, scene.add_suzanne(), face_budget=100)
    refuses("find_tolerance", "The Face Limit is 500; raise it first", face_budget=1000, max_faces=500)
    refuses("subdivide", "no tolerance would fit", max_faces=100)


def test_objects_that_share_a_mesh_have_one_count() -> None:
    """The result that both get, whichever is active; and none is told of one alone that was not counted so."""
    first = scene.add_object(meshes.landscape(4, 4))
    second = scene.add_mesh(first.data)
    second.scale = (0.5, 0.5, 0.5)
    set_scene(tolerance=0.02)
    addon.finish("count_faces", second)
    alone = known_count(second).faces
    addon.select(first, second)
    panel, counts = addon.module("state.chosen"), addon.module("state.known")
    settings = bpy.context.scene.ccdepth
    assert counts.count_to_make(panel.chosen(bpy.context), settings) is None
    assert bpy.ops.ccdepth.count_faces() == {"FINISHED"}
    for active in (first, second):
        bpy.context.view_layer.objects.active = active
        together = counts.count_to_make(panel.chosen(bpy.context), settings).faces
        assert together > alone
    assert (known_count(first), known_count(second).faces) == (None, alone)
    results = subdivide(first, second, tolerance=0.02)
    assert [faces(result) for result in results] == [together, together]
    assert results[0].data == results[1].data


CHANGES: tuple[Callable[[bpy.types.Object], object], ...] = (
    lambda result: move_vertex(result.ccdepth.source.data),
    lambda result: setattr(result, "scale", (2.0, 1.0, 1.0)),
    lambda result: set_scene(tolerance=2 * TOLERANCE),
)


@pytest.mark.parametrize("change", CHANGES)
def test_a_count_for_a_result_is_forgotten_when_something_changes(change: Callable[[bpy.types.Object], None]) -> None:
    source, result = made_result()
    source.hide_set(False)
    addon.finish("count_faces", result)
    assert known_count(result) is not None
    change(result)
    assert known_count(result) is None


def test_the_limit_is_for_all_objects_together(capfd: pytest.CaptureFixture[str]) -> None:
    """And so is the tolerance that is found."""
    objects = [scene.add_object(meshes.landscape(2, 2), "Hills"), scene.add_object(meshes.cube(), "Cube")]
    objects[1].scale = (2.0, 2.0, 2.0)
    set_scene(tolerance_mode="RELATIVE", relative_tolerance=TOLERANCE)
    count = made_with(TOLERANCE, *objects)
    for each in objects:
        each.hide_set(False)
    most = count - 1
    set_scene(max_faces=most)
    refuses("subdivide", "The 2 results together .* are allowed; Find Tolerance finds one that fits", *objects)
    assert bpy.ops.ccdepth.count_faces() == {"FINISHED"}
    assert f"The 2 results together would have about {count:,} faces" in capfd.readouterr().out
    assert most / 2 < made_with(find(*objects, face_budget=most), *objects) <= most
