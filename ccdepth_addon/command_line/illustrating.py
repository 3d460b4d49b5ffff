# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures of objects, and what every method says of them, for the page of a report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy
import numpy as np

from ..core import METHODS
from ..state.properties import scene_tolerance
from ..tasks.depth_task import DepthSettings, MeshDepths, compute_depths, prepare_depths
from ..tasks.frames import chosen_frames
from ..tasks.stepwise import Stepwise
from ..tasks.surfaces import ComputeError
from . import picture
from .arguments import OVER_FRAMES
from .blender_calls import CommandError
from .illustration import Illustration, Levels, MethodLevel
from .report_text import settings_text

# Of the size that --picture has: as wide as the page.
PICTURE_SIZE = 0.65


def levels_of(objects: Sequence[bpy.types.Object], action: str) -> list[Levels]:
    """The levels of objects by the scene's settings, on the frames that the action takes; nothing is written to their
    meshes. Raises CommandError."""
    chosen = bpy.context.scene.ccdepth.method
    # By distance takes far longer than the others, so it is compared only where it was asked for.
    compared = [method for method in METHODS if method == chosen or method != "DISTANCE"]
    answers = {method: _depths(objects, action, method) for method in compared}
    return [_levels(chosen, {method: by_name[each.name] for method, by_name in answers.items()}) for each in objects]


def _levels(chosen: str, by_method: dict[str, MeshDepths]) -> Levels:
    counts = np.bincount(by_method[chosen].depths)
    return Levels(
        chosen,
        tuple((depth, int(counts[depth])) for depth in np.flatnonzero(counts).tolist()),
        tuple(
            MethodLevel(method, max(each.deepest, each.added_deepest), each.uniform_level, each.uniform_faces)
            for method, each in by_method.items()
        ),
    )


def _depths(objects: Sequence[bpy.types.Object], action: str, method: str) -> dict[str, MeshDepths]:
    """The depths of the objects' meshes, by the names of the objects: they may share one."""
    scene = bpy.context.scene
    settings = scene.ccdepth
    frames = chosen_frames(scene, settings.frames, settings.frame_list) if action in OVER_FRAMES else ""
    by_method = DepthSettings.of(settings, scene_tolerance(settings), frames=frames, method=method)
    reading = Stepwise(prepare_depths(bpy.context, objects, by_method))
    try:
        reading.work()
        assert reading.answer is not None
        answers = compute_depths(reading.answer)
    except ComputeError as fault:
        raise CommandError(str(fault)) from fault
    return {name: each for each in answers for name in each.task.object_names}


def illustrations(shown: Sequence[bpy.types.Object], levels: Sequence[Levels]) -> tuple[Illustration, ...]:
    """The pictures of objects that have results, with their levels. Raises PictureError."""
    return tuple(
        Illustration(each, _drawn(one, picture.Look.HEAT_MAP), _drawn(one, picture.Look.WIREFRAME))
        for one, each in zip(shown, levels, strict=True)
    )


def _drawn(blender_object: bpy.types.Object, look: picture.Look) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"picture{picture.WEBP if picture.has_webp() else '.png'}"
        subtitle = settings_text([blender_object])
        picture.render(bpy.context, [blender_object], path, blender_object.name, subtitle, look, PICTURE_SIZE)
        return path.read_bytes()
