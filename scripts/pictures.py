# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the pictures of README, of the manual and of the extension's page: docs/images/before_and_after.jpg,
featured.jpg and icon.png, ccdepth_addon/manual/angles.jpg and weights.jpg.

python scripts/pictures.py       with the bpy wheel and pillow
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np
from mathutils import Euler, Vector
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import ccdepth_addon
from benchmarks.normals import MODELS
from ccdepth_addon.state.colors import depth_colors
from tests.blender import scene

FloatArray = NDArray[np.float64]

CHECKOUT = Path(__file__).resolve().parent.parent
IMAGES, MANUAL = CHECKOUT / "docs" / "images", CHECKOUT / "ccdepth_addon" / "manual"

# A part of the diagonal, an angle in degrees, and the least level that brings all of Suzanne's faces within the
# tolerance, with limit vertices.
TOLERANCE, ANGLE = 1e-3, 5.0
LEVEL = 3

# Edges are drawn larger and scaled down, for smooth lines.
OVERSAMPLING = 4

SAMPLES = 40
PAINT = (0.42, 0.02, 0.012, 1.0)
# The light of the surroundings by height, from below to above, with a horizon.
SURROUNDINGS = ((0.0, 0.02), (0.49, 0.12), (0.51, 0.75), (1.0, 0.25))
PAPER, INK, LINE, FACE = (255, 255, 255), (40, 44, 52), (52, 60, 74), np.array([236, 239, 244])
LIGHT, INSIDE = np.array([-0.35, 0.55, 0.76]), 0.4

# Soft boxes that are reflected, as seen: where they stand, and their widths and heights; and their strength.
SOFT_BOXES = (((-4, 4, 5), (2, 6)), ((5, 1, 4), (1, 8)), ((0, 7, 1), (9, 2)), ((0, -6, 3), (6, 1)))
STRENGTH = 9.0


@dataclass(frozen=True)
class View:
    """A view from the front: degrees to the side and upwards, the point in the middle, and the width seen there."""

    aside: float
    up: float
    middle: tuple[float, float, float]
    width: float

    def axes(self) -> FloatArray:
        """(3, 3), in columns: to the right, upwards, and towards the viewer."""
        turned = Euler((np.radians(90 - self.up), 0, np.radians(self.aside))).to_matrix()
        return np.array(turned, dtype=np.float64)


# The distance of the eye, in widths seen.
EYE = 3.0

SUZANNE = View(28.0, 12.0, (0.06, 0.0, -0.03), 2.85)
# What the manual shows of the models of benchmarks/normals.py.
SHOWN = {
    "Suzanne": View(14.0, 4.0, (0.38, -0.7, 0.26), 1.15),
    "chair": View(35.0, 28.0, (0.42, -0.42, 0.0), 0.42),
    "bevelled cube": View(35.0, 30.0, (0.82, -0.82, 0.82), 0.9),
    "torus 12 x 8": View(0.0, 34.0, (0.0, 0.0, 0.0), 2.65),
}


# The way from a column's middle to the next, in percent of a cell.
APART = 103


@dataclass(frozen=True)
class Sheet:
    """A picture of two columns: its size in pixels, that of a mesh, and of the letters."""

    width: int
    cell: tuple[int, int]
    letters: int


README, FEATURED, ANGLES = Sheet(1240, (600, 450), 22), Sheet(1920, (640, 480), 40), Sheet(900, (440, 330), 17)

# Corner and side of the icon's squares on a grid of eight, and their depths.
ICON_SIZE = 256
ICON_SQUARES = (
    *((x, y, 2, 1) for x, y in ((0, 0), (0, 2), (0, 4), (0, 6), (2, 0), (4, 0), (6, 0), (2, 2))),
    *((x, y, 1, 3) for x in (4, 5, 6, 7) for y in (2, 3)),
    *((x, y, 1, 3) for x in (2, 3) for y in (4, 5, 6, 7)),
    *((x / 2, y / 2, 0.5, 5) for x in range(8, 16) for y in range(8, 16) if x < 12 or y < 12),
    *((6 + x / 4, 6 + y / 4, 0.25, 7) for x in range(8) for y in range(8)),
)


def smooth(make: Callable[[], bpy.types.Object]) -> bpy.types.Object:
    """A new object alone in the scene, selected and shaded smooth."""
    scene.clear()
    made = make()
    made.data.polygons.foreach_set("use_smooth", [True] * len(made.data.polygons))
    made.select_set(True)
    bpy.context.view_layer.objects.active = made
    return made


def of_level(make: Callable[[], bpy.types.Object]) -> None:
    """A model by its modifier, at the level that all of its faces need."""
    modifier = smooth(make).modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.quality, modifier.use_limit_surface = LEVEL, 10, True
    bpy.ops.object.modifier_apply(modifier=modifier.name)


def adaptive(make: Callable[[], bpy.types.Object], angle: float) -> None:
    """A model by Apply Adaptive Subdivision, with an angle of shading in degrees."""
    smooth(make)
    bpy.ops.ccdepth.subdivide(
        tolerance=TOLERANCE, tolerance_mode="RELATIVE", output="IN_PLACE", shading_angle=np.radians(angle)
    )


def glossy(view: View, size: tuple[int, int]) -> Image.Image:
    """The active object as a render in car paint, on paper."""
    axes, render = view.axes(), bpy.context.scene.render
    _paint(bpy.context.object)
    _surround()
    for place, (width, height) in SOFT_BOXES:
        _add_soft_box(axes @ np.array(place), width, height, Vector(view.middle))
    camera = scene.add("Camera", bpy.data.cameras.new("Camera"))
    camera.data.lens = EYE * camera.data.sensor_width
    camera.rotation_euler = Euler((np.radians(90 - view.up), 0, np.radians(view.aside)))
    camera.location = Vector(view.middle) + Vector(EYE * view.width * axes[:, 2])
    bpy.context.scene.camera = camera
    bpy.context.scene.view_settings.view_transform = "Standard"
    render.engine, render.film_transparent = "CYCLES", True
    render.resolution_x, render.resolution_y = size
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGBA"
    bpy.context.scene.cycles.samples, bpy.context.scene.cycles.use_denoising = SAMPLES, True
    with TemporaryDirectory() as folder:
        render.filepath = str(Path(folder) / "render.png")
        bpy.ops.render.render(write_still=True)
        with Image.open(render.filepath) as image:
            paper = Image.new("RGBA", size, (*PAPER, 255))
            return Image.alpha_composite(paper, image.convert("RGBA")).convert("RGB")


def _paint(shown: bpy.types.Object) -> None:
    material = bpy.data.materials.new("Paint")
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"].inputs
    shader["Base Color"].default_value, shader["Roughness"].default_value = PAINT, 0.3
    shader["Metallic"].default_value = 0.7
    shader["Coat Weight"].default_value, shader["Coat Roughness"].default_value = 1.0, 0.02
    shown.data.materials.clear()
    shown.data.materials.append(material)


def _surround() -> None:
    world = bpy.context.scene.world = bpy.data.worlds.new("Horizon")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    place, parts, half, ramp = (
        nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "SeparateXYZ", "MapRange", "ValToRGB")
    )
    half.inputs["From Min"].default_value = -1.0
    links.new(place.outputs["Generated"], parts.inputs[0])
    links.new(parts.outputs["Z"], half.inputs["Value"])
    links.new(half.outputs["Result"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], nodes["Background"].inputs["Color"])
    elements = ramp.color_ramp.elements
    while len(elements) < len(SURROUNDINGS):
        elements.new(0.5)
    for element, (height, light) in zip(elements, SURROUNDINGS, strict=True):
        element.position, element.color = height, (light, light, light, 1.0)


def _add_soft_box(place: FloatArray, width: float, height: float, middle: Vector) -> None:
    light = scene.add("Soft Box", bpy.data.lights.new("Soft Box", "AREA"))
    light.data.shape, light.data.size, light.data.size_y = "RECTANGLE", width, height
    light.data.energy = STRENGTH * np.pi * width * height
    light.location = Vector(place) + middle
    light.rotation_euler = Vector(place).to_track_quat("Z", "Y").to_euler()


def drawn(mesh: bpy.types.Mesh, view: View, size: tuple[int, int]) -> Image.Image:
    """The mesh with its edges, farther faces first."""
    points = (scene.values_of(mesh.vertices, "co", np.float32, 3).astype(np.float64) - view.middle) @ view.axes()
    large = [OVERSAMPLING * each for each in size]
    points[:, :2] *= (EYE * view.width / (EYE * view.width - points[:, 2]))[:, None]
    flat = points[:, :2] * (large[0] / view.width) * (1, -1) + np.array(large) / 2
    image = Image.new("RGB", tuple(large), PAPER)
    pen = ImageDraw.Draw(image)
    polygons = [list(polygon.vertices) for polygon in mesh.polygons]
    for polygon in sorted(polygons, key=lambda polygon: points[polygon, 2].mean()):
        corners = points[polygon]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= np.linalg.norm(normal)
        shade = 0.62 + 0.38 * max(0.0, float(normal @ LIGHT)) if normal[2] > 0 else INSIDE
        outline = [tuple(point) for point in flat[polygon].tolist()]
        pen.polygon(outline, fill=tuple((FACE * shade).astype(int).tolist()))
        pen.line([*outline, outline[0]], fill=LINE, width=OVERSAMPLING // 2)
    return image.resize(size, Image.Resampling.LANCZOS)


def count_of_faces() -> str:
    return f"{len(bpy.context.object.data.polygons):,} faces"


def sheet_of(sheet: Sheet, rows: list[list[Image.Image]], titles: list[list[str]]) -> Image.Image:
    """Pictures in two columns, with the titles below each row, if there are any."""
    line = 2 * sheet.letters
    heights = [sheet.cell[1] + line * bool(own) for own in titles]
    picture = Image.new("RGB", (sheet.width, sum(heights) + line // 2), PAPER)
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(size=sheet.letters)
    for row, (images, own) in enumerate(zip(rows, titles, strict=True)):
        top = sum(heights[:row])
        for column, image in enumerate(images):
            middle = sheet.width // 2 + (2 * column - 1) * sheet.cell[0] * APART // 200
            picture.paste(image.resize(sheet.cell, Image.Resampling.LANCZOS), (middle - sheet.cell[0] // 2, top))
            if own:
                pen.text((middle, top + sheet.cell[1] + line // 2), own[column], fill=INK, font=font, anchor="mm")
    return picture


def level_and_adaptive() -> None:
    """Suzanne at a level and adaptive, glossy and as edges."""
    columns = []
    makers = ((f"Level {LEVEL}", lambda: of_level(scene.add_suzanne)),)
    makers += (("CC Depth", lambda: adaptive(scene.add_suzanne, ANGLE)),)
    for name, make in makers:
        make()
        size = FEATURED.cell
        images = [glossy(SUZANNE, size), drawn(bpy.context.object.data, SUZANNE, size)]
        columns.append((images, f"{name}: {count_of_faces()}"))
    rows = [list(row) for row in zip(*(images for images, _ in columns), strict=True)]
    for file, sheet in (("before_and_after", README), ("featured", FEATURED)):
        save(sheet_of(sheet, rows, [[], [title for _, title in columns]]), IMAGES / f"{file}.jpg")


def angles() -> None:
    """Models by distance alone, and with an angle of shading as well."""
    rows, titles = [], []
    for name, view in SHOWN.items():
        images, own = [], []
        for angle, what in ((0.0, "By distance alone"), (ANGLE, f"With {ANGLE:.0f}°")):
            adaptive(MODELS[name], angle)
            images.append(glossy(view, ANGLES.cell))
            own.append(f"{what}: {count_of_faces()}")
        rows.append(images)
        titles.append(own)
    save(sheet_of(ANGLES, rows, titles), MANUAL / "angles.jpg")


def weights() -> None:
    """Suzanne with one tolerance, and with weights that keep the tolerance for the face."""
    columns = []
    for by, what in (("NONE", "One tolerance"), ("VERTEX_GROUP", "Face at weight 1")):
        suzanne = smooth(scene.add_suzanne)
        group = suzanne.vertex_groups.new(name="Face")
        for vertex in suzanne.data.vertices:
            # From the ears to the eyes.
            group.add([vertex.index], float(np.clip(-2 * vertex.co.y - 0.4, 0.0, 1.0)), "REPLACE")
        bpy.ops.ccdepth.subdivide(
            **{"tolerance": TOLERANCE / 2, "tolerance_mode": "RELATIVE", "output": "IN_PLACE", "shading_angle": 0.0},
            **{"tolerance_by": by, "vertex_group": group.name, "coarsest": 10.0},
        )
        views = [glossy(SUZANNE, ANGLES.cell), drawn(bpy.context.object.data, SUZANNE, ANGLES.cell)]
        columns.append((views, f"{what}: {count_of_faces()}"))
    rows = [list(row) for row in zip(*(views for views, _ in columns), strict=True)]
    save(sheet_of(ANGLES, rows, [[], [title for _, title in columns]]), MANUAL / "weights.jpg")


def save(picture: Image.Image, path: Path) -> None:
    picture.save(path, quality=82, optimize=True, progressive=True)


def icon() -> Image.Image:
    """A square divided further and further towards a corner, in the colours of the depths."""
    side = ICON_SIZE * OVERSAMPLING
    cell = side / 8
    image = Image.new("RGBA", (side, side))
    pen = ImageDraw.Draw(image)
    for x, y, width, depth in ICON_SQUARES:
        [color] = depth_colors(np.array([depth]))[:, :3]
        corners = [x * cell, y * cell, (x + width) * cell - 1, (y + width) * cell - 1]
        pen.rectangle(corners, fill=tuple((255 * color).astype(int).tolist()), outline=PAPER, width=OVERSAMPLING * 2)
    return image.resize((ICON_SIZE, ICON_SIZE), Image.Resampling.LANCZOS)


def main() -> None:
    ccdepth_addon.register()
    level_and_adaptive()
    angles()
    weights()
    icon().save(IMAGES / "icon.png", optimize=True)
    ccdepth_addon.unregister()


if __name__ == "__main__":
    main()
