# SPDX-License-Identifier: GPL-3.0-or-later
"""Files in and out: the formats, the lengths of their units, and Blender's operators that read and write them."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from .blender_arrays import read_values
from .blender_calls import CommandError, available, call, known_options, scripts_allowed, temporary_data
from .custom_normals import CarriedNormals
from .data_blocks import as_bmesh
from .displayed_mesh import Triangles
from .face_values import remove_all
from .switch_distances import Switch
from .whole_files import UnwrittenError, refuse_existing, written_whole

BLEND = ".blend"

USD = (".usd", ".usda", ".usdc", ".usdz")

# The operators that read each format: the first that this Blender has.
READERS = {
    ".obj": ("wm.obj_import",),
    ".ply": ("wm.ply_import",),
    ".stl": ("wm.stl_import",),
    ".glb": ("import_scene.gltf",),
    ".gltf": ("import_scene.gltf",),
    **dict.fromkeys(USD, ("wm.usd_import",)),
    ".fbx": ("wm.fbx_import", "import_scene.fbx"),
    ".abc": ("wm.alembic_import",),
}

WRITERS = {
    ".obj": "wm.obj_export",
    ".ply": "wm.ply_export",
    ".stl": "wm.stl_export",
    ".glb": "export_scene.gltf",
    **dict.fromkeys(USD[:3], "wm.usd_export"),
    ".fbx": "export_scene.fbx",
}

READING: dict[str, dict[str, Any]] = {
    ".glb": {"merge_vertices": True},
    ".gltf": {"merge_vertices": True},
    ".abc": {"as_background_job": False},
}

# Shown meshes of selected objects are written.
WRITING_USD = {
    "selected_objects_only": True,
    "evaluation_mode": "VIEWPORT",
    "convert_world_material": False,
    "export_subdivision": "IGNORE",
    # Textures stay where they are, instead of being copied to a folder beside the file.
    "export_textures": False,
    "export_textures_mode": "KEEP",
}
WRITING: dict[str, dict[str, Any]] = {
    ".obj": {"export_selected_objects": True, "export_colors": True, "path_mode": "RELATIVE"},
    # With UV maps vertices would be split, and closed meshes would have a border.
    ".ply": {"export_selected_objects": True, "export_uv": False},
    ".stl": {"export_selected_objects": True},
    ".glb": {"use_selection": True, "export_format": "GLB", "export_animations": False, "export_extras": True},
    **dict.fromkeys(USD[:3], WRITING_USD),
    ".fbx": {
        "use_selection": True,
        "object_types": {"EMPTY", "MESH"},
        "use_custom_props": True,
        "bake_anim": False,
        "path_mode": "RELATIVE",
    },
}

# The unit, in metres, of formats without units. Other formats are in metres, or their readers know the unit.
UNITS = {".stl": 0.001, ".obj": 1.0, ".ply": 1.0}

# Files that lie beside one of this format and belong to it.
COMPANIONS = {".obj": (".mtl",)}

# The data of a mesh, and the data lost by each format, or by Blender's writer.
HELD: dict[str, Callable[[bpy.types.Mesh], bool]] = {
    "materials": lambda mesh: any(mesh.materials),
    "UV maps": lambda mesh: len(mesh.uv_layers) > 0,
    "UV maps but one": lambda mesh: len(mesh.uv_layers) > 1,
    "colours": lambda mesh: len(mesh.color_attributes) > 0,
    "colours of corners": lambda mesh: [each.domain for each in mesh.color_attributes] not in ([], ["POINT"]),
    "custom normals": lambda mesh: mesh.has_custom_normals,
    "images that are in no file": lambda mesh: any(map(_has_images_in_no_file, mesh.materials)),
}
LOST = {
    ".stl": ("materials", "UV maps", "colours", "custom normals"),
    ".ply": ("materials", "UV maps", "colours of corners", "custom normals"),
    ".obj": ("UV maps but one", "colours of corners", "images that are in no file"),
    **dict.fromkeys((*USD, ".fbx"), ("images that are in no file",)),
}

# The formats whose reader leaves out repeated triangles, unless their normals differ.
WITHOUT_REPEATED = {".glb"}

# The formats without normals of their own.
WITHOUT_NORMALS = {suffix for suffix, names in LOST.items() if "custom normals" in names}

# The loss of an angle in these formats.
SHADING_LOST = "the shading angle (the format has no normals)"

# The lines of an .mtl file that name a file in another folder, up to this name.
NAMED_FILE = re.compile(rb"^((?:map_|refl|norm|bump|disp)(?:.* )?)\.\./", re.MULTILINE)

# The characters that end a line of some formats, or break a program.
NO_NAME = re.compile(r"[\x00-\x1f\x7f]")

# The likely reason why a file cannot be read back: Blender reports no full disk.
CUT_OFF = "is the disk full?"

INPUTS = (BLEND, *READERS)
OUTPUTS = (BLEND, *WRITERS)


def _has_images_in_no_file(material: bpy.types.Material | None) -> bool:
    nodes = material.node_tree.nodes if material and material.node_tree else ()
    images = [image for each in nodes if (image := getattr(each, "image", None)) is not None]
    return any(each.packed_file or not each.filepath for each in images)


def names_of(suffixes: Sequence[str]) -> str:
    return f"{', '.join(suffixes[:-1])} or {suffixes[-1]}"


def unit_of(path: Path, unit: float | None) -> float:
    """The length of a file's unit in metres, for files other than .blend, given the requested unit."""
    default = UNITS.get(path.suffix.lower())
    if default is None:
        return 1.0
    return default if unit is None else unit


def reader(path: Path) -> Any:
    """The operator that reads a file. Raises CommandError if this Blender has none."""
    return _operator(path, READERS[path.suffix.lower()], "read")


def writer(path: Path) -> Any:
    """The operator that writes a file. Raises CommandError if this Blender has none."""
    return _operator(path, (WRITERS[path.suffix.lower()],), "write")


def _operator(path: Path, names: Sequence[str], use: str) -> Any:
    found = next((operator for name in names if (operator := available(name)) is not None), None)
    if found is None:
        raise CommandError(f"{path}: this Blender cannot {use} {path.suffix.lower()} files")
    return found


def refuse_place(path: Path, overwrite: bool) -> None:
    """Raise CommandError without a writable folder for a file, and if something there has to stay."""
    if not path.absolute().parent.is_dir():
        raise CommandError(f"{path}: there is no folder {path.parent}")
    if not os.access(path.absolute().parent, os.W_OK):
        raise CommandError(f"{path}: the folder {path.parent} cannot be written to")
    try:
        refuse_existing(path, overwrite, COMPANIONS.get(path.suffix.lower(), ()))
    except UnwrittenError as fault:
        raise CommandError(f"{path}: {fault}") from fault


@contextmanager
def written_there(path: Path, overwrite: bool) -> Iterator[Path]:
    """The path to write the file to; afterwards the whole file is there, or CommandError is raised."""
    companions = COMPANIONS.get(path.suffix.lower(), ())
    try:
        with written_whole(path, companions=companions, overwrite=overwrite) as beside:
            yield beside
    except (UnwrittenError, CommandError) as fault:
        # Blender's own message about a failure need not name the file.
        raise CommandError(f"{path}: {fault}") from fault


def load(path: Path | None, unit: float | None = None) -> None:
    """Open or import a file, or Suzanne without one, in place of the open file.

    unit: in metres, for files without a unit of their own. The scene's unit becomes that of the file, so that its
    numbers stay.
    """
    if path is not None and path.suffix.lower() == BLEND:
        call(bpy.ops.wm.open_mainfile, filepath=str(path.absolute()), use_scripts=scripts_allowed())
        if bpy.context.mode != "OBJECT":
            call(bpy.ops.object.mode_set, mode="OBJECT")
        return
    call(bpy.ops.wm.read_homefile, use_empty=True)
    if path is None:
        call(bpy.ops.mesh.primitive_monkey_add)
        return
    settings = bpy.context.scene.unit_settings
    settings.scale_length = unit_of(path, unit)
    if unit_of(path, unit) == UNITS[".stl"]:
        settings.length_unit = "MILLIMETERS"
    _import(path)
    for mesh in bpy.data.meshes:
        if path.suffix.lower() in {".glb", ".gltf"}:
            _weld(mesh)


def _import(path: Path) -> None:
    operator = reader(path)
    options = {"filepath": str(path.absolute()), **READING.get(path.suffix.lower(), {})}
    call(operator, **known_options(operator, options))


def _weld(mesh: bpy.types.Mesh) -> None:
    """Merge vertices at equal positions. glTF splits them wherever normals or UVs change, and the limit surface would
    come apart there."""
    positions = read_values(mesh.vertices, "co", np.float32, 3)
    _, firsts, groups = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    targets = firsts[groups.ravel()]
    moved = np.flatnonzero(targets != np.arange(len(positions)))
    if not len(moved):
        return
    # Custom normals are stored as seen from the faces around a vertex, which become others.
    carried = CarriedNormals(mesh) if mesh.has_custom_normals else None
    with as_bmesh(mesh) as shape:
        shape.verts.ensure_lookup_table()
        target_of = {shape.verts[one]: shape.verts[other] for one, other in zip(moved, targets[moved], strict=True)}
        bmesh.ops.weld_verts(shape, targetmap=target_of)
    if carried is not None:
        carried.put_back(mesh, deformable=False)


def write_blend(path: Path) -> None:
    """Save a copy of the open file. Raises CommandError."""
    try:
        call(bpy.ops.wm.save_as_mainfile, filepath=str(path), copy=True, check_existing=False)
    except CommandError as fault:
        # Blender has removed the unfinished file, and may report only that.
        raise CommandError(f"Blender could not save it: {fault}; is the disk full?") from fault


def check_blend(path: Path, names: Sequence[str]) -> None:
    """Raise CommandError unless objects of these names can be read from a .blend file. Blender keeps the list of its
    structures at the end of a file, and so reads nothing from one that was cut off."""
    try:
        with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
            wanted.objects = list(names)
        is_whole = None not in wanted.objects
    except (OSError, RuntimeError):
        is_whole = False
    bpy.data.batch_remove([each for each in bpy.data.libraries if Path(bpy.path.abspath(each.filepath)) == path])
    if not is_whole:
        raise CommandError(f"it cannot be read back; {CUT_OFF}")


def write_meshes(objects: Mapping[str, bpy.types.Object], path: Path, scale: float) -> tuple[str, ...]:
    """Write the shown meshes of objects under these names, without heat maps, to a file; returns the data that the file
    does not hold. scale: the unit of the scene in the unit of the file. Files beside it are named relative to the
    folder above, where the file is moved later."""
    operator, suffix = writer(path), path.suffix.lower()
    options = {"filepath": str(path), "check_existing": False, **WRITING[suffix]}
    if suffix in COMPANIONS and not any(each.material_slots for each in objects.values()):
        options["export_materials"] = False
    with _shown_alone(objects, scale) as meshes:
        call(operator, **known_options(operator, options))
        lost = tuple(name for name in LOST.get(suffix, ()) if any(map(HELD[name], meshes)))
    for companion in (path.with_suffix(each) for each in COMPANIONS.get(suffix, ())):
        if companion.exists():
            companion.write_bytes(NAMED_FILE.sub(rb"\1", companion.read_bytes()))
    return lost


def triangles_in(path: Path, triangles: Triangles) -> int:
    """The least number of an object's triangles that are read back from a file."""
    if path.suffix.lower() not in WITHOUT_REPEATED:
        return len(triangles.corners)
    _, vertices = np.unique(triangles.positions, axis=0, return_inverse=True)
    corners = np.sort(vertices.ravel()[triangles.corners], axis=1)
    return len(np.unique(corners[np.diff(corners, axis=1).all(axis=1)], axis=0))


@contextmanager
def _shown_alone(objects: Mapping[str, bpy.types.Object], scale: float) -> Iterator[list[bpy.types.Mesh]]:
    """Select only plain copies of the objects' shown meshes, with these names, enlarged by a factor, in a scene of
    metres. Gives the meshes of the copies."""
    names = [NO_NAME.sub("_", each) for each in objects]
    layer, unit = bpy.context.view_layer, bpy.context.scene.unit_settings
    with ExitStack() as undo:
        for each in [*bpy.data.objects, *bpy.data.meshes]:
            if each.name in names and each.is_editable:
                undo.callback(setattr, each, "name", each.name)
                each.name = f"Original {each.name}"
        undo.callback(setattr, layer.objects, "active", layer.objects.active)
        for each in layer.objects:
            undo.callback(each.select_set, each.select_get())
        undo.enter_context(temporary_data("objects", "meshes"))
        # In a scene of metres no writer changes lengths.
        undo.callback(setattr, unit, "scale_length", unit.scale_length)
        unit.scale_length = 1.0
        depsgraph = bpy.context.evaluated_depsgraph_get()
        shown = [_shown_copy(each.evaluated_get(depsgraph), depsgraph) for each in objects.values()]
        # Selecting may bring the list up to date, which crashes Blender while it is read.
        for each in list(layer.objects):
            each.select_set(False)
        groups: dict[bpy.types.Collection, bpy.types.Object] = {}
        for each, name, (mesh, matrix) in zip(objects.values(), names, shown, strict=True):
            # Some formats take the name of the one, some that of the other.
            mesh.name = name
            copy = bpy.data.objects.new(name, mesh)
            _place(copy, Matrix.Scale(scale, 4) @ matrix)
            bpy.context.scene.collection.objects.link(copy)
            copy.select_set(True)
            layer.objects.active = copy
            if (switch := Switch.read(each)) is not None:
                switch.in_units(scale).write(copy)
                copy.parent = _level_group(each.users_collection[0], groups)
        layer.update()
        yield [mesh for mesh, _ in shown]


def _level_group(
    collection: bpy.types.Collection, groups: dict[bpy.types.Collection, bpy.types.Object]
) -> bpy.types.Object:
    """The empty above the levels of detail in a collection, a LodGroup in FBX files, which engines take for a set of
    levels. groups: the empties so far."""
    if collection not in groups:
        group = groups[collection] = bpy.data.objects.new(collection.name, None)
        group["fbx_type"] = "LodGroup"
        bpy.context.scene.collection.objects.link(group)
        group.select_set(True)
    return groups[collection]


def _shown_copy(evaluated: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[bpy.types.Mesh, Matrix]:
    """A copy of an object's shown mesh, with the colours of the user, and the object's matrix."""
    mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=depsgraph)
    remove_all(mesh)
    mesh.property_unset("ccdepth")
    return mesh, evaluated.matrix_world.copy()


def _place(copy: bpy.types.Object, matrix: Matrix) -> None:
    """Put a new object at the place of a matrix; scale and shear go to its mesh, as not all formats have shear."""
    copy.data.transform(matrix.to_3x3().to_4x4())
    if matrix.is_negative:
        copy.data.flip_normals()
    copy.location = matrix.translation


def read_back(path: Path, names: Sequence[str]) -> list[bpy.types.Object]:
    """The mesh objects of a file, opened in place of the open file; of a .blend file the objects of given names, in
    this order, as its scene shows them."""
    if path.suffix.lower() == BLEND:
        load(path, None)
        missing = [name for name in names if (name, None) not in bpy.data.objects]
        if missing:
            raise CommandError(f"there is no object “{missing[0]}” in it")
        return [bpy.data.objects[name, None] for name in names]
    call(bpy.ops.wm.read_homefile, use_empty=True)
    bpy.context.scene.unit_settings.scale_length = 1.0
    try:
        _import(path)
    except CommandError as fault:
        raise CommandError(f"it cannot be read back: {fault}; {CUT_OFF}") from fault
    bpy.context.view_layer.update()
    return [each for each in bpy.data.objects if each.type == "MESH"]
