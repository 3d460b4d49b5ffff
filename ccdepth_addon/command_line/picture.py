# SPDX-License-Identifier: GPL-3.0-or-later
"""A picture of the heat map with its legend, or of the edges alone, rendered without a display or a graphics card.

Everything is laid out in a temporary scene with the picture as its XY plane, one unit to the pixel, seen from straight
above by an orthographic camera. Surfaces glow in their own colours, so the legend's colours are exact to the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import Enum, auto
from math import cos, radians, sin
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ..core import FloatArray
from ..exchange.blender_arrays import read_values
from ..exchange.data_blocks import own_copy
from ..exchange.evaluated import Evaluated, evaluated
from ..exchange.face_values import has_values
from ..exchange.modifiers import counted_modifiers
from ..state import heat_map, mesh_values
from ..state.colors import to_linear
from ..state.heat_map import Shown
from ..ui.legend_contents import Color, Legend, legend
from ..ui.legend_layout import Style, column
from .blender_calls import CommandError, temporary_data
from .picture_materials import emission_material, give_material, surface_material

WIDTH, HEIGHT = 1600, 1000
# The size of pictures in a report, as a part of --picture's: as wide as the page.
SMALL = 0.65
MARGIN = 70
LEGEND_WIDTH = 250
TITLE_HEIGHT = 130
SAMPLES = 16

# A quarter of the size of a .png file, without a visible loss.
WEBP, WEBP_QUALITY = ".webp", 90

# The last bytes of every .png file.
PNG_END = b"IEND\xaeB`\x82"

# The viewer stands to the right of the front, a little above.
AZIMUTH = radians(32)
ELEVATION = radians(18)

TITLE_SIZE = 44
TEXT_SIZE = 24
# The size of the legend, in parts of its size in the 3D View, and the width of a letter, as a part of the font's size.
LEGEND_SIZE, LETTER_WIDTH = 2.2, 0.55

BACKGROUND_COLOR = (0.035, 0.036, 0.040)
TITLE_COLOR = (0.90, 0.90, 0.90)
TEXT_COLOR = (0.62, 0.62, 0.62)
STYLE_COLORS = {Style.TEXT: TITLE_COLOR, Style.HEADING: TEXT_COLOR}
EDGE_COLOR = (0.008, 0.008, 0.010)
SURFACE_COLOR = (0.60, 0.61, 0.63)

# Edges are drawn while faces are large enough to be seen between them.
SHORTEST_DRAWN_EDGE = 5.0
LARGEST_DRAWN_FACE_COUNT = 200_000
EDGE_WIDTH = 1.6

# Stamps that Blender writes into pictures by default: the places of files, and the time and duration of rendering.
STAMPS = ("date", "time", "render_time", "frame", "scene", "camera", "filename")


class Look(Enum):
    """The look of a picture: the colours of the results, with their legend, or the edges on a surface of one colour."""

    HEAT_MAP = auto()
    WIREFRAME = auto()


def render(
    context: bpy.types.Context,
    objects: Sequence[bpy.types.Object],
    path: Path,
    title: str,
    subtitle: str,
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
    colored = [obj for obj in shown if heat_map.has_shown(obj.data, kind)]
    counted = {each: counted_modifiers(each, use_modifiers=each.data.ccdepth.use_modifiers) for each in shown}
    kinds = ("scenes", "objects", "meshes", "curves", "cameras", "materials")
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
        if look is Look.HEAT_MAP:
            # Title and subtitle replace its notes.
            _add_legend(scene, replace(legend(context.scene, kind, colored), notes=[], alert=""))
        _add_text(scene, title, TITLE_SIZE, TITLE_COLOR, MARGIN, HEIGHT - MARGIN - 0.75 * TITLE_SIZE)
        _add_text(scene, subtitle, TEXT_SIZE, TEXT_COLOR, MARGIN, HEIGHT - MARGIN - 0.75 * TITLE_SIZE - 46)
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
    _add_rectangle(scene, 0, 0, WIDTH, HEIGHT, BACKGROUND_COLOR, z=-2 * WIDTH)
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
    """The matrix that scales and moves the objects, turned to the viewer, into the space beside the texts."""
    seen = np.concatenate([_seen_positions(*pair) for pair in zip(meshes, matrices, strict=True)])
    least, largest = seen.min(axis=0), seen.max(axis=0)
    middle, extent = (least + largest) / 2, largest - least
    space = np.array([WIDTH - 3 * MARGIN - LEGEND_WIDTH, HEIGHT - 2 * MARGIN - TITLE_HEIGHT])
    # A line or a point, as seen by the viewer, still gets into the picture, and nothing comes before the camera.
    scale = min((space / np.maximum(extent[:2], extent.max() / 100 + 1e-30)).min(), WIDTH / max(extent[2], 1e-30))
    centre = Matrix.Translation((MARGIN + space[0] / 2, MARGIN + space[1] / 2, 0.0))
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


def _add_legend(scene: bpy.types.Scene, wanted: Legend) -> None:
    """Draw the legend of the 3D View, as large as there is room."""
    largest = column(wanted, LEGEND_SIZE, _width)
    room = min(1.0, LEGEND_WIDTH / largest.width, (HEIGHT - 2 * MARGIN) / largest.height)
    layout = column(wanted, LEGEND_SIZE * room, _width)
    x, y = WIDTH - MARGIN - layout.width, (HEIGHT - layout.height) / 2
    filled = [
        # Materials take linear colours.
        *((place, tuple(to_linear(np.array(color)).tolist())) for place, color in layout.swatches),
        *((tick, TEXT_COLOR) for tick in layout.ticks),
    ]
    for (left, bottom, right, top), color in filled:
        _add_rectangle(scene, x + left, y + bottom, x + right, y + top, color)
    for text, along, up, style, ends_there in layout.texts:
        align = "RIGHT" if ends_there else "LEFT"
        _add_text(scene, text, layout.font_size, STYLE_COLORS[style], x + along, y + up, align)


def _width(text: str, size: float) -> float:
    """The approximate width of a text: without a window Blender measures no text before evaluating it."""
    return LETTER_WIDTH * size * len(text)


def _add_rectangle(
    scene: bpy.types.Scene, left: float, bottom: float, right: float, top: float, color: Color, z: float = WIDTH
) -> None:
    mesh = bpy.data.meshes.new("Rectangle")
    mesh.from_pydata([(left, bottom, 0), (right, bottom, 0), (right, top, 0), (left, top, 0)], [], [(0, 1, 2, 3)])
    give_material(mesh, emission_material())
    _add_object(scene, "Rectangle", mesh, Matrix.Translation((0, 0, z)), color)


def _add_text(
    scene: bpy.types.Scene, text: str, size: float, color: Color, x: float, y: float, align: str = "LEFT"
) -> None:
    curve = bpy.data.curves.new("Text", "FONT")
    curve.body = text
    curve.size = size
    curve.align_x = align
    if align == "LEFT":
        # Whatever is too long for the picture is made smaller.
        curve.overflow = "SCALE"
        curve.text_boxes[0].width, curve.text_boxes[0].height = WIDTH - x - MARGIN, 1.5 * size
    give_material(curve, emission_material())
    _add_object(scene, "Text", curve, Matrix.Translation((x, y, WIDTH)), color)


def _add_object(
    scene: bpy.types.Scene, name: str, data: Any, matrix: Matrix, color: Color = (1.0, 1.0, 1.0)
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
