# SPDX-License-Identifier: GPL-3.0-or-later
"""Faults planted one at a time in copies of a checkout, to see whether the tests catch them.

``python -m tests.planted.plant --answers now.json`` plants every fault of ``faults.toml`` that has no answer yet, runs
the tests that should catch it, and where these pass the whole suite. The exit status is 1 where one is not caught, or
its line has gone. A copy is of the files that git knows, as they are in the checkout.
"""

import argparse
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
PYTEST = (".venv/bin/python", "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider")
WHOLE = "-n 2 --maxprocesses 2 --ignore tests/window"

# Seconds that the first files may take, and how many times that the whole suite may.
FIRST_LIMIT, TIMES_AS_LONG = 1800.0, 4.0
# What pytest returns: all passed; it could not run, by its own fault or its command line's; there were no tests.
PASSED, CANNOT_RUN, NOTHING_TO_RUN = 0, (3, 4), 5

Answer = dict[str, Any] | None


class UntriedError(Exception):
    """A fault cannot be tried; the message says why."""


@dataclass(frozen=True)
class Fault:
    """A change of one place in a file; or a function of the add-on, and what stands for it and gets it with its
    arguments. tests: the files to run first, or tests of them, the most likely one first."""

    name: str
    tests: list[str]
    file: str = ""
    old: str = ""
    new: str = ""
    function: str = ""
    wrong: str = ""

    def plant(self, copy: Path) -> None:
        """Write the fault into a copy. Raises UntriedError."""
        if self.function:
            self._replace(copy)
            return
        path = copy / self.file
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        if text.count(self.old) != 1:
            raise UntriedError(f"the fault's line has gone: {self.name}")
        path.write_text(text.replace(self.old, self.new), encoding="utf-8")

    def _replace(self, copy: Path) -> None:
        package, module, name = self.function.split(".", 2)
        path = copy / "ccdepth_addon" / package / f"{module}.py"
        if not path.is_file() or f"def {name.rpartition('.')[2]}(" not in path.read_text(encoding="utf-8"):
            raise UntriedError(f"the fault's function has gone: {self.name}")
        with path.open("a", encoding="utf-8") as file:
            file.write(f"\n\n_right, _wrong = {name}, {self.wrong}\n")
            file.write(f"{name} = lambda *given, **named: _wrong(_right, *given, **named)\n")


def copy_of(checkout: Path, folder: Path) -> Path:
    """A copy of the files of a checkout that git knows, with the same virtual environment."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=checkout, capture_output=True, check=True, text=True).stdout
    # pytest takes it for a package of that name, as it has an __init__.py: a module's name would hide the module.
    copy = folder / "planted_checkout"
    for name in filter(None, listed.split("\0")):
        source, target = checkout / name, copy / name
        # Git still lists what was removed since the last commit.
        if source.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
    (copy / ".venv").symlink_to((checkout / ".venv").resolve())
    return copy


# Runs of pytest that have not ended.
_running: set[subprocess.Popen[str]] = set()


def failing(copy: Path, arguments: Sequence[str], seconds: float) -> str | None:
    """The first test that fails, ``hang`` where it takes longer than that, and None where all pass."""
    # Nothing of the original's may be imported, and nothing is left behind.
    environment = {**os.environ, "PYTHONPATH": "", "TMPDIR": str(copy.parent)}
    process = subprocess.Popen(
        [*PYTEST, *arguments], cwd=copy, env=environment, text=True, errors="replace", start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    _running.add(process)
    try:
        output, _ = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        return "hang"
    finally:
        # Its own processes go with it.
        _end(process)
        _running.discard(process)
    if process.returncode in CANNOT_RUN:
        raise UntriedError(f"pytest cannot run: {output[-1000:]}")
    if process.returncode in (PASSED, NOTHING_TO_RUN):
        return None
    found = re.search(r"^(?:FAILED|ERROR) (tests/\S+(?: \S+)*?)(?: - .*)?$", output, re.MULTILINE)
    return found[1] if found else f"status {process.returncode}"


def _end(process: subprocess.Popen[str]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def tried(fault: Fault, options: argparse.Namespace) -> dict[str, Any]:
    """What became of a fault. Raises UntriedError."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="planted_", ignore_cleanup_errors=True) as folder:
        copy = copy_of(options.checkout, Path(folder))
        if not options.unplanted:
            fault.plant(copy)
        first = [name for name in fault.tests if (copy / name.partition("::")[0]).is_file()]
        stage, by = "first", failing(copy, ["-n", "0", *first], options.limit) if first else None
        if by is None and not options.first_only:
            stage, by = "whole", failing(copy, shlex.split(options.whole), TIMES_AS_LONG * options.limit)
    return {"caught": by is not None, "by": by, "stage": stage, "seconds": round(time.monotonic() - began, 1)}


def try_all(faults: list[Fault], options: argparse.Namespace, answers: dict[str, Answer]) -> None:
    """Try the faults that have no answer, and write the answers after every one."""
    # Where a line had gone, or the first files alone were run, there is no answer yet.
    final = "first whole" if options.first_only else "whole"
    answered = {name for name, answer in answers.items() if answer and (answer["caught"] or answer["stage"] in final)}
    left = [fault for fault in faults if fault.name not in answered]
    pool = ThreadPoolExecutor(options.jobs)
    try:
        running = {pool.submit(tried, fault, options): fault for fault in left}
        for done, ended in enumerate(as_completed(running), start=1):
            name = running[ended].name
            try:
                answer = answers[name] = ended.result()
                text = f"{name}: {answer['stage']}: {answer['by'] or 'NOT CAUGHT'} ({answer['seconds']} s)"
            except UntriedError as fault:
                answers[name], text = None, str(fault)
            print(f"{done} of {len(left)}: {text}", flush=True)
            if options.answers:
                beside = options.answers.with_name(f"{options.answers.name}.new")
                beside.write_text(json.dumps(answers, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
                beside.replace(options.answers)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in list(_running):
            _end(process)


def main() -> int:
    """Run the command line; the exit status is 1 where a fault is not caught."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkout", type=Path, default=HERE.parents[2], help="the tree whose copy is used")
    parser.add_argument("--only", metavar="SUBSTRING", default="", help="faults whose name or file has this in it")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="how many copies are worked on side by side")
    parser.add_argument("--answers", type=Path, metavar="FILE", help="what became of each; faults in it are skipped")
    parser.add_argument("--first-only", action="store_true", help="leave out the whole suite for those that survive")
    parser.add_argument("--whole", default=WHOLE, metavar="ARGS", help=f"pytest's arguments for it ({WHOLE})")
    parser.add_argument("--limit", type=float, default=FIRST_LIMIT, metavar="SECONDS", help="of a run of first files")
    parser.add_argument("--unplanted", action="store_true", help="run the same without the faults: all has to pass")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    text = HERE.with_name("faults.toml").read_text(encoding="utf-8")
    listed = [Fault(**each) for each in tomllib.loads(text)["fault"]]
    faults = [each for each in listed if any(options.only in text for text in (each.name, each.file, each.function))]
    is_known = options.answers is not None and options.answers.is_file()
    answers = json.loads(options.answers.read_text(encoding="utf-8")) if is_known else {}
    try_all(faults, options, answers)
    found = [answers.get(fault.name) for fault in faults]
    return 0 if all(answer and answer["caught"] for answer in found) else 1


if __name__ == "__main__":
    sys.exit(main())
