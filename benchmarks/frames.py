# SPDX-License-Identifier: GPL-3.0-or-later
"""The time of each further frame as a part of the first one's, with reading, computing and writing.

python benchmarks/frames.py -- [LEVELS…]        with the bpy wheel

Suzanne, subdivided LEVELS times before (1 and 2 by default), bends with an armature or is deformed by a shape key.
Times are processor time, the least of three runs, in milliseconds; one frame is the middle frame.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np

import ccdepth_addon
from tests.blender import addon, scene

FRAMES = 100
REPEATS = 3

# Fractions of the diagonal, by levels.
TOLERANCES = {1: 3e-3, 2: 1e-3, 3: 3e-4, 4: 1e-4}


def refined_suzanne(levels: int) -> bpy.types.Object:
    scene.clear()
    holder = scene.add_suzanne()
    holder.modifiers.new("Subdivision", "SUBSURF").levels = levels
    addon.select(holder)
    bpy.ops.object.modifier_apply(modifier="Subdivision")
    return holder


def bending(levels: int) -> bpy.types.Object:
    """Suzanne with an armature: her upper half turns by 70°, and back beyond its first position."""
    holder = refined_suzanne(levels)
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(rig)
    with addon.edit_mode(rig):
        for name, low in (("Lower", -1.0), ("Upper", 0.0)):
            bone = rig.data.edit_bones.new(name)
            bone.head, bone.tail = (0.0, 0.0, low), (0.0, 0.0, low + 1.0)
    for name, sign in (("Lower", -1.0), ("Upper", 1.0)):
        group = holder.vertex_groups.new(name=name)
        for vertex in holder.data.vertices:
            group.add([vertex.index], min(max(0.5 + sign * vertex.co.z, 0.0), 1.0), "REPLACE")
    holder.modifiers.new("Armature", "ARMATURE").object = rig
    bone = rig.pose.bones["Upper"]
    bone.rotation_mode = "XYZ"
    for frame, angle in ((1, 0.0), (FRAMES // 2, 1.2), (FRAMES, -0.5)):
        bone.rotation_euler.x = angle
        bone.keyframe_insert("rotation_euler", frame=frame)
    return holder


def deformed(levels: int) -> bpy.types.Object:
    """Suzanne with a shape key: waves that come and go."""
    holder = refined_suzanne(levels)
    holder.shape_key_add(name="Basis")
    shape = holder.shape_key_add(name="Waves")
    positions = np.zeros(3 * len(shape.data), dtype=np.float32)
    shape.data.foreach_get("co", positions)
    points = positions.reshape(-1, 3)
    shape.data.foreach_set("co", (points * (1 + 0.2 * np.sin(9 * points[:, :1]))).astype(np.float32).reshape(-1))
    for frame, value in ((1, 0.0), (FRAMES // 2, 1.0), (FRAMES, 0.2)):
        shape.value = value
        shape.keyframe_insert("value", frame=frame)
    return holder


CASES: dict[str, Callable[[int], bpy.types.Object]] = {"armature": bending, "shape key": deformed}


# Method and vertices, and the number of frames for each frame computed.
KINDS = (("DISTANCE", "LIMIT", 10), ("CERTIFIED", "CONTROL", 1))


def milliseconds(frames: str, tolerance: float, method: str, vertices: str) -> float:
    found = []
    for _ in range(REPEATS):
        begun = process_time()
        bpy.ops.ccdepth.compute(
            tolerance=tolerance,
            tolerance_mode="RELATIVE",
            method=method,
            vertices=vertices,
            frames="CUSTOM",
            frame_list=frames,
        )
        found.append(process_time() - begun)
    return 1000 * min(found)


def main(arguments: list[str]) -> None:
    ccdepth_addon.register()
    print("| faces | | method | vertices | frames | one frame | each further | ratio |")
    print("|---|---|---|---|---|---|---|---|")
    for levels in map(int, arguments or ("1", "2")):
        for name, build in CASES.items():
            holder, tolerance = build(levels), TOLERANCES[levels]
            addon.select(holder)
            for *kinds, step in KINDS:
                count = len(range(1, FRAMES + 1, step))
                one = milliseconds(str(FRAMES // 2), tolerance, *kinds)
                each = (milliseconds(f"1-{FRAMES}/{step}", tolerance, *kinds) - one) / (count - 1)
                case = f"{len(holder.data.polygons):,} | {name} | {' | '.join(kinds)} | {count}"
                print(f"| {case} | {one:.0f} | {each:.0f} | {each / one:.2f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
