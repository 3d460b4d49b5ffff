# SPDX-License-Identifier: GPL-3.0-or-later
"""A picture of the heat map, or of the edges alone, rendered without a display or a graphics card.

Everything is laid out in a temporary scene with the picture as its XY plane, one unit to the pixel, seen from straight
above by an orthographic camera. Surfaces glow in their own colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto
from math import cos, radians, sin
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ..core import FloatArray
from ..exchange.blender_arrays import read_values
from ..exchange.blender_calls import CommandError, temporary_data
from ..exchange.data_blocks import own_copy
from ..exchange.evaluated import Evaluated, evaluated
from ..exchange.face_values import COLOR, has_values
from ..exchange.modifiers import counted_modifiers
from ..state import heat_map, mesh_values
from ..state.heat_map import Shown

WIDTH, HEIGHT = 1600, 1000
# The size of pictures in a report, as a part of --picture's: as wide as the page.
SMALL = 0.65
MARGIN = 70
SAMPLES = 16

# A quarter of the size of a .png file, without a visible loss.
WEBP, WEBP_QUALITY = ".webp", 90

# The last bytes of every .png file.
PNG_END = b"IEND\xaeB`\x82"

# The viewer stands to the right of the front, a little above.
AZIMUTH = radians(32)
ELEVATION = radians(18)

BACKGROUND_COLOR = (0.035, 0.036, 0.040)
EDGE_COLOR = (0.008, 0.008, 0.010)
SURFACE_COLOR = (0.60, 0.61, 0.63)

# Edges are drawn while faces are large enough to be seen between them.
SHORTEST_DRAWN_EDGE = 5.0
LARGEST_DRAWN_FACE_COUNT = 200_000
EDGE_WIDTH = 1.6

# Stamps that Blender writes into pictures by default: the places of files, and the time and duration of rendering.
STAMPS = ("date", "time", "render_time", "frame", "scene", "camera", "filename")


class Look(Enum):
    """The look of a picture: the colours of the results, or the edges on a surface of one colour."""

    HEAT_MAP = auto()
    WIREFRAME = auto()


def render(
    context: bpy.types.Context,
    objects: Sequence[bpy.types.Object],
    path: Path,
    look: Look = Look.HEAT_MAP,
    size: float = 1.0,
) -> None:
    """Render objects with results, to a .png file, or to a .webp file (``has_webp``). size: of the picture, as a part
    of the usual size.

    Each object is shown by its control mesh with depths or deviations, or by its adaptive mesh with distances. The
    file's own scenes, objects and meshes stay unchanged. Raises CommandError.
    """
    shown = [obj for obj in objects if mesh_values.has_any(obj.data)]
    if not shown:
        raise CommandError("there are no depths to make a picture of")
    kind = heat_map.last_kind(shown[0].data)
    assert kind is not None
    counted = {each: counted_modifiers(each, use_modifiers=each.data.ccdepth.use_modifiers) for each in shown}
    kinds = ("scenes", "objects", "meshes", "cameras", "materials")
    with temporary_data(*kinds), evaluated(context, counted) as copies:
        scene = _new_scene(size)
        if path.suffix == WEBP:
            scene.render.image_settings.file_format = "WEBP"
            scene.render.image_settings.quality = WEBP_QUALITY
        meshes = [_colored_mesh(copies, each, kind, context.scene.ccdepth) for each in shown]
        matrices = [_view_rotation() @ obj.matrix_world for obj in shown]
        fit = _fitting(meshes, matrices)
        for mesh, matrix in zip(meshes, matrices, strict=True):
            _add_surface(scene, mesh, fit @ matrix, look)
        _write_picture(scene, path)


def has_webp() -> bool:
    """Whether this Blender can write .webp files."""
    formats = bpy.types.ImageFormatSettings.bl_rna.properties["file_format"]
    assert isinstance(formats, bpy.types.EnumProperty)
    return "WEBP" in formats.enum_items


def _new_scene(size: float) -> bpy.types.Scene:
    """An empty scene and its camera, which looks straight down at the picture's plane."""
    scene = bpy.data.scenes.new("CC Depth Picture")
    render_settings = scene.render
    try:
        render_settings.engine = "CYCLES"
    except TypeError as fault:
        raise CommandError("the picture needs the Cycles renderer, which is not enabled in this Blender") from fault
    render_settings.resolution_x, render_settings.resolution_y = WIDTH, HEIGHT
    render_settings.resolution_percentage = round(100 * size)
    render_settings.dither_intensity = 0.0
    render_settings.image_settings.file_format = "PNG"
    render_settings.image_settings.color_mode = "RGB"
    for name in STAMPS:
        setattr(render_settings, f"use_stamp_{name}", False)
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.max_bounces = 0
    scene.display_settings.display_device = "sRGB"
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    scene.camera = _add_object(scene, "Camera", _new_camera(), Matrix.Translation((WIDTH / 2, HEIGHT / 2, 2 * WIDTH)))
    background = bpy.data.meshes.new("Background")
    background.from_pydata([(0, 0, 0), (WIDTH, 0, 0), (WIDTH, HEIGHT, 0), (0, HEIGHT, 0)], [], [(0, 1, 2, 3)])
    give_material(background, emission_material())
    _add_object(scene, "Background", background, Matrix.Translation((0, 0, -2 * WIDTH)), BACKGROUND_COLOR)
    return scene


def _new_camera() -> bpy.types.Camera:
    camera = bpy.data.cameras.new("Camera")
    camera.type = "ORTHO"
    camera.ortho_scale = WIDTH
    camera.clip_start, camera.clip_end = 1.0, 5.0 * WIDTH
    return camera


def _view_rotation() -> Matrix:
    """The rotation from the scene's directions to the picture's: X to the right, Y up, Z to the viewer."""
    right = (cos(AZIMUTH), sin(AZIMUTH), 0.0)
    up = (-sin(ELEVATION) * sin(AZIMUTH), sin(ELEVATION) * cos(AZIMUTH), cos(ELEVATION))
    viewer = (cos(ELEVATION) * sin(AZIMUTH), -cos(ELEVATION) * cos(AZIMUTH), sin(ELEVATION))
    return Matrix((right, up, viewer)).to_4x4()


def _colored_mesh(
    copies: Evaluated, blender_object: bpy.types.Object, kind: Shown, settings: bpy.types.PropertyGroup
) -> bpy.types.Mesh:
    """A copy of the object's control mesh, with the heat map's colours."""
    mesh = copies.without_origins(blender_object) if blender_object in copies else own_copy(blender_object.data)
    if not has_values(mesh, kind.values):
        mesh = own_copy(blender_object.data)
    if has_values(mesh, kind.values):
        heat_map.write_colors(mesh, kind, heat_map.tolerance_of(blender_object.data, kind), settings)
    return mesh


def _fitting(meshes: list[bpy.types.Mesh], matrices: list[Matrix]) -> Matrix:
    """The matrix that scales and moves the objects, turned to the viewer, into the picture."""
    seen = np.concatenate([_seen_positions(*pair) for pair in zip(meshes, matrices, strict=True)])
    least, largest = seen.min(axis=0), seen.max(axis=0)
    middle, extent = (least + largest) / 2, largest - least
    space = np.array([WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN])
    # A line or a point, as seen by the viewer, still gets into the picture, and nothing comes before the camera.
    scale = min((space / np.maximum(extent[:2], extent.max() / 100 + 1e-30)).min(), WIDTH / max(extent[2], 1e-30))
    centre = Matrix.Translation((WIDTH / 2, HEIGHT / 2, 0.0))
    return centre @ Matrix.Scale(scale, 4) @ Matrix.Translation(-middle)


def _seen_positions(mesh: bpy.types.Mesh, matrix: Matrix) -> FloatArray:
    """(V, 3) float64: the positions of vertices moved by a matrix."""
    transform = np.array(matrix, dtype=np.float64)
    return read_values(mesh.vertices, "co", np.float32, 3) @ transform[:3, :3].T + transform[:3, 3]


def _add_surface(scene: bpy.types.Scene, mesh: bpy.types.Mesh, matrix: Matrix, look: Look) -> None:
    width = _edge_width(mesh, matrix)
    if width > 0.0:
        _add_edges(scene, mesh.copy(), matrix, width)
    give_material(mesh, surface_material(look is Look.HEAT_MAP))
    _add_object(scene, "Surface", mesh, matrix, SURFACE_COLOR)


def _edge_width(mesh: bpy.types.Mesh, matrix: Matrix) -> float:
    """The width of the edges in pixels; 0 if they would hide the faces."""
    if not len(mesh.edges) or len(mesh.polygons) > LARGEST_DRAWN_FACE_COUNT:
        return 0.0
    ends = _seen_positions(mesh, matrix)[read_values(mesh.edges, "vertices", np.int32, 2)]
    typical = float(np.median(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)))
    return EDGE_WIDTH * min(1.0, typical / 20) if typical > SHORTEST_DRAWN_EDGE else 0.0


def _add_edges(scene: bpy.types.Scene, mesh: bpy.types.Mesh, matrix: Matrix, width: float) -> None:
    give_material(mesh, emission_material())
    edges = _add_object(scene, "Edges", mesh, matrix, EDGE_COLOR)
    wireframe = edges.modifiers.new("Wireframe", "WIREFRAME")
    wireframe.thickness = width / max(np.linalg.svd(np.array(matrix)[:3, :3], compute_uv=False).max(), 1e-30)
    wireframe.offset = 0.0
    wireframe.use_even_offset = False
    wireframe.use_boundary = True


def _add_object(
    scene: bpy.types.Scene, name: str, data: Any, matrix: Matrix, color: tuple[float, ...] = (1.0, 1.0, 1.0)
) -> bpy.types.Object:
    added = bpy.data.objects.new(name, data)
    added.matrix_world = matrix
    added.color = (*color, 1.0)
    scene.collection.objects.link(added)
    return added


def _write_picture(scene: bpy.types.Scene, path: Path) -> None:
    try:
        bpy.ops.render.render(scene=scene.name)
        result = next(each for each in bpy.data.images if each.type == "RENDER_RESULT")
        result.save_render(str(path.absolute()), scene=scene)
    except RuntimeError as fault:
        raise CommandError(f"the picture could not be rendered: {fault}") from fault
    # Blender reports no full disk; both formats are cut off at an end of their own.
    content = path.read_bytes() if path.is_file() else b""
    length = int.from_bytes(content[4:8], "little") + 8
    is_whole = len(content) == length if path.suffix == WEBP else content.endswith(PNG_END)
    if not is_whole:
        raise CommandError(f"the picture could not be written to {path}; is the disk full?")


# A face turned away from the light keeps this part of its colour: less than from one depth to the next.
SHADOW = 0.8
LIGHT = (-0.40, 0.55, 0.73)


def give_material(data: Any, material: bpy.types.Material) -> None:
    """Give a mesh a single material."""
    data.materials.clear()
    data.materials.append(material)


def emission_material() -> bpy.types.Material:
    """A material that glows in its object's colour."""
    material, _nodes, emission = _new_emission("CC Depth Glow")
    source = material.node_tree.nodes.new("ShaderNodeObjectInfo")
    material.node_tree.links.new(source.outputs["Color"], emission.inputs["Color"])
    return material


def surface_material(has_heat_map: bool) -> bpy.types.Material:
    """A material that glows in the colours of the results, or of its object, a little less on sides turned away from
    the light."""
    material, nodes, emission = _new_emission("CC Depth Surface")
    links = material.node_tree.links
    if has_heat_map:
        color = nodes.new("ShaderNodeAttribute")
        color.attribute_name = COLOR
    else:
        color = nodes.new("ShaderNodeObjectInfo")
    links.new(color.outputs["Color"], emission.inputs["Color"])
    cosine = nodes.new("ShaderNodeVectorMath")
    cosine.operation = "DOT_PRODUCT"
    cosine.inputs[1].default_value = LIGHT
    links.new(nodes.new("ShaderNodeNewGeometry").outputs["Normal"], cosine.inputs[0])
    strength = nodes.new("ShaderNodeMapRange")
    strength.inputs["From Min"].default_value = -0.1
    strength.inputs["To Min"].default_value = SHADOW
    links.new(cosine.outputs["Value"], strength.inputs["Value"])
    links.new(strength.outputs["Result"], emission.inputs["Strength"])
    return material


def _new_emission(name: str) -> tuple[bpy.types.Material, bpy.types.Nodes, bpy.types.Node]:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    emission = nodes.new("ShaderNodeEmission")
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
    return material, nodes, emission
