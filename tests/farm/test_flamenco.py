# SPDX-License-Identifier: GPL-3.0-or-later
"""The job type for Flamenco: compiled by node, and its commands really run."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.farm.files import FARM, OPTIONS, blender, report_of_one_command, write_files
from tests.thorough import each

SCRIPT = FARM / "flamenco" / "ccdepth.js"
RUNNER = FARM / "openjd" / "run_files.py"

# What Flamenco knows of settings and commands.
TYPES = {"string", "int32"}
SUBTYPES = {None, "file_path", "dir_path"}

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="there is no node")


def compiled(**settings: object) -> dict[str, Any]:
    """The job type and the tasks of a job."""
    program = Path(__file__).with_name("flamenco_job.js")
    given = json.dumps(settings, default=str)
    ended = subprocess.run(["node", program, SCRIPT, given], capture_output=True, text=True, timeout=60, check=True)
    content: dict[str, Any] = json.loads(ended.stdout)
    return content


def test_a_thousand_files_become_forty_tasks_and_one_that_gathers() -> None:
    job = compiled(file_list="/l/files.txt", files="1-1000", report_folder="/r", script="/s/run_files.py")
    for setting in job["jobType"]["settings"]:
        assert setting["type"] in TYPES
        assert setting.get("subtype") in SUBTYPES
        assert setting.get("required") or "default" in setting
    *tasks, last = job["tasks"]
    assert [task["name"] for task in tasks] == [f"files-{first}-{first + 24}" for first in range(1, 1001, 25)]
    assert not any(task["dependencies"] for task in tasks)
    assert last["dependencies"] == [task["name"] for task in tasks]
    assert {command["name"] for task in job["tasks"] for command in task["commands"]} == {"exec"}


@pytest.mark.parametrize("broken", each([None, 2], short=[2]))
def test_the_commands_make_the_report_of_one_command(tmp_path: Path, broken: int | None) -> None:
    files, program, reports = write_files(tmp_path / "files", 3, broken), blender(tmp_path), tmp_path / "reports"
    settings = {"file_list": files, "files": "1-3", "chunk_size": 2, "options": OPTIONS, "report_folder": reports}
    job = compiled(**settings, script=RUNNER, python=sys.executable)
    statuses = []
    for task in job["tasks"]:
        [command] = task["commands"]
        words = [command["parameters"]["exe"], *command["parameters"]["args"]]
        line = [word.replace("{blender}", str(program)) for word in words]
        statuses.append(subprocess.run(line, timeout=300, capture_output=True, check=False).returncode)
    assert statuses == [0, 0, 0 if broken is None else 1]
    assert (reports / "report.json").read_bytes() == report_of_one_command(program, files, reports / "one.json")
