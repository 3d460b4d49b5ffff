# SPDX-License-Identifier: GPL-3.0-or-later
"""What the page of a report shows of objects beside their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy

from . import picture
from .report import Illustration
from .report_text import settings_text

# Of the size that --picture has: as wide as the page.
PICTURE_SIZE = 0.65


def illustrations(shown: Sequence[bpy.types.Object]) -> tuple[Illustration, ...]:
    """The pictures of objects that have results, and their faces by depth. Raises PictureError."""
    return tuple(
        Illustration(
            tuple((row.depth, row.faces) for row in each.data.ccdepth.rows),
            *(_drawn(each, look) for look in (picture.Look.HEAT_MAP, picture.Look.WIREFRAME)),
        )
        for each in shown
    )


def _drawn(blender_object: bpy.types.Object, look: picture.Look) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"picture{picture.WEBP if picture.has_webp() else '.png'}"
        subtitle = settings_text([blender_object])
        picture.render(bpy.context, [blender_object], path, blender_object.name, subtitle, look, PICTURE_SIZE)
        return path.read_bytes()
