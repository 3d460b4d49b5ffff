# SPDX-License-Identifier: GPL-3.0-or-later
"""What the programs in benchmarks/ name is there."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

from benchmarks.tuned_constants import CACHES, ENTRIES, WORKLOADS, located

CHECKOUT = Path(__file__).resolve().parent.parent

# It does its work when it is imported, as a script that Blender runs.
SCRIPTS = {"responsiveness"}


def test_what_is_switched_off_is_there_and_its_workloads_are() -> None:
    places = {entry.place for entry in ENTRIES} | {name for cache in CACHES.values() for name in cache}
    missing = []
    for place in sorted(places):
        owner, name = located(place)
        named = {field.name for field in fields(owner)} if is_dataclass(owner) else set()
        missing += [place] if name not in vars(owner).keys() | named else []
    assert places
    assert not missing
    assert {workload for entry in ENTRIES for workload in entry.workloads} <= WORKLOADS.keys()


def test_programs_find_all_that_they_import() -> None:
    names = sorted({path.stem for path in (CHECKOUT / "benchmarks").glob("*.py")} - SCRIPTS)
    imports = "".join(f"import benchmarks.{name}\n" for name in names)
    # The bpy module can hang while the interpreter winds up.
    program = f"import os, bpy\n{imports}os._exit(0)"
    subprocess.run([sys.executable, "-c", program], cwd=CHECKOUT, check=True, timeout=120)
