# SPDX-License-Identifier: GPL-3.0-or-later
"""How many faces the adaptive meshes of objects would have, as counted last, until the objects change.

Counts last for this session and are not in the file: counting changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy

from ..tasks.adaptive_meshes import FaceCount
from ..tasks.adaptive_task import AdaptiveSettings
from . import sources, watch


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


def _forget_changed(changed: bpy.types.Object, _geometry: bool) -> bool:
    for uid in (changed.session_uid, *sources.uids_of_results(changed.session_uid)) if _known else ():
        _known.pop(uid, None)
    return False


watch.clients.append(watch.Client(forget=_known.clear, updated=_forget_changed, replaced=_known.clear))
