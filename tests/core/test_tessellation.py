# SPDX-License-Identifier: GPL-3.0-or-later
"""Polygons drawn from a quadtree whose triangles would meet along one edge too often."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.leaf_approximation import LeafApproximation
from ccdepth_addon.core.adaptive.quadtree import Quadtree
from ccdepth_addon.core.adaptive.templates import Transitions
from ccdepth_addon.core.adaptive.tessellation import TessellationPlan, plan_tessellation
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh, polygon_mesh
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def two_faces(second: list[int]) -> PolygonMesh:
    """Two quads over the same four vertices."""
    mesh = polygon_mesh(np.array(SQUARE), np.array([4, 4]), np.array([0, 1, 2, 3, *second]))
    return apply_boundary_rule(mesh, smooth_corners=True)


def drawn_folded(mesh: PolygonMesh, alternatives: list[int]) -> TessellationPlan:
    """Every face as two triangles, along the diagonals of the alternatives."""
    tree = Quadtree(mesh)
    approximation = LeafApproximation.none(mesh.face_count)
    approximation.folded[:] = True
    approximation.alternatives[:] = alternatives
    return plan_tessellation(tree, tree.leaves(), approximation, Transitions.TRIANGLES)


@pytest.mark.parametrize(
    ("second", "alternatives", "clashing"),
    [
        ([3, 2, 1, 0], [0, 0], []),
        ([3, 2, 1, 0], [0, 1], [0, 1]),
        ([3, 2, 1, 0], [1, 0], [0, 1]),
        ([2, 1, 0, 3], [0, 0], [0, 1]),
        ([2, 1, 0, 3], [0, 1], []),
    ],
)
def test_faces_do_not_share_a_diagonal(second: list[int], alternatives: list[int], clashing: list[int]) -> None:
    plan = drawn_folded(two_faces(second), alternatives)
    assert plan.clashes.tolist() == clashing
    assert len(plan.drawn) == 4


def test_a_diagonal_is_not_where_a_loose_edge_is() -> None:
    """Of two edges with the same ends Blender would take one away."""
    mesh = polygon_mesh(np.array(SQUARE), np.array([4]), np.arange(4))
    loose = mesh.changed(
        edge_vertices=np.concatenate([mesh.edge_vertices, [[0, 2]]]), edge_sharpness=np.append(mesh.edge_sharpness, 0.0)
    )
    loose = apply_boundary_rule(loose, smooth_corners=True)
    assert drawn_folded(loose, [0]).clashes.tolist() == [0]
    assert drawn_folded(loose, [1]).clashes.tolist() == []
