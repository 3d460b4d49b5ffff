# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on as Blender registered it, wherever it was installed, and its results as arrays."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType

import bpy
import numpy as np
from numpy.typing import NDArray

from tests.blender import scene

ATTRIBUTES = ("ccdepth", "ccdepth_bound")


def module(name: str) -> ModuleType:
    """A module of the registered add-on."""
    package = bpy.types.CCDEPTH_OT_compute.__module__.rpartition(".operators.")[0]
    return import_module(f"{package}.{name}")


def examine_touched() -> None:
    """Let Blender pass on its updates, and the timer run."""
    bpy.context.view_layer.update()
    module("state.watch").examine()


def select(*objects: bpy.types.Object, mode: str = "OBJECT") -> None:
    """Select these objects alone, in Object Mode, and go to a mode; the last one becomes the active one."""
    bpy.context.view_layer.update()
    for other in bpy.context.view_layer.objects:
        other.select_set(False)
    for chosen in objects:
        chosen.select_set(True)
    bpy.context.view_layer.objects.active = objects[-1] if objects else None
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode=mode)


def compute(*objects: bpy.types.Object, **settings: object) -> None:
    """``finish`` with Compute Depth."""
    finish("compute", *objects, **settings)


def measure(*objects: bpy.types.Object, **settings: object) -> None:
    """``finish`` with Measure Deviation, for half a second unless ``time_limit`` is given."""
    finish("measure", *objects, **{"time_limit": 0.5, **settings})


def finish(operator: str, *objects: bpy.types.Object, **settings: object) -> None:
    """Show and select the objects alone, the last one as the active one, or leave the selection without any; and call
    an operator of ours, which must finish. A tolerance is absolute unless it says otherwise."""
    for each in objects:
        each.hide_set(False)
    if objects:
        select(*objects)
    mode = {"tolerance_mode": "ABSOLUTE"} if "tolerance" in settings else {}
    assert getattr(bpy.ops.ccdepth, operator)(**mode | settings) == {"FINISHED"}


@contextmanager
def edit_mode(*objects: bpy.types.Object, editing: bool = True) -> Iterator[None]:
    """The objects selected alone, in Edit Mode or, where ``editing`` is not, in Object Mode."""
    select(*objects, mode="EDIT" if editing else "OBJECT")
    try:
        yield
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def depths(holder: bpy.types.Object) -> NDArray[np.int32]:
    """(F,): the depths on the object's mesh, which must not be in Edit Mode."""
    return scene.read(holder.data, "ccdepth")[:, 0]


def bounds(holder: bpy.types.Object) -> NDArray[np.float32]:
    return scene.read(holder.data, "ccdepth_bound")[:, 0]


def deviations(holder: bpy.types.Object) -> NDArray[np.float32]:
    return scene.read(holder.data, "ccdepth_deviation")[:, 0]


def colors(holder: bpy.types.Object) -> NDArray[np.float32]:
    """(C, 4), linear."""
    return scene.read(holder.data, "ccdepth_color")


def facts(holder: bpy.types.Object) -> dict[str, str]:
    """What panels and the terminal tell of the result on the object's mesh."""
    found = module("ui.facts").facts_of(bpy.context.scene, holder.data.ccdepth)
    return {fact.name: fact.value for fact in found}


def histogram(holder: bpy.types.Object) -> dict[int, int]:
    return {row.depth: row.faces for row in holder.data.ccdepth.rows}


def is_untouched(objects: Iterable[bpy.types.Object]) -> bool:
    """Whether no mesh of these objects holds anything of the add-on's."""
    return not any(
        holder.data.ccdepth.has_result
        or holder.data.ccdepth.has_deviation
        or any(name in holder.data.attributes for name in (*ATTRIBUTES, "ccdepth_deviation", "ccdepth_color"))
        for holder in objects
        if holder.type == "MESH"
    )
