# SPDX-License-Identifier: GPL-3.0-or-later
"""What the page of a report shows of an object beside its numbers: pictures, faces by depth, and levels by method."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MethodLevel:
    """What a method says: the deepest depth of a face, the first level at which all faces are within the tolerance, and
    how many faces there are at that level."""

    method: str
    deepest: int
    level: int
    faces: int


@dataclass(frozen=True)
class Levels:
    """What is proved of an object's control mesh. method: the one that was chosen. faces_by_depth: by it, the depths
    that faces have and how many have them, from the least depth on. by_method: what each of the methods says."""

    method: str
    faces_by_depth: tuple[tuple[int, int], ...]
    by_method: tuple[MethodLevel, ...]


@dataclass(frozen=True)
class Illustration:
    """What is shown of an object. heat_map, wireframe: WebP files, or PNG files from a Blender
    that cannot write those."""

    levels: Levels
    heat_map: bytes
    wireframe: bytes
