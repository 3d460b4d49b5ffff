# SPDX-License-Identifier: GPL-3.0-or-later
"""Subdivision and limit positions without Blender: provenance, invariants, and the limit as a limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.mesh.submesh import corners_of_faces, faces_alone, submesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.sharpness import (
    VertexRule,
    apply_boundary_rule,
    crease_to_sharpness,
    has_semi_sharp,
    vertex_rules,
)
from tests import meshes

# Faces without area have no normals.
MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    **{name: data for name, data in meshes.AWKWARD.items() if "collapsed" not in name},
    "torus": lambda: meshes.torus(7, 5),
    "trapezohedron": lambda: meshes.trapezohedron(7),
    "bipyramid": lambda: meshes.bipyramid(5),
    "dart": lambda: meshes.creased(meshes.fan(5, 3), {(0, 1): 1.0}),
}

# Some dozens of additions and multiplications of numbers below 20, each rounded to 2⁻⁵³ of them.
ROUNDING = 1e-13

# Semi-sharp features last ten levels at most; after them a step leaves no more than 0.6546 of the distance to the
# limit (the largest second eigenvalue of any rule), and 0.6546⁴⁰ < 1e-7.
MANY_LEVELS = 50
NEARLY_THERE = 1e-6


def build(name: str, *, smooth_corners: bool = True) -> PolygonMesh:
    return apply_boundary_rule(meshes.to_polygon_mesh(MESHES[name]()), smooth_corners=smooth_corners)


def refined(mesh: PolygonMesh, levels: int) -> PolygonMesh:
    for _ in range(levels):
        mesh = subdivide(mesh).mesh
    return mesh


every_mesh = pytest.mark.parametrize("name", MESHES)


# Topology and provenance


@every_mesh
def test_children_and_their_edges_follow_their_parents(name: str) -> None:
    mesh = build(name)
    step = subdivide(mesh)
    child = step.mesh
    np.testing.assert_array_equal(step.parent_faces, mesh.corner_faces)
    quads = child.corner_vertices.reshape(-1, 4)
    np.testing.assert_array_equal(quads[:, 0], mesh.corner_vertices)
    np.testing.assert_array_equal(quads[:, 1], mesh.vertex_count + mesh.corner_edges)
    np.testing.assert_array_equal(quads[:, 2], mesh.vertex_count + mesh.edge_count + mesh.corner_faces)
    np.testing.assert_array_equal(quads[:, 3], mesh.vertex_count + mesh.corner_edges[mesh.previous_corner])
    halves, inner = slice(0, 2 * mesh.edge_count), slice(2 * mesh.edge_count, None)
    np.testing.assert_array_equal(child.edge_face_counts[halves], np.repeat(mesh.edge_face_counts, 2))
    np.testing.assert_array_equal(child.edge_face_counts[inner], 2)
    # Halves inherit sharpness less one.
    np.testing.assert_array_equal(child.edge_sharpness[halves], np.repeat(np.maximum(mesh.edge_sharpness - 1, 0), 2))
    np.testing.assert_array_equal(child.edge_sharpness[inner], 0)
    np.testing.assert_array_equal(child.vertex_sharpness[mesh.vertex_count :], 0)
    for _ in range(2):
        ends = np.stack([child.corner_vertices, child.corner_vertices[child.next_corner]], axis=1)
        np.testing.assert_array_equal(np.sort(child.edge_vertices[child.corner_edges]), np.sort(ends))
        assert len(np.unique(np.sort(child.edge_vertices), axis=0)) == child.edge_count
        child = subdivide(child).mesh


def test_edges_and_vertices_without_faces_change_nothing() -> None:
    mesh = meshes.to_polygon_mesh(meshes.landscape(4, 4))
    far = np.array([[9.0, 0.0, 0.0], [9.0, 1.0, 0.0], [9.0, 2.0, 0.0]])
    count = mesh.vertex_count
    with_loose = replace(
        mesh,
        positions=np.concatenate([mesh.positions, far]),
        edge_vertices=np.concatenate([mesh.edge_vertices, [[count, count + 1]]]),
        edge_sharpness=np.append(mesh.edge_sharpness, 2.0),
        vertex_sharpness=np.append(mesh.vertex_sharpness, [0.0, 0.0, 0.0]),
    )
    expected = refined(apply_boundary_rule(mesh, smooth_corners=False), 2)
    found = refined(apply_boundary_rule(with_loose, smooth_corners=False), 2)
    at_corners = found.positions[found.corner_vertices]
    np.testing.assert_array_equal(at_corners, expected.positions[expected.corner_vertices])
    assert np.isfinite(found.positions).all()


# The boundary rule


@pytest.mark.parametrize("smooth_corners", [True, False])
@every_mesh
def test_boundary_rule_is_idempotent(name: str, smooth_corners: bool) -> None:
    once = build(name, smooth_corners=smooth_corners)
    for again in (True, False):
        twice = apply_boundary_rule(once, smooth_corners=again)
        np.testing.assert_array_equal(twice.edge_sharpness, once.edge_sharpness)
        np.testing.assert_array_equal(twice.vertex_sharpness, once.vertex_sharpness)
    assert apply_boundary_rule(refined(once, 1), smooth_corners=False).sharpness_is_explicit


def test_corners_of_a_quad_stay_only_where_kept() -> None:
    mesh = meshes.to_polygon_mesh(meshes.grid(1, 1))
    kept = apply_boundary_rule(mesh, smooth_corners=False)
    smoothed = apply_boundary_rule(mesh, smooth_corners=True)
    assert (vertex_rules(kept) == VertexRule.CORNER).all()
    assert (vertex_rules(smoothed) == VertexRule.CREASE).all()
    np.testing.assert_array_equal(refined(kept, 3).positions[:4], mesh.positions)
    np.testing.assert_allclose(subdivide(smoothed).mesh.positions[0], [0.125, 0.125, 0.0])


def test_rules_follow_from_the_number_of_sharp_edges() -> None:
    data = meshes.creased(meshes.cube(), {(0, 1): 1.0, (1, 3): 0.5, (1, 5): 0.2}, {6: 0.3})
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True)
    dart, corner, smooth = VertexRule.DART, VertexRule.CORNER, VertexRule.SMOOTH
    np.testing.assert_array_equal(vertex_rules(mesh), [dart, corner, smooth, dart, smooth, dart, corner, smooth])
    np.testing.assert_array_equal(has_semi_sharp(mesh), [False, True, False, True, False, True, True, False])


def test_crease_becomes_sharpness_in_single_precision() -> None:
    sharpness = crease_to_sharpness(np.array([0.0, 0.3, 0.5, 1.0]))
    np.testing.assert_allclose(sharpness, [0.0, 0.9, 2.5, np.inf], rtol=1e-6)
    np.testing.assert_array_equal(sharpness, sharpness.astype(np.float32))


def test_non_manifold_features_are_infinitely_sharp() -> None:
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(meshes.fin_through()), smooth_corners=True)
    rules = vertex_rules(mesh)
    # The line where the fin stands: inside it a crease, at its ends, on the boundary, corners.
    np.testing.assert_array_equal(rules[10:15], [VertexRule.CORNER, *[VertexRule.CREASE] * 3, VertexRule.CORNER])
    touching = apply_boundary_rule(meshes.to_polygon_mesh(meshes.bow_tie_inside()), smooth_corners=True)
    assert np.isinf(touching.vertex_sharpness[4])


@pytest.mark.parametrize("steps", [1, 2])
def test_whole_sharpness_is_infinite_for_so_many_steps(steps: int) -> None:
    mesh = build("cube")
    edges, vertices = mesh.edge_sharpness.copy(), mesh.vertex_sharpness.copy()
    edges[[0, 1, 4, 7]], vertices[[2, 5]] = steps, steps
    semi = replace(mesh, edge_sharpness=edges, vertex_sharpness=vertices)
    sharp_edges, sharp_vertices = (np.where(each > 0, np.inf, 0.0) for each in (edges, vertices))
    sharp = replace(mesh, edge_sharpness=sharp_edges, vertex_sharpness=sharp_vertices)
    np.testing.assert_allclose(refined(semi, steps).positions, refined(sharp, steps).positions, rtol=0, atol=ROUNDING)
    assert not has_semi_sharp(refined(semi, steps)).any()


# The limit


@every_mesh
def test_limit_positions_stay_the_same_from_level_to_level(name: str) -> None:
    mesh = build(name, smooth_corners=False)
    limits = limit_positions(mesh)
    for _ in range(3):
        mesh = subdivide(mesh).mesh
        np.testing.assert_allclose(limit_positions(mesh)[: len(limits)], limits, rtol=0, atol=ROUNDING)


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
        mesh = subdivide(part).mesh
    positions[vertices] = mesh.positions[at]
    return positions


# Parts of meshes


@every_mesh
def test_a_part_refines_like_the_whole(name: str) -> None:
    """The children of the given faces, and those around them, are where and what they are in the whole mesh."""
    mesh = build(name)
    generator = np.random.default_rng(2)
    faces = generator.permutation(mesh.face_count)[: max(1, mesh.face_count // 4)]
    part, kept = submesh(mesh, faces)
    np.testing.assert_array_equal(kept[: len(faces)], faces)
    whole_step, part_step = subdivide(mesh), subdivide(part)
    # The face of the whole mesh's step that each face of the part's step is.
    same_child = corners_of_faces(mesh, kept)
    children = np.flatnonzero(part_step.parent_faces < len(faces))
    _, ring = submesh(part_step.mesh, children)
    _, ring_in_whole = submesh(whole_step.mesh, same_child[children])
    np.testing.assert_array_equal(np.sort(same_child[ring]), np.sort(ring_in_whole))

    for of_part, of_whole, rows in (
        (part_step.mesh.positions, whole_step.mesh.positions, (ring, same_child[ring])),
        (limit_positions(part_step.mesh), limit_positions(whole_step.mesh), (children, same_child[children])),
        (vertex_rules(part_step.mesh), vertex_rules(whole_step.mesh), (children, same_child[children])),
    ):
        at_part = of_part[part_step.mesh.corner_vertices.reshape(-1, 4)[rows[0]]]
        at_whole = of_whole[whole_step.mesh.corner_vertices.reshape(-1, 4)[rows[1]]]
        # Equal rules; points are sums of the same products in another order.
        np.testing.assert_allclose(at_part, at_whole, rtol=0, atol=1e-14)


@every_mesh
def test_the_faces_around_vertices_are_enough_for_their_points(name: str) -> None:
    mesh = build(name)
    chosen = np.zeros(mesh.vertex_count, dtype=bool)
    chosen[mesh.corner_vertices[:: max(1, mesh.corner_count // 7)]] = True
    faces = np.unique(mesh.corner_faces[chosen[mesh.corner_vertices]])
    part = faces_alone(mesh, faces)
    same_vertex = np.zeros(part.vertex_count, dtype=np.intp)
    same_vertex[part.corner_vertices] = mesh.corner_vertices[corners_of_faces(mesh, faces)]
    own = chosen[same_vertex]
    assert np.count_nonzero(own) == np.count_nonzero(chosen)
    of_part, of_whole = subdivide(part).mesh, subdivide(mesh).mesh
    np.testing.assert_array_equal(of_part.positions[: len(own)][own], of_whole.positions[same_vertex[own]])
    np.testing.assert_array_equal(limit_positions(part)[own], limit_positions(mesh)[same_vertex[own]])
    np.testing.assert_array_equal(limit_positions(mesh, chosen)[chosen], limit_positions(mesh)[chosen])


def test_part_of_no_faces_is_empty() -> None:
    part, kept = submesh(build("cube"), np.array([], dtype=np.intp))
    assert part.face_count == part.vertex_count == part.edge_count == len(kept) == 0
