# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls of Blender's operators with reports as exceptions, and temporary data that are removed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
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
