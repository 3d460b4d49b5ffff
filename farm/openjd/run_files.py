# SPDX-License-Identifier: GPL-3.0-or-later
"""Do some of the files of a list with CC Depth, and write the report of them: one task of a farm's job.

    python3 run_files.py LIST NUMBERS REPORTS [--blender PROGRAM] [--options OPTIONS]

LIST: a text file with the path of a file in each line, absolute or relative to its folder; Blender is started there.
NUMBERS: the lines, like 26-50; the first is 1. REPORTS: the folder for the report, made if missing. OPTIONS: options of
CC Depth's command line as one text, quoted as in a shell.

Exit status 0 says that the report was written, with all failures; gathering the reports names them. So one broken file
neither stops the others nor is tried again and again.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from pathlib import Path


def main() -> int:
    """The exit status of the task."""
    arguments = _arguments()
    try:
        first, _, last = arguments.numbers.partition("-")
        numbers = range(int(first), int(last or first) + 1)
        files = _lines(arguments.list, numbers)
        given = shlex.split(arguments.options)
    except (OSError, ValueError) as fault:
        raise SystemExit(f"run_files.py: {fault}") from fault
    # Names in the order of the numbers, as reports are gathered in that of their names.
    report = arguments.reports.absolute() / f"{numbers[0]:08}-{numbers[-1]:08}.json"
    report.parent.mkdir(parents=True, exist_ok=True)
    report.unlink(missing_ok=True)
    # Another Blender does the files, so that a crash is only a failure in the report.
    options = [*given, "--jobs", "1", "--json", str(report), "--", *files]
    command = [arguments.blender, "-b", "--command", "ccdepth", *options]
    status = subprocess.run(command, cwd=arguments.list.absolute().parent, check=False).returncode
    if not report.is_file():
        print(f"Blender ended with status {status} and wrote no report", file=sys.stderr)
        return 1
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("list", type=Path, metavar="LIST")
    parser.add_argument("numbers", metavar="NUMBERS")
    parser.add_argument("reports", type=Path, metavar="REPORTS")
    parser.add_argument("--blender", default="blender", metavar="PROGRAM")
    parser.add_argument("--options", default="", metavar="OPTIONS")
    return parser.parse_args()


def _lines(path: Path, numbers: range) -> list[str]:
    """Lines of a text file by their numbers. Raises SystemExit for missing lines."""
    # Some editors write a mark before UTF-8.
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    if numbers.start < 1 or numbers.stop > len(lines) + 1 or not numbers:
        raise SystemExit(f"{path} has {len(lines)} lines, not {numbers.start} to {numbers.stop - 1}")
    return [lines[number - 1] for number in numbers]


if __name__ == "__main__":
    sys.exit(main())
