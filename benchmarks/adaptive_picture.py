# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw Suzanne as Apply Adaptive Subdivision makes her at two tolerances: docs/images/adaptive.png.

python benchmarks/adaptive_picture.py       with the bpy wheel and pillow
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import ccdepth_addon
from tests.blender import scene

FloatArray = NDArray[np.float64]

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "images" / "adaptive.png"

TOLERANCES = (3e-3, 3e-4)
SIZE = 620

# Drawn larger and scaled down, for smooth lines.
OVERSAMPLING = 4

# Degrees to the side and upwards, from the front.
VIEW = (28.0, 12.0)
LIGHT = np.array([-0.35, 0.55, 0.76])
FACE, LINE, PAPER, INK = np.array([236, 239, 244]), (52, 60, 74), (255, 255, 255), (40, 44, 52)


def adaptive_suzanne(tolerance: float) -> bpy.types.Mesh:
    """Suzanne with a Subdivision Surface modifier's surface, at a part of her diagonal."""
    scene.clear()
    suzanne = scene.add_suzanne()
    bpy.context.view_layer.objects.active = suzanne
    suzanne.select_set(True)
    bpy.ops.ccdepth.subdivide(tolerance=tolerance, tolerance_mode="RELATIVE", output="IN_PLACE")
    return suzanne.data


def seen(mesh: bpy.types.Mesh) -> FloatArray:
    """(V, 3): positions as seen, x to the right, y upwards, z towards the viewer."""
    positions = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", positions)
    x, y, z = positions.reshape(-1, 3).astype(np.float64).T
    aside, up = np.radians(VIEW)
    right, towards = np.cos(aside) * x + np.sin(aside) * y, np.sin(aside) * x - np.cos(aside) * y
    return np.stack([right, np.cos(up) * z - np.sin(up) * towards, np.sin(up) * z + np.cos(up) * towards], axis=1)


def draw(mesh: bpy.types.Mesh, tolerance: float) -> Image.Image:
    """The mesh with its edges, farther faces first."""
    points = seen(mesh)
    side = SIZE * OVERSAMPLING
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    scale = 0.9 * side / (high - low).max()
    middle = (low + high) / 2
    flat = (points[:, :2] - middle) * (scale, -scale) + (side / 2, side * 0.47)
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
        pen.line([*outline, outline[0]], fill=LINE, width=OVERSAMPLING - 1)
    image = image.resize((SIZE, SIZE), Image.Resampling.LANCZOS)
    text = f"{tolerance:g} of the diagonal: {len(mesh.polygons):,} faces"
    font = ImageFont.load_default(size=20)
    ImageDraw.Draw(image).text((SIZE / 2, SIZE - 34), text, fill=INK, font=font, anchor="mm")
    return image


def main() -> None:
    ccdepth_addon.register()
    picture = Image.new("RGB", (SIZE * len(TOLERANCES), SIZE), PAPER)
    for place, tolerance in enumerate(TOLERANCES):
        picture.paste(draw(adaptive_suzanne(tolerance), tolerance), (SIZE * place, 0))
    picture.quantize(64).save(PICTURE, optimize=True)
    ccdepth_addon.unregister()


if __name__ == "__main__":
    main()
