# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounding: of Blender's single precision, and of the double precision in which bounds are computed."""

from __future__ import annotations

import numpy as np

from ..mesh.polygon_mesh import PolygonMesh


def largest_coordinate(mesh: PolygonMesh) -> float:
    """The largest absolute coordinate of a vertex that has a face."""
    has_faces = mesh.vertex_face_counts > 0
    used = mesh.positions if np.all(has_faces) else mesh.positions[has_faces]
    return max(float(used.max(initial=0.0)), -float(used.min(initial=0.0)))


def largest_valence(mesh: PolygonMesh) -> int:
    """The largest number of faces at a vertex, or of corners of a face."""
    return max(int(mesh.vertex_face_counts.max(initial=0)), int(mesh.face_sizes.max(initial=0)))


def modifier_rounding(mesh: PolygonMesh, level: int) -> float:
    """The error of a level's vertices in Blender's own single precision, in the unit of the positions.

    (2n + 4k)uR, with n the largest valence or face size, k the level, u = 2⁻²⁴ and R the largest coordinate: at least
    one and a half times the errors measured up to valence 128 (docs/methods.md, Single precision).
    """
    return (2 * largest_valence(mesh) + 4 * level) * 2.0**-24 * largest_coordinate(mesh)


def smallest_step(mesh: PolygonMesh) -> float:
    """Four steps of single precision at the largest coordinate: coordinates show nothing finer."""
    return 2.0**-22 * largest_coordinate(mesh)


def smallest_tolerance(mesh: PolygonMesh) -> float:
    """The least tolerance for which a depth can be promised: the single-precision error at level 1."""
    return modifier_rounding(mesh, 1)


def rounding_allowance(mesh: PolygonMesh) -> float:
    """The most that double-precision rounding can take off a bound, in the unit of the positions.

    A sum of s terms with non-negative weights that sum to 1 is off by at most (s + 2)uR, u = 2⁻⁵³ and R the largest
    coordinate; s is at most twice the largest valence or face size, plus one, and 9 on a regular patch. A hundred
    levels of such sums and a last difference of three points with its norm stay below 128(2s + 8)uR, some 10⁻⁶ of
    ``smallest_step``. What it covers in tessellations: docs/adaptive.md, Rounding.
    """
    terms = 2 * max(largest_valence(mesh), 4) + 1
    return 128 * (2 * terms + 8) * 2.0**-53 * largest_coordinate(mesh)
