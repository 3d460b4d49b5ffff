# SPDX-License-Identifier: GPL-3.0-or-later
"""How many faces the adaptive meshes of objects would have, as counted last, until the objects change.

Counts last for this session and are not in the file: counting changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import bpy

from ..tasks.adaptive_meshes import FaceCount
from ..tasks.adaptive_task import AdaptiveSettings
from . import sources, watch

# By the session identifiers of the objects that were counted together: a mesh that several of them get counts once.
_known: dict[frozenset[int], tuple[AdaptiveSettings, FaceCount]] = {}


def remember(groups: Sequence[Sequence[str]], settings: AdaptiveSettings, counts: Sequence[FaceCount]) -> None:
    """Keep the count of each result, and that of all together, until the objects change.

    groups: the names of the objects that get each result. Where there are too many faces, any count is that of all.
    """
    together = counts[0]
    if together.fitting is None:
        together = FaceCount(sum(count.faces for count in counts), None)
        for names, count in zip(groups, counts, strict=True):
            _known[_uids(bpy.data.objects[name] for name in names)] = settings, count
    _known[_uids(bpy.data.objects[name] for names in groups for name in names)] = settings, together


def known_count(objects: Iterable[bpy.types.Object], settings: AdaptiveSettings) -> FaceCount | None:
    """The count of all these objects together with these settings, if it is known."""
    counted_with, count = _known.get(_uids(objects), (None, None))
    return count if counted_with == settings else None


def _uids(objects: Iterable[bpy.types.Object]) -> frozenset[int]:
    return frozenset(each.session_uid for each in objects)


def _forget_changed(changed: bpy.types.Object, _geometry: bool) -> bool:
    uids = {changed.session_uid, *sources.uids_of_results(changed.session_uid)} if _known else set()
    for counted in [counted for counted in _known if counted & uids]:
        del _known[counted]
    return False


watch.clients.append(watch.Client(forget=_known.clear, updated=_forget_changed, replaced=_known.clear))
