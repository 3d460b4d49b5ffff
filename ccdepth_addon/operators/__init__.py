# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators, one file each, and the common code of long runs."""

from importlib import import_module
from pkgutil import iter_modules

import bpy

from ..state import watch
from . import mesh_operators
from .update_result import start_keeping_updated


def _operators() -> list[type]:
    """The operators in the files of this package."""
    modules = [import_module(f".{each.name}", __package__) for each in iter_modules(__path__)]
    return [each for module in modules for name, each in vars(module).items() if name.startswith("CCDEPTH_OT_")]


def register() -> None:
    for operator in _operators():
        bpy.utils.register_class(operator)
    watch.after_examination.append(start_keeping_updated)


def unregister() -> None:
    watch.after_examination.remove(start_keeping_updated)
    mesh_operators.stop_all()
    for operator in _operators():
        bpy.utils.unregister_class(operator)
