# SPDX-License-Identifier: GPL-3.0-or-later
"""The templates for farms, checked and really run."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.farm.files import FARM, OPTIONS, blender, report_of_one_command, write_files
from tests.thorough import each

TEMPLATE = FARM / "openjd" / "template.yaml"
OPENJD = [sys.executable, "-m", "openjd"]


def run(files: Path, program: Path, numbers: str, reports: Path, *more: str) -> subprocess.CompletedProcess[str]:
    parameters = {"FileList": files, "Numbers": numbers, "FilesPerTask": 2, "Options": OPTIONS}
    parameters |= {"ReportFolder": reports, "Blender": program, "Python": sys.executable}
    given = [argument for name, value in parameters.items() for argument in ("-p", f"{name}={value}")]
    command = [*OPENJD, "run", str(TEMPLATE), *given, *more]
    return subprocess.run(command, timeout=300, capture_output=True, text=True, encoding="utf-8", check=False)


@pytest.fixture(scope="module")
def report_of_one(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int | None], bytes]:
    """Makes the report of three files by one command, once; the one of this number is broken."""

    @cache
    def made(broken: int | None) -> bytes:
        folder = tmp_path_factory.mktemp("one")
        (folder / "reports").mkdir()
        files = write_files(folder / "files", 3, broken)
        return report_of_one_command(blender(folder), files, folder / "reports" / "one.json")

    return made


@pytest.mark.parametrize("broken", each([None, 1], short=[1]))
def test_a_job_makes_the_report_of_one_command(
    tmp_path: Path, broken: int | None, report_of_one: Callable[[int | None], bytes]
) -> None:
    """Up to two files in a task. One that is broken is in the report, and makes the job fail after all others.

    The list is as other editors write it, with a mark before UTF-8, and other ends of lines.
    """
    files, program, reports = write_files(tmp_path / "files", 3, broken), blender(tmp_path), tmp_path / "reports"
    names = files.read_text(encoding="utf-8")
    files.write_text(names, encoding="utf-8-sig", newline="\r\n")
    ended = run(files, program, "1-3", reports)
    assert (ended.returncode == 0) == (broken is None), ended.stdout
    assert sorted(path.stem for path in (reports / "tasks").iterdir()) == ["00000001-00000002", "00000003-00000003"]
    made = {path.stem for path in (tmp_path / "made").iterdir()}
    assert made == {f"part {number:03}" for number in range(3) if number != broken}
    content = json.loads((reports / "report.json").read_text(encoding="utf-8"))
    failed = [file["input"]["path"] for file in content["files"] if file["error"] is not None]
    assert failed == ([] if broken is None else [f"../files/part {broken:03}.obj"])
    assert content["met"] == (broken is None)
    if broken is not None:
        assert f"part {broken:03}.obj: " in ended.stdout[ended.stdout.index("Running step 'Report'") :]
    assert (reports / "report.json").read_bytes() == report_of_one(broken)
    assert len((reports / "report.csv").read_text(encoding="utf-8").splitlines()) == 4
    assert "<h1>CC Depth Report</h1>" in (reports / "report.html").read_text(encoding="utf-8")


def test_a_task_without_a_report_fails(tmp_path: Path) -> None:
    files = write_files(tmp_path / "files", 2)
    assert run(files, Path("/bin/false"), "1-2", tmp_path / "reports").returncode != 0
    ended = run(files, blender(tmp_path), "2-3", tmp_path / "reports")
    assert ended.returncode != 0
    assert "files.txt has 2 lines, not 2 to 3" in ended.stdout


# Flamenco, its job type compiled by node and its commands really run


SCRIPT = FARM / "flamenco" / "ccdepth.js"
RUNNER = FARM / "openjd" / "run_files.py"

# What Flamenco knows of settings and commands.
TYPES = {"string", "int32"}
SUBTYPES = {None, "file_path", "dir_path"}


def compiled(**settings: object) -> dict[str, Any]:
    """The job type and the tasks of a job."""
    program = Path(__file__).with_name("flamenco_job.js")
    given = json.dumps(settings, default=str)
    ended = subprocess.run(["node", program, SCRIPT, given], capture_output=True, text=True, timeout=60, check=True)
    content: dict[str, Any] = json.loads(ended.stdout)
    return content


@pytest.mark.skipif(shutil.which("node") is None, reason="there is no node")
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


@pytest.mark.skipif(shutil.which("node") is None, reason="there is no node")
@pytest.mark.parametrize("broken", each([None, 1], short=[1]))
def test_the_commands_make_the_report_of_one_command(
    tmp_path: Path, broken: int | None, report_of_one: Callable[[int | None], bytes]
) -> None:
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
    assert (reports / "report.json").read_bytes() == report_of_one(broken)
