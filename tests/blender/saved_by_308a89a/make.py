# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the files beside it, with the add-on as it was at commit 308a89a. In a checkout of that commit:

    python path/to/make.py

with bpy 4.2, the oldest Blender there is an add-on for.

In depths.blend a scene for each method and kind of vertices has its name from these, both settings, and a cube with the
depths; "Untouched" has what was the default, so that Blender stored neither. results.blend holds depths of two objects
of one mesh and over frames, an adaptive result that is kept updated, one that was reduced, one in place, and
measurements of an object against itself and against another.
"""

import sys
from itertools import product
from pathlib import Path

sys.path.insert(0, ".")

import bpy

import ccdepth_addon

METHODS = ("CERTIFIED", "SHARP", "SECOND_ORDER", "FIRST_ORDER")

bpy.ops.wm.read_factory_settings(use_empty=True)
ccdepth_addon.register()
[untouched] = bpy.data.scenes
untouched.name = "Untouched"
bpy.data.batch_remove([each for each in bpy.data.workspaces if each != bpy.context.workspace])
chosen = {f"{method} {vertices}": (method, vertices) for method, vertices in product(METHODS, ("CONTROL", "LIMIT"))}
for name in ("Untouched", *chosen):
    bpy.context.window.scene = bpy.data.scenes.get(name) or bpy.data.scenes.new(name)
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.name = bpy.context.object.data.name = name
    if name in chosen:
        settings = bpy.context.scene.ccdepth
        settings.method, settings.vertices = chosen[name]
    bpy.ops.ccdepth.compute()
bpy.ops.wm.save_as_mainfile(filepath=str(Path(__file__).with_name("depths.blend")), compress=True)

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.data.batch_remove([each for each in bpy.data.workspaces if each != bpy.context.workspace])
settings = bpy.context.scene.ccdepth
settings.method, settings.vertices = "CERTIFIED", "CONTROL"
settings.tolerance_mode, settings.tolerance, settings.time_limit = "ABSOLUTE", 0.05, 1.0


def cube(name: str, place: int) -> bpy.types.Object:
    """A cube with a Subdivision Surface modifier, selected alone."""
    bpy.ops.mesh.primitive_cube_add(location=(4.0 * place, 0.0, 0.0))
    made = bpy.context.object
    made.name = made.data.name = name
    made.modifiers.new("Subdivision", "SUBSURF").use_limit_surface = False
    return made


def select(*objects: bpy.types.Object) -> None:
    for other in bpy.context.view_layer.objects:
        other.select_set(other in objects)
    bpy.context.view_layer.objects.active = objects[-1]


small = cube("Small", 0)
large = bpy.data.objects.new("Large", small.data)
bpy.context.scene.collection.objects.link(large)
large.modifiers.new("Subdivision", "SUBSURF").use_limit_surface = False
large.scale = (3.0, 2.0, 1.0)
bpy.context.view_layer.update()
select(small, large)
bpy.ops.ccdepth.compute()

moving = cube("Moving", 1)
for frame, size in ((1, 1.0), (3, 2.0)):
    moving.scale = (size,) * 3
    moving.keyframe_insert("scale", frame=frame)
bpy.context.scene.frame_set(1)
bpy.ops.ccdepth.compute(frames="CUSTOM", frame_list="1-3")
settings.frames = "CURRENT"

own = cube("Own", 2)
# Another Blender has other settings of modifiers, which makes what they show out of date.
own.modifiers.clear()
bpy.ops.ccdepth.measure()

kept = cube("Kept", 3)
bpy.ops.ccdepth.subdivide()
bpy.data.objects["Kept Adaptive"].ccdepth.keep_updated = True
bpy.ops.ccdepth.measure()

cube("Reduced", 4)
bpy.ops.ccdepth.subdivide(reduce=True, exact_normals=True)

cube("In Place", 5)
bpy.ops.ccdepth.subdivide(output="IN_PLACE", mode="PER_FACE", transitions="NGONS")

bpy.ops.wm.save_as_mainfile(filepath=str(Path(__file__).with_name("results.blend")), compress=True)
