# SPDX-License-Identifier: GPL-3.0-or-later
"""`scripts/supervise_tests.py`: what hangs is ended and named, what fails fails, and the rest of a run goes on."""

import subprocess
import sys
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
TESTS = """
import os, time
def test_that_passes(): pass
def test_that_fails(): assert False
def test_that_hangs(): time.sleep(120)
def test_that_crashes(): os.kill(os.getpid(), 11)
"""
# A hook of the folder: Blender as a module can hang when the process winds up.
HANGS_AT_EXIT = "import atexit, time\natexit.register(time.sleep, 120)\n"
# In seconds. Other processes of pytest take several to start, and to end, on a busy machine, and say nothing meanwhile.
SHORT_LIMITS = "import scripts.supervise_tests as s; s.TEST_SECONDS, s.EXIT_SECONDS = 12.0, {}; "


def supervised(folder: Path, *options: str, exit_hangs: bool = False) -> subprocess.CompletedProcess[str]:
    """Output and status of a supervised run of the four tests above, with short limits."""
    (folder / "test_four.py").write_text(TESTS)
    (folder / "conftest.py").write_text(HANGS_AT_EXIT if exit_hangs else "")
    command = [sys.executable, "-m", "pytest", "-p", "tests.progress", "-p", "no:cacheprovider", "-q", *options]
    limits = SHORT_LIMITS.format(3.0 if exit_hangs else 60.0)
    call = f"{limits}raise SystemExit(s.supervise({[*command, str(folder)]!r}))"
    return subprocess.run([sys.executable, "-c", call], cwd=CHECKOUT, capture_output=True, text=True, timeout=100)


def test_a_process_that_hangs_at_its_end_is_ended_and_its_tests_have_passed(tmp_path: Path) -> None:
    run = supervised(tmp_path, "-n", "0", "-k", "passes", exit_hangs=True)
    assert (run.returncode, "ENDED: nothing was heard for" in run.stdout) == (0, True), run.stdout + run.stderr


def test_what_ends_its_process_is_named(tmp_path: Path) -> None:
    run = supervised(tmp_path, "-n", "0", "-k", "crashes")
    assert (run.returncode, "test_four.py::test_that_crashes" in run.stdout) == (139, True), run.stdout + run.stderr


def test_the_other_processes_go_on_when_a_test_hangs(tmp_path: Path) -> None:
    run = supervised(tmp_path, "-n", "2", "-k", "passes or fails or hangs")
    assert run.returncode == 1
    assert "ENDED after" in run.stdout
    assert "2 failed, 1 passed" in run.stdout
    assert "crashed while running" in run.stdout
