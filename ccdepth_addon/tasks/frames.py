# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames: parsed as typed, and visited one by one, with the scene's own frame restored afterwards."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from .surfaces import ComputeError

# Frames that Blender's timeline can show, and how many are computed at most.
FIRST_FRAME, LAST_FRAME = -1_048_574, 1_048_574
MOST_FRAMES = 100_000

_PART = re.compile(r"(-?\d+)(?:\s*-\s*(-?\d+)(?:\s*/\s*(\d+))?)?")


def typed_frames(text: str) -> tuple[int, ...]:
    """The frames of 1-250, 1-250/5 (every fifth), 1,5,9 or several such parts: rising, each once. Raises
    ComputeError."""
    frames: set[int] = set()
    for part in text.split(","):
        found = _PART.fullmatch(part.strip())
        if found is None:
            raise ComputeError(f"“{text}” are no frames, like 1-250, 1-250/5 for every fifth, or 1,5,9")
        first = int(found[1])
        last, step = int(found[2] or first), int(found[3] or 1)
        if last < first or step < 1:
            raise ComputeError(
                f"“{part.strip()}” are no frames: the first comes before the last, and a step is 1 or more"
            )
        if first < FIRST_FRAME or last > LAST_FRAME:
            raise ComputeError(f"“{part.strip()}”: Blender has frames from {FIRST_FRAME:,} to {LAST_FRAME:,}")
        frames.update(range(first, last + 1, step))
        if len(frames) > MOST_FRAMES:
            raise ComputeError(f"“{text}” are more than {MOST_FRAMES:,} frames")
    return tuple(sorted(frames))


def chosen_frames(scene: bpy.types.Scene, choice: str, frame_list: str) -> str:
    """The chosen frames, as they would be typed; empty for the current frame.

    choice: CURRENT, SCENE for the scene's range, or CUSTOM for the frames in frame_list.
    """
    if choice == "SCENE":
        step = f"/{scene.frame_step}" if scene.frame_step > 1 else ""
        return f"{scene.frame_start}-{scene.frame_end}{step}"
    return "" if choice == "CURRENT" else "".join(frame_list.split())


@contextmanager
def frame_restored(scene: bpy.types.Scene) -> Iterator[None]:
    """Restore the scene's frame at the end of this context, however it ends."""
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        scene.frame_set(frame, subframe=subframe)
