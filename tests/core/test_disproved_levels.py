# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces of which no lesser depth is enough: a point of the surface is too far from the whole mesh at every lesser
level, by distances to all of its triangles."""

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import BoolArray, FloatArray, IndexArray
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from ccdepth_addon.core.bounds.rounding import rounding_allowance
from ccdepth_addon.core.depth.disproved_levels import MOST_FACES, DisprovedLevels
from ccdepth_addon.core.depth.face_depths import face_depths
from ccdepth_addon.core.depth.tolerance import ToleranceTest
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.limit_positions import limit_positions
from tests import meshes, nets
from tests.core.test_distance_depth import MESHES, ROUNDING, case, cases_of
from tests.drawn_levels import refined
from tests.triangle_distances import distances


def drawn(mesh: PolygonMesh, level: int, vertices: Vertices) -> tuple[FloatArray, IndexArray]:
    """The triangles of a level; at level 0 of all polygons fans from all of their corners."""
    if level == 0:
        corners = np.split(mesh.corner_vertices, mesh.face_starts[1:-1])
        fans = [np.roll(own, -turn) for own in corners for turn in range(len(own) if len(own) != 4 else 1)]
        triangles = [[fan[0], fan[i], fan[i + 1]] for fan in fans for i in range(1, len(fan) - 1)]
        return mesh.positions, np.array(triangles)
    return refined(mesh, level).drawn(vertices)[:2]


def far_faces(mesh: PolygonMesh, level: int, vertices: Vertices, tolerance: float) -> BoolArray:
    """(F,): faces with a point of the surface, two levels later, farther from the whole mesh at a level."""
    fine, limit = refined(mesh, level + 2), tolerance * (1 - ROUNDING)
    is_far = distances(limit_positions(fine.mesh), *drawn(mesh, level, vertices), limit) > limit
    found = np.zeros(mesh.face_count, dtype=bool)
    found[np.repeat(fine.owners, 4)[is_far[fine.mesh.corner_vertices]]] = True
    return found


@pytest.mark.parametrize(("name", "vertices", "seed", "levels"), cases_of(MESHES, 1))
def test_no_level_is_disproved_that_is_near_enough(name: str, vertices: Vertices, seed: int, levels: int) -> None:
    """At tolerances from about the largest to about the least distances of faces."""
    mesh, diagonal = case(name, seed)
    every = np.arange(mesh.face_count)
    for level in range(levels + 1):
        for share in (0.05, 0.01):
            tolerance = share * 0.4**level * diagonal
            found = disproved(mesh, vertices, tolerance, level, every)
            assert not np.any(found & ~far_faces(mesh, level, vertices, tolerance))


def disproved(mesh: PolygonMesh, vertices: Vertices, tolerance: float, level: int, faces: IndexArray) -> BoolArray:
    test = ToleranceTest(tolerance, rounding_allowance(mesh))
    return DisprovedLevels.of(mesh, vertices, test, lambda: None).all_before(level + 1, faces, lambda: None)


@pytest.mark.parametrize("vertices", Vertices)
@pytest.mark.parametrize("level", [0, pytest.param(1, marks=pytest.mark.thorough)])
def test_another_sheet_of_the_mesh_near_the_surface_is_not_overlooked(level: int, vertices: Vertices) -> None:
    """Every face is far from its own triangles; near its surface lies a fine copy of this, part of the same mesh."""
    data = meshes.landscape(5, 4, 2)
    coarse = meshes.build(data)
    fine = nets.refined(coarse, 3)
    tolerance = 0.01 / 2**level
    every = np.arange(coarse.face_count)
    assert np.count_nonzero(disproved(coarse, vertices, tolerance, level, every)) > 0.8 * len(every)
    faces = [*data.faces, *(fine.corner_vertices.reshape(-1, 4) + coarse.vertex_count).tolist()]
    both = meshes.from_faces(np.concatenate([coarse.positions, limit_positions(fine)]), faces)
    doubled = meshes.build(both)
    found = disproved(doubled, vertices, tolerance, level, every)
    assert not np.any(found & ~far_faces(doubled, level, vertices, tolerance)[every])
    assert np.count_nonzero(found) < 0.2 * len(every)


@pytest.mark.parametrize("vertices", Vertices)
def test_most_depths_of_smooth_meshes_are_seen_to_be_the_least(vertices: Vertices) -> None:
    """Of those that samples of the surface can tell: nearly all."""
    for name in ("torus", "bevelled prism", "cube"):
        mesh, diagonal = case(name, 9)
        found = face_depths(mesh, 2e-3 * diagonal, "DISTANCE", vertices.value)
        levels = range(min(found.depths.max(), 3))
        far = [far_faces(mesh, level, vertices, 2e-3 * diagonal) | (found.depths <= level) for level in levels]
        far = np.logical_and.reduce(far)
        known = found.depths <= 3
        assert not np.any(found.exact & known & ~far)
        assert np.count_nonzero(found.exact & known) >= 0.9 * np.count_nonzero(far & known)


@pytest.mark.parametrize("vertices", Vertices)
@pytest.mark.parametrize("height", [1.0, 0.01])
def test_quads_drawn_along_their_other_diagonal_are_compared_as_drawn(height: float, vertices: Vertices) -> None:
    """Where the object is flat, many quads are folded in its own space."""
    mesh, diagonal = case("torus", 3)
    turned = mesh.changed(axes=np.diag([1.0, 1.0, height]))
    every = np.arange(mesh.face_count)
    for tolerance in np.geomspace(2e-4, 2e-2, 4) * diagonal:
        found = disproved(turned, vertices, tolerance, 1, every)
        assert not np.any(found & ~far_faces(turned, 1, vertices, tolerance))


@pytest.mark.parametrize("vertices", Vertices)
def test_middles_of_regular_faces_are_no_nearer_than_said(vertices: Vertices) -> None:
    """On a mesh so large that nothing else is looked at; there most far faces are found."""
    mesh = meshes.build(meshes.torus(54, 20))
    found = disproved(mesh, vertices, 6e-4, 1, np.arange(mesh.face_count))
    far = far_faces(mesh, 1, vertices, 6e-4)
    assert not np.any(found & ~far)
    assert np.count_nonzero(far) > MOST_FACES
    assert np.count_nonzero(found) > 0.9 * np.count_nonzero(far)
