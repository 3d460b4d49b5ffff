# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes, random operators on them, and what must be so after each, as a state machine of Hypothesis.

Each part is some scenes of its own, those of a seed; what fails is reported with the fewest steps that were found.
"""

import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from hypothesis import seed as seeded
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from tests.blender import addon, random_steps, scene, snapshot
from tests.blender.full_mesh import counts
from tests.blender.random_steps import REFUSALS, Random, chance, one
from tests.blender.snapshot import OURS, Snapshot
from tests.thorough import each

KINDS = {"ccdepth": "INT", "ccdepth_bound": "FLOAT"}

# Bounds are rounded up to single precision, and tolerances are kept in it: half a step each.
SINGLE = 2.0**-23

# What Select by Depth may change.
SELECTION = {
    ".select_vert", ".select_edge", ".select_poly", "select mode", "select history", "total_vert_sel", "total_edge_sel",
    "total_face_sel", "active attribute",
}  # fmt: skip

# What a mesh says while it is edited alone. Edit Mode goes on with the result.
EDITING = {"select history", "is_editmode", "active attribute", "has_custom_normals"}


SEEDS = st.integers(0, 2**32 - 1)

# Repeated ones are likelier.
ACTIONS = (
    *["compute"] * 4, *["clear"] * 2, *["subdivide"] * 2, *["update"] * 2, *["compute_again"] * 2, *["measure"] * 2,
    "count_faces", "set_levels", "select", "undo", "save_and_load",
)  # fmt: skip


def names_of(steps: Iterable[random_steps.Step]) -> list[str]:
    return [step.__name__ for step in steps]


class Scenes(RuleBasedStateMachine):
    """A file that steps put things into, and what is looked back at.

    before_result: what was there before there was any result, as long as nobody has changed anything else since.
    before_last: what was there before the last operator. last_computed: all settings that Compute Depth was called with
    last, in Object Mode, and the names of the mesh objects that were selected. refusal: what was said last where an
    operator refused. errors: all that was printed to the standard error since it was called last, by whomever.
    """

    errors: Callable[[], str]

    def __init__(self) -> None:
        super().__init__()
        bpy.ops.wm.read_homefile(use_factory_startup=True)
        scene.clear()
        self.refusal, self.before_last = "", dict[snapshot.Path, Any]()
        self.before_result: Snapshot | None = None
        self.last_computed: tuple[dict[str, Any], list[str]] | None = None
        self._folder = tempfile.TemporaryDirectory(prefix="random_scenes")
        tempfile.tempdir = self._folder.name

    def teardown(self) -> None:
        tempfile.tempdir = None
        self._folder.cleanup()

    @initialize(steps=st.lists(st.tuples(st.sampled_from(names_of(random_steps.BUILDING)), SEEDS), max_size=12))
    def build(self, steps: list[tuple[str, int]]) -> None:
        for name, seed in (("add_mesh", 1), *steps):
            self.step(name, seed)

    @rule(name=st.sampled_from(names_of(random_steps.BETWEEN)), seed=SEEDS)
    def between(self, name: str, seed: int) -> None:
        self.step(name, seed)

    def step(self, name: str, seed: int) -> None:
        with suppress(*REFUSALS):
            getattr(random_steps, name)(np.random.default_rng(seed))
        bpy.context.view_layer.update()
        self.before_result = None

    @rule(name=st.sampled_from(ACTIONS), seed=SEEDS)
    def act(self, name: str, seed: int) -> None:
        getattr(self, name)(np.random.default_rng(seed))

    @invariant()
    def nothing_fails(self) -> None:
        """Handlers and timers print their tracebacks."""
        addon.module("state.watch").examine()
        assert "Traceback" not in (heard := self.errors()), f"a traceback was printed: {heard}"

    def _call(self, name: str, allowed: Callable[[snapshot.Path], bool] | None, /, **settings: Any) -> bool:
        """Call an operator of ours; True when it finished, and then it changed only what is allowed; for None whoever
        calls looks. A refusal must have changed nothing."""
        bpy.ops.ed.undo_push(message="Before")
        self.before_last = snapshot.take()
        try:
            outcome = getattr(bpy.ops.ccdepth, name)(**settings)
        except RuntimeError as refusal:
            if "Traceback" in str(refusal) or not str(refusal).strip():
                raise AssertionError(f"{name} {settings}: refused with “{refusal}”") from None
            outcome, self.refusal = {"CANCELLED"}, str(refusal)
        bpy.context.view_layer.update()
        finished = outcome == {"FINISHED"}
        if not finished or allowed is not None:
            _same(f"{name} {settings}: {outcome}", self.before_last, allowed if finished and allowed else _nothing)
        _nothing_temporary()
        _results_sound(f"{name} {settings}")
        bpy.ops.ed.undo_push(message=name)
        return finished

    def compute(self, rng: Random) -> None:
        settings = _tolerance(rng)
        settings["method"] = one(rng, ("CERTIFIED", "DISTANCE", "SHARP", "SECOND_ORDER", "FIRST_ORDER"))
        settings["vertices"] = one(rng, ("OBJECT", "CONTROL", "LIMIT"))
        clean = not any(map(addon.module("state.mesh_values").has_traces, bpy.data.meshes))
        if self._call("compute", snapshot.is_ours, **settings):
            if clean:
                self.before_result = self.before_last
            self.last_computed = (_filled_in(settings), _meant()) if bpy.context.mode == "OBJECT" else None
            _results_current()

    def compute_again(self, rng: Random) -> None:
        """A result that is said to be current is what would be computed now."""
        settings, names = self.last_computed or ({}, [])
        objects = [bpy.data.objects.get(name) for name in names]
        if not objects or bpy.context.mode != "OBJECT" or not all(objects):
            return
        with suppress(*REFUSALS):
            addon.select(*objects)
        staleness = addon.module("state.out_of_date")
        addon.module("state.watch").examine()
        has_depths = addon.module("state.mesh_values").has_depths
        found = [each.data for each in objects if each.type == "MESH" and has_depths(each.data)]
        computed = [mesh for mesh in found if not mesh.ccdepth.subdivision]
        current = {mesh.name: _depths(mesh) for mesh in computed if not staleness.is_stale(mesh)}
        if len(bpy.context.selected_objects) == len(objects) and self._call("compute", None, **settings):
            for name, depths in current.items():
                now = _depths(bpy.data.meshes[name])
                assert now == depths, f"the result on {name} was said to be current and was not"
        self.before_result = None

    def clear(self, rng: Random) -> None:
        has_traces = addon.module("state.mesh_values").has_traces
        if self._call("clear", None):
            if self.before_result is not None and not any(map(has_traces, bpy.data.meshes)):
                # What the heat map shows stays as it was chosen.
                _same("compute and clear", self.before_result, lambda path: path[-1] == "heat_map")
            chosen = {"active attribute", "rendered color"}
            gone = {path for path, value in self.before_last.items() if path[-1] in chosen and value in OURS}
            _same("clear finished", self.before_last, lambda path: snapshot.is_ours(path) or path in gone)

    def count_faces(self, rng: Random) -> None:
        self._call("count_faces", _nothing, **_subdivision(rng))

    def subdivide(self, rng: Random) -> None:
        settings = _subdivision(rng)
        settings["output"] = one(rng, ("NEW_OBJECT", "IN_PLACE"))
        settings["subdivide_results"] = chance(rng, 0.7)
        assert self._make(rng, "subdivide", settings), f"subdivide {settings} finished and made nothing"

    def update(self, rng: Random) -> None:
        if not bpy.ops.ccdepth.update.poll():
            self.subdivide(rng)
        self._make(rng, "update", _subdivision(rng))

    def _make(self, rng: Random, name: str, settings: dict[str, Any]) -> bool:
        """Call an operator that makes meshes; whether it did, or refused."""
        settings["exact_normals"], settings["reduce"] = chance(rng, 0.3), chance(rng, 0.2)
        present = {mesh.session_uid for mesh in bpy.data.meshes}
        if not self._call(name, None, **settings):
            return True
        made = [mesh for mesh in bpy.data.meshes if mesh.session_uid not in present]
        # Meshes of results that had been edited are kept under other names.
        edited = [mesh for mesh in bpy.data.meshes if mesh.name.startswith("Edited ")]
        self._originals_kept(f"{name} {settings} finished", [*made, *edited])
        for mesh in made:
            if not mesh.is_editmode:
                _sound_mesh(mesh)
        _results_current()
        self.before_result = None
        return bool(made)

    def _originals_kept(self, what: str, made: list[bpy.types.Mesh]) -> None:
        """Meshes that are still there are as they were; results take over names."""
        present = {mesh.name_full for mesh in bpy.data.meshes} - {mesh.name_full for mesh in made}
        edited = any(path[-1] == "is_editmode" and value == "True" for path, value in self.before_last.items())
        # Leaving Edit Mode writes what was edited to a key, and the basis to the mesh.
        with_keys = {mesh.name_full for mesh in bpy.data.meshes if mesh.shape_keys}

        def may_differ(path: snapshot.Path) -> bool:
            if edited and (path[-1].startswith("total_") or path[-1] in EDITING):
                return True
            if edited and path[-1] == "position" and path[1] in with_keys:
                return True
            return path[0] != "meshes" or path[1] not in present

        _same(what, self.before_last, may_differ)

    def set_levels(self, rng: Random) -> None:
        bpy.context.scene.ccdepth.max_faces = int(one(rng, (10, 2000, 2000)))
        self.before_result = None
        staleness = addon.module("state.out_of_date")
        meshes = [bpy.data.objects[name].data for name in _meant()]
        # A result may be current and yet not be about another user of its mesh.
        current = all(mesh.users == 1 and not staleness.is_stale(mesh) for mesh in meshes)
        done = self._call("set_levels", lambda path: path[2:3] == ("modifiers",))
        is_stale = not done and "its depths are out of date" in self.refusal
        assert not (is_stale and current), "set_levels says that a result is out of date, and the panel does not"

    def select(self, rng: Random) -> None:
        settings: dict[str, Any] = {"extend": chance(rng, 0.3)}
        if chance(rng, 0.7):
            settings["depth"] = int(rng.integers(0, 4))
            settings["comparison"] = one(rng, ("EQUAL", "AT_LEAST", "AT_MOST"))
        if self._call("select", lambda path: path[-1] in SELECTION, **settings):
            self.before_result = None

    def undo(self, rng: Random) -> None:
        """Undo takes the last operator of ours back."""
        with suppress(RuntimeError):
            bpy.ops.ed.undo()
        bpy.context.view_layer.update()
        # What was computed last may be what was taken back.
        self.before_result = self.last_computed = None
        if chance(rng, 0.3):
            with suppress(RuntimeError):
                bpy.ops.ed.redo()

    def save_and_load(self, rng: Random) -> None:
        """Results come back from the file as they were saved."""
        before = _results()
        scene.open_again(Path(tempfile.mkdtemp(prefix="saved")))
        assert before == (after := _results()), f"saving and loading: {before} became {after}"
        self.before_result = None

    def measure(self, rng: Random) -> None:
        # Whether it is near enough by then does not matter here.
        if self._call("measure", snapshot.is_ours, time_limit=0.2):
            self.before_result = None


@pytest.mark.every_blender
@pytest.mark.parametrize("part", each(range(25), short=[0]))
def test_random_scenes(part: int, capfd: pytest.CaptureFixture[str]) -> None:
    machine = seeded(part)(type("Scenes", (Scenes,), {"errors": staticmethod(lambda: capfd.readouterr().err)}))
    run_state_machine_as_test(machine, settings=settings(max_examples=25, stateful_step_count=12, derandomize=False))


def _nothing(_path: snapshot.Path) -> bool:
    return False


def _same(what: str, before: Snapshot, allowed: Callable[[snapshot.Path], bool] = _nothing) -> None:
    """AssertionError where anything but what is allowed has been changed since."""
    found = snapshot.differences(before, snapshot.take(), allowed)
    assert not found, f"{what}, and this was changed:\n" + "\n".join(found[:12])


def _tolerance(rng: Random) -> dict[str, Any]:
    if chance(rng, 0.15):
        return {}
    settings: dict[str, Any] = {"tolerance_mode": one(rng, ("RELATIVE", "RELATIVE", "ABSOLUTE"))}
    settings["tolerance"] = float(10.0 ** rng.uniform(-1, 0))
    if chance(rng, 0.06):
        settings["tolerance"] = one(rng, (0.0, -1.0, 1e-12, 1e30, 1e39, float("inf"), float("nan")))
    if chance(rng, 0.5):
        settings["use_modifiers"] = chance(rng, 0.7)
    return settings


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


def _depths(mesh: bpy.types.Mesh) -> list[int]:
    return [each.value for each in mesh.attributes["ccdepth"].data]


def _subdivision(rng: Random) -> dict[str, Any]:
    settings = _tolerance(rng)
    settings["shading_angle"] = float(one(rng, (0.0, 0.0, 0.3)))
    settings["mode"] = one(rng, ("ADAPTIVE", "PER_FACE"))
    settings["max_faces"] = int(one(rng, (1, 20, 300, 1000, 1000)))
    return settings


def _results() -> dict[str, list[Any]]:
    """The results on meshes that are saved: not those of overrides, whose attributes Blender does not save."""
    found: dict[str, list[Any]] = {}
    for mesh in bpy.data.meshes:
        if mesh.users and mesh.library is None and mesh.override_library is None and mesh.ccdepth.has_result:
            ours = [each for each in snapshot.mesh_paths(mesh) if snapshot.is_ours(("meshes", "", *each[0]))]
            found[mesh.name] = sorted(each for each in ours if each[0][0] != "displayed color")
    return found


def _nothing_temporary() -> None:
    for collection in ("objects", "meshes", "shape_keys", "collections", "node_groups"):
        for block in getattr(bpy.data, collection):
            is_ours = block.name.startswith(("ccdepth_", "Snapshot"))
            assert not is_ours, f"left behind in bpy.data.{collection}: {block.name}"
    stray = [keys.name for keys in bpy.data.shape_keys if keys.library is None and not keys.users]
    assert not stray, f"shape keys without a mesh: {stray}"


def _results_sound(what: str) -> None:
    """Attributes of the right kind and length, and bounds that are numbers within the tolerance."""
    for mesh in bpy.data.meshes:
        record = mesh.ccdepth
        if not record.has_result or mesh.is_editmode or "ccdepth" not in mesh.attributes:
            continue
        for name, kind in KINDS.items():
            attribute = mesh.attributes.get(name)
            found = attribute and (attribute.data_type, attribute.domain, len(attribute.data))
            assert found == (kind, "FACE", len(mesh.polygons)), f"{what}: {name} on {mesh.name} is {found}"
        bounds = scene.read(mesh, "ccdepth_bound")
        # Several users may have several tolerances, and only the least of them is known.
        most = record.world_tolerance * (1 + SINGLE) if len(record.contributors) <= 1 else np.inf
        are_sound = np.all(np.isfinite(bounds) & (bounds >= 0) & (bounds <= most))
        assert are_sound, f"{what}: bounds from {bounds.min()} to {bounds.max()} on {mesh.name}, tolerance {most}"
        least = min(_depths(mesh), default=0)
        assert least >= 0, f"{what}: depth {least} on {mesh.name}"


def _results_current() -> None:
    """What was just made is not out of date."""
    staleness = addon.module("state.out_of_date")
    addon.module("state.watch").examine()
    for holder in bpy.context.selected_objects:
        # Edit Mode shows one key by itself, which is another shape than that of the result.
        if holder.type != "MESH" or (holder.data.is_editmode and holder.data.shape_keys):
            continue
        is_stale = holder.data.ccdepth.has_result and staleness.is_stale(holder.data)
        assert not is_stale, f"the new result on {holder.name} is out of date"


def _sound_mesh(mesh: bpy.types.Mesh) -> None:
    """Its attributes are whole, the colour it shows is one of them, and Blender finds nothing to mend."""
    for path, value in snapshot.mesh_content(mesh):
        is_whole = path[0] != "attribute" or value[2] == counts(mesh)[value[1]]
        assert is_whole, f"{path[1]} on the result {mesh.name} has {value[2]} values"
    active = mesh.attributes.active_color_name
    assert not active or active in mesh.attributes, f"the result {mesh.name} shows “{active}”, which it does not have"
    # Blender finds fault with what is no number, also where the base mesh has it.
    values = [scene.read(mesh, attribute.name) for attribute in mesh.attributes if attribute.data_type != "STRING"]
    is_finite = all(np.isfinite(each_one).all() for each_one in values)
    assert not (is_finite and mesh.validate(verbose=True)), f"the result {mesh.name} was not valid"
