# SPDX-License-Identifier: GPL-3.0-or-later
"""The tolerance test, the only comparison of bounds with the tolerance, and its results by face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.rounding import rounding_allowance
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.touching_faces import least_of_touching
from ..tolerance.variation import Variation

# The factor between tolerances of faces that are proved together: a tenth of the tolerance is lost in the mean.
STEP = 2**0.25


@dataclass(frozen=True)
class ToleranceTest:
    """A tolerance, and the allowance for rounding; both in the unit of the positions. is_common: whether it is the
    tolerance of all faces of the mesh."""

    tolerance: float
    allowance: float
    is_common: bool = True

    def within(self, upper: FloatArray) -> BoolArray:
        """Whether distances of at most ``upper`` are proved to be within the tolerance."""
        return upper + self.allowance <= self.tolerance

    def exceeds(self, lower: FloatArray) -> BoolArray:
        """Whether distances of at least ``lower`` are proved to exceed the tolerance."""
        return lower - self.allowance > self.tolerance


def tolerance_groups(
    mesh: PolygonMesh,
    faces: IndexArray,
    tolerance: float,
    variation: Variation | None,
    *,
    with_faces_around: bool,
) -> list[tuple[IndexArray, ToleranceTest]]:
    """Some faces of a mesh in groups, each with a test of one tolerance: the least over all faces of the group, which
    differ by less than ``STEP``. with_faces_around: whether the faces that share a vertex with a face count as well
    (docs/tolerance.md, Depths)."""
    allowance = rounding_allowance(mesh)
    if variation is None:
        return [(faces, ToleranceTest(tolerance, allowance))]
    own = variation.of_faces(mesh, tolerance)
    own = (least_of_touching(mesh, own) if with_faces_around else own)[faces]
    steps = np.floor(np.log(own) / np.log(STEP))
    alike = [np.flatnonzero(steps == step) for step in np.unique(steps)]
    is_common = len(alike) == 1 and len(faces) == mesh.face_count
    return [(faces[some], ToleranceTest(float(own[some].min()), allowance, is_common)) for some in alike]


@dataclass(frozen=True)
class FaceDepths(Table):
    """Faces of the mesh and their depths: (P,) each; distances are in the unit of the positions.

    faces: intp. depths: int32, -1 while undecided. bounds: float64, the proved distance at that depth. distances:
    float64, a distance reached there (0 for methods that compute none). exact: bool, whether every lesser depth is
    disproved. lasting: bool, whether the face is proved to be within the tolerance at every later level, too. alone:
    bool, whether each of its leaves at that depth that has no feet is proved both ways, whatever is beside it.
    might_need_less: bool, whether more effort might prove a lesser depth.
    """

    faces: IndexArray
    depths: NDArray[np.int32]
    bounds: FloatArray
    distances: FloatArray
    exact: BoolArray
    lasting: BoolArray
    alone: BoolArray
    might_need_less: BoolArray

    @staticmethod
    def undecided(faces: IndexArray) -> FaceDepths:
        """The faces before anything is known."""
        count = len(faces)
        return FaceDepths(
            faces=faces,
            depths=np.full(count, -1, dtype=np.int32),
            bounds=np.zeros(count),
            distances=np.zeros(count),
            exact=np.ones(count, dtype=bool),
            lasting=np.zeros(count, dtype=bool),
            alone=np.zeros(count, dtype=bool),
            might_need_less=np.zeros(count, dtype=bool),
        )

    def settle(self, chosen: BoolArray, depth: int, bounds: FloatArray, distances: FloatArray | None = None) -> None:
        """Set the depth of the chosen faces; of the arrays (P,) only their entries are used.

        Without distances no lesser depth is disproved.
        """
        self.depths[chosen] = depth
        self.bounds[chosen] = bounds[chosen]
        if distances is None:
            self.exact[chosen] = False
        else:
            self.distances[chosen] = distances[chosen]

    def update(self, part: FaceDepths) -> None:
        """Copy the results of some faces into these results, which must be for faces 0, 1, 2, …"""
        for name, column in vars(part).items():
            vars(self)[name][part.faces] = column


@dataclass(frozen=True)
class LevelBounds:
    """The bounds of P faces of the mesh, each at a level of its own: (P,) each. bounds: the proved distances, inf where
    none is within the tolerance. lasting, alone: as of ``FaceDepths``.
    """

    faces: IndexArray
    bounds: FloatArray
    lasting: BoolArray | bool = False
    alone: BoolArray | bool = False

    @property
    def all_within(self) -> bool:
        """Whether all of its faces are proved to be within the tolerance."""
        return bool(np.all(np.isfinite(self.bounds)))
