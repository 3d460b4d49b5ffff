# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes, random operators on them, and what must be so after each: the plan of a seed, run and checked.

Any range of seeds, in processes that may crash or hang, each fault reduced to the steps it needs:

    python -m tests.blender.random_runs 0 2000

One seed with what happened at each step, or some of its steps alone:

    python -m tests.blender.random_runs --one 17
    python -m tests.blender.random_runs --one 17 --steps 0,3,8
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Timer
from typing import Any

import bpy
import numpy as np

from tests.blender import addon, random_scenes, snapshot
from tests.blender.addon import ATTRIBUTES
from tests.blender.random_scenes import REFUSALS, Random, Step, chance, one
from tests.blender.snapshot import OURS, Snapshot

CHECKOUT = Path(__file__).resolve().parents[2]

KINDS = {"ccdepth": ("INT", "FACE"), "ccdepth_bound": ("FLOAT", "FACE"), "ccdepth_color": ("FLOAT_COLOR", "CORNER")}

# Bounds are rounded up to single precision, and tolerances are kept in it: half a step each.
SINGLE = 2.0**-23

# What Select by Depth may change.
SELECTION = {
    ".select_vert", ".select_edge", ".select_poly", "select mode", "select history", "total_vert_sel", "total_edge_sel",
    "total_face_sel", "active attribute",
}  # fmt: skip

# What a mesh says while it is edited alone. Edit Mode goes on with the result.
EDITING = {"select history", "is_editmode", "active attribute", "has_custom_normals"}

# Nothing here is large: what takes longer than this, in seconds, is stuck.
PATIENCE = 600.0


class Fault(AssertionError):
    """Something that must not be."""


@dataclass(frozen=True)
class Computed:
    """All settings that Compute Depth was called with, and the mesh objects that were selected."""

    settings: dict[str, Any]
    objects: list[str]


@dataclass
class Run:
    """One run of a plan, and what later steps look back at.

    before_result: what was there before there was any result, as long as nobody has changed anything else since.
    before_last: what was there before the last operator. last_computed: how depths were computed last, in Object Mode.
    """

    random: Random
    tally: Counter[str] = field(default_factory=Counter)
    before_result: Snapshot | None = None
    before_last: Snapshot | None = None
    last_computed: Computed | None = None


def plan(seed: int) -> list[str]:
    """The names of the steps of a seed."""
    rng = np.random.default_rng(seed)
    steps = ["add_mesh", *(one(rng, random_scenes.ADDED_FIRST).__name__ for _ in range(rng.integers(0, 5)))]
    steps += [one(rng, random_scenes.BUILDING).__name__ for _ in range(rng.integers(2, 14))]
    if chance(rng, 0.7):
        steps.append("choose_objects")
    if chance(rng, 0.3):
        steps.append("set_mode")
    if chance(rng, 0.7):
        steps.append("compute")
    for _ in range(rng.integers(2, 7)):
        steps.append(one(rng, ACTIONS).__name__)
        if chance(rng, 0.3):
            steps.append(one(rng, random_scenes.BETWEEN).__name__)
    return steps


def run(seed: int, kept: Sequence[int] | None = None, tell: Callable[[str], None] = lambda text: None) -> Counter[str]:
    """Carry out the plan of a seed, or only some of its steps, and count how the operators ended. Raises Fault."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes])
    tally: Counter[str] = Counter()
    this = Run(np.random.default_rng(seed), tally)
    with warnings.catch_warnings(), tempfile.TemporaryDirectory(prefix="random_scenes") as folder:
        warnings.simplefilter("error", RuntimeWarning)
        tempfile.tempdir = folder
        try:
            for number, name in enumerate(plan(seed)):
                if kept is not None and number not in kept:
                    continue
                this.random = np.random.default_rng([seed, number])
                tell(f"{number} {name}")
                with _errors_heard() as heard:
                    _carry_out(name, this)
                    for module in ("state.staleness", "state.sources"):
                        addon.module(module).check_touched()
                if "Traceback" in heard():
                    raise Fault(f"a traceback was printed: {heard()}")
        finally:
            tempfile.tempdir = None
    return tally


def _carry_out(name: str, this: Run) -> None:
    action = next((action for action in ACTIONS if action.__name__ == name), None)
    if action is not None:
        action(this)
        return
    step: Step = getattr(random_scenes, name)
    with suppress(*REFUSALS):
        step(this.random)
    bpy.context.view_layer.update()
    this.before_result = this.before_last = None


@contextmanager
def _errors_heard() -> Iterator[Callable[[], str]]:
    """Everything printed to the standard error meanwhile, by whomever: handlers and timers print their tracebacks."""
    sys.stderr.flush()
    python, saved = sys.stderr, os.dup(2)
    with tempfile.TemporaryFile() as file:

        def heard() -> str:
            file.seek(0)
            return file.read().decode(errors="replace")

        os.dup2(file.fileno(), 2)
        sys.stderr = os.fdopen(os.dup(2), "w", buffering=1)
        text = ""
        try:
            yield lambda: text
        finally:
            sys.stderr.close()
            sys.stderr = python
            os.dup2(saved, 2)
            os.close(saved)
            text = heard()


# Actions: operators with random settings, and what must be so afterwards.


def _call(this: Run, name: str, **settings: Any) -> bool:
    """Call an operator of ours; True when it finished. A refusal must have changed nothing."""
    operator = getattr(bpy.ops.ccdepth, name)
    bpy.ops.ed.undo_push(message="Before")
    before = snapshot.take()
    this.before_last = before
    try:
        outcome = operator(**settings)
    except RuntimeError as refusal:
        if "Traceback" in str(refusal):
            raise Fault(f"{name} {settings}: {refusal}") from None
        if not str(refusal).strip():
            raise Fault(f"{name} {settings}: refused without a word") from refusal
        outcome = {"CANCELLED"}
        this.tally[f"{name}: {_reason(str(refusal))}"] += 1
    bpy.context.view_layer.update()
    finished = outcome == {"FINISHED"}
    this.tally[f"{name} {'finished' if finished else 'refused'}"] += 1
    if not finished:
        _same(f"{name} {settings} refused", before, snapshot.take())
    _nothing_temporary()
    _results_sound(f"{name} {settings}")
    bpy.ops.ed.undo_push(message=name)
    return finished


def _reason(text: str) -> str:
    """What is said, without names and numbers."""
    words = text.splitlines()[0].removeprefix("Error: ").rpartition(": ")[2]
    return "".join("#" if letter.isdigit() else letter for letter in words)[:70]


def _same(
    what: str, before: Snapshot, after: Snapshot, but: Callable[[snapshot.Path], bool] = lambda path: False
) -> None:
    found = snapshot.differences(before, after, but)
    if found:
        raise Fault(f"{what}, and this was changed:\n" + "\n".join(found[:12]))


def _tolerance(rng: Random) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    if chance(rng, 0.15):
        return settings
    settings["tolerance_mode"] = one(rng, ("RELATIVE", "RELATIVE", "ABSOLUTE"))
    settings["tolerance"] = float(10.0 ** rng.uniform(-1.5, 0))
    if chance(rng, 0.06):
        settings["tolerance"] = one(rng, (0.0, -1.0, 1e-12, 1e30, 1e39, float("inf"), float("nan")))
    if chance(rng, 0.5):
        settings["use_modifiers"] = chance(rng, 0.7)
    return settings


def compute(this: Run) -> None:
    rng = this.random
    settings = _tolerance(rng)
    settings["method"] = one(rng, ("CERTIFIED", "CERTIFIED", "SHARP", "SECOND_ORDER", "FIRST_ORDER"))
    settings["vertices"] = one(rng, ("CONTROL", "LIMIT"))
    clean = not any(addon.module("state.results").has_traces(mesh) for mesh in bpy.data.meshes)
    if _call(this, "compute", **settings):
        assert this.before_last is not None
        _same(f"compute {settings} finished", this.before_last, snapshot.take(), but=snapshot.is_ours)
        if clean:
            this.before_result = this.before_last
        in_object_mode = bpy.context.mode == "OBJECT"
        this.last_computed = Computed(_filled_in(settings), _meant()) if in_object_mode else None
        _results_current()


def _filled_in(settings: dict[str, Any]) -> dict[str, Any]:
    """The settings with those that come from the scene."""
    scene = bpy.context.scene.ccdepth
    names = ("tolerance_mode", "use_modifiers", "method", "vertices")
    filled = {**{name: getattr(scene, name) for name in names}, **settings}
    relative = filled["tolerance_mode"] == "RELATIVE"
    return {"tolerance": scene.relative_tolerance if relative else scene.tolerance, **filled}


def _meant() -> list[str]:
    active = bpy.context.active_object
    chosen = bpy.context.selected_objects or ([active] if active else [])
    return [each.name for each in chosen if each.type == "MESH" and each.library is None]


def compute_again(this: Run) -> None:
    """A result that is said to be current is what would be computed now."""
    objects = [bpy.data.objects.get(name) for name in (this.last_computed.objects if this.last_computed else ())]
    if not objects or bpy.context.mode != "OBJECT" or not all(objects):
        return
    assert this.last_computed is not None
    with suppress(*REFUSALS):
        addon.select(*objects)
    staleness = addon.module("state.staleness")
    staleness.check_touched()
    current = {
        each.data.name: _depths(each.data)
        for each in objects
        if each.type == "MESH" and _has_depths(each.data) and not staleness.is_stale(each.data)
    }
    if len(bpy.context.selected_objects) == len(objects) and _call(this, "compute", **this.last_computed.settings):
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
        after = snapshot.take()
        left = [mesh.name for mesh in bpy.data.meshes if addon.module("state.results").has_traces(mesh)]
        if this.before_result is not None and not left:
            _same("compute and clear", this.before_result, after)
        assert this.before_last is not None
        chosen = {"active attribute", "rendered color"}
        gone = {path for path, value in this.before_last.items() if path[-1] in chosen and value in OURS}
        _same("clear finished", this.before_last, after, but=lambda path: snapshot.is_ours(path) or path in gone)


def count_faces(this: Run) -> None:
    settings = _subdivision(this.random)
    if _call(this, "count_faces", **settings):
        assert this.before_last is not None
        _same(f"count_faces {settings}", this.before_last, snapshot.take())


def subdivide(this: Run) -> None:
    rng = this.random
    settings = _subdivision(rng)
    settings["output"] = one(rng, ("NEW_OBJECT", "IN_PLACE"))
    settings["exact_normals"] = chance(rng, 0.3)
    settings["reduce"] = chance(rng, 0.3)
    settings["subdivide_results"] = chance(rng, 0.7)
    present = {mesh.session_uid for mesh in bpy.data.meshes}
    if not _call(this, "subdivide", **settings):
        return
    this.before_result = None
    made = [mesh for mesh in bpy.data.meshes if mesh.session_uid not in present]
    if not made:
        raise Fault(f"subdivide {settings} finished and made nothing")
    assert this.before_last is not None
    _originals_kept(settings, this.before_last, made)
    for mesh in made:
        if not mesh.is_editmode:
            _sound_mesh(mesh)
    _results_current()


def _originals_kept(settings: dict[str, Any], before: Snapshot, made: list[bpy.types.Mesh]) -> None:
    """Meshes that are still there are as they were; results take over names."""
    present = {mesh.name_full for mesh in bpy.data.meshes} - {mesh.name_full for mesh in made}
    edited = before["mode",] == "EDIT_MESH"
    # Leaving Edit Mode writes what was edited to a key, and the basis to the mesh.
    with_keys = {mesh.name_full for mesh in bpy.data.meshes if mesh.shape_keys}

    def may_differ(path: snapshot.Path) -> bool:
        if edited and (path[-1].startswith("total_") or path[-1] in EDITING):
            return True
        if edited and path[-1] == "position" and path[1] in with_keys:
            return True
        return path[0] != "meshes" or path[1] not in present

    _same(f"subdivide {settings} finished", before, snapshot.take(), but=may_differ)


def _subdivision(rng: Random) -> dict[str, Any]:
    settings = _tolerance(rng)
    settings["mode"] = one(rng, ("ADAPTIVE", "PER_FACE"))
    settings["transitions"] = one(rng, ("TRIANGLES", "NGONS"))
    settings["max_faces"] = int(one(rng, (1, 20, 300, 1000, 1000)))
    return settings


def set_levels(this: Run) -> None:
    bpy.context.scene.ccdepth.max_faces = int(one(this.random, (10, 2000, 2000)))
    this.before_result = None
    staleness = addon.module("state.staleness")
    meshes = [bpy.data.objects[name].data for name in _meant()]
    # A result may be current and yet not be about another user of its mesh.
    current = all(mesh.users == 1 and not staleness.is_stale(mesh) for mesh in meshes)
    refused = this.tally["set_levels: its depths are out of date; compute them again"]
    finished = _call(this, "set_levels")
    if current and this.tally["set_levels: its depths are out of date; compute them again"] > refused:
        raise Fault("set_levels says that a result is out of date, and the panel does not")
    if finished:
        assert this.before_last is not None
        _same("set_levels", this.before_last, snapshot.take(), but=lambda path: path[2:3] == ("modifiers",))
        this.before_result = None


def select(this: Run) -> None:
    rng = this.random
    settings: dict[str, Any] = {"extend": chance(rng, 0.3)}
    if chance(rng, 0.7):
        settings["depth"] = int(rng.integers(0, 4))
        settings["comparison"] = one(rng, ("EQUAL", "AT_LEAST", "AT_MOST"))
    if _call(this, "select", **settings):
        assert this.before_last is not None
        _same(f"select {settings}", this.before_last, snapshot.take(), but=_is_selection)
        this.before_result = None


def _is_selection(path: snapshot.Path) -> bool:
    return path[-1] in SELECTION


def undo(this: Run) -> None:
    """Undo takes the last operator of ours back."""
    with suppress(RuntimeError):
        bpy.ops.ed.undo()
    bpy.context.view_layer.update()
    this.before_result = this.before_last = None
    if chance(this.random, 0.3):
        with suppress(RuntimeError):
            bpy.ops.ed.redo()


def save_and_load(this: Run) -> None:
    """Results come back from the file as they were saved."""
    before = _results()
    file = os.path.join(tempfile.mkdtemp(prefix="saved"), "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    bpy.ops.wm.open_mainfile(filepath=file)
    after = _results()
    if before != after:
        raise Fault(f"saving and loading: {before} became {after}")
    this.before_result = this.before_last = None


def _results() -> dict[str, list[Any]]:
    """The results on meshes that are saved: not those of overrides, whose attributes Blender does not save."""
    found: dict[str, list[Any]] = {}
    for mesh in bpy.data.meshes:
        if mesh.users and mesh.library is None and mesh.override_library is None and mesh.ccdepth.has_result:
            paths = {
                path: value for path, value in snapshot.mesh_paths(mesh) if snapshot.is_ours(("meshes", "", *path))
            }
            found[mesh.name] = sorted((path, value) for path, value in paths.items() if path[0] != "displayed color")
    return found


def update(this: Run) -> None:
    """Update Result, where there is one."""
    if not is_there("update"):
        return
    settings = _subdivision(this.random)
    settings["exact_normals"] = chance(this.random, 0.3)
    settings["reduce"] = chance(this.random, 0.2)
    present = {mesh.session_uid for mesh in bpy.data.meshes}
    if not _call(this, "update", **settings):
        return
    made = [mesh for mesh in bpy.data.meshes if mesh.session_uid not in present]
    # Meshes of results that had been edited are kept under other names.
    kept = [mesh for mesh in bpy.data.meshes if mesh.name.startswith("Edited ")]
    assert this.before_last is not None
    _originals_kept(settings, this.before_last, [*made, *kept])
    for mesh in made:
        if not mesh.is_editmode:
            _sound_mesh(mesh)
    _results_current()
    this.before_result = None


def measure(this: Run) -> None:
    """Measure Deviation, where there is one."""
    # Whether it is near enough by then does not matter here.
    if is_there("measure") and _call(this, "measure", time_limit=0.2):
        assert this.before_last is not None
        _same("measure finished", this.before_last, snapshot.take(), but=snapshot.is_ours)
        this.before_result = None


def is_there(name: str) -> bool:
    """Whether this version has the operator; plans are the same with and without."""
    return hasattr(bpy.types, f"CCDEPTH_OT_{name}")


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
    stray = [keys.name for keys in bpy.data.shape_keys if keys.library is None and not keys.users]
    if stray:
        raise Fault(f"shape keys without a mesh: {stray}")


def _results_sound(what: str) -> None:
    """Attributes of the right kind and length, and bounds that are numbers within the tolerance."""
    for mesh in bpy.data.meshes:
        record = mesh.ccdepth
        if not record.has_result or mesh.is_editmode or "ccdepth" not in mesh.attributes:
            continue
        lengths = {"FACE": len(mesh.polygons), "CORNER": len(mesh.loops)}
        for name in ATTRIBUTES[: 2 if record.subdivision else 3]:
            attribute = mesh.attributes.get(name)
            if attribute is None or (attribute.data_type, attribute.domain) != KINDS[name]:
                raise Fault(f"{what}: {mesh.name} has no {name} of its kind")
            if len(attribute.data) != lengths[attribute.domain]:
                raise Fault(f"{what}: {name} on {mesh.name} has {len(attribute.data)} values")
        depths, bounds = (np.zeros(len(mesh.polygons), dtype) for dtype in (np.int32, np.float32))
        mesh.attributes["ccdepth"].data.foreach_get("value", depths)
        mesh.attributes["ccdepth_bound"].data.foreach_get("value", bounds)
        # Several users may have several tolerances, and only the least of them is known.
        most = record.world_tolerance * (1 + SINGLE) if len(record.contributors) <= 1 else np.inf
        if not (np.isfinite(bounds).all() and (bounds >= 0).all() and (bounds <= most).all()):
            raise Fault(f"{what}: bounds from {bounds.min()} to {bounds.max()} on {mesh.name}, tolerance {most}")
        if (depths < 0).any():
            raise Fault(f"{what}: depth {depths.min()} on {mesh.name}")


def _results_current() -> None:
    """What was just made is not out of date."""
    staleness = addon.module("state.staleness")
    staleness.check_touched()
    for holder in bpy.context.selected_objects:
        # Edit Mode shows one key by itself, which is another shape than that of the result.
        if holder.type != "MESH" or (holder.data.is_editmode and holder.data.shape_keys):
            continue
        if holder.data.ccdepth.has_result and staleness.is_stale(holder.data):
            raise Fault(f"the new result on {holder.name} is out of date")


def _sound_mesh(mesh: bpy.types.Mesh) -> None:
    """Its attributes are whole, the colour it shows is one of them, and Blender finds nothing to mend."""
    for path, value in snapshot.mesh_content(mesh):
        if path[0] == "attribute" and value[2] != _lengths(mesh)[value[1]]:
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
        value, dtype, width = snapshot.VALUES.get(attribute.data_type, ("", bool, 1))
        if np.issubdtype(dtype, np.floating):
            values = np.zeros(len(attribute.data) * width, dtype)
            attribute.data.foreach_get(value, values)
            if not np.isfinite(values).all():
                return False
    return True


def _lengths(mesh: bpy.types.Mesh) -> dict[str, int]:
    return {
        "POINT": len(mesh.vertices), "EDGE": len(mesh.edges), "FACE": len(mesh.polygons), "CORNER": len(mesh.loops)
    }  # fmt: skip


# Running


def fault_of(seed: int, kept: Sequence[int] | None = None) -> str | None:
    """What goes wrong, if anything does."""
    try:
        run(seed, kept)
    except Fault as fault:
        return str(fault)
    except Exception:
        return traceback.format_exc()
    return None


def reduced(seed: int, fault: str) -> tuple[list[int], str]:
    """As few steps as still end in a fault of this kind, and that fault."""
    kept = list(range(len(plan(seed))))
    for number in reversed(range(len(kept))):
        without = [other for other in kept if other != number]
        found = fault_of(seed, without)
        if found is not None and _kind(found) == _kind(fault):
            kept, fault = without, found
    return kept, fault


def _kind(fault: str) -> str:
    """The last line of a traceback, or how the fault begins."""
    lines = fault.strip().splitlines()
    return lines[-1][:40] if "Traceback" in fault else lines[0][:12]


def _run_seeds(first: int, last: int) -> None:
    """In this process; tells the parent what happens."""
    out = os.fdopen(os.dup(1), "w", buffering=1)
    for seed in range(first, last):
        print(f"@seed {seed}", file=out)
        began = time.process_time()
        try:
            for name, count in run(seed).items():
                print(f"@tally {count} {name}", file=out)
        except Exception as found:
            fault = str(found) if isinstance(found, Fault) else traceback.format_exc()
            kept, fault = reduced(seed, fault)
            steps = ",".join(map(str, kept))
            names = " ".join(plan(seed)[number] for number in kept)
            print(f"@fault {seed} --steps {steps}  ({names})\n{fault}\n@end", file=out)
        print(f"@time {time.process_time() - began:.2f}", file=out)
    out.flush()
    # The bpy module can hang when the interpreter winds up.
    os._exit(0)


class Range:
    """Seeds run in processes of their own, and what they said."""

    def __init__(self) -> None:
        self.tally: Counter[str] = Counter()
        self.times: list[float] = []
        self.faults = 0
        self.reached = 0

    def run(self, first: int, last: int, size: int) -> None:
        """Run the seeds, ``size`` to a process; after a crash the next process goes on behind it."""
        while first < last:
            end = min(first + size, last)
            self.reached = first
            status, errors = self._run_process(first, end)
            if status != 0:
                # Without the add-on on the stack Blender has crashed by itself, as some of its modes and modifiers do.
                crashed = status in (-signal.SIGSEGV, -signal.SIGABRT)
                is_ours = not crashed or f"{os.sep}ccdepth_addon{os.sep}" in errors
                self.faults += is_ours
                end = self.reached + 1
                where = "\n".join(line for line in errors.splitlines() if str(CHECKOUT) in line)
                print(
                    f"@crash {'' if is_ours else 'of Blender by itself '}{self.reached}: {status}\n{where}", flush=True
                )
            first = end

    def _run_process(self, first: int, end: int) -> tuple[int, str]:
        command = [sys.executable, "-m", "tests.blender.random_runs", "--inside", str(first), str(end)]
        with tempfile.TemporaryFile("w+", errors="replace") as errors:
            process = subprocess.Popen(
                command, cwd=CHECKOUT, stdout=subprocess.PIPE, stderr=errors, text=True, errors="replace"
            )
            assert process.stdout is not None
            watch = Timer(PATIENCE, process.kill)
            watch.start()
            telling = False
            for line in process.stdout:
                if line.startswith("@seed "):
                    self.reached = int(line.split()[1])
                    watch.cancel()
                    watch = Timer(PATIENCE, process.kill)
                    watch.start()
                telling = self._hear(line, telling)
            status = process.wait()
            watch.cancel()
            errors.seek(0)
            return status, errors.read()

    def _hear(self, line: str, telling: bool) -> bool:
        """Count what a process says; faults are told on as they come, from their first line to their end."""
        if line.startswith("@tally "):
            _, count, name = line.rstrip("\n").split(" ", 2)
            self.tally[name] += int(count)
        elif line.startswith("@time "):
            self.times.append(float(line.split()[1]))
        elif line.startswith("@fault "):
            self.faults += 1
            telling = True
        elif line.startswith("@end"):
            return False
        if telling:
            print(line, end="", flush=True)
        return telling

    def tell(self) -> None:
        for name, count in sorted(self.tally.items()):
            print(f"{count:7} {name}")
        seconds, most = sum(self.times), max(self.times, default=0.0)
        seeds = f"{len(self.times)} seeds, {self.faults} faults"
        print(f"{seeds}, {seconds:.0f} s of CPU time, {most:.0f} s at most for one")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("last", type=int, nargs="?", default=100)
    parser.add_argument("--size", type=int, default=20, help="seeds per process")
    parser.add_argument("--one", type=int, help="run this seed alone, and say what happens")
    parser.add_argument("--steps", help="only these of its steps")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if not (options.inside or options.one is not None):
        seeds = Range()
        seeds.run(options.first, options.last, options.size)
        seeds.tell()
        sys.exit(1 if seeds.faults else 0)
    import ccdepth_addon

    faulthandler.enable(os.dup(2))
    if not hasattr(bpy.types.Scene, "ccdepth"):
        ccdepth_addon.register()
    if options.inside:
        _run_seeds(options.first, options.last)
    kept = [int(number) for number in options.steps.split(",")] if options.steps else None
    status = 0
    try:
        print(run(options.one, kept, tell=lambda text: print(text, flush=True)))
    except Exception:
        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


if __name__ == "__main__":
    main()
