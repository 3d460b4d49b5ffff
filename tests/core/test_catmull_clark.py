# SPDX-License-Identifier: GPL-3.0-or-later
"""Subdivision and limit positions without Blender: provenance, invariants, and the limit as a limit."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh, polygon_mesh
from ccdepth_addon.core.mesh.submesh import corners_of_faces, submesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule, crease_to_sharpness, has_semi_sharp
from tests import meshes, nets

# Faces without area have no normals.
MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    **{name: data for name, data in meshes.AWKWARD.items() if "collapsed" not in name},
    "torus": lambda: meshes.torus(7, 5),
    "trapezohedron": lambda: meshes.trapezohedron(7),
    "bipyramid": lambda: meshes.sphere(5, 2),
    "dart": lambda: meshes.creased(meshes.fan(5, 3), {(0, 1): 1.0}),
}

# Some dozens of additions and multiplications of numbers below 20, each rounded to 2⁻⁵³ of them.
ROUNDING = 1e-13

# Semi-sharp features last ten levels at most; after them a step leaves no more than 0.6546 of the distance to the
# limit (the largest second eigenvalue of any rule), and 0.6546⁴⁰ < 1e-7.
MANY_LEVELS = 50
NEARLY_THERE = 1e-6


def build(name: str, *, smooth_corners: bool = True) -> PolygonMesh:
    return meshes.build(MESHES[name](), smooth_corners=smooth_corners)


every_mesh = pytest.mark.parametrize("name", MESHES)


@pytest.mark.parametrize("smooth_corners", [True, False])
@every_mesh
def test_boundary_rule_is_idempotent(name: str, smooth_corners: bool) -> None:
    once = build(name, smooth_corners=smooth_corners)
    for again in (True, False):
        twice = apply_boundary_rule(once, smooth_corners=again)
        np.testing.assert_array_equal(twice.edge_sharpness, once.edge_sharpness)
        np.testing.assert_array_equal(twice.vertex_sharpness, once.vertex_sharpness)
    assert apply_boundary_rule(nets.refined(once, 1), smooth_corners=False).sharpness_is_explicit


def test_crease_becomes_sharpness_in_single_precision() -> None:
    sharpness = crease_to_sharpness(np.array([0.0, 0.3, 0.5, 1.0]))
    np.testing.assert_allclose(sharpness, [0.0, 0.9, 2.5, np.inf], rtol=1e-6)
    np.testing.assert_array_equal(sharpness, sharpness.astype(np.float32))


@pytest.mark.parametrize("steps", [1, 2])
def test_whole_sharpness_is_infinite_for_so_many_steps(steps: int) -> None:
    mesh = build("cube")
    edges, vertices = mesh.edge_sharpness.copy(), mesh.vertex_sharpness.copy()
    edges[[0, 1, 4, 7]], vertices[[2, 5]] = steps, steps
    semi = replace(mesh, edge_sharpness=edges, vertex_sharpness=vertices)
    sharp_edges, sharp_vertices = (np.where(each > 0, np.inf, 0.0) for each in (edges, vertices))
    sharp = replace(mesh, edge_sharpness=sharp_edges, vertex_sharpness=sharp_vertices)
    np.testing.assert_allclose(
        nets.refined(semi, steps).positions, nets.refined(sharp, steps).positions, rtol=0, atol=ROUNDING
    )
    assert not has_semi_sharp(nets.refined(semi, steps)).any()


@every_mesh
def test_vertices_go_to_their_limits(name: str) -> None:
    mesh = build(name)
    np.testing.assert_allclose(after_many_levels(mesh), limit_positions(mesh), rtol=0, atol=NEARLY_THERE)


def after_many_levels(mesh: PolygonMesh) -> np.ndarray:
    """Where the vertices of the mesh are ``MANY_LEVELS`` down, refining only the faces around them and their ring."""
    vertices = np.flatnonzero(mesh.vertex_face_counts)
    positions = mesh.positions.copy()
    at = vertices
    for _ in range(MANY_LEVELS):
        wanted = np.zeros(mesh.vertex_count, dtype=bool)
        wanted[at] = True
        part, kept = submesh(mesh, np.unique(mesh.corner_faces[wanted[mesh.corner_vertices]]))
        new_number = np.zeros(mesh.vertex_count, dtype=np.intp)
        new_number[mesh.corner_vertices[corners_of_faces(mesh, kept)]] = part.corner_vertices
        at = new_number[at]
        mesh = subdivide(part)
    positions[vertices] = mesh.positions[at]
    return positions


@pytest.mark.parametrize("vertex", [-1, 4, 2**40])
def test_vertices_that_are_not_there_are_refused(vertex: int) -> None:
    """numpy would take -1 for the last one."""
    with pytest.raises(IndexError, match=f"corner 2 stands at vertex {vertex}, and there are 4"):
        polygon_mesh(np.eye(4, 3), np.array([4]), np.array([0, 1, vertex, 3]))
