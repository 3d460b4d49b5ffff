# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad input gets a clear report, and changes nothing, not even on the good objects selected with it. Faces that have no
surface are found and taken away; those without area are faces like others."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import refuses, subdivide
from tests.blender.updating import set_scene
from tests.thorough import combinations

pytestmark = pytest.mark.every_blender

MAKERS = ("compute", "subdivide", "count_faces")
ALL = (*MAKERS, "measure")
NAN, INF = float("nan"), float("inf")


@dataclass(frozen=True)
class Refusal:
    """make: makes and returns the object or the objects to select, the active one last, or selects them itself.
    operators: to which a good object is given as well, but to Measure Deviation. match: what each of them says."""

    make: Callable[[], Any]
    match: str
    operators: tuple[str, ...] = MAKERS
    settings: dict[str, object] = field(default_factory=dict)


def cube(name: str = "Cube", modifier: str = "", size: float = 1.0) -> bpy.types.Object:
    holder = scene.add_object(meshes.cube(), name)
    holder.scale = (size, size, size)
    if modifier:
        holder.modifiers.new(modifier.title(), modifier)
    return holder


def empty(name: str = "Empty") -> bpy.types.Object:
    return scene.add_mesh(bpy.data.meshes.new(name))


def wire() -> bpy.types.Object:
    holder = empty("Wire")
    holder.data.from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
    return holder


def nowhere(value: float) -> bpy.types.Object:
    """Suzanne with a coordinate that is no finite number."""
    holder = scene.add_suzanne()
    scene.put_nowhere(holder, 16, value)
    return holder


def with_repeated_vertices(*faces: int) -> bpy.types.Object:
    """A landscape some of whose faces visit a vertex twice."""
    holder = scene.add_object(meshes.landscape(4, 3), "Scan")
    for face in faces:
        first = holder.data.polygons[face].loop_start
        holder.data.loops[first + 1].vertex_index = holder.data.loops[first].vertex_index
    return holder


def points_of_one_mesh() -> list[bpy.types.Object]:
    """Two objects of a mesh without extent: a division by it would print a warning."""
    mesh = cube("Point").data
    mesh.vertices.foreach_set("co", np.ones(3 * len(mesh.vertices), dtype=np.float32))
    return [scene.add_mesh(mesh), scene.add_mesh(mesh)]


def with_attribute(name: str, data_type: str, domain: str) -> bpy.types.Object:
    """With a fifth value that is no number, where there is such a thing."""
    holder = cube()
    # Only smooth faces have normals to store.
    holder.data.shade_smooth()
    attribute = holder.data.attributes.new(name, data_type, domain)
    if data_type == "FLOAT":
        attribute.data[5].value = NAN
    return holder


def with_odd_key(value: float) -> bpy.types.Object:
    holder = cube()
    key = scene.add_key(holder, "Odd")
    key.data.foreach_set("co", np.full(3 * len(key.data), value, dtype=np.float32))
    return holder


def hollow() -> bpy.types.Object:
    holder = cube("Hollow", "MASK")
    holder.modifiers[0].vertex_group = holder.vertex_groups.new(name="Nothing").name
    return holder


def with_results() -> bpy.types.Object:
    holder = cube()
    addon.compute(holder)
    addon.measure(holder, time_limit=0.1)
    return holder


def edited_since() -> bpy.types.Object:
    """With results for another number of faces."""
    holder = with_results()
    with addon.edit_mode(holder):
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.mesh.subdivide()
    return holder


def put_away(way: str) -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    if way == "excluded":
        scene.add_collection("Excluded", holder, alone=True)
        addon.select(holder)
        bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True
    elif way == "hidden":
        holder.hide_set(True)
    else:
        holder.hide_viewport = True


def none_active() -> None:
    addon.select(cube(), cube(), cube())
    bpy.context.view_layer.objects.active.select_set(False)


def edited_without_faces() -> None:
    holder = scene.add_suzanne()
    addon.select(holder, mode="EDIT")
    edited = bmesh.from_edit_mesh(holder.data)
    bmesh.ops.delete(edited, geom=edited.faces[:], context="FACES_ONLY")


MEASURE, COMPUTE = ("measure",), ("compute",)
# Blender takes the last one for infinity.
TOLERANCES = {
    **dict.fromkeys((0.0, -0.1), "greater than zero"),
    **dict.fromkeys((NAN, INF, 1e39), "not a finite number|too large"),
}
TAKEN = "Cube: .*called “{}”"
SHOWN_NOWHERE = "Suzanne: it shows 1 vertex at no finite position"
REFUSALS: dict[str, Refusal] = {
    **{
        f"{mode} tolerance {value}": Refusal(cube, match, ALL, {"tolerance": value, "tolerance_mode": mode})
        for mode in ("ABSOLUTE", "RELATIVE")
        for value, match in TOLERANCES.items()
    },
    "too fine": Refusal(cube, "Cube: the tolerance .* is finer than the mesh's", settings={"tolerance": 1e-12}),
    "no tolerance in the scene": Refusal(lambda: set_scene(relative_tolerance=0.0) or cube(), "greater than zero"),
    **{f"accuracy {x}": Refusal(cube, "The accuracy must be", MEASURE, {"accuracy": x}) for x in (0.0, -1.0, NAN)},
    "in Edit Mode, which stays": Refusal(
        lambda: addon.select(cube(), mode="EDIT"), "greater than zero", ALL, {"tolerance": 0.0}
    ),
    "results from before stay": Refusal(with_results, "greater than zero", ALL, {"tolerance": 0.0}),
    "nothing selected": Refusal(addon.select, "Select a mesh object", ALL),
    "no mesh": Refusal(lambda: addon.select(scene.add_light()), "Select a mesh object", ALL),
    "another mode": Refusal(lambda: addon.select(cube(), mode="SCULPT"), "Object Mode and in Edit Mode", ALL),
    "hidden": Refusal(lambda: put_away("hidden"), "Suzanne: the object is hidden", ALL),
    "hidden in viewports": Refusal(
        lambda: put_away("viewport"), "Suzanne: the object is hidden|Select a mesh object", ALL
    ),
    "excluded": Refusal(lambda: put_away("excluded"), "Select a mesh object", ALL),
    "none of several is active": Refusal(none_active, "none is active", MEASURE),
    "no faces": Refusal(empty, "Empty: the mesh has no faces"),
    "a wire": Refusal(wire, "Wire: the mesh has no faces"),
    "no faces in Edit Mode": Refusal(edited_without_faces, "Suzanne: the mesh has no faces", COMPUTE),
    "no faces after the modifiers": Refusal(
        hollow, "Hollow: its modifiers leave no faces of the mesh", ("compute", "subdivide")
    ),
    "not a number": Refusal(lambda: nowhere(NAN), "Suzanne: 1 vertex at no finite position"),
    "infinite": Refusal(lambda: nowhere(INF), "Suzanne: 1 vertex at no finite position"),
    "a repeated vertex": Refusal(lambda: with_repeated_vertices(0), "Scan: 1 face with a repeated vertex"),
    "scaled to a point": Refusal(lambda: cube("Flat", size=0.0), "Flat: all its faces are at one point"),
    "no extent": Refusal(points_of_one_mesh, "Point.*all its faces are at one point"),
    "a group with our name": Refusal(lambda: cube().vertex_groups.new(name="ccdepth").id_data, TAKEN.format("ccdepth")),
    "an attribute with our name": Refusal(
        lambda: with_attribute("ccdepth", "FLOAT", "POINT"), TAKEN.format("ccdepth")
    ),
    **{
        f"{data_type} of {domain} with the name of deviations": Refusal(
            lambda data_type=data_type, domain=domain: with_attribute("ccdepth_deviation", data_type, domain),
            TAKEN.format("ccdepth_deviation"),
            ("compute", "measure"),
        )
        for data_type, domain in (("INT", "FACE"), ("FLOAT", "POINT"))
    },
    "a simulation": Refusal(lambda: cube(modifier="CLOTH"), "Cube: .*“Cloth” is a simulation", ALL),
    "an edge crease that is no number": Refusal(
        lambda: with_attribute("crease_edge", "FLOAT", "EDGE"),
        r"Cube: 1 edge with a crease that is not a number \(first: edge 5\)",
    ),
    "a vertex crease that is no number": Refusal(
        lambda: with_attribute("crease_vert", "FLOAT", "POINT"), r"Cube: 1 vertex .* not a number \(first: vertex 5\)"
    ),
    **{
        # Though it is not mixed in.
        f"a shape key at {value}": Refusal(
            lambda value=value: with_odd_key(value),
            "Cube: .*the shape key “Odd” has a vertex at no finite position",
            ("subdivide",),
        )
        for value in (NAN, INF)
    },
    "every bad object": Refusal(
        lambda: [nowhere(NAN), empty()], r"(?s)Suzanne: 1 vertex.*Empty: the mesh has no faces", COMPUTE
    ),
    # Measured
    "shows no faces": Refusal(empty, "Empty: the object shows no faces", MEASURE),
    "no faces on one": Refusal(lambda: [empty("Measured"), cube()], "Measured: the object shows no faces", MEASURE),
    "no surface": Refusal(lambda: [cube(), empty("Target")], "Target: the mesh has no faces", MEASURE),
    "modifiers leave no faces": Refusal(lambda: [hollow(), cube()], "Hollow: the object shows no faces", MEASURE),
    "shows no number": Refusal(lambda: nowhere(NAN), SHOWN_NOWHERE, MEASURE),
    "shows infinity": Refusal(lambda: [nowhere(INF), cube()], SHOWN_NOWHERE, MEASURE),
    "infinite surface": Refusal(
        lambda: [cube(), nowhere(-INF)], "Suzanne: 1 vertex at no finite position", MEASURE
    ),
    "surface without extent": Refusal(
        lambda: [cube(), cube("Flat", size=0.0)], "Flat: all its faces are at one point", MEASURE
    ),
    "every object that shows nothing": Refusal(
        lambda: [empty("First"), empty("Second"), cube()], "(?s)First: .*Second: ", MEASURE
    ),
    "no faces to look at": Refusal(empty, "Empty: the mesh has no faces", ("select_invalid",)),
    "no depths": Refusal(cube, "Compute Depth first", ("select",), {"depth": 1}),
    "no measurement": Refusal(cube, "Measure Deviation first", ("select_worst",)),
    "edited since": Refusal(edited_since, "the mesh has changed; measure it again", ("select_worst",)),
}  # fmt: skip
CASES = [
    pytest.param(refusal, operator, id=f"{name}, {operator}")
    for name, refusal in REFUSALS.items()
    for operator in refusal.operators
]


@pytest.mark.parametrize(("refusal", "operator"), CASES)
def test_bad_input_is_refused_and_changes_nothing(refusal: Refusal, operator: str) -> None:
    objects = refusal.make()
    if objects:
        good = [cube("Good")] if operator in MAKERS else []
        addon.select(*good, *(objects if isinstance(objects, list) else [objects]))
    refuses(operator, refusal.match, **refusal.settings)
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def test_hidden_objects_that_a_script_names_are_refused() -> None:
    shown, hidden = cube("Shown"), cube("Hidden")
    addon.select(shown)
    hidden.hide_set(True)
    with bpy.context.temp_override(selected_objects=[shown, hidden], active_object=shown):
        refuses("subdivide", "Hidden: the object is hidden; show it first")


def test_an_object_that_could_not_be_edited_again_stays_in_edit_mode() -> None:
    hidden, other = cube("Hidden"), cube("Other")
    with addon.edit_mode(hidden, other):
        hidden.hide_viewport = True
        refuses("count_faces", "Hidden: it is edited while it is hidden")
        assert (hidden.mode, other.mode) == ("EDIT", "EDIT")
        hidden.hide_viewport = False


def test_other_objects_among_the_selected_and_a_loose_vertex_nowhere_do_not_matter() -> None:
    light, holder = scene.add_light(), cube()
    addon.compute(holder, light)
    assert holder.data.ccdepth.has_result
    data = meshes.cube()
    positions = np.concatenate([data.positions, [[NAN, 0.0, 0.0]]])
    holder = scene.add_object(meshes.MeshData(positions, data.face_sizes, data.corner_vertices))
    addon.measure(holder, time_limit=0.1)
    assert holder.data.ccdepth.has_deviation


@pytest.mark.parametrize(("output", "reduce"), combinations(["NEW_OBJECT", "IN_PLACE"], [False, True]))
def test_faces_without_area_are_subdivided(output: str, reduce: bool) -> None:
    holder = scene.add_object(meshes.with_collapsed_faces(meshes.landscape(5, 4)))
    addon.compute(holder, tolerance=0.01)
    assert addon.bounds(holder).max() <= 0.01
    [result] = subdivide(holder, tolerance=0.01, output=output, reduce=reduce, exact_normals=True)
    assert result.data.validate() is False
    assert np.isfinite(scene.mesh_data(result.data).positions).all()


@pytest.mark.parametrize("scale", [(1.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
def test_flattened_objects(scale: tuple[float, float, float]) -> None:
    holder = scene.add_object(meshes.torus(8, 6), "Flat")
    holder.scale = scale
    addon.compute(holder, tolerance=0.1)
    addon.measure(holder, tolerance=0.1)
    [result] = subdivide(holder, tolerance=0.1)
    addon.measure(result, holder, tolerance=0.1)
    assert result.data.ccdepth.deviation_reached <= 0.1


def test_the_report_names_the_remedy_which_selects_what_was_refused() -> None:
    holder = with_repeated_vertices(2, 7)
    scene.put_nowhere(holder, 3 * 19)
    refuses(
        "compute",
        r"(?s)Scan: 1 vertex at no finite position \(first: vertex 19\), 2 faces with a repeated vertex "
        r"\(first: face 2\).*Select Invalid Faces.*Repair Mesh",
        holder,
    )
    assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
    assert scene.selected_faces(holder) == [2, 7, 11]
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert scene.selected_faces(holder) == [2, 7, 11]


def test_selects_in_edit_mode_and_what_is_left_is_accepted() -> None:
    holder = scene.add_object(meshes.landscape(4, 3))
    scene.put_nowhere(holder, 3 * 6)
    with addon.edit_mode(holder):
        refuses("compute", "1 vertex at no finite position")
        assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
        edited = bmesh.from_edit_mesh(holder.data)
        assert [face.index for face in edited.faces if face.select] == [0, 1, 4, 5]
        bpy.ops.mesh.delete(type="FACE")
        assert bpy.ops.ccdepth.compute() == {"FINISHED"}
    assert holder.data.ccdepth.faces == 8


def test_selects_on_several_objects_and_leaves_the_others_alone() -> None:
    first, second = with_repeated_vertices(3), with_repeated_vertices(0, 5)
    good = scene.add_object(meshes.cube(), "Good")
    before = scene.selected_faces(good)
    # Another object that uses the mesh is no other mesh.
    refuses("compute", r"(?s)Scan: 1 face.*Scan\.001: 2 faces", first, scene.add_mesh(first.data), second, good)
    assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
    assert [scene.selected_faces(each) for each in (first, second, good)] == [[3], [0, 5], before]


def mask_all_but(holder: bpy.types.Object, face: int) -> None:
    holder.vertex_groups.new(name=f"Face {face}").add([*holder.data.polygons[face].vertices], 1.0, "REPLACE")
    holder.modifiers.new("Mask", "MASK").vertex_group = f"Face {face}"


def test_selects_what_is_invalid_in_any_object_of_a_mesh() -> None:
    """Of each all faces but one are masked."""
    first = scene.add_object(meshes.landscape(4, 3))
    holders = [first, scene.add_mesh(first.data)]
    for holder, face, vertex in zip(holders, (0, 11), (0, 19), strict=True):
        mask_all_but(holder, face)
        scene.put_nowhere(first, 3 * vertex)
    refuses("compute", "1 vertex at no finite position", *holders)
    assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
    assert scene.selected_faces(first) == [0, 11]


def test_faces_that_modifiers_repeat_and_those_that_lose_an_edge_to_one() -> None:
    """Blender takes away the edge that the repeated vertex had."""
    holder = with_repeated_vertices(3)
    holder.modifiers.new("Array", "ARRAY").count = 3
    refuses("compute", "3 faces with a repeated vertex", holder)
    assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
    assert scene.selected_faces(holder) == [3]
    masked = with_repeated_vertices(0)
    mask_all_but(masked, 0)
    refuses("compute", "1 face with a repeated vertex", masked)


def test_hidden_faces_stay_hidden() -> None:
    holder = with_repeated_vertices(2, 7)
    for face in holder.data.polygons:
        face.hide = face.index == 2
    addon.finish("select_invalid", holder)
    assert scene.selected_faces(holder) == [7]
    holder.data.polygons[7].hide = True
    assert bpy.ops.ccdepth.select_invalid() == {"CANCELLED"}
    assert holder.data.polygons[2].hide


def test_nothing_is_invalid() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    before = scene.selected_faces(holder)
    for operator in (bpy.ops.ccdepth.select_invalid, bpy.ops.ccdepth.repair):
        assert operator() == {"CANCELLED"}
        assert scene.selected_faces(holder) == before


@pytest.mark.parametrize("missing", [1000, -1])
def test_corners_and_edges_at_no_vertex_are_refused(missing: int) -> None:
    """As files have them that were written wrongly."""
    holder, other = (scene.add_object(meshes.landscape(4, 3)) for _ in range(2))
    for corner in holder.data.attributes[".corner_vert"].data[:2]:
        corner.value = missing
    refuses("compute", "2 corners of faces at vertices that the mesh does not have", holder)
    other.data.attributes[".edge_verts"].data[0].value = (0, missing)
    refuses("compute", "1 ends of edges at vertices that the mesh does not have", other)


def test_the_panel_knows_until_a_run_goes_well() -> None:
    known = addon.module("state.known")
    holder = with_repeated_vertices(2, 7)
    refuses("compute", "Scan", holder)
    assert known.faces_at_fault(holder.data) == 2
    bpy.ops.ccdepth.select_invalid()
    addon.compute(scene.add_suzanne())
    assert known.faces_at_fault(holder.data) == 0


def test_vertices_at_no_finite_position_are_moved_to_the_origin(capfd: pytest.CaptureFixture[str]) -> None:
    """Also where no face is removed, and where a single coordinate is not finite."""
    holder = scene.add_object(meshes.landscape(4, 3))
    scene.put_nowhere(holder, 1)
    addon.finish("repair", holder)
    assert "0 faces removed, 1 vertex moved to the origin" in capfd.readouterr().out
    assert scene.read(holder.data, "position")[0].tolist() == [0.0, 0.0, 0.0]


def test_repaired_meshes_are_accepted_and_keep_their_attributes() -> None:
    holder, good = with_repeated_vertices(2, 7), scene.add_object(meshes.pillow(4), "Good")
    scene.put_nowhere(holder, 3 * 0)
    numbers = holder.data.attributes.new("number", "INT", "FACE").data
    numbers.foreach_set("value", range(12))
    refuses("compute", "Scan", holder, good)
    assert bpy.ops.ccdepth.repair() == {"FINISHED"}
    kept = [value.value for value in holder.data.attributes["number"].data]
    assert kept == [0, 1, 3, 4, 5, 6, 8, 9, 10, 11]
    # Blender takes one of two equal faces for a fault; meshes without one of ours stay as they are.
    assert len(good.data.polygons) == 2
    addon.compute(holder, good)
    with addon.edit_mode(with_repeated_vertices(2)), pytest.raises(RuntimeError, match="Object Mode"):
        bpy.ops.ccdepth.repair()
