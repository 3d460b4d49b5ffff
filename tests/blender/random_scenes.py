# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes, random operators on them, and what must be so after each: the plan of a seed, run and checked."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np

from tests.blender import addon, random_steps, scene, snapshot
from tests.blender.addon import ATTRIBUTES
from tests.blender.full_mesh import counts
from tests.blender.random_steps import REFUSALS, Random, chance, one
from tests.blender.snapshot import OURS, Snapshot

KINDS = {"ccdepth": ("INT", "FACE"), "ccdepth_bound": ("FLOAT", "FACE")}

# Bounds are rounded up to single precision, and tolerances are kept in it: half a step each.
SINGLE = 2.0**-23

# What Select by Depth may change.
SELECTION = {
    ".select_vert", ".select_edge", ".select_poly", "select mode", "select history", "total_vert_sel", "total_edge_sel",
    "total_face_sel", "active attribute",
}  # fmt: skip

# What a mesh says while it is edited alone. Edit Mode goes on with the result.
EDITING = {"select history", "is_editmode", "active attribute", "has_custom_normals"}


class Fault(AssertionError):
    """Something that must not be."""


@dataclass
class Run:
    """One run of a plan, and what later steps look back at.

    before_result: what was there before there was any result, as long as nobody has changed anything else since.
    before_last: what was there before the last operator. last_computed: all settings that Compute Depth was called with
    last, in Object Mode, and the names of the mesh objects that were selected. refusal: what was said last where an
    operator refused.
    """

    random: Random
    refusal: str = ""
    before_result: Snapshot | None = None
    before_last: Snapshot = field(default_factory=dict)
    last_computed: tuple[dict[str, Any], list[str]] | None = None


def plan(seed: int) -> list[str]:
    """The names of the steps of a seed."""
    rng = np.random.default_rng(seed)
    steps = ["add_mesh", *(one(rng, random_steps.ADDED_FIRST).__name__ for _ in range(rng.integers(0, 5)))]
    steps += [one(rng, random_steps.BUILDING).__name__ for _ in range(rng.integers(2, 14))]
    for name, share in (("choose_objects", 0.7), ("set_mode", 0.3), ("compute", 0.7)):
        steps += [name] if chance(rng, share) else []
    for _ in range(rng.integers(2, 7)):
        steps.append(one(rng, ACTIONS).__name__)
        if chance(rng, 0.3):
            steps.append(one(rng, random_steps.BETWEEN).__name__)
    return steps


def run(seed: int, errors: Callable[[], str]) -> None:
    """Carry out the plan of a seed. errors: all that was printed to the standard error since it was called last, by
    whomever: handlers and timers print their tracebacks. Raises Fault."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene.clear()
    this = Run(np.random.default_rng(seed))
    with warnings.catch_warnings(), tempfile.TemporaryDirectory(prefix="random_scenes") as folder:
        warnings.simplefilter("error", RuntimeWarning)
        tempfile.tempdir = folder
        try:
            for number, name in enumerate(plan(seed)):
                this.random = np.random.default_rng([seed, number])
                _carry_out(name, this)
                addon.module("state.watch").examine()
                if "Traceback" in (heard := errors()):
                    raise Fault(f"{number} {name}: a traceback was printed: {heard}")
        finally:
            tempfile.tempdir = None


def _carry_out(name: str, this: Run) -> None:
    action = next((action for action in ACTIONS if action.__name__ == name), None)
    if action is not None:
        action(this)
        return
    with suppress(*REFUSALS):
        getattr(random_steps, name)(this.random)
    bpy.context.view_layer.update()
    this.before_result = None


# Actions: operators with random settings, and what must be so afterwards.


def _call(this: Run, name: str, **settings: Any) -> bool:
    """Call an operator of ours; True when it finished. A refusal must have changed nothing."""
    bpy.ops.ed.undo_push(message="Before")
    this.before_last = snapshot.take()
    try:
        outcome = getattr(bpy.ops.ccdepth, name)(**settings)
    except RuntimeError as refusal:
        if "Traceback" in str(refusal) or not str(refusal).strip():
            raise Fault(f"{name} {settings}: refused with “{refusal}”") from None
        outcome, this.refusal = {"CANCELLED"}, str(refusal)
    bpy.context.view_layer.update()
    finished = outcome == {"FINISHED"}
    if not finished:
        _same(f"{name} {settings} refused", this.before_last)
    _nothing_temporary()
    _results_sound(f"{name} {settings}")
    bpy.ops.ed.undo_push(message=name)
    return finished


def _same(what: str, before: Snapshot, allowed: Callable[[snapshot.Path], bool] = lambda path: False) -> None:
    """Raise Fault where anything but what is allowed has been changed since."""
    if found := snapshot.differences(before, snapshot.take(), allowed):
        raise Fault(f"{what}, and this was changed:\n" + "\n".join(found[:12]))


def _tolerance(rng: Random) -> dict[str, Any]:
    if chance(rng, 0.15):
        return {}
    settings: dict[str, Any] = {"tolerance_mode": one(rng, ("RELATIVE", "RELATIVE", "ABSOLUTE"))}
    settings["tolerance"] = float(10.0 ** rng.uniform(-1.5, 0))
    if chance(rng, 0.06):
        settings["tolerance"] = one(rng, (0.0, -1.0, 1e-12, 1e30, 1e39, float("inf"), float("nan")))
    if chance(rng, 0.5):
        settings["use_modifiers"] = chance(rng, 0.7)
    return settings


def compute(this: Run) -> None:
    rng = this.random
    settings = _tolerance(rng)
    settings["method"] = one(rng, ("CERTIFIED", "DISTANCE", "SHARP", "SECOND_ORDER", "FIRST_ORDER"))
    settings["vertices"] = one(rng, ("OBJECT", "CONTROL", "LIMIT"))
    clean = not any(map(addon.module("state.results").has_traces, bpy.data.meshes))
    if _call(this, "compute", **settings):
        _same(f"compute {settings} finished", this.before_last, snapshot.is_ours)
        if clean:
            this.before_result = this.before_last
        this.last_computed = (_filled_in(settings), _meant()) if bpy.context.mode == "OBJECT" else None
        _results_current()


def _filled_in(settings: dict[str, Any]) -> dict[str, Any]:
    """The settings with those that come from the scene."""
    present = bpy.context.scene.ccdepth
    names = ("tolerance_mode", "use_modifiers", "method", "vertices")
    filled = {**{name: getattr(present, name) for name in names}, **settings}
    relative = filled["tolerance_mode"] == "RELATIVE"
    return {"tolerance": present.relative_tolerance if relative else present.tolerance, **filled}


def _meant() -> list[str]:
    active = bpy.context.active_object
    chosen = bpy.context.selected_objects or ([active] if active else [])
    return [each.name for each in chosen if each.type == "MESH" and each.library is None]


def compute_again(this: Run) -> None:
    """A result that is said to be current is what would be computed now."""
    settings, names = this.last_computed or ({}, [])
    objects = [bpy.data.objects.get(name) for name in names]
    if not objects or bpy.context.mode != "OBJECT" or not all(objects):
        return
    with suppress(*REFUSALS):
        addon.select(*objects)
    staleness = addon.module("state.out_of_date")
    addon.module("state.watch").examine()
    with_depths = [each.data for each in objects if each.type == "MESH" and _has_depths(each.data)]
    current = {mesh.name: _depths(mesh) for mesh in with_depths if not staleness.is_stale(mesh)}
    if len(bpy.context.selected_objects) == len(objects) and _call(this, "compute", **settings):
        for name, depths in current.items():
            if _depths(bpy.data.meshes[name]) != depths:
                raise Fault(f"the result on {name} was said to be current and was not")
    this.before_result = None


def _has_depths(mesh: bpy.types.Mesh) -> bool:
    return mesh.ccdepth.has_result and not mesh.ccdepth.subdivision and "ccdepth" in mesh.attributes


def _depths(mesh: bpy.types.Mesh) -> list[int]:
    return [each.value for each in mesh.attributes["ccdepth"].data]


def clear(this: Run) -> None:
    if _call(this, "clear"):
        if this.before_result is not None and not any(map(addon.module("state.results").has_traces, bpy.data.meshes)):
            # What the heat map shows stays as it was chosen.
            _same("compute and clear", this.before_result, lambda path: (path[0], path[-1]) == ("scenes", "heat_map"))
        chosen = {"active attribute", "rendered color"}
        gone = {path for path, value in this.before_last.items() if path[-1] in chosen and value in OURS}
        _same("clear finished", this.before_last, lambda path: snapshot.is_ours(path) or path in gone)


def count_faces(this: Run) -> None:
    settings = _subdivision(this.random)
    if _call(this, "count_faces", **settings):
        _same(f"count_faces {settings}", this.before_last)


def subdivide(this: Run) -> None:
    rng = this.random
    settings = _subdivision(rng)
    settings["output"] = one(rng, ("NEW_OBJECT", "IN_PLACE"))
    settings["subdivide_results"] = chance(rng, 0.7)
    if not _make(this, "subdivide", settings):
        raise Fault(f"subdivide {settings} finished and made nothing")


def update(this: Run) -> None:
    _make(this, "update", _subdivision(this.random))


def _make(this: Run, name: str, settings: dict[str, Any]) -> bool:
    """Call an operator that makes meshes; whether it did, or refused."""
    settings["exact_normals"], settings["reduce"] = chance(this.random, 0.3), chance(this.random, 0.3)
    present = {mesh.session_uid for mesh in bpy.data.meshes}
    if not _call(this, name, **settings):
        return True
    made = [mesh for mesh in bpy.data.meshes if mesh.session_uid not in present]
    # Meshes of results that had been edited are kept under other names.
    edited = [mesh for mesh in bpy.data.meshes if mesh.name.startswith("Edited ")]
    _originals_kept(this, f"{name} {settings} finished", [*made, *edited])
    for mesh in made:
        if not mesh.is_editmode:
            _sound_mesh(mesh)
    _results_current()
    this.before_result = None
    return bool(made)


def _originals_kept(this: Run, what: str, made: list[bpy.types.Mesh]) -> None:
    """Meshes that are still there are as they were; results take over names."""
    present = {mesh.name_full for mesh in bpy.data.meshes} - {mesh.name_full for mesh in made}
    edited = any(path[-1] == "is_editmode" and value == "True" for path, value in this.before_last.items())
    # Leaving Edit Mode writes what was edited to a key, and the basis to the mesh.
    with_keys = {mesh.name_full for mesh in bpy.data.meshes if mesh.shape_keys}

    def may_differ(path: snapshot.Path) -> bool:
        if edited and (path[-1].startswith("total_") or path[-1] in EDITING):
            return True
        if edited and path[-1] == "position" and path[1] in with_keys:
            return True
        return path[0] != "meshes" or path[1] not in present

    _same(what, this.before_last, may_differ)


def _subdivision(rng: Random) -> dict[str, Any]:
    settings = _tolerance(rng)
    settings["mode"] = one(rng, ("ADAPTIVE", "PER_FACE"))
    settings["transitions"] = one(rng, ("TRIANGLES", "NGONS"))
    settings["max_faces"] = int(one(rng, (1, 20, 300, 1000, 1000)))
    return settings


def set_levels(this: Run) -> None:
    bpy.context.scene.ccdepth.max_faces = int(one(this.random, (10, 2000, 2000)))
    this.before_result = None
    staleness = addon.module("state.out_of_date")
    meshes = [bpy.data.objects[name].data for name in _meant()]
    # A result may be current and yet not be about another user of its mesh.
    current = all(mesh.users == 1 and not staleness.is_stale(mesh) for mesh in meshes)
    if _call(this, "set_levels"):
        _same("set_levels", this.before_last, lambda path: path[2:3] == ("modifiers",))
    elif current and "its depths are out of date" in this.refusal:
        raise Fault("set_levels says that a result is out of date, and the panel does not")


def select(this: Run) -> None:
    rng = this.random
    settings: dict[str, Any] = {"extend": chance(rng, 0.3)}
    if chance(rng, 0.7):
        settings["depth"] = int(rng.integers(0, 4))
        settings["comparison"] = one(rng, ("EQUAL", "AT_LEAST", "AT_MOST"))
    if _call(this, "select", **settings):
        _same(f"select {settings}", this.before_last, lambda path: path[-1] in SELECTION)
        this.before_result = None


def undo(this: Run) -> None:
    """Undo takes the last operator of ours back."""
    with suppress(RuntimeError):
        bpy.ops.ed.undo()
    bpy.context.view_layer.update()
    # What was computed last may be what was taken back.
    this.before_result = this.last_computed = None
    if chance(this.random, 0.3):
        with suppress(RuntimeError):
            bpy.ops.ed.redo()


def save_and_load(this: Run) -> None:
    """Results come back from the file as they were saved."""
    before = _results()
    file = os.path.join(tempfile.mkdtemp(prefix="saved"), "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    bpy.ops.wm.open_mainfile(filepath=file)
    if before != (after := _results()):
        raise Fault(f"saving and loading: {before} became {after}")
    this.before_result = None


def _results() -> dict[str, list[Any]]:
    """The results on meshes that are saved: not those of overrides, whose attributes Blender does not save."""
    found: dict[str, list[Any]] = {}
    for mesh in bpy.data.meshes:
        if mesh.users and mesh.library is None and mesh.override_library is None and mesh.ccdepth.has_result:
            ours = [each for each in snapshot.mesh_paths(mesh) if snapshot.is_ours(("meshes", "", *each[0]))]
            found[mesh.name] = sorted(each for each in ours if each[0][0] != "displayed color")
    return found


def measure(this: Run) -> None:
    # Whether it is near enough by then does not matter here.
    if _call(this, "measure", time_limit=0.2):
        _same("measure finished", this.before_last, snapshot.is_ours)
        this.before_result = None


# Repeated ones are likelier.
ACTIONS: tuple[Callable[[Run], None], ...] = (
    compute, compute, compute, compute, clear, clear, subdivide, subdivide, subdivide, count_faces, set_levels, select,
    undo, save_and_load, update, measure, compute_again, compute_again,
)  # fmt: skip


# What must be so whatever has happened.


def _nothing_temporary() -> None:
    for collection in ("objects", "meshes", "shape_keys", "collections", "node_groups"):
        for block in getattr(bpy.data, collection):
            if block.name.startswith(("ccdepth_", "Snapshot")):
                raise Fault(f"left behind in bpy.data.{collection}: {block.name}")
    if stray := [keys.name for keys in bpy.data.shape_keys if keys.library is None and not keys.users]:
        raise Fault(f"shape keys without a mesh: {stray}")


def _results_sound(what: str) -> None:
    """Attributes of the right kind and length, and bounds that are numbers within the tolerance."""
    for mesh in bpy.data.meshes:
        record = mesh.ccdepth
        if not record.has_result or mesh.is_editmode or "ccdepth" not in mesh.attributes:
            continue
        lengths = counts(mesh)
        for name in ATTRIBUTES[: 2 if record.subdivision else 3]:
            attribute, (data_type, domain) = mesh.attributes.get(name), KINDS[name]
            found = attribute and (attribute.data_type, attribute.domain, len(attribute.data))
            if found != (data_type, domain, lengths[domain]):
                raise Fault(f"{what}: {name} on {mesh.name} is {found}")
        bounds = np.array([each.value for each in mesh.attributes["ccdepth_bound"].data])
        # Several users may have several tolerances, and only the least of them is known.
        most = record.world_tolerance * (1 + SINGLE) if len(record.contributors) <= 1 else np.inf
        if not (np.isfinite(bounds).all() and (bounds >= 0).all() and (bounds <= most).all()):
            raise Fault(f"{what}: bounds from {bounds.min()} to {bounds.max()} on {mesh.name}, tolerance {most}")
        if (least := min(_depths(mesh), default=0)) < 0:
            raise Fault(f"{what}: depth {least} on {mesh.name}")


def _results_current() -> None:
    """What was just made is not out of date."""
    staleness = addon.module("state.out_of_date")
    addon.module("state.watch").examine()
    for holder in bpy.context.selected_objects:
        # Edit Mode shows one key by itself, which is another shape than that of the result.
        if holder.type != "MESH" or (holder.data.is_editmode and holder.data.shape_keys):
            continue
        if holder.data.ccdepth.has_result and staleness.is_stale(holder.data):
            raise Fault(f"the new result on {holder.name} is out of date")


def _sound_mesh(mesh: bpy.types.Mesh) -> None:
    """Its attributes are whole, the colour it shows is one of them, and Blender finds nothing to mend."""
    for path, value in snapshot.mesh_content(mesh):
        if path[0] == "attribute" and value[2] != counts(mesh)[value[1]]:
            raise Fault(f"{path[1]} on the result {mesh.name} has {value[2]} values")
    active = mesh.attributes.active_color_name
    if active and active not in mesh.attributes:
        raise Fault(f"the result {mesh.name} shows a color attribute “{active}” that it does not have")
    # Blender finds fault with what is no number, also where the base mesh has it.
    if _is_finite(mesh) and mesh.validate(verbose=True):
        raise Fault(f"the result {mesh.name} was not valid")


def _is_finite(mesh: bpy.types.Mesh) -> bool:
    """Whether all values of its attributes are numbers."""
    for attribute in mesh.attributes:
        value, dtype, _ = snapshot.VALUES.get(attribute.data_type, ("", bool, 1))
        floating = np.issubdtype(dtype, np.floating)
        if floating and not all(np.isfinite(getattr(each, value)).all() for each in attribute.data):
            return False
    return True
