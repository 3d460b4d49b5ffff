# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the pictures of README and of the extension's page: docs/images/before_and_after.png, featured.png and icon.png.

python scripts/pictures.py       with the bpy wheel and pillow
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import ccdepth_addon
from ccdepth_addon.state.colors import depth_colors
from tests.blender import scene

FloatArray = NDArray[np.float64]

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "images"

# A part of Suzanne's diagonal, and the least level that brings all of her faces within it, with limit vertices.
TOLERANCE = 1e-3
LEVEL = 3

# Drawn larger and scaled down, for smooth lines.
OVERSAMPLING = 4

# Degrees to the side and upwards, from the front.
VIEW = (28.0, 12.0)
LIGHT = np.array([-0.35, 0.55, 0.76])
FACE, LINE, PAPER, INK = np.array([236, 239, 244]), (52, 60, 74), (255, 255, 255), (40, 44, 52)

# Corner and side of the icon's squares on a grid of eight, and their depths.
ICON_SIZE = 256
ICON_SQUARES = (
    *((x, y, 2, 1) for x, y in ((0, 0), (0, 2), (0, 4), (0, 6), (2, 0), (4, 0), (6, 0), (2, 2))),
    *((x, y, 1, 3) for x in (4, 5, 6, 7) for y in (2, 3)),
    *((x, y, 1, 3) for x in (2, 3) for y in (4, 5, 6, 7)),
    *((x / 2, y / 2, 0.5, 5) for x in range(8, 16) for y in range(8, 16) if x < 12 or y < 12),
    *((6 + x / 4, 6 + y / 4, 0.25, 7) for x in range(8) for y in range(8)),
)


@dataclass(frozen=True)
class Sheet:
    """A picture of two meshes beside each other: its size in pixels, that of a mesh, and of the letters."""

    width: int
    height: int
    side: int
    letters: int


README, FEATURED = Sheet(1240, 620, 560, 22), Sheet(1920, 1080, 900, 34)


def subdivided_suzanne() -> bpy.types.Mesh:
    """Suzanne by her modifier, at the level that all of her faces need."""
    suzanne = scene.add_suzanne()
    modifier = suzanne.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.quality, modifier.use_limit_surface = LEVEL, 10, True
    return bpy.data.meshes.new_from_object(suzanne.evaluated_get(bpy.context.evaluated_depsgraph_get()))


def adaptive_suzanne() -> bpy.types.Mesh:
    """Suzanne by Apply Adaptive Subdivision."""
    for other in bpy.context.selected_objects:
        other.select_set(False)
    suzanne = scene.add_suzanne()
    bpy.context.view_layer.objects.active = suzanne
    suzanne.select_set(True)
    bpy.ops.ccdepth.subdivide(tolerance=TOLERANCE, tolerance_mode="RELATIVE", output="IN_PLACE")
    return suzanne.data


def seen(mesh: bpy.types.Mesh) -> FloatArray:
    """(V, 3): positions as seen, x to the right, y upwards, z towards the viewer."""
    positions = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", positions)
    x, y, z = positions.reshape(-1, 3).astype(np.float64).T
    aside, up = np.radians(VIEW)
    right, towards = np.cos(aside) * x + np.sin(aside) * y, np.sin(aside) * x - np.cos(aside) * y
    return np.stack([right, np.cos(up) * z - np.sin(up) * towards, np.sin(up) * z + np.cos(up) * towards], axis=1)


def drawn(mesh: bpy.types.Mesh, size: int) -> Image.Image:
    """The mesh with its edges, farther faces first."""
    points = seen(mesh)
    side = size * OVERSAMPLING
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    scale = 0.98 * side / (high - low).max()
    flat = (points[:, :2] - (low + high) / 2) * (scale, -scale) + side / 2
    image = Image.new("RGB", (side, side), PAPER)
    pen = ImageDraw.Draw(image)
    polygons = [list(polygon.vertices) for polygon in mesh.polygons]
    for polygon in sorted(polygons, key=lambda polygon: points[polygon, 2].mean()):
        corners = points[polygon]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= np.linalg.norm(normal)
        if normal[2] <= 0:
            continue
        shade = 0.62 + 0.38 * max(0.0, float(normal @ LIGHT))
        outline = [tuple(point) for point in flat[polygon].tolist()]
        pen.polygon(outline, fill=tuple((FACE * shade).astype(int).tolist()))
        pen.line([*outline, outline[0]], fill=LINE, width=OVERSAMPLING // 2)
    return image.resize((size, size), Image.Resampling.LANCZOS)


def before_and_after(sheet: Sheet, before: bpy.types.Mesh, after: bpy.types.Mesh) -> Image.Image:
    """The two meshes, within the same tolerance, with their numbers of faces."""
    picture = Image.new("RGB", (sheet.width, sheet.height), PAPER)
    pen = ImageDraw.Draw(picture)
    line = sheet.letters * 3 // 2
    top = (sheet.height - sheet.side - 2 * line) // 2
    for place, (mesh, title) in enumerate([(before, f"Level {LEVEL} everywhere"), (after, "Adaptive subdivision")]):
        middle = sheet.width * (2 * place + 1) // 4
        picture.paste(drawn(mesh, sheet.side), (middle - sheet.side // 2, top))
        for row, (text, letters) in enumerate(
            [(f"{len(mesh.polygons):,} faces", sheet.letters), (title, sheet.letters * 3 // 4)]
        ):
            font = ImageFont.load_default(size=letters)
            pen.text((middle, top + sheet.side + row * line), text, fill=INK, font=font, anchor="mm")
    return picture


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
    scene.clear()
    before = subdivided_suzanne()
    after = adaptive_suzanne()
    for name, sheet in (("before_and_after", README), ("featured", FEATURED)):
        before_and_after(sheet, before, after).quantize(128).save(FOLDER / f"{name}.png", optimize=True)
    icon().save(FOLDER / "icon.png", optimize=True)
    ccdepth_addon.unregister()


if __name__ == "__main__":
    main()
