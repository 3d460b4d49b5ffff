# SPDX-License-Identifier: GPL-3.0-or-later
"""Reports of all kinds that are forged, and the fields that they have."""

import csv
import json
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.runs import Capture, printed, run, said, save, skip_unwritten
from tests.blender.test_left_out_and_lost import rig
from tests.blender.test_report import OTHERS, SCHEMA, claim, report_in, reported
from tests.thorough import each

DOCS = SCHEMA.with_name("report.md")

ABSOLUTE = ("--absolute", "--tolerance", "250mm")
# Levels and vertices that ask for more than others, so that what is forged asks for more.
LOW = (*ABSOLUTE, "--method", "certified", "--vertices", "limit")

ONE = ("--objects", "One")

# Reports by kind: the file that is read, and what is done with it. {} is the folder.
KINDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "depths": ("mirrored.blend", (*LOW, "--output", "{}/depths.blend")),
    "levels": ("mirrored.blend", (*LOW, "--levels", "--collection", "Some", "--output", "{}/levels.ply")),
    "subdivide": ("mirrored.blend", (*ABSOLUTE, "--subdivide", "--objects", "One", "Two", "--output", "{}/made.obj")),
    "measure": ("mirrored.blend", ("--absolute", "--tolerance", "2m", "--measure", *ONE, "--accuracy", "0.3")),
}


@cache
def fields(schema_part: str = "") -> dict[str, list[str]]:
    """The fields of the schema by their paths, with the types they can have."""
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))

    def walk(part: dict[str, Any], path: str) -> Iterator[tuple[str, list[str]]]:
        types = list(np.atleast_1d(part.get("type", [])))
        for other in [part, *part.get("anyOf", ())]:
            types += ["null"] if other.get("type") == "null" else []
            target = schema["$defs"][other["$ref"].removeprefix("#/$defs/")] if "$ref" in other else other
            for name, field in target.get("properties", {}).items():
                yield from walk(field, f"{path}.{name}".removeprefix("."))
            if "items" in target:
                yield from walk(target["items"], f"{path}[]")
        yield path, types

    return {path: types for path, types in walk(schema, schema_part) if path and not path.endswith("[]")}


def test_the_tables_have_all_fields_of_the_schema() -> None:
    told, prefix = [], None
    for line in DOCS.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if cells[1:] == ["says"]:
            prefix = "" if cells[0] == "`report`" else cells[0].strip("`") + "."
        elif not line.startswith("|"):
            prefix = None
        elif prefix is not None and not set(line) <= set("|-"):
            told += [prefix + name for name in re.findall(r"`([^`]*)`", cells[0])]
    assert sorted(told) == sorted(fields())


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Makes the report of a kind, once, beside its files; nobody changes them."""
    folder = tmp_path_factory.mktemp("reports")
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene.clear()
    for index, name in enumerate(("One", "Two", "Other")):
        cube = scene.add_object(meshes.cube(), name)
        cube.location.x, cube.scale = 10.0 * index, (1.0, 1.0, 1.0 + index)
        # Without it there are half as many faces.
        cube.modifiers.new("Mirror", "MIRROR").use_axis = (False, False, True)
        cube.modifiers["Mirror"].use_mirror_merge = False
        cube.modifiers.new("Move", "DISPLACE").strength = 1.0
    scene.add_collection("Some", bpy.data.objects["Two"])
    save(folder / "mirrored.blend")

    @cache
    def made(kind: str) -> Path:
        source, options = KINDS[kind]
        report = folder / f"{kind}.json"
        line = [each.format(folder) for each in options]
        assert run(line[0], *line[1:], "--json", report, "--", folder / source) == 0
        return report

    return made


# What is forged: the kind of report, and what becomes of the file's entry and of its last object's.
FORGED: dict[str, tuple[str, Callable[[Any, Any], object]]] = {
    "fewer objects": ("subdivide", lambda file, _: file["objects"].pop()),
    "an object twice": ("subdivide", lambda file, one: file["objects"].append(one)),
    "objects not asked for": ("depths", lambda file, _: file.update(chosen={"objects": ["One"], "collection": None})),
    "nothing left out": ("levels", lambda file, _: file.update(left_out=["Nobody"])),
    "another unit": ("subdivide", lambda file, _: file["output"].update(metres_per_unit=0.5)),
    "another file": ("measure", lambda file, _: file["input"].update(sha256="0")),
    "other faces": ("measure", lambda _, one: one.update(faces=one["faces"] + 1)),
    "a lower depth": ("depths", lambda _, one: one.update(deepest=one["deepest"] - 1)),
    "a lower level": ("levels", lambda _, one: one.update(level=one["level"] - 1)),
    "a shorter bound": ("depths", lambda _, one: one.update(proved=one["proved"] / 2)),
    "other triangles": ("levels", lambda _, one: one.update(triangles=one["triangles"] - 1)),
    "another tolerance": ("depths", lambda _, one: one.update(tolerance=2 * one["tolerance"])),
    "depths of no measurement": ("measure", lambda _, one: one.update(deepest=3)),
    "no measurement": ("subdivide", lambda _, one: one.update(measured=None, met=None)),
    "a verdict of no distance": ("subdivide", lambda _, one: one.update(met=False)),
    "an angle beyond the settings": ("subdivide", lambda _, one: one.update(proved_facets=3.0)),
    "a turned face": ("subdivide", lambda _, one: one.update(oriented=False)),
    "other settings": ("levels", lambda _, one: one["settings"].update(use_modifiers=False)),
    "settings that are none": ("levels", lambda _, one: one["settings"].update(method="GUESSED")),
    "no number": ("depths", lambda _, one: one.update(proved="0")),
}


@pytest.mark.parametrize("forged", FORGED)
def test_what_is_forged_does_not_pass(forged: str, reports: Callable[[str], Path]) -> None:
    kind, change = FORGED[forged]
    content = report_in(reports(kind))
    change(content["files"][0], content["files"][0]["objects"][-1])
    assert run("--verify", claim(reports(kind).with_name("forged.json"), content)) == 1


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_not_forged_passes(kind: str, reports: Callable[[str], Path]) -> None:
    assert run("--verify", reports(kind)) == 0


@pytest.mark.parametrize("kind", ["subdivide", "levels", "measure"])
def test_distances_are_proved_again(kind: str, reports: Callable[[str], Path], capfd: Capture) -> None:
    """Those told agree with each other and with the tolerance, and are smaller than those that are there."""
    content = report_in(reports(kind))
    entry = content["files"][0]["objects"][0]
    reached, tolerance = entry["measured"]["reached"], entry["tolerance"]
    for distances, is_true in (
        ((0.9 * reached, min(1.3 * reached, tolerance)), True),
        ((0.9 * reached, 0.97 * reached), False),
        ((tolerance, tolerance), False),
    ):
        entry["measured"] = dict(zip(("reached", "proved"), distances, strict=True))
        if kind == "measure":
            entry["settings"]["accuracy"] = 0.5
        claimed = claim(reports(kind).with_name("claimed.json"), content)
        told = printed(capfd, "--verify", claimed, status=0 if is_true else 1)
        assert ("the report says measured" in told) == (not is_true)


def test_a_report_does_not_hide_what_failed(tmp_path: Path, capfd: Capture) -> None:
    """An object whose driver did not run is not in the list; the others are."""
    source, report = rig(tmp_path / "rig.blend"), tmp_path / "report.json"
    content = reported(report, source, *ABSOLUTE, status=1)
    [entry] = content["files"]
    assert [each_object["name"] for each_object in entry["objects"]] == ["Plain"]
    # What says that all is well agrees with itself, and the object is not there.
    content["met"], entry["met"], entry["error"] = True, True, None
    assert "“Driven” depends on a driver" in printed(capfd, "--verify", claim(report, content), status=1)


def test_a_report_without_new_fields_is_none_of_this_version(reports: Callable[[str], Path], capfd: Capture) -> None:
    content = report_in(reports("subdivide"))
    [entry] = content["files"]
    chosen = entry.pop("chosen")
    old = reports("subdivide").with_name("old.json")
    assert "not a CC Depth report" in said(capfd, "--verify", claim(old, content))
    entry["chosen"] = chosen
    for each_object in entry["objects"]:
        del each_object["closed"], each_object["oriented"]
    assert "fields are missing or unknown: closed, oriented" in said(capfd, "--verify", claim(old, content))


def test_fields_that_no_report_has_do_not_pass(reports: Callable[[str], Path]) -> None:
    content = report_in(reports("subdivide"))
    [entry] = content["files"]
    one = entry["objects"][0]
    for holder in (content, entry, entry["input"], entry["chosen"], one, one["settings"], one["measured"]):
        holder["approved"] = True
        assert run("--verify", claim(reports("subdivide").with_name("more.json"), content)) == 1, holder
        del holder["approved"]


def test_low_levels_and_last_digits_are_no_fault(
    reports: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A report of a program that knows no better than the first-order bound, and of one that rounds otherwise."""
    report = reports("depths")
    content = report_in(report)
    entries = content["files"][0]["objects"]
    source = report.with_name("mirrored.blend")
    weak = report.with_name("weak.json")
    line = (source, *ABSOLUTE, "--method", "first-order", "--vertices", "limit")
    weaker = reported(weak, *line)["files"][0]["objects"]
    assert all(one["level"] > other["level"] for one, other in zip(weaker, entries, strict=True))
    for one, other in zip(weaker, entries, strict=True):
        other |= {name: one[name] for name in ("deepest", "level", "proved")}
    assert run("--verify", claim(report.with_name("claimed.json"), content)) == 0
    for kind in ("depths", "subdivide", "measure"):
        for factor in (1 - 5e-7, 1 + 5e-7):
            content = report_in(reports(kind))
            for each_object in content["files"][0]["objects"]:
                for holder in (each_object, each_object["measured"] or {}):
                    for name in holder.keys() & {"tolerance", "proved", "reached"}:
                        holder[name] = holder[name] and holder[name] * factor
            assert run("--verify", claim(report.with_name("rounded.json"), content)) == 0, (kind, factor)


@pytest.mark.every_blender
@pytest.mark.parametrize("suffix", each([".blend", *OTHERS], short=[".stl", ".obj", ".glb"]))
def test_closed_and_oriented_meshes_are_told(suffix: str, tmp_path: Path) -> None:
    """One of each kind; files say so whatever else they keep."""
    skip_unwritten(suffix)
    scene.add_object(meshes.cube(), "Cube")
    grid = scene.add_object(meshes.grid(3, 3), "Grid")
    turned = scene.add_object(meshes.cube(), "Turned")
    turned.data.polygons[0].flip()
    for index, each_object in enumerate((grid, turned)):
        each_object.location.x = 10.0 * (index + 1)
    report, table = tmp_path / "report.json", tmp_path / "report.csv"
    source = save(tmp_path / "kinds.blend")
    line = [*ABSOLUTE, "--subdivide", "--output", tmp_path / f"made{suffix}", "--json", report, "--csv", table]
    assert run(source, *line) == 0
    kinds = {one["name"]: (one["closed"], one["oriented"]) for one in report_in(report)["files"][0]["objects"]}
    assert kinds == {"Cube": (True, True), "Grid": (False, True), "Turned": (True, False)}
    rows = list(csv.DictReader(table.open(encoding="utf-8")))
    assert [(row["closed"], row["oriented"]) for row in rows] == [("yes", "yes"), ("no", "yes"), ("yes", "no")]
    assert run("--verify", report) == 0


def test_edges_are_counted_as_by_hand() -> None:
    """Of few vertices, so that edges are shared in every way, and some triangles have two corners at one."""
    shown, edges_of = addon.module("exchange.displayed_mesh"), addon.module("command_line.written_meshes").Edges.of
    generator = np.random.default_rng(1)
    for _ in range(60):
        corners = generator.integers(0, 4, (int(generator.integers(1, 6)), 3))
        passed: dict[tuple[int, int], list[int]] = {}
        for start, end in np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2).tolist():
            if start != end:
                passed.setdefault((min(start, end), max(start, end)), []).append(1 if start < end else -1)
        edges = edges_of(shown.Triangles(np.zeros((4, 3)), corners, np.arange(len(corners))))
        assert edges.are_closed == all(len(each_edge) % 2 == 0 for each_edge in passed.values())
        assert edges.are_oriented == all(abs(sum(each_edge)) <= 1 for each_edge in passed.values())
