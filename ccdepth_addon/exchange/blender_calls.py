# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls of Blender's operators with reports as exceptions, and temporary data that are removed."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy


class CommandError(Exception):
    """The error of a request that cannot be met; the message says why."""


def call(operator: Any, **properties: Any) -> None:
    """Call an operator. Raises CommandError with its error reports."""
    try:
        result = operator(**properties)
    except RuntimeError as fault:
        raise CommandError(_report_in(str(fault), operator.idname_py())) from fault
    if "FINISHED" not in result:
        raise CommandError(f"{operator.idname_py()} did not finish")


def _report_in(message: str, name: str) -> str:
    """The report of an operator of this name; the exception of an operator in Python that went wrong."""
    text = re.sub(r"^Error: ", "", message, flags=re.MULTILINE).strip()
    if "Traceback (most recent call last)" not in text:
        return text
    raised = [line for line in text.splitlines() if line and not line.startswith((" ", "Location:"))]
    return f"{name} went wrong: {raised[-1]}"


def available(name: str) -> Any | None:
    """The operator with a name like ``wm.obj_import``; None if this Blender does not have it."""
    module, _, function = name.partition(".")
    operator = getattr(getattr(bpy.ops, module), function)
    try:
        operator.get_rna_type()
    except (KeyError, AttributeError):
        return None
    return operator


def known_options(operator: Any, options: dict[str, Any]) -> dict[str, Any]:
    """The options that the operator has in this Blender."""
    properties = operator.get_rna_type().properties
    return {name: value for name, value in options.items() if name in properties}


@contextmanager
def temporary_data(*kinds: str) -> Iterator[None]:
    """Remove all data of some kinds, like ``meshes``, that are made inside this context."""
    before = {kind: set(getattr(bpy.data, kind)) for kind in kinds}
    try:
        yield
    finally:
        bpy.data.batch_remove([item for kind in kinds for item in set(getattr(bpy.data, kind)) - before[kind]])


# The name of our command.
COMMAND = "ccdepth"


def own_process(*options: str) -> list[str]:
    """The line that runs our command in another process of this Blender, with these options of Blender's. Raises
    CommandError if this Blender is no program."""
    if not bpy.app.binary_path:
        raise CommandError("another Blender is needed, and this one is no program")
    return [bpy.app.binary_path, *options, "--command", COMMAND]


def own_options() -> list[str]:
    """The options that this Blender was started with before our command."""
    options = sys.argv[1:]
    end = next((index for index, option in enumerate(options) if option in ENDS), 0)
    return options[:end] or ["-b"]


def end_of(process: subprocess.Popen[bytes], log: Path) -> str:
    """The end of another process, in words, with the last line that it printed to a log."""
    lines = log.read_text(encoding="utf-8", errors="replace").split("\n")
    last = next((line.strip() for line in reversed(lines) if line.strip()), "it printed nothing")
    return f"Blender ended with status {process.returncode}: {last}"


# Blender's options before the arguments of other programs, and its options that switch scripts on and off.
ENDS = ("-c", "--command", "--")
ON, OFF = ("-y", "--enable-autoexec"), ("-Y", "--disable-autoexec")


def scripts_allowed() -> bool:
    """Whether Blender was started with ``-y``. The last of ``-y`` and ``-Y`` holds; without either, scripts are off."""
    allowed = False
    # Blender as a module has the arguments of another program.
    for option in sys.argv[1:] if bpy.app.binary_path else ():
        if option in ENDS:
            break
        allowed = option in ON or (allowed and option not in OFF)
    return allowed


@contextmanager
def scripts_as_started() -> Iterator[None]:
    """Run scripts of files as `scripts_allowed` says, independent of the preferences.

    Blender follows the preference again whenever it opens its startup file or appends, so the choice of a single load
    does not last.
    """
    paths = bpy.context.preferences.filepaths
    before = paths.use_scripts_auto_execute
    paths.use_scripts_auto_execute = scripts_allowed()
    try:
        yield
    finally:
        paths.use_scripts_auto_execute = before
