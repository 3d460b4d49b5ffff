# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: ``blender -b --command ccdepth [FILE…]``."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from argparse import Namespace
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, redirect_stdout, suppress
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

import bpy

from ..exchange.blender_calls import COMMAND, CommandError, own_options, own_process, scripts_as_started
from ..exchange.mesh_files import refuse_place
from ..exchange.whole_files import UnwrittenError, written_whole
from ..tasks.surfaces import ComputeError
from ..ui.lengths import printable, printable_lines
from .arguments import STANDARD_OUTPUT, Parser, action_of
from .measured_export import measure_export
from .one_file import process_file
from .processes import process_files
from .report import FileEntry, Report, csv_text, json_text, losses, stamp
from .report_page import page
from .report_reading import ReportError, gathered_reports
from .verification import verify

PROGRAM = f"blender -b --command {COMMAND}"

EXIT_FAILURE = 1

# Why a file cannot be done, so that the others still can.
FAULTS = (CommandError, ComputeError, OSError)

# Bytes of names that are not UTF-8 are escaped; JSON has the same escapes.
NOT_UNICODE = "backslashreplace"

_handle: Any = None

# The signal that ends the run, if one has come.
_received: int | None = None


def run(arguments: Sequence[str], program: str = PROGRAM, process: Sequence[str] | None = None) -> int:
    """Run a command line; returns the exit status. Errors go to the standard error.

    process: the line that runs command lines in another process, for ``--jobs``; by default this Blender.
    """
    parser = Parser(program)
    try:
        options = parser.parsed(arguments)
    except SystemExit as finished:
        return int(finished.code or 0)
    try:
        with _interruptible(), scripts_as_started(), _standard_output(options) as standard_output:
            is_good = _execute(options, program, arguments, process, standard_output)
            sys.stdout.flush()
            standard_output.flush()
    except KeyboardInterrupt:
        _tell(program, "interrupted; files that are there are whole")
        # The status that a shell gives to a program ended by the signal.
        return 128 + (_received or signal.SIGINT)
    except (*FAULTS, ReportError) as fault:
        # Printing may be the fault.
        with suppress(OSError):
            sys.stdout.flush()
        _tell(program, str(fault))
        return EXIT_FAILURE
    return 0 if is_good else EXIT_FAILURE


def _execute(
    options: Namespace,
    program: str,
    arguments: Sequence[str],
    process: Sequence[str] | None,
    standard_output: TextIO,
) -> bool:
    """Do everything requested; returns whether all is done and every tolerance met."""
    if options.verify is not None:
        return verify(options.verify)
    if options.written is not None:
        measure_export(options.written)
        return True
    if options.one is not None:
        number, path = options.one
        [(_, entry)] = _one_after_the_other([(int(number), options.files[int(number)])], options, names=True)
        text = json_text(Report(action_of(options), (entry,)), None, with_pictures=True)
        Path(path).write_text(text, encoding="utf-8", errors=NOT_UNICODE)
        return True
    for path in (options.json, options.csv, options.html):
        if path not in (None, STANDARD_OUTPUT):
            refuse_place(Path(path), options.overwrite)
    if options.gather is not None:
        report = gathered_reports(options.gather)
        for entry in report.files:
            _tell_progress(program, entry, 1, 1)
    else:
        report = _done(options, program, arguments, process)
    _write_reports(report, options, standard_output)
    return report.is_good


def _done(options: Namespace, program: str, arguments: Sequence[str], process: Sequence[str] | None) -> Report:
    """Do all files; returns their entries."""
    if options.output_folder is not None:
        _make_folder(options.output_folder)
    sources: list[Path | None] = options.files or [None]
    if options.jobs is not None and options.files:
        ended = process_files(process or own_process(*own_options()), options, arguments)
    else:
        ended = _one_after_the_other(enumerate(sources), options, names=len(sources) > 1)
    entries: dict[int, FileEntry] = {}
    with closing(ended):
        for number, entry in ended:
            entries[number] = entry
            _tell_progress(program, entry, len(entries), len(sources))
    return Report(action_of(options), tuple(entries[number] for number in sorted(entries)))


def _make_folder(path: Path) -> None:
    """Make the folder if missing. Raises CommandError."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise CommandError(f"{path}: the folder cannot be made: {fault.strerror}") from fault


def _one_after_the_other(
    sources: Iterable[tuple[int, Path | None]], options: Namespace, names: bool
) -> Generator[tuple[int, FileEntry]]:
    """Do each file: yields its number and its entry. names: whether to print its name before."""
    for number, source in sources:
        if names:
            print(f"{printable(str(source))}:", flush=True)
        try:
            entry = process_file(source, options)
            # Flushed before the line about the finished file; a failure to print is reported at the end.
            with suppress(OSError):
                sys.stdout.flush()
        except FAULTS as fault:
            entry = _failed(source, str(fault))
        except Exception as fault:
            # A mistake of ours must not keep the other files from being done.
            traceback.print_exc()
            entry = _failed(source, f"{type(fault).__name__}: {fault}")
        if _received is not None:
            # Blender turns an exception within an operator into a report.
            raise KeyboardInterrupt
        yield number, entry


def _failed(source: Path | None, error: str) -> FileEntry:
    return FileEntry(None if source is None else stamp(source, None), error=error)


def _tell_progress(program: str, entry: FileEntry, done: int, count: int) -> None:
    """Report the parts of a file that were left out or lost, its outcome, and the number of files left; for a single
    file only its faults."""
    for text in losses(entry):
        _tell(program, f"{entry.name}: {text}")
    if count == 1 and entry.is_good:
        return
    state = entry.error or ("done" if entry.is_good else "done, and not within the tolerance")
    text = state if state.startswith(entry.name) else f"{entry.name}: {state}"
    if count > 1:
        text = f"{done:,} of {count:,} files done, {count - done:,} left: {text}"
    _tell(program, text)


def _tell(program: str, text: str) -> None:
    print(f"{program}: {printable_lines(text)}", file=sys.stderr, flush=True)


def _write_reports(report: Report, options: Namespace, standard_output: TextIO) -> None:
    for name, text_in in (
        (options.json, lambda folder: json_text(report, folder, options.pictures)),
        (options.csv, lambda _folder: csv_text(report)),
        (options.html, lambda _folder: page(report)),
    ):
        if name == STANDARD_OUTPUT:
            standard_output.write(text_in(None))
        elif name is not None:
            path = Path(name)
            try:
                with written_whole(path, overwrite=options.overwrite) as beside:
                    text = text_in(path.absolute().parent)
                    beside.write_text(text, encoding="utf-8", errors=NOT_UNICODE)
            except UnwrittenError as fault:
                raise CommandError(f"{path}: {fault}") from fault


@contextmanager
def _standard_output(options: Namespace) -> Iterator[TextIO]:
    """The standard output. With a report there, everything else goes to the standard error from then on, including
    Blender's own last lines."""
    if options.one is not None or STANDARD_OUTPUT not in (options.json, options.csv, options.html):
        yield sys.stdout
        return
    sys.stdout.flush()
    with os.fdopen(os.dup(1), "w", encoding="utf-8", errors=NOT_UNICODE, newline="\n") as kept:
        os.dup2(2, 1)
        with redirect_stdout(sys.stderr):
            yield kept


@contextmanager
def _interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt at SIGINT or SIGTERM, which would end Blender at once or not at all; a second signal ends
    Blender. Writing to a process or a terminal that has gone, or more than a file may hold, is an error, and does not
    end Blender."""
    global _received
    _received = None
    handlers: dict[signal.Signals, Callable[[int, FrameType | None], None] | signal.Handlers] = {
        signal.SIGINT: _interrupt,
        signal.SIGTERM: _interrupt,
    }
    if hasattr(signal, "SIGPIPE"):
        handlers |= {signal.SIGPIPE: signal.SIG_IGN, signal.SIGXFSZ: signal.SIG_IGN}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            # None stands for a handler not set from Python.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


def _interrupt(number: int, _frame: FrameType | None) -> None:
    global _received
    _received = number
    signal.signal(number, signal.SIG_DFL)
    raise KeyboardInterrupt


def register() -> None:
    global _handle
    _handle = bpy.utils.register_cli_command(COMMAND, run)


def unregister() -> None:
    global _handle
    bpy.utils.unregister_cli_command(_handle)
    _handle = None
