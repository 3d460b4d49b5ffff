# SPDX-License-Identifier: GPL-3.0-or-later
"""How many faces the adaptive meshes of objects would have, as counted last, until the objects change.

Counts last for this session and are not in the file: counting changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..registration import add_handlers, remove_handlers
from ..tasks.adaptive_task import AdaptiveSettings, FaceCount
from . import sources


@dataclass(frozen=True)
class _KnownCount:
    settings: AdaptiveSettings
    count: FaceCount


# By the session identifier of the object.
_known: dict[int, _KnownCount] = {}


def remember(objects: Iterable[bpy.types.Object], settings: AdaptiveSettings, count: FaceCount) -> None:
    """Keep the count of these objects until they change."""
    for blender_object in objects:
        _known[blender_object.session_uid] = _KnownCount(settings, count)


def known_count(blender_object: bpy.types.Object, settings: AdaptiveSettings) -> FaceCount | None:
    """The count of the object with these settings, if it is known."""
    known = _known.get(blender_object.session_uid)
    return known.count if known is not None and known.settings == settings else None


@persistent
def _forget_changed(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if not _known:
        return
    for update in depsgraph.updates:
        if update.is_updated_geometry or update.is_updated_transform:
            uid = update.id.original.session_uid
            for changed in (uid, *sources.uids_of_results(uid)):
                _known.pop(changed, None)


@persistent
def _forget_everything(*_: Any) -> None:
    _known.clear()


HANDLERS = (
    ("depsgraph_update_post", _forget_changed),
    ("frame_change_post", _forget_changed),
    ("undo_post", _forget_everything),
    ("redo_post", _forget_everything),
    ("load_pre", _forget_everything),
)


def register() -> None:
    add_handlers(HANDLERS)


def unregister() -> None:
    remove_handlers(HANDLERS)
    _forget_everything()
