# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the pictures of a report that was read, from the files that it names, where these have not changed."""

from __future__ import annotations

from dataclasses import replace

from .blender_calls import CommandError
from .illustrating import illustrations
from .one_file import ACTIONS, settings_of
from .picture import PictureError
from .report import FileEntry
from .verification import other_file, reopened


def drawn(action: str, entry: FileEntry) -> FileEntry:
    """The entry with pictures of its objects, which are done once more for it, or with the reason why it has none."""
    if entry.error is not None:
        return entry
    for fault in other_file(entry.source):
        return replace(entry, undrawn=fault)
    try:
        objects = reopened(action, entry)
        shown = [each.shown for each in ACTIONS[action](objects, settings_of(action))]
        return replace(entry, illustrations=illustrations(shown))
    except (CommandError, PictureError, OSError, ValueError) as fault:
        return replace(entry, undrawn=str(fault))
