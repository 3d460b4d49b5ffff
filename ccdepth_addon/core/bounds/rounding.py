# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounding: of Blender's single precision, and of the double precision in which bounds are computed."""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray
from ..mesh.polygon_mesh import PolygonMesh


def largest_coordinates(mesh: PolygonMesh) -> FloatArray:
    """(3,) float64: the largest absolute coordinate along each axis, of vertices with faces."""
    has_faces = mesh.vertex_face_counts > 0
    used = mesh.positions if np.all(has_faces) else mesh.positions[has_faces]
    # Axis by axis numpy takes a tenth of the time.
    return np.array([max(along.max(initial=0.0), -along.min(initial=0.0)) for along in used.T])


def rounded_size(mesh: PolygonMesh) -> float:
    """R, the reference length of all rounding of positions, in their unit: the length of ``largest_coordinates``, or
    ``PolygonMesh.rounded_size`` if that is longer.

    Blender rounds positions P in object space, each coordinate by a part u of the largest one along its axis, m. With
    the linear part W of the object's matrix that is ‖W δ‖ ≤ u‖|W| m‖, however short W P is.
    """
    return max(float(np.linalg.norm(largest_coordinates(mesh))), mesh.rounded_size)


def largest_valence(mesh: PolygonMesh) -> int:
    """The largest number of faces at a vertex, or of corners of a face."""
    return max(int(mesh.vertex_face_counts.max(initial=0)), int(mesh.face_sizes.max(initial=0)))


def modifier_rounding(mesh: PolygonMesh, level: int) -> float:
    """The error of a level's vertices in Blender's own single precision, in the unit of the positions.

    (3s/2 + 2k - 8)uR, with s = ``PolygonMesh.largest_surroundings``, 12 on a regular mesh, k the level, u = 2⁻²⁴ and R
    the ``rounded_size``: at least one and a half times all errors measured (docs/methods.md, Single precision).
    """
    return (1.5 * mesh.largest_surroundings + 2 * level - 8) * 2.0**-24 * rounded_size(mesh)


def smallest_step(mesh: PolygonMesh) -> float:
    """The smallest distance that coordinates can show: four single-precision steps of the ``rounded_size``."""
    return 2.0**-22 * rounded_size(mesh)


def smallest_tolerance(mesh: PolygonMesh) -> float:
    """The least tolerance for which a depth can be promised: the single-precision error at level 1."""
    return modifier_rounding(mesh, 1)


def rounding_allowance(mesh: PolygonMesh) -> float:
    """The largest amount by which double-precision rounding can lower a bound, in the unit of the positions.

    A sum of s terms with non-negative weights that sum to 1 is off by at most (s + 2)uR, u = 2⁻⁵³ and R the
    ``rounded_size``; s is at most twice the largest valence or face size, plus one, and 9 on a regular patch. A hundred
    levels of such sums and a last difference of three points with its norm stay below 128(2s + 8)uR, about 10⁻⁶ of
    ``smallest_step``. For tessellations see docs/adaptive.md, Rounding.
    """
    terms = 2 * max(largest_valence(mesh), 4) + 1
    return 128 * (2 * terms + 8) * 2.0**-53 * rounded_size(mesh)
