# SPDX-License-Identifier: GPL-3.0-or-later
"""The faces that Suzanne needs by each method's depths: prints the numbers and draws docs/images/faces_by_method.svg.

python benchmarks/faces_by_method.py          with the bpy wheel

Suzanne is subdivided once, so that all 1,968 faces are quads; the tolerance is a thousandth of her diagonal. Every face
is then subdivided to its own depth d, into 4ᵈ faces.
"""

from __future__ import annotations

import sys
from math import log10
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from ccdepth_addon.core.depth.face_depths import VERTICES, face_depths
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests.blender import scene

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "images" / "faces_by_method.svg"
PART_OF_DIAGONAL = 1e-3

NAMES = {
    "DISTANCE": "By Distance",
    "CERTIFIED": "Certified",
    "SHARP": "Sharp",
    "SECOND_ORDER": "Second Order (Published)",
    "FIRST_ORDER": "First Order",
}
COLOURS = {"CONTROL": "#2d708e", "LIMIT": "#73d055"}
LABELS = {"CONTROL": "control vertices", "LIMIT": "limit vertices"}

LEFT, TOP, BAR, ROW, PER_DECADE, DECADES = 190, 54, 16, 48, 44, 9


def suzanne_once() -> tuple[PolygonMesh, float]:
    """Suzanne after one step, and her diagonal."""
    scene.clear()
    mesh = scene.polygon_mesh_of(scene.add_suzanne().data)
    once = subdivide(apply_boundary_rule(mesh, smooth_corners=True))
    return once, float(np.linalg.norm(np.ptp(once.positions, axis=0)))


def faces_needed(mesh: PolygonMesh, tolerance: float) -> dict[tuple[str, str], tuple[int, int]]:
    """By method and vertices: the deepest depth, and the faces when each face has its own."""
    needed = {}
    for method in NAMES:
        for vertices in VERTICES:
            depths = face_depths(mesh, tolerance, method, vertices).depths
            needed[method, vertices] = int(depths.max()), sum(4**depth for depth in depths.tolist())
    return needed


def count_text(count: int) -> str:
    """As SVG text: in full up to a million, then as a power of ten."""
    if count < 10**7:
        return f"{count:,}"
    mantissa, power = f"{count:.1e}".split("e+")
    return f'{mantissa} × 10<tspan dy="-4" font-size="9">{int(power)}</tspan><tspan dy="4">\u200b</tspan>'


def picture(needed: dict[tuple[str, str], tuple[int, int]], faces: int) -> str:
    """The bars as an SVG, on a scale of powers of ten that begins at 1,000 faces."""
    width = LEFT + DECADES * PER_DECADE + 150
    height = TOP + ROW * len(NAMES) + 34
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif"'
        ' font-size="13" fill="#222">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        f'<text x="16" y="24" font-size="15" font-weight="bold">Faces that {faces:,} faces of Suzanne become</text>',
    ]
    for place, vertices in enumerate(VERTICES):
        x = LEFT + 150 * place
        lines.append(f'<rect x="{x}" y="34" width="11" height="11" fill="{COLOURS[vertices]}"/>')
        lines.append(f'<text x="{x + 17}" y="44">{LABELS[vertices]}</text>')
    bottom = TOP + ROW * len(NAMES)
    for power in range(3, 3 + DECADES + 1, 3):
        x = LEFT + (power - 3) * PER_DECADE
        lines.append(f'<line x1="{x}" y1="{TOP}" x2="{x}" y2="{bottom}" stroke="#ddd"/>')
        lines.append(
            f'<text x="{x}" y="{bottom + 18}" text-anchor="middle" fill="#666">10'
            f'<tspan dy="-5" font-size="9">{power}</tspan></text>'
        )
    for row, method in enumerate(NAMES):
        y = TOP + ROW * row + 8
        lines.append(f'<text x="{LEFT - 12}" y="{y + BAR + 5}" text-anchor="end">{NAMES[method]}</text>')
        for place, vertices in enumerate(VERTICES):
            deepest, count = needed[method, vertices]
            length = (log10(count) - 3) * PER_DECADE
            at = y + place * BAR
            lines.append(
                f'<rect x="{LEFT}" y="{at}" width="{length:.1f}" height="{BAR - 2}" fill="{COLOURS[vertices]}"/>'
            )
            lines.append(
                f'<text x="{LEFT + length + 6:.1f}" y="{at + 12}" font-size="12">{count_text(count)}'
                f'<tspan dx="8" fill="#666">deepest {deepest}</tspan></text>'
            )
    return "\n".join([*lines, "</svg>", ""])


def main() -> None:
    mesh, diagonal = suzanne_once()
    needed = faces_needed(mesh, PART_OF_DIAGONAL * diagonal)
    for (method, vertices), (deepest, count) in needed.items():
        print(f"{NAMES[method]:<26}{LABELS[vertices]:<18}deepest {deepest:>2}, {count:,} faces", flush=True)
    PICTURE.write_text(picture(needed, mesh.face_count), encoding="utf-8")


if __name__ == "__main__":
    main()
