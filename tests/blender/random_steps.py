# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps of random scenes: each puts something into the file, as a user or a script of his might.

A step takes a random generator and looks for what it can work on. Where there is nothing, or Blender refuses, it raises
one of ``REFUSALS`` and whoever runs it goes on. So any step can be left out, and the others still do what they did.
"""

import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from tests import meshes
from tests.blender import scene
from tests.blender.scene import VALUES

Random = np.random.Generator
Step = Callable[[Random], None]

# What Blender raises when it does not want to, and `one` where there is nothing.
REFUSALS = (RuntimeError, TypeError, ValueError, AttributeError, KeyError, OverflowError, ReferenceError)

# Evaluated on every update: more would test the patience of whoever waits, and nothing else.
MOST_FACES = 400

NAMES = (
    "id", "Weight", "UVMap", "Color", "crease_edge", "crease_vert", "sharp_edge", "sharp_face", "material_index",
    "custom_normal", "position", ".select_vert", ".select_poly", ".hide_poly", ".hide_vert", ".hide_edge", "uv_seam",
    "bevel_weight_edge", "bevel_weight_vert", ".sculpt_mask", ".sculpt_face_set", "freestyle_edge", "freestyle_face",
    "normal", "velocity", "ccdepth_origin", "ccdepth_weights_0", ".corner_vert", ".edge_verts", "shade_smooth", "Größe",
    "a name as long as Blender keeps them, or even longer than that it is",
)  # fmt: skip
PAINTING = ("SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT", "TEXTURE_PAINT")
OUR_NAMES = ("ccdepth", "ccdepth_bound", "ccdepth_color")


def one(rng: Random, items: Any) -> Any:
    """One of the items. ValueError, one of the refusals, when there are none."""
    items = list(items)
    return items[int(rng.integers(len(items)))]


def some(rng: Random, items: Any, share: float = 0.5) -> list[Any]:
    return [item for item in items if rng.random() < share]


def chance(rng: Random, probability: float) -> bool:
    return bool(rng.random() < probability)


def local_meshes() -> list[bpy.types.Mesh]:
    """The meshes that can be written to in bulk."""
    return [mesh for mesh in bpy.data.meshes if mesh.is_editable and not mesh.is_editmode and len(mesh.vertices)]


def mesh_objects() -> list[bpy.types.Object]:
    return [each for each in bpy.data.objects if each.type == "MESH"]


def editable_of_any_type() -> list[bpy.types.Object]:
    return [each for each in bpy.data.objects if each.is_editable]


def editable_objects() -> list[bpy.types.Object]:
    return [each for each in editable_of_any_type() if each.type == "MESH" and not each.data.is_editmode]


def add_mesh(rng: Random) -> None:
    """An object with a random mesh, perhaps with loose edges and a loose vertex."""
    data = one(rng, MESHES)(rng)
    if len(data.positions) and chance(rng, 0.25):
        first = len(data.positions)
        loose = [(first, first + 1), (0, first + 2)]
        data = replace(data, positions=np.concatenate([data.positions, rng.normal(size=(4, 3))]), loose_edges=loose)
    _chosen(scene.add_object(data, one(rng, ("Mesh", "Cube", "Ärger", "Mesh Adaptive", "ccdepth"))))


def _chosen(holder: bpy.types.Object) -> bpy.types.Object:
    """A new object, which is selected and made active, where that is possible."""
    with suppress(*REFUSALS):
        holder.select_set(True)
        bpy.context.view_layer.objects.active = holder
    return holder


def _grid(rng: Random) -> meshes.MeshData:
    """Quads, some of them as two triangles."""
    data = meshes.landscape(*rng.integers(1, 6, 2).tolist())
    faces = [[quad] if chance(rng, 0.8) else [quad[:3], [quad[0], *quad[2:]]] for quad in map(list, data.faces)]
    return meshes.from_faces(data.positions, [face for parts in faces for face in parts])


# Repeated ones are likelier.
MESHES: tuple[Callable[[Random], meshes.MeshData], ...] = (
    _grid,
    _grid,
    _grid,
    lambda rng: meshes.fan(int(rng.integers(3, 13)), 1),
    lambda rng: meshes.bumpy(meshes.sphere(int(rng.integers(3, 13)), 2), 0.1),
    lambda rng: meshes.bumpy(meshes.cylinder(int(rng.integers(3, 9))), 0.1),
    lambda rng: meshes.torus(*rng.integers(3, 7, 2).tolist()),
    lambda rng: one(rng, (meshes.cube, meshes.creased_cube, meshes.valence_two))(),
    lambda rng: meshes.triangles_and_quads(),
    lambda rng: meshes.with_random_creases(meshes.triangles_and_quads(), seed=int(rng.integers(99))),
    lambda rng: scene.suzanne() if chance(rng, 0.2) else scene.icosphere(1),
    lambda rng: meshes.face_soup(int(rng.integers(99))),
    lambda rng: meshes.from_faces(rng.normal(size=(int(rng.integers(0, 4)), 3)), []),
)


def spoil_mesh(rng: Random) -> None:
    """Repeated vertices, faces without area, no finite position, a wrong size: what is refused; or another size."""
    mesh, way = one(rng, local_meshes()), int(rng.integers(12))
    positions = scene.read(mesh, "position").ravel()
    if way == 0 and len(mesh.loops) > 1:
        mesh.loops[1].vertex_index = mesh.loops[0].vertex_index
    elif way == 1:
        positions[rng.integers(len(positions))] = one(rng, (np.nan, np.inf, -np.inf))
    elif way == 2:
        positions.reshape(-1, 3)[: max(1, len(mesh.vertices) // 4 * 3)] = positions[:3]
    elif way == 3:
        positions += np.float32(10.0 ** rng.uniform(0, 8))
    elif way == 4:
        positions[2::3] = 0
    elif way < 9:
        most = 30 if way == 5 else 4
        with np.errstate(over="ignore"):
            positions *= np.float32(10.0 ** rng.uniform(-most, most))
    mesh.attributes["position"].data.foreach_set("vector", positions)
    mesh.update()


def add_user(rng: Random) -> None:
    """One more object with a mesh that is there, at a size of its own."""
    holder = _chosen(scene.add("User", one(rng, bpy.data.meshes)))
    if chance(rng, 0.5):
        holder.scale = rng.uniform(0.3, 2.0, 3).tolist()


def add_other(rng: Random) -> None:
    """An object that is no mesh."""
    kinds = (("lights", "POINT"), ("curves", "CURVE"), ("curves", "FONT"), ("cameras",), ("lattices",), ("armatures",))
    collection, *kind = one(rng, (*kinds, ("metaballs",), ("",)))
    _chosen(scene.add("Other", getattr(bpy.data, collection).new("Other", *kind) if collection else None))


def place(rng: Random) -> None:
    """Location, rotation and scale: negative, zero, uneven."""
    holder = one(rng, editable_of_any_type())
    holder.location, holder.rotation_euler = rng.normal(0, 3, 3).tolist(), rng.uniform(-3, 3, 3).tolist()
    scale = rng.uniform(0.2, 3.0, 3) * rng.choice([-1, 1, 1], 3)
    if chance(rng, 0.1):
        scale[rng.integers(3)] = 0
    if chance(rng, 0.1):
        scale *= 10.0 ** rng.uniform(-9, 9)
    holder.scale = scale.tolist()


def give_parent(rng: Random) -> None:
    """A parent with an uneven scale, which shears."""
    child = one(rng, editable_of_any_type())
    child.parent = one(rng, [each for each in bpy.data.objects if each != child])
    child.matrix_parent_inverse = Matrix(rng.normal(size=(3, 3))).to_4x4()


def hide(rng: Random) -> None:
    holder, way = one(rng, bpy.data.objects), int(rng.integers(4))
    names = ("hide_viewport", "hide_render", "hide_select", "show_only_shape_key", "use_shape_key_edit_mode")
    if way < 2:
        setattr(holder, one(rng, names), True)
    if way == 1:
        holder.hide_set(True)


def use_collections(rng: Random) -> None:
    """A collection with some of the objects, perhaps excluded, hidden, or instanced."""
    group = scene.add_collection("Group")
    for each in some(rng, bpy.data.objects):
        group.objects.link(each)
        if chance(rng, 0.5):
            with suppress(*REFUSALS):
                bpy.context.scene.collection.objects.unlink(each)
    layer = bpy.context.view_layer.layer_collection.children[group.name]
    layer.exclude, layer.hide_viewport, group.hide_viewport = (chance(rng, share) for share in (0.15, 0.1, 0.1))
    if chance(rng, 0.2):
        empty = scene.add("Instance")
        empty.instance_type, empty.instance_collection = "COLLECTION", group


def choose_objects(rng: Random) -> None:
    """What is selected, and what is active."""
    share = one(rng, (0.1, 0.5, 1.0, 1.0, 1.0, 1.0))
    # Selecting may bring the list up to date, which crashes Blender while it is read.
    for each in list(bpy.context.view_layer.objects):
        with suppress(*REFUSALS):
            each.select_set(bool(rng.random() < share))
    bpy.context.view_layer.objects.active = one(rng, [*bpy.context.view_layer.objects, *mesh_objects()[:4]])


def link_library(rng: Random) -> None:
    """Some objects go to a file of their own and come back linked, perhaps overridden."""
    chosen = [each for each in some(rng, editable_objects(), 0.6) if each.library is None and not each.override_library]
    if not chosen or chance(rng, 0.4) or bpy.context.mode != "OBJECT":
        return
    names = [each.name for each in chosen]
    file = os.path.join(tempfile.mkdtemp(prefix="library"), "library.blend")
    bpy.data.libraries.write(file, set(chosen))
    bpy.data.batch_remove(list({*chosen, *(each.data for each in chosen if each.data.users == 1)}))
    with bpy.data.libraries.load(file, link=True) as (_, wanted):
        wanted.objects = names
    for linked in filter(None, wanted.objects):
        bpy.context.scene.collection.objects.link(linked)
        way = int(rng.integers(4))
        overridden = linked.override_create(remap_local_usages=True) if way in (1, 2) else linked
        if way >= 2:
            overridden.data.override_create(remap_local_usages=True)
    choose_objects(rng)
    # Blender itself crashes when undo goes back over objects that a script has removed without a step of undo.
    bpy.ops.ed.undo_push(message="Link Library")


def _add_attribute(rng: Random, mesh: bpy.types.Mesh, name: str, types: Any, domains: Any) -> None:
    with suppress(*REFUSALS):
        fill(rng, mesh.attributes[mesh.attributes.new(name, one(rng, types), one(rng, domains)).name])


def add_attributes(rng: Random) -> None:
    """Attributes of any type on any domain, also under names that Blender or CC Depth uses.

    Matrices are left out: Blender itself crashes where a modifier adds elements to a mesh that has them beside other
    attributes, as BMesh writes their defaults to addresses that are not aligned. `test_attributes` has them.
    """
    mesh = one(rng, local_meshes())
    types = bpy.types.Attribute.bl_rna.properties["data_type"].enum_items.keys()
    types = [name for name in types if name != "FLOAT4X4"]
    for _ in range(int(rng.integers(1, 7))):
        name = one(rng, NAMES) if chance(rng, 0.5) else f"attribute {rng.integers(100)}"
        name = one(rng, OUR_NAMES) if chance(rng, 0.02) else name
        _add_attribute(rng, mesh, name, types, ("POINT", "EDGE", "FACE", "CORNER"))
    if chance(rng, 0.5):
        mesh.attributes.active = one(rng, mesh.attributes)


def add_colors(rng: Random) -> None:
    mesh = one(rng, local_meshes())
    for name in some(rng, ("Color", "Paint", "Color.001")):
        _add_attribute(rng, mesh, name, ("FLOAT_COLOR", "BYTE_COLOR"), ("POINT", "CORNER"))
    for name in some(rng, ("active_color_name", "default_color_name")):
        setattr(mesh.attributes, name, one(rng, ["", *(color.name for color in mesh.color_attributes)]))


def fill(rng: Random, attribute: bpy.types.Attribute) -> None:
    """Random values, as wild as the type allows."""
    count = len(attribute.data)
    if attribute.data_type == "STRING":
        for item in attribute.data:
            item.value = one(rng, (b"", b"text", "ü".encode(), b"\xff\xfe"))
        return
    value, dtype, width = VALUES[attribute.data_type]
    if np.issubdtype(dtype, np.integer):
        limits = np.iinfo(dtype)
        least, most = (limits.min, limits.max) if chance(rng, 0.1) else (-3, 100)
        values = rng.integers(least, most, count * width)
    elif dtype is np.bool_:
        values = rng.random(count * width) < 0.4
    else:
        values = rng.normal(0.5, 0.5, count * width)
        if chance(rng, 0.1) and count:
            values[rng.integers(len(values))] = one(rng, (np.nan, np.inf, 1e38))
    attribute.data.foreach_set(value, values.astype(dtype))


def add_uv_maps(rng: Random) -> None:
    mesh = one(rng, local_meshes())
    for _ in range(int(rng.integers(1, 4))):
        layer = mesh.uv_layers.new(name=one(rng, ("UVMap", "Lightmap", "ccdepth_uv", "")), do_init=chance(rng, 0.5))
        if layer is not None and chance(rng, 0.6):
            # Whole numbers and halves: corners of several faces often meet.
            values = rng.integers(0, 5, 2 * len(mesh.loops)).astype(np.float32) / 2
            mesh.uv_layers[layer.name].uv.foreach_set("vector", values)
    for name in ("active", "active_render", "active_clone"):
        setattr(one(rng, mesh.uv_layers), name, True)


def add_groups(rng: Random) -> None:
    holder = one(rng, [each for each in editable_objects() if each.data.is_editable])
    for _ in range(int(rng.integers(1, 5))):
        group = holder.vertex_groups.new(name=one(rng, ("Group", "Weight", "id", "ccdepth_weights_0", "Bone")))
        for member in some(rng, range(len(holder.data.vertices)), rng.random()):
            group.add([member], float(rng.choice([0.0, 0.3, 1.0])), "REPLACE")
        group.lock_weight = chance(rng, 0.2)
    holder.vertex_groups.active_index = int(rng.integers(len(holder.vertex_groups)))


def add_shape_keys(rng: Random) -> None:
    """Keys, relative or not, some muted, some driven or animated."""
    holder = one(rng, [each for each in editable_objects() if each.data.is_editable and len(each.data.vertices)])
    if bpy.context.mode != "OBJECT":
        return
    for number in range(int(rng.integers(1, 4))):
        key = holder.shape_key_add(name=one(rng, ("Key", "Smile", "Basis")), from_mix=False)
        coordinates = scene.read(holder.data, "position").ravel()
        coordinates += rng.normal(0, 0.2, len(coordinates)).astype(np.float32) * bool(number)
        coordinates[0] = np.nan if chance(rng, 0.03) else coordinates[0]
        key.points.foreach_set("co", coordinates)
        key.value, key.mute = float(rng.choice([0.0, 0.5, 1.0])), chance(rng, 0.2)
        key.vertex_group = one(rng, ["", *holder.vertex_groups.keys()])
        key.relative_key = one(rng, holder.data.shape_keys.key_blocks)
    keys = holder.data.shape_keys
    keys.use_relative, keys.eval_time = not chance(rng, 0.2), float(rng.uniform(0, 20))
    holder.active_shape_key_index = int(rng.integers(len(keys.key_blocks)))
    key, way = one(rng, keys.key_blocks), int(rng.integers(6))
    if way < 2:
        key.driver_add("value").driver.expression = ("frame / 10", "no_such_name")[way]
    elif way == 2:
        scene.animate(key, "value", {1: key.value, 20: 0.9})
    elif way == 3:
        track = keys.animation_data_create().nla_tracks.new()
        track.strips.new("Strip", 1, bpy.data.actions.new("Action"))


def add_creases(rng: Random) -> None:
    mesh = one(rng, local_meshes())
    for name, domain, count in (("crease_edge", "EDGE", len(mesh.edges)), ("crease_vert", "POINT", len(mesh.vertices))):
        if chance(rng, 0.6) and name not in mesh.attributes:
            wild, tame = rng.normal(0.5, 1.0, count), rng.choice([0.0, 0.0, 0.3, 0.7, 1.0], count)
            values = wild if chance(rng, 0.1) else tame
            mesh.attributes.new(name, "FLOAT", domain).data.foreach_set("value", values.astype(np.float32))


def add_materials(rng: Random) -> None:
    """Materials, empty slots, indices without a slot."""
    mesh = one(rng, local_meshes())
    for _ in range(int(rng.integers(1, 4))):
        mesh.materials.append(one(rng, (None, bpy.data.materials.new("Material"))))
    for polygon in mesh.polygons:
        polygon.material_index = int(rng.integers(0, 6))
    if chance(rng, 0.3):
        slot = one(rng, [each for each in editable_objects() if each.data == mesh]).material_slots[0]
        slot.link, slot.material = "OBJECT", bpy.data.materials.new("Own")


def add_normals(rng: Random) -> None:
    mesh = one(rng, [each for each in local_meshes() if "custom_normal" not in each.attributes])
    sharp = mesh.attributes.get("sharp_edge")
    # Blender itself crashes where something else has the name of its sharp edges, and now and then when it looks for
    # the corners around a vertex of a face that has it twice.
    is_safe = sharp is None or (sharp.data_type, sharp.domain) == ("BOOLEAN", "EDGE")
    if is_safe and all(len({*face.vertices}) == len(face.vertices) for face in mesh.polygons):
        mesh.normals_split_custom_set(rng.normal(size=(len(mesh.loops), 3)).tolist())


FLAGS = (
    (".hide_vert", "POINT"), (".hide_edge", "EDGE"), (".hide_poly", "FACE"), (".select_vert", "POINT"),
    (".select_edge", "EDGE"), (".select_poly", "FACE"), ("uv_seam", "EDGE"), ("sharp_edge", "EDGE"),
    ("sharp_face", "FACE"),
)  # fmt: skip


def mark_elements(rng: Random) -> None:
    """Hidden, selected and sharp elements, seams, and face sets.

    Where something else has the name of one of Blender's own flags, Blender's access would crash.
    """
    mesh = one(rng, local_meshes())
    for name, domain in some(rng, FLAGS, 0.4):
        attribute = mesh.attributes.get(name) or mesh.attributes.new(name, "BOOLEAN", domain)
        if (attribute.data_type, attribute.domain) == ("BOOLEAN", domain):
            attribute.data.foreach_set("value", rng.random(len(attribute.data)) < rng.choice([0.0, 0.3, 1.0]))
    for name, data_type, domain in ((".sculpt_face_set", "INT", "FACE"), (".sculpt_mask", "FLOAT", "POINT")):
        if chance(rng, 0.3) and name not in mesh.attributes:
            fill(rng, mesh.attributes.new(name, data_type, domain))
    mesh.use_mirror_x, mesh["custom"] = chance(rng, 0.5), 12.5


# Blender itself crashes when it evaluates Bevel on a mesh with attributes of some types on its edges, with no operator
# of ours; fluids run scripts of their own, which print tracebacks, and caches want files. On some meshes that are not
# valid Blender itself writes normals beyond its arrays, and ends while it makes a skin.
LEFT_OUT_MODIFIERS = {"BEVEL", "FLUID", "MESH_SEQUENCE_CACHE", "NORMAL_EDIT", "SKIN", "WEIGHTED_NORMAL"}


def add_modifiers(rng: Random) -> None:
    """Modifiers of any type, as they come or with random settings."""
    types = bpy.types.Modifier.bl_rna.properties["type"].enum_items.keys()
    types = [name for name in types if not name.startswith("GREASE") and name not in LEFT_OUT_MODIFIERS]
    for _ in range(int(rng.integers(1, 4))):
        holder, kind = one(rng, editable_objects()), one(rng, types)
        with suppress(*REFUSALS):
            modifier = holder.modifiers.new(kind.title(), kind)
            if modifier is not None and chance(rng, 0.6):
                randomise(rng, holder, modifier)
            keep_small(holder, modifier)
            if chance(rng, 0.5):
                holder.modifiers.move(len(holder.modifiers) - 1, 0)


def randomise(rng: Random, holder: bpy.types.Object, modifier: Any, share: float = 0.5) -> None:
    """Set some settings to something in the range that Blender suggests."""
    for field in modifier.bl_rna.properties:
        if not field.is_readonly and field.identifier not in {"name", "filepath", "rna_type"} and chance(rng, share):
            with suppress(*REFUSALS):
                setattr(modifier, field.identifier, _random_setting(rng, holder, field))


def _random_setting(rng: Random, holder: bpy.types.Object, field: Any) -> Any:
    if field.type == "BOOLEAN":
        return [chance(rng, 0.5) for _ in range(field.array_length)] if field.is_array else chance(rng, 0.5)
    if field.type in {"INT", "FLOAT"}:
        least, most = max(field.soft_min, -4), min(field.soft_max, 4)
        numbers = rng.uniform(least, max(most, least), max(field.array_length, 1))
        numbers = np.rint(numbers).astype(int) if field.type == "INT" else numbers
        return numbers.tolist() if field.is_array else numbers.tolist()[0]
    if field.type == "ENUM":
        names = [item.identifier for item in field.enum_items]
        return set(some(rng, names)) if field.is_enum_flag else one(rng, names)
    if field.type == "STRING":
        mesh = holder.data
        names = [*holder.vertex_groups.keys(), *mesh.attributes.keys(), *mesh.uv_layers.keys()]
        return one(rng, ["", "no such name", *names])
    blocks = {"Object": bpy.data.objects, "Collection": bpy.data.collections}
    return one(rng, blocks.get(field.fixed_type.identifier, [None]))


# Settings with which Blender takes seconds or gigabytes for itself, and what they are at most.
SMALL = {
    "count": 2, "levels": 1, "render_levels": 1, "octree_depth": 3, "steps": 4, "render_steps": 4, "resolution": 1,
    "viewport_resolution": 1, "segments": 2, "iterations": 2, "repeat_u": 1, "repeat_v": 1,
}  # fmt: skip


def keep_small(holder: bpy.types.Object, modifier: Any) -> None:
    extent = max(holder.dimensions) if len(holder.data.vertices) else 1.0
    fixed = {"fit_type": "FIXED_COUNT", "voxel_size": max(extent / 8 if np.isfinite(extent) else 1.0, 0.1)}
    least = {name: min(getattr(modifier, name), most) for name, most in SMALL.items() if hasattr(modifier, name)}
    for name, value in {**fixed, **least}.items():
        if hasattr(modifier, name):
            with suppress(*REFUSALS):
                setattr(modifier, name, value)


def add_subdivision(rng: Random) -> None:
    """A Subdivision Surface modifier, somewhere in the stack."""
    holder = one(rng, editable_objects())
    modifier = holder.modifiers.new("Subdivision", "SUBSURF")
    randomise(rng, holder, modifier, 0.8)
    keep_small(holder, modifier)
    modifier.show_viewport, modifier.levels = chance(rng, 0.8), int(rng.integers(0, 3))
    modifier.subdivision_type = one(rng, ("CATMULL_CLARK", "CATMULL_CLARK", "SIMPLE"))
    if chance(rng, 0.4):
        holder.modifiers.move(len(holder.modifiers) - 1, int(rng.integers(len(holder.modifiers))))


NODES = (
    ("MeshToCurve", "MeshToPoints"),
    ("SetPosition", "DualMesh", "FlipFaces", "Triangulate", "SubdivideMesh", "ScaleElements", "JoinGeometry"),
)


def add_nodes(rng: Random) -> None:
    """Geometry Nodes: without a group, with an empty one, and with one that does something."""
    modifier, way = one(rng, editable_objects()).modifiers.new("Nodes", "NODES"), int(rng.integers(4))
    if way == 1:
        modifier.node_group = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    if way > 1:
        modifier.node_group = scene.node_tree(f"GeometryNode{one(rng, NODES[way - 2])}")
        for name in ("Float", "Object"):
            modifier.node_group.interface.new_socket(name, in_out="INPUT", socket_type=f"NodeSocket{name}")


def add_multires(rng: Random) -> None:
    holder = one(rng, [each for each in editable_objects() if each.visible_get()])
    if bpy.context.mode != "OBJECT" or len(holder.data.polygons) > MOST_FACES // 16:
        return
    bpy.context.view_layer.objects.active = holder
    modifier = holder.modifiers.new("Multires", "MULTIRES")
    bpy.ops.object.multires_subdivide(modifier=modifier.name, mode="CATMULL_CLARK")
    modifier.levels = int(rng.integers(0, 2))


def add_constraint(rng: Random) -> None:
    constraints = one(rng, editable_of_any_type()).constraints
    constraints.new(one(rng, ("COPY_SCALE", "LIMIT_SCALE", "TRACK_TO"))).target = one(rng, bpy.data.objects)


def animate(rng: Random) -> None:
    """Another frame, keyed objects and modifiers."""
    step_frame(rng)
    holder = one(rng, editable_of_any_type())
    scene.animate(holder, "scale", {1: holder.scale[:], 20: rng.uniform(0.5, 2, 3).tolist()})
    one(rng, holder.modifiers).keyframe_insert(one(rng, ("levels", "strength", "show_viewport", "thickness")), frame=1)


def step_frame(rng: Random) -> None:
    bpy.context.scene.frame_set(int(rng.integers(1, 30)))


def set_scene(rng: Random) -> None:
    """Units, and the scene's own settings of CC Depth."""
    units = bpy.context.scene.unit_settings
    units.system, units.scale_length = one(rng, ("NONE", "METRIC", "IMPERIAL")), float(10.0 ** rng.uniform(-3, 3))
    settings = bpy.context.scene.ccdepth
    settings.heat_map, settings.show_legend = one(rng, ("DEPTH", "DISTANCE", "NONE")), chance(rng, 0.5)
    settings.use_modifiers = chance(rng, 0.7)
    settings.distance_range = one(rng, ("TOLERANCE", "FIXED"))


def add_scene(rng: Random) -> None:
    """Another scene, with some of the objects, and perhaps the one that is worked in."""
    other = bpy.data.scenes.new("Scene")
    for each in some(rng, bpy.data.objects):
        other.collection.objects.link(each)
    if chance(rng, 0.2) and bpy.context.window is not None and bpy.context.mode == "OBJECT":
        bpy.context.window.scene = other


def set_mode(rng: Random) -> None:
    """Edit Mode mostly, and those in which one paints."""
    bpy.ops.object.mode_set(mode=one(rng, ("EDIT",) * 6 + ("OBJECT",) * 5 + PAINTING))
    if bpy.context.mode == "EDIT_MESH":
        kinds = [chance(rng, 0.4), chance(rng, 0.4), chance(rng, 0.4)]
        bpy.context.scene.tool_settings.mesh_select_mode = kinds if any(kinds) else (True, False, False)
        bpy.ops.mesh.select_random(ratio=float(rng.random()), seed=int(rng.integers(1, 1000)))


def edit_mesh(rng: Random) -> None:
    """A vertex moves, or a face is gone."""
    mesh = one(rng, [each for each in bpy.data.meshes if each.is_editable])
    if not mesh.is_editmode:
        one(rng, mesh.vertices).co.x += 0.1
        mesh.update()
        return
    import bmesh

    edited = bmesh.from_edit_mesh(mesh)
    if len(edited.faces) and chance(rng, 0.4):
        bmesh.ops.delete(edited, geom=[one(rng, edited.faces)], context="FACES")
    else:
        one(rng, edited.verts).co.x += 0.1
    bmesh.update_edit_mesh(mesh)


def remove_something(rng: Random) -> None:
    """An object goes, or its mesh, or a modifier."""
    holder, way = one(rng, [each for each in mesh_objects() if not each.data.is_editmode]), int(rng.integers(3))
    if bpy.context.mode != "OBJECT":
        return
    if way == 0 and len(mesh_objects()) > 1:
        bpy.data.objects.remove(holder)
    elif way == 1 and len(bpy.data.meshes) > 1 and holder.data.library is None:
        bpy.data.meshes.remove(holder.data)
    else:
        holder.modifiers.remove(one(rng, holder.modifiers))


# Repeated ones are likelier.
BUILDING: tuple[Step, ...] = (
    add_mesh, add_mesh, add_mesh, add_other, spoil_mesh, spoil_mesh, place, place, give_parent, hide, use_collections,
    link_library, add_attributes, add_attributes, add_attributes, add_uv_maps, add_uv_maps, add_colors, add_colors,
    add_groups, add_groups, add_shape_keys, add_shape_keys, add_creases, add_creases, add_materials, add_normals,
    mark_elements, mark_elements, add_modifiers, add_modifiers, add_modifiers, add_subdivision, add_subdivision,
    add_nodes, add_multires, add_constraint, animate, set_scene, add_scene, add_user, add_user,
)  # fmt: skip
BETWEEN: tuple[Step, ...] = (
    choose_objects, choose_objects, set_mode, set_mode, set_mode, edit_mesh, step_frame, set_scene, remove_something,
    place, add_attributes, add_modifiers, hide, mark_elements, add_colors, link_library,
)  # fmt: skip
