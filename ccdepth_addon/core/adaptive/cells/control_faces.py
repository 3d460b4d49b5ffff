# SPDX-License-Identifier: GPL-3.0-or-later
"""The faces of a control mesh as cells (``leaf_approximation.Cells``), each with the most precise representation of its
surface: a bicubic patch, a net around an extraordinary vertex, or the refined mesh.
"""

from __future__ import annotations

from collections.abc import Iterator

from ...arrays.chunks import index_chunks
from ...mesh.polygon_mesh import PolygonMesh
from ...surface.patches import classify_patches
from ...surface.refinement import Refinement
from ...surface.stencils import by_valence, by_valences
from ..leaf_approximation import Cells
from .irregular_cells import RefinedCells
from .patch_cells import CELLS_AT_ONCE, LEAST_OF_A_KIND, BicubicCells, ExtraordinaryCells
from .polygon_cells import PolygonCells, TriangleCells


def cells_of_faces(mesh: PolygonMesh) -> Iterator[Cells]:
    """The faces of a control mesh, whose sharpness is explicit, as cells: node f is face f."""
    kinds = classify_patches(mesh)
    regular, extraordinary, rest = by_valence(mesh, kinds, mesh.face_count)
    for faces in index_chunks(regular, CELLS_AT_ONCE):
        yield BicubicCells.of_faces(mesh, faces, faces)
    for valence, of_valence in extraordinary:
        for faces in index_chunks(of_valence, CELLS_AT_ONCE):
            corners = kinds.extraordinary_corners[faces]
            yield ExtraordinaryCells.of_faces(mesh, (valence, 4, 4, 4), corners, faces)
    inside, rest = by_valences(mesh, kinds, rest, LEAST_OF_A_KIND)
    for valences, first_corners in inside:
        for corners in index_chunks(first_corners, CELLS_AT_ONCE):
            yield ExtraordinaryCells.of_faces(mesh, valences, corners, mesh.corner_faces[corners])
    sizes = mesh.face_sizes[rest]
    for kind, of_kind in ((RefinedCells, sizes == 4), (TriangleCells, sizes == 3), (PolygonCells, sizes > 4)):
        for faces in index_chunks(rest[of_kind], CELLS_AT_ONCE):
            yield kind(faces, Refinement.start(mesh, faces))
