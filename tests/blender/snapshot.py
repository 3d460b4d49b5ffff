# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything of the user's in the file, as plain values that can be compared: what must be the same after a refusal,
and again after Clear.

A snapshot maps paths to values: ``("meshes", "Cube", "attribute", "UVMap")`` to its type, domain and bytes.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from zlib import crc32

import bpy
import numpy as np

from tests.blender.addon import ATTRIBUTES
from tests.blender.scene import VALUES, values_of

Path = tuple[str, ...]
Snapshot = dict[Path, Any]

OURS = {*ATTRIBUTES, "ccdepth_angle", "ccdepth_deviation"}

# What Blender computes when it evaluates or on access; and what is ours, which is compared apart.
VOLATILE = {
    "bound_box", "ccdepth", "dimensions", "execution_time", "is_evaluated", "is_runtime_data", "persistent_uid",
    "rna_type", "session_uid", "tag", "users",
    # Whether somebody of this file's own uses a linked block besides those of its library: temporary copies do.
    "is_library_indirect",
    # Found from the positions, once somebody asks.
    "texspace_location", "texspace_size",
    # Of a bpy collection of attributes: kept by name, as places move.
    "active_color_index", "active_index", "render_color_index",
}  # fmt: skip
PLAIN = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}
# Collections of settings; all others are data, which is read in bulk, or lists of data-blocks.
SETTINGS = {"constraints", "contributors", "key_blocks", "modifiers", "particle_systems", "rows", "vertex_groups"}
# Where settings of a data-block lie apart from it.
APART = {"data", "display", "driver", "keyframe_points", "override_library", "properties", "inputs"}
# What is loaded and made by working with the interface, and not by operators of ours.
INTERFACE = {"all_ids", "brushes", "palettes", "screens", "window_managers", "workspaces", "fonts", "images"}


# Looking through them takes longer than reading the values.
_known_fields: dict[type, list[tuple[str, str]]] = {}


def take() -> Snapshot:
    """The whole file as it is now. It changes nothing."""
    return dict(_everything())


def differences(before: Snapshot, after: Snapshot, but: Callable[[Path], bool] = lambda path: False) -> list[str]:
    """What is not the same in both, but for the paths that may differ; empty when there is nothing."""
    gone, new = "nothing", "nothing"
    return [
        f"{' / '.join(path)}: {_short(before.get(path, gone))} became {_short(after.get(path, new))}"
        for path in sorted({*before, *after})
        if before.get(path, gone) != after.get(path, new) and not but(path)
    ]


@contextmanager
def unchanged(but: Callable[[Path], bool] = lambda path: False) -> Iterator[None]:
    """What is done within leaves the whole file as it was, but for the paths that may differ."""
    bpy.context.view_layer.update()
    before = take()
    yield
    found = differences(before, take(), but)
    assert not found, "\n".join(found)


def is_ours(path: Path) -> bool:
    """Whether an operator may change this: our attributes and record, and what the heat map shows."""
    if path[0] == "scenes":
        return path[-1] == "heat_map"
    return path[0] == "meshes" and (path[2] == "record" or path[-1] in OURS)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 120 else f"{text[:117]}…"


def _everything() -> Iterator[tuple[Path, Any]]:
    # A measured object keeps what it is measured against, as a result keeps its source.
    kept = Counter(each.ccdepth.measured_against for each in bpy.data.objects)
    for collection in bpy.data.bl_rna.properties:
        if collection.type == "COLLECTION" and collection.identifier not in INTERFACE:
            for block in getattr(bpy.data, collection.identifier):
                # Blender counts two users when it copies an override of a linked block, and one when that is removed.
                users = None if block.library else block.users - kept.get(block, 0)
                library = block.library.name if block.library else ""
                yield ("blocks", collection.identifier, block.name, library), (users, block.use_fake_user)
    for mesh in bpy.data.meshes:
        for path, value in mesh_paths(mesh):
            yield ("meshes", mesh.name_full, *path), value
    for kind in ("objects", "shape_keys", "materials", "collections", "actions", "node_groups", "textures"):
        for block in getattr(bpy.data, kind):
            for path, value in _settings(block):
                yield (kind, block.name_full, *path), value
    for blender_object in bpy.data.objects:
        yield ("objects", blender_object.name_full, "collections"), _names(blender_object.users_collection)
        slots = [(slot.link, slot.material and slot.material.name_full) for slot in blender_object.material_slots]
        yield ("objects", blender_object.name_full, "material slots"), slots
    for keys in bpy.data.shape_keys:
        # What is edited is written to the keys when Edit Mode is left, and not before.
        for key in () if getattr(keys.user, "is_editmode", False) else keys.key_blocks:
            points = _read(key.data, "co", np.float32, 3)
            yield ("shape_keys", keys.name_full, key.name, "points"), points
    for group in bpy.data.collections:
        yield ("collections", group.name_full, "objects"), _names(group.objects)
        yield ("collections", group.name_full, "children"), _names(group.children)
    yield from _scenes()
    yield from _interface()


def _names(blocks: Any) -> list[str]:
    return [block.name_full for block in blocks]


def _scenes() -> Iterator[tuple[Path, Any]]:
    for scene in bpy.data.scenes:
        path = ("scenes", scene.name_full)
        for inner, value in _settings(scene):
            yield (*path, *inner), value
        for inner, value in _settings(scene.ccdepth):
            yield (*path, "ccdepth", *inner), value
        yield (*path, "select mode"), list(scene.tool_settings.mesh_select_mode)
        for layer in scene.view_layers:
            active = layer.objects.active
            yield (*path, layer.name, "active"), active and active.name_full
            yield (*path, layer.name, "objects"), sorted(_names(layer.objects))
            for each in layer.objects:
                state = each.select_get(view_layer=layer), each.hide_get(view_layer=layer)
                yield (*path, layer.name, "selected and hidden", each.name_full), state


def _interface() -> Iterator[tuple[Path, Any]]:
    context = bpy.context
    yield ("mode",), context.mode
    yield ("scene",), context.scene.name
    for screen in bpy.data.screens:
        for number, area in enumerate(screen.areas):
            for space in area.spaces:
                for part in ("shading", "overlay") if space.type == "VIEW_3D" else ():
                    for inner, value in _settings(getattr(space, part)):
                        yield ("viewports", screen.name, str(number), part, *inner), value


def _settings(holder: Any, depth: int = 2) -> Iterator[tuple[Path, Any]]:
    """Every setting of a data-block or of a part of one, and of its parts."""
    for name, kind in _fields(holder):
        try:
            value = getattr(holder, name)
        except (AttributeError, RuntimeError, UnicodeDecodeError):
            continue
        if kind in PLAIN:
            yield (name,), _plain(value)
        elif kind == "POINTER" and isinstance(value, bpy.types.ID):
            yield (name,), value.name_full
        elif kind == "POINTER" and value is not None and depth and name in APART:
            for path, inner in _settings(value, depth - 1):
                yield (name, *path), inner
        elif kind == "COLLECTION" and name in SETTINGS and depth:
            for number, item in enumerate(value):
                for path, inner in _settings(item, depth - 1):
                    yield (name, str(number), *path), inner
    yield from _custom(holder)
    yield from _animation(holder)


def _fields(holder: Any) -> list[tuple[str, str]]:
    """The names and types of the properties of anything of this type, without volatile ones."""
    key = type(holder)
    if key not in _known_fields:
        fields = holder.bl_rna.properties
        _known_fields[key] = [(field.identifier, field.type) for field in fields if field.identifier not in VOLATILE]
    return _known_fields[key]


def _custom(holder: Any) -> Iterator[tuple[Path, Any]]:
    """Custom properties, and before Blender 5.2 the inputs of node groups."""
    try:
        names = list(holder.keys())
    except (AttributeError, TypeError):
        return
    for name in names:
        if name not in {"ccdepth", "cycles"}:
            yield ("custom", name), _plain(holder[name])


def _animation(holder: Any) -> Iterator[tuple[Path, Any]]:
    animation = getattr(holder, "animation_data", None)
    if animation is None:
        return
    action = animation.action
    drivers = [(curve.data_path, curve.driver.expression) for curve in animation.drivers]
    tracks = [
        (track.name, track.mute, [(strip.name, strip.frame_start, strip.frame_end) for strip in track.strips])
        for track in animation.nla_tracks
    ]
    yield ("animation",), (action and action.name_full, drivers, tracks)


def _plain(value: Any) -> Any:
    if isinstance(value, set):
        return sorted(value)
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if isinstance(value, str):
        return value
    # As text, in which a number that is none is equal to itself.
    return repr([_plain(each) for each in value]) if hasattr(value, "__len__") else repr(value)


def mesh_paths(mesh: bpy.types.Mesh) -> Iterator[tuple[Path, Any]]:
    """Everything on a mesh, as it is being edited where it is."""
    if not mesh.is_editmode:
        yield from mesh_content(mesh)
    else:
        import bmesh

        edited = bmesh.from_edit_mesh(mesh)
        scratch = bpy.data.meshes.new("Snapshot")
        try:
            edited.to_mesh(scratch)
            yield from mesh_content(scratch)
        finally:
            bpy.data.meshes.remove(scratch)
        # Through a list, as Python 3.13's comprehensions reject the iterator of Blender 4.3.
        yield ("select history",), [(type(item).__name__, item.index) for item in list(edited.select_history)]
    attributes = mesh.attributes
    active = attributes.active
    # Blender makes and removes hidden attributes as Edit Mode begins and ends, the active one among them.
    yield ("active attribute",), active.name if active and not active.name.startswith(".") else None
    yield ("displayed color",), attributes.active_color_name
    yield ("rendered color",), attributes.default_color_name
    layers = mesh.uv_layers
    yield ("active UV map",), layers.active and layers.active.name
    for layer in layers:
        yield ("UV map", layer.name), (layer.active_render, layer.active_clone)
    yield ("materials",), [material and material.name_full for material in mesh.materials]
    yield ("record",), sorted(_settings(mesh.ccdepth))
    for path, value in _settings(mesh):
        yield ("settings", *path), value


def mesh_content(mesh: bpy.types.Mesh) -> Iterator[tuple[Path, Any]]:
    """The elements, attributes and weights of a mesh that is not being edited."""
    yield ("elements",), (len(mesh.vertices), len(mesh.edges), len(mesh.polygons), len(mesh.loops))
    yield ("loop_start",), _read(mesh.polygons, "loop_start", np.int32, 1)
    for attribute in mesh.attributes:
        kind = attribute.data_type
        if kind == "STRING":
            content: Any = [item.value for item in attribute.data]
        else:
            content = _read(attribute.data, *VALUES[kind])
        yield ("attribute", attribute.name), (kind, attribute.domain, len(attribute.data), content)
    weights = [[(entry.group, entry.weight) for entry in vertex.groups] for vertex in mesh.vertices]
    yield ("weights",), repr(weights)


def _read(items: Any, name: str, dtype: type, width: int) -> int:
    """A checksum of the bytes of a property of every item."""
    return crc32(values_of(items, name, dtype, width).tobytes())
