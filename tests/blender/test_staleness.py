# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels show depths, deviations and adaptive results as out of date when what they depend on has changed."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from time import process_time
from typing import Any, Self

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import refuses
from tests.blender.updating import move_vertex, set_scene, stale_line

pytestmark = pytest.mark.every_blender

SETTINGS_LINE = "Out of date: settings changed"
ALL = "depths own other result"


def mesh_line(holder: bpy.types.Object) -> str:
    """What the panels show when the object's mesh, or an object that uses it, was changed."""
    return f"Out of date: mesh “{holder.data.name}” changed"


@dataclass
class Made:
    """A source with depths, and with its deviation from its own limit surface; another object that was measured against
    that surface; and an adaptive result of the source."""

    source: bpy.types.Object
    other: bpy.types.Object
    result: bpy.types.Object

    def lines(self) -> dict[str, str]:
        """What the panels show of each kind that is out of date."""
        addon.examine_touched()
        settings = bpy.context.scene.ccdepth
        depths, deviations = addon.module("ui.panels").stale_line, addon.module("ui.deviation_panel").stale_line
        lines = {
            "depths": depths(settings, self.source.data),
            "own": deviations(settings, self.source.data),
            "other": deviations(settings, self.other.data),
            "result": depths(settings, self.result.data, self.result),
        }
        return {kind: line for kind, line in lines.items() if line}

    @classmethod
    def found(cls) -> Self:
        """By name, in the present file."""
        return cls(*(bpy.data.objects[name] for name in ("Source", "Other", "Source Adaptive")))


def stale(kinds: str, line: str = "", *, own: str = "“Source” changed", other: str = "") -> dict[str, str]:
    """What the panels show of these kinds: one line, or what each says when its mesh or that of its source changed.

    own, other: what has happened to the source as measured against itself, and to the two objects.
    """
    lines = {"depths": "mesh “Mesh” changed", "own": own, "other": other or own, "result": "“Source” changed"}
    return {kind: line or f"Out of date: {lines[kind]}" for kind in kinds.split()}


def made_of(source: bpy.types.Object, **settings: object) -> Made:
    """Everything about a source, made with the scene's settings."""
    source.name = "Source"
    set_scene(**{"tolerance": 0.05, "relative_tolerance": 0.01, "accuracy": 0.5, "time_limit": 0.01, **settings})
    for operator in ("subdivide", "compute", "measure"):
        addon.finish(operator, source)
    result = bpy.data.objects["Source Adaptive"]
    other = scene.add_object(scene.evaluated_mesh_data(source), "Other")
    other.modifiers.new("Triangulate", "TRIANGULATE")
    addon.finish("measure", other, source)
    made = Made(source, other, result)
    assert made.lines() == {}
    return made


def creased_source() -> bpy.types.Object:
    ring = meshes.torus(4, 3)
    holder = scene.add_object(meshes.creased(ring, {tuple(ring.edges[0].tolist()): 0.3}))
    mirror = holder.modifiers.new("Mirror", "MIRROR")
    mirror.use_mirror_merge = False
    scene.add_subdivision(holder, 2)
    holder.vertex_groups.new(name="Group")
    holder.data.uv_layers.new(name="Map")
    holder.data.materials.append(bpy.data.materials.new("Red"))
    return holder


@pytest.fixture
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Everything about a creased source, made once, and opened by each test."""
    path = tmp_path_factory.getbasetemp() / "made.blend"
    if not path.exists():
        made_of(creased_source())
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return Made.found()


def fill(holder: bpy.types.Object, name: str, values: float, kind: tuple[str, str] | None = None) -> None:
    """Set all values of an attribute, which is new when its type and domain are given."""
    attribute = holder.data.attributes.new(name, *kind) if kind else holder.data.attributes[name]
    attribute.data.foreach_set("value", [values] * len(attribute.data))
    holder.data.update()


def set_on(*holders: Any, **values: object) -> None:
    for holder in holders:
        for name, value in values.items():
            setattr(holder, name, value)


def edit(holder: bpy.types.Object, *operators: Callable[..., object]) -> None:
    """Call operators of Edit Mode on all that is selected."""
    with addon.edit_mode(holder):
        bpy.ops.mesh.select_all(action="SELECT")
        for operator in operators:
            operator()


def add_a_crease_group(holder: bpy.types.Object) -> None:
    """Of no weights, as with the button: Blender tells nobody of groups that scripts make."""
    with bpy.context.temp_override(object=holder, active_object=holder):
        bpy.ops.object.vertex_group_add()
    holder.vertex_groups[-1].name = "crease_edge"


# What is out of date afterwards.
CHANGES: dict[str, tuple[Callable[[Made], object], str]] = {
    "a vertex of the source": (lambda made: move_vertex(made.source.data), ALL),
    "a vertex of the other object": (lambda made: move_vertex(made.other.data), "other"),
    "creases of edges": (lambda made: fill(made.source, "crease_edge", 0.9), ALL),
    "the crease of an edge": (
        lambda made: set_on(made.source.data.attributes["crease_edge"].data[0], value=0.6) or made.source.data.update(),
        ALL,
    ),
    "creases of vertices": (lambda made: fill(made.source, "crease_vert", 0.5, ("FLOAT", "POINT")), ALL),
    "creases of another kind": (lambda made: fill(made.source, "crease_vert", 1, ("INT", "FACE")), ALL),
    "creases of zero": (lambda made: fill(made.source, "crease_vert", 0, ("FLOAT", "POINT")), ""),
    "a group like creases": (lambda made: add_a_crease_group(made.source), ALL),
    "a renamed group": (lambda made: set_on(made.source.vertex_groups["Group"], name="crease_vert"), ALL),
    "all faces turned over": (lambda made: made.source.data.flip_normals(), ALL),
    "one face turned over": (lambda made: made.source.data.polygons[0].flip() or made.source.data.update(), ALL),
    "new faces": (lambda made: edit(made.source, bpy.ops.mesh.subdivide), ALL),
    "the scale of the source": (lambda made: set_on(made.source, scale=(1.001, 1.0, 1.0)), "depths own other"),
    "the scale of both": (lambda made: set_on(made.source, made.other, scale=(2, 2, 2)), "depths own other"),
    "a modifier": (lambda made: set_on(made.source.modifiers["Mirror"], use_axis=(True, True, False)), ALL),
    "no modifier": (lambda made: made.source.modifiers.remove(made.source.modifiers["Mirror"]), ALL),
    "a modifier of the other object": (lambda made: made.other.modifiers.new("Solidify", "SOLIDIFY"), "other"),
    "no creases": (lambda made: set_on(made.source.modifiers["Subdivision"], use_creases=False), ALL),
    "corners": (lambda made: set_on(made.source.modifiers["Subdivision"], boundary_smooth="PRESERVE_CORNERS"), ALL),
    "levels": (lambda made: set_on(made.source.modifiers["Subdivision"], levels=1), "own"),
    "depths": (lambda made: fill(made.source, "ccdepth", 9), "depths"),
    "deviations of the source": (lambda made: fill(made.source, "ccdepth_deviation", 0.0), "own"),
    "deviations of the other object": (lambda made: fill(made.other, "ccdepth_deviation", 0.0), "other"),
    "depths computed again": (lambda made: addon.compute(made.source), ""),
    "the place of the source": (lambda made: set_on(made.source, location=(0, 0.001, 0)), "other"),
    "the place of the other object": (lambda made: set_on(made.other, location=(0, 0.001, 0)), "other"),
    "the place of both": (
        lambda made: set_on(made.source, made.other, location=(5, 1, 2), rotation_euler=(0.4, 1.0, -0.3)),
        "",
    ),
    "the name of the source": (lambda made: set_on(made.source, name="Renamed"), ""),
    "the name of the other object": (lambda made: set_on(made.other, name="Renamed"), ""),
    "selection": (lambda made: edit(made.source, bpy.ops.mesh.hide), ""),
    "attributes of zeros": (lambda made: made.source.data.attributes.new("Zeros", "FLOAT", "POINT"), ""),
    "a UV map": (lambda made: made.source.data.uv_layers.new(name="Other").id_data.update(), "result"),
    "an attribute": (lambda made: fill(made.source, "Paint", 0.5, ("FLOAT", "FACE")), "result"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_changes_are_noticed_where_they_matter(change: str, made: Made) -> None:
    assert made.lines() == {}
    act, kinds = CHANGES[change]
    act(made)
    if change.startswith("the place"):
        lines = stale(kinds, other="objects were moved")
    elif change.startswith("the scale"):
        lines = stale(kinds, own="“Source” was scaled")
    else:
        lines = stale(kinds, other="“Other” changed" if "the other object" in change else "")
    assert made.lines() == lines


def test_what_was_changed_is_changed_back_or_computed_anew(made: Made) -> None:
    before = made.source.data.vertices[0].co.copy()
    move_vertex(made.source.data)
    assert made.lines() == stale(ALL)
    made.source.data.vertices[0].co = before
    made.source.data.update()
    assert made.lines() == {}
    move_vertex(made.source.data)
    addon.compute(made.source)
    assert made.lines() == stale("own other result")
    bpy.ops.ccdepth.measure()
    assert made.lines() == stale("other result")
    addon.finish("measure", made.other, made.source)
    assert made.lines() == stale("result")
    bpy.ops.ccdepth.update()
    assert made.lines() == {}


def delete(holder: bpy.types.Object) -> None:
    """As a user does; records may keep the object in the file."""
    addon.select(holder)
    bpy.ops.object.delete()


@pytest.mark.parametrize("remove", [lambda holder: bpy.data.objects.remove(holder), delete])
def test_a_source_may_be_gone(remove: Callable[[bpy.types.Object], object], made: Made) -> None:
    """What was measured against it is out of date then, and of its result only edits of its own are told."""
    remove(made.source)
    made.other.update_tag()
    made.source = made.other
    lines = made.lines()
    assert (lines["other"], lines.get("result")) == ("Out of date: “Source” was removed", None)
    move_vertex(made.result.data)
    can_be_updated = made.result.ccdepth.source is not None
    edited = "Result edited; Update keeps your version" if can_be_updated else mesh_line(made.result)
    assert made.lines()["result"] == edited


def test_renamed_objects_are_told_by_their_names(made: Made, tmp_path: Path) -> None:
    """Of a measurement, also after the file was loaded again."""
    made.source.name, made.other.name = "Surface", "Measured"
    scene.open_again(tmp_path)
    other = bpy.data.objects["Measured"]
    assert addon.module("ui.deviation_panel")._pair(other) == ("Measured", "Surface")
    addon.select(other, bpy.data.objects["Surface"])
    assert addon.module("state.still_holds").measured_to_show(bpy.context) == other
    assert Made(bpy.data.objects["Surface"], other, bpy.data.objects["Source Adaptive"]).lines() == {}


def test_groups_that_are_taken_for_creases_are_noticed_by_operators() -> None:
    """Compute Depth refuses them, so that what it found before does not hold either; and operators that rely on results
    examine them, as Blender tells nobody of groups that scripts make."""
    holder = creased_source()
    addon.compute(holder)
    holder.vertex_groups.new(name="crease_edge")
    refuses("set_levels", "out of date")
    assert stale_line(holder) == mesh_line(holder)
    refuses("compute", "takes for creases")
    holder.vertex_groups["crease_edge"].name = "Other"
    assert stale_line(holder) == ""


SETTINGS: tuple[tuple[str, object, str], ...] = (
    ("tolerance_mode", None, ALL),
    ("method", "FIRST_ORDER", ""),
    ("vertices", "LIMIT", "depths"),
    ("use_modifiers", False, ALL),
    ("accuracy", 0.2, "own other"),
    ("mode", "PER_FACE", "result"),
    ("exact_normals", True, "result"),
    ("reduce", True, "result"),
    ("max_faces", 1234, ""),
    ("output", "IN_PLACE", ""),
    ("time_limit", 9.0, ""),
)


@pytest.mark.parametrize(("mode", "other"), [("ABSOLUTE", "RELATIVE"), ("RELATIVE", "ABSOLUTE")])
def test_settings_are_noticed_where_they_matter(mode: str, other: str) -> None:
    made = made_of(creased_source(), tolerance_mode=mode)
    relative = mode == "RELATIVE"
    tolerances = (("tolerance", 0.06, "" if relative else ALL), ("relative_tolerance", 0.02, ALL if relative else ""))
    settings = bpy.context.scene.ccdepth
    for name, value, kinds in (*SETTINGS, *tolerances):
        before = getattr(settings, name)
        setattr(settings, name, other if name == "tolerance_mode" else value)
        assert made.lines() == stale(kinds, SETTINGS_LINE), name
        setattr(settings, name, before)
        assert made.lines() == {}, name


def test_depths_of_a_result_do_not_tell_whether_it_is_out_of_date(made: Made) -> None:
    """Neither those computed of the result itself, nor their removal."""
    result = made.result
    line, settings = addon.module("ui.panels").result_line, bpy.context.scene.ccdepth
    addon.select(result)
    assert line(settings, result) == ""
    settings.tolerance *= 2
    assert line(settings, result) == SETTINGS_LINE
    bpy.ops.ccdepth.compute()
    assert line(settings, result) == SETTINGS_LINE
    settings.tolerance /= 2
    bpy.ops.ccdepth.clear()
    assert line(settings, result) == ""


def modified(holder: bpy.types.Object, kind: str, **settings: object) -> bpy.types.Modifier:
    set_on(modifier := holder.modifiers.new("Modifier", kind), **settings)
    return modifier


def posed(holder: bpy.types.Object) -> bpy.types.Object:
    holder.vertex_groups.new(name="Bone").add(range(3), 1.0, "REPLACE")
    return modified(holder, "ARMATURE", object=scene.add_rig()).object


def keyed(holder: bpy.types.Object, value: float = 0.0) -> bpy.types.ShapeKey:
    key = scene.add_key(holder, value=value)
    key.data[0].co.x += 1.0
    return key


def weigh(holder: bpy.types.Object, group: str) -> None:
    """Change weights as painting does."""
    holder.vertex_groups[group].add(range(3), 0.25, "REPLACE")
    holder.data.update()


def moved_by_an_attribute(holder: bpy.types.Object) -> bpy.types.Object:
    fill(holder, "Offset", 0.0, ("FLOAT", "POINT"))
    tree = scene.node_tree("GeometryNodeSetPosition")
    named = tree.nodes.new("GeometryNodeInputNamedAttribute")
    named.inputs["Name"].default_value = "Offset"
    tree.links.new(named.outputs["Attribute"], tree.nodes["Set Position"].inputs["Offset"])
    return modified(holder, "NODES", node_group=tree).id_data


def cut(holder: bpy.types.Object, operand_type: str) -> bpy.types.Object:
    """The object that is taken away."""
    cutter = scene.add_object(meshes.cube(), "Cutter")
    cutter.location = (1.5, 0.5, 0.25)
    collection = scene.add_collection("Cutters", cutter)
    modified(holder, "BOOLEAN", operand_type=operand_type, object=cutter, collection=collection)
    return cutter


def bent(holder: bpy.types.Object) -> bpy.types.Curve:
    path = modified(holder, "CURVE", object=scene.add("Path", bpy.data.curves.new("Path", "CURVE"))).object.data
    path.splines.new("POLY").points.add(2)
    path.splines[0].points.foreach_set("co", [0, 0, 0, 1, 1, 0, 0, 1, 2, 0, 0, 1])
    return path


def displaced_by_an_image(holder: bpy.types.Object, **settings: str) -> bpy.types.Image:
    texture = bpy.data.textures.new("Image", "IMAGE")
    texture.image = bpy.data.images.new("Image", 8, 8)
    modified(holder, "DISPLACE", texture=texture, **settings)
    return texture.image


def paint(image: bpy.types.Image) -> None:
    image.pixels.foreach_set([0.75] * len(image.pixels))
    image.update_tag()


def scaled_by_nodes(holder: bpy.types.Object) -> bpy.types.Modifier:
    """Geometry Nodes that scale by their input, within a node group of their own."""
    inner, outer = scene.node_tree("GeometryNodeTransform"), scene.node_tree()
    inner.name = "Inner"
    outer.nodes.new("GeometryNodeGroup").node_tree = inner
    for tree in (inner, outer):
        tree.interface.new_socket("Scale", in_out="INPUT", socket_type="NodeSocketVector").default_value = (1, 1, 1)
        start, end = tree.nodes["Group Input"], tree.nodes["Group Output"]
        [node] = {*tree.nodes} - {start, end}
        for name in ("Geometry", "Scale"):
            tree.links.new(start.outputs[name], node.inputs[name])
        tree.links.new(node.outputs["Geometry"], end.inputs["Geometry"])
    return modified(holder, "NODES", node_group=outer)


def set_an_input(nodes: bpy.types.Modifier) -> None:
    if hasattr(nodes, "properties"):
        nodes.properties.inputs.Socket_2.value = (1.0, 2.0, 1.0)
    else:
        nodes["Socket_2"] = (1.0, 2.0, 1.0)
    nodes.id_data.update_tag()


def set_and_tell(holder: Any, *updates: Any, **values: object) -> None:
    """Set what Blender does not notice by itself."""
    set_on(holder, **values)
    for update in updates:
        update()


# What is made on a cube, and how it is changed then.
SHAPED: dict[str, tuple[Callable[[bpy.types.Object], Any], Callable[[Any], object]]] = {
    "an armature": (posed, lambda rig: set_on(rig.pose.bones["Bone"], location=(0.5, 0.0, 0.0))),
    "a shape key": (keyed, lambda key: set_on(key, value=0.5)),
    "an object": (
        lambda holder: modified(holder, "MIRROR", mirror_object=scene.add("Axis")).mirror_object,
        lambda axis: set_on(axis, location=(0.5, 0.0, 0.0)),
    ),
    "a collection": (
        lambda holder: cut(holder, "COLLECTION"),
        lambda cutter: set_on(cutter, location=(1.5, 0.0, 0.25)),
    ),
    "a texture": (
        lambda holder: modified(holder, "DISPLACE", texture=bpy.data.textures.new("Clouds", "CLOUDS")).texture,
        lambda texture: set_on(texture, noise_scale=2.0),
    ),
    "the pixels of an image": (displaced_by_an_image, paint),
    "sharp edges": (
        lambda holder: modified(holder, "EDGE_SPLIT", use_edge_angle=False).id_data,
        lambda holder: set_and_tell(holder.data.edges[0], holder.data.update, use_edge_sharp=True),
    ),
    "a lattice": (
        lambda holder: modified(holder, "LATTICE", object=scene.add("It", bpy.data.lattices.new("It"))).object.data,
        lambda lattice: set_and_tell(lattice.points[0], lattice.update_tag, co_deform=(-1.5, -0.5, -0.5)),
    ),
    "a curve": (bent, lambda path: set_and_tell(path.splines[0].points[1], path.update_tag, co=(1, 1, 0, 1))),
    "a falloff": (
        lambda holder: modified(holder, "HOOK", falloff_type="CURVE"),
        lambda hook: set_and_tell(
            hook.falloff_curve.curves[0].points[0],
            hook.falloff_curve.update,
            hook.id_data.update_tag,
            location=(0.0, 0.5),
        ),
    ),
    "a profile": (
        lambda holder: modified(holder, "BEVEL", profile_type="CUSTOM").custom_profile,
        lambda profile: set_and_tell(profile, profile.update, profile.id_data.update_tag, preset="STEPS"),
    ),
    "Simplify": (
        lambda holder: modified(holder, "SUBSURF", subdivision_type="SIMPLE", levels=2),
        lambda _: set_on(bpy.context.scene.render, use_simplify=True, simplify_subdivision=1),
    ),
    "other weights": (
        lambda holder: modified(holder, "DISPLACE").id_data,
        lambda holder: weigh(holder, holder.vertex_groups.new(name="Some").name),
    ),
    "an attribute that nodes name": (moved_by_an_attribute, lambda holder: fill(holder, "Offset", 0.5)),
    "nodes": (lambda holder: modified(holder, "NODES"), lambda nodes: set_on(nodes, node_group=scene.node_tree())),
    "an input of nodes": (scaled_by_nodes, set_an_input),
}


WITHOUT_EFFECT = {"other weights"}


@pytest.mark.parametrize("shape", SHAPED)
def test_what_shapes_the_source_is_noticed(shape: str) -> None:
    make, change = SHAPED[shape]
    source = scene.add_object(meshes.cube())
    thing = make(source)
    made = made_of(source)
    change(thing)
    assert made.lines() == stale("" if shape in WITHOUT_EFFECT else ALL)


def test_what_others_changed_before_a_file_is_opened_is_not_known(tmp_path: Path) -> None:
    """Depths, measurements and results that depend on other data say so until they are made anew."""
    holder = scene.add_object(meshes.cube())
    modified(holder, "MIRROR", mirror_object=scene.add("Axis"))
    made_of(holder)
    plain = scene.add_object(meshes.torus(4, 3), "Plain")
    addon.compute(plain)
    scene.open_again(tmp_path)
    made = Made.found()
    unknown = "Not checked since opening"
    assert made.lines() == dict.fromkeys(ALL.split(), unknown)
    assert stale_line(bpy.data.objects["Plain"]) == ""
    refuses("set_levels", "out of date", made.source)
    addon.finish("compute", made.source)
    addon.finish("update", made.result)
    assert made.lines() == dict.fromkeys(("own", "other"), unknown)
    bpy.data.objects["Axis"].location.x += 0.5
    assert made.lines()["depths"] == mesh_line(made.source)


def test_other_frames_are_other_states() -> None:
    """What depends on an animated object holds on the frame of its computation, also after others were shown."""
    holder, axis = scene.add_object(meshes.cube()), scene.add("Axis")
    modified(holder, "MIRROR", mirror_object=axis)
    scene.animate(axis, "location", {1: (0.0, 0.0, 0.0), 10: (1.0, 0.0, 0.0)})
    bpy.context.scene.frame_set(3)
    addon.compute(holder)
    assert stale_line(holder) == ""
    bpy.context.scene.frame_set(5)
    assert stale_line(holder) == mesh_line(holder)
    bpy.context.scene.frame_set(3)
    assert stale_line(holder) == ""


def test_a_pause_takes_no_time_with_a_posed_mesh_of_many_vertices() -> None:
    """No timer may take more than 5 ms; here of processor time, and the best of three. Nothing of the mesh is read
    again, as nothing of it has changed."""
    holder = scene.add_object(meshes.grid(300, 300))
    group = holder.vertex_groups.new(name="Bone")
    group.add(range(len(holder.data.vertices)), 1.0, "REPLACE")
    rig = modified(holder, "ARMATURE", object=scene.add_rig()).object
    addon.compute(holder, tolerance=1.0, method="FIRST_ORDER")
    addon.examine_touched()
    times = []
    for step in range(3):
        rig.pose.bones["Bone"].location.x = step + 1.0
        bpy.context.view_layer.update()
        started = process_time()
        addon.module("state.watch").examine()
        times.append(process_time() - started)
    assert stale_line(holder) == mesh_line(holder)
    assert min(times) < 0.005


def test_edit_mode_is_followed(made: Made) -> None:
    """The sources of results are examined when they leave it."""
    with addon.edit_mode(made.source):
        bpy.ops.ccdepth.compute()
        bpy.ops.ccdepth.measure()
        assert made.lines() == {}
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.transform.translate(value=(0.1, 0.0, 0.0))
        assert made.lines() == stale("depths own other")
    assert made.lines() == stale(ALL)


@pytest.mark.parametrize(
    ("operator", "module", "work", "change"),
    [
        ("compute", "compute_depth", "compute_depths", lambda holder: move_vertex(holder.data)),
        ("measure", "measure_deviation", "measure", lambda holder: move_vertex(holder.data)),
        ("subdivide", "adaptive_operator", "subdivide", lambda holder: set_on(holder, scale=(4.0, 4.0, 4.0))),
        ("subdivide", "reduced_meshes", "reduction_of", lambda holder: move_vertex(holder.data)),
    ],
)
def test_changes_during_a_run_make_its_outcome_out_of_date(
    operator: str, module: str, work: str, change: Callable[[Any], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An animation may play meanwhile."""
    holder = scene.add_object(meshes.cube())
    run = getattr(addon.module(f"operators.{module}"), work)
    monkeypatch.setattr(addon.module(f"operators.{module}"), work, lambda *given: change(holder) or run(*given))
    set_scene(reduce=module == "reduced_meshes", tolerance=0.1)
    addon.finish(operator, holder)
    addon.examine_touched()
    made, settings = bpy.context.active_object, bpy.context.scene.ccdepth
    if operator == "measure":
        line = addon.module("ui.deviation_panel").stale_line(settings, made.data)
    else:
        line = addon.module("ui.panels").stale_line(settings, made.data, made)
    assert line.endswith("changed")


def test_a_duplicate_of_another_scale_that_goes_away() -> None:
    """It shares the mesh, so it shows the depths, which hold for it where they were computed for it as well."""
    first = scene.add_suzanne()
    second = scene.add_mesh(first.data)
    second.scale = (2.0, 2.0, 2.0)
    addon.compute(first)
    assert (stale_line(first), stale_line(second)) == ("", "Not computed for this object")
    refuses("set_levels", "out of date", second)
    addon.compute(first, second)
    assert not addon.module("state.out_of_date").noted(second).is_uncovered, "told before anything is examined"
    assert stale_line(first) == stale_line(second) == ""
    bpy.data.objects.remove(second)
    first.rotation_euler.x = 0.4
    assert stale_line(first) == mesh_line(first)


def test_of_objects_with_one_mesh_the_last_measured_one_counts() -> None:
    first = scene.add_object(meshes.cube(), "First")
    second = scene.add("Second", first.data)
    for each in (first, second):
        addon.measure(each)
    second.scale.x = 2.0
    addon.examine_touched()
    line = addon.module("ui.deviation_panel").stale_line(bpy.context.scene.ccdepth, first.data)
    assert line == "Out of date: “Second” was scaled"


def test_files_are_examined_when_they_are_loaded(made: Made, tmp_path: Path) -> None:
    for kinds in ("", ALL):
        scene.open_again(tmp_path)
        made = Made.found()
        made.source.name = "Renamed"
        made.source.name = "Source"
        assert made.lines() == stale(kinds)
        move_vertex(made.source.data)


def test_undo_is_followed(made: Made) -> None:
    bpy.ops.ed.undo_push(message="before")
    move_vertex(made.source.data)
    bpy.ops.ed.undo_push(message="moved")
    assert made.lines() == stale(ALL)
    bpy.ops.ed.undo()
    assert Made.found().lines() == {}
    bpy.ops.ed.redo()
    assert Made.found().lines() == stale(ALL)


def test_nothing_is_left_running() -> None:
    check = addon.module("state.watch").examine
    holder = creased_source()
    addon.compute(holder)
    move_vertex(holder.data)
    bpy.context.view_layer.update()
    assert bpy.app.timers.is_registered(check)
    assert check() is None


def test_updates_of_other_threads_and_graphs_touch_no_timer() -> None:
    """Exporters and renders evaluate in threads of their own."""
    watch, holder = addon.module("state.watch"), creased_source()
    addon.compute(holder)
    addon.examine_touched()
    holder.location.x += 1.0
    # Updated, so that there is something to notice.
    depsgraph = bpy.context.evaluated_depsgraph_get()
    addon.module("registration").do_not_call(watch.examine)
    thread = Thread(target=watch._notice_updates, args=(bpy.context.scene, depsgraph))
    thread.start()
    thread.join()
    assert not bpy.app.timers.is_registered(watch.examine)
