# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles of the control mesh as they are drawn, against the surface itself at sampled places."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.cells.polygon_cells import HALVINGS, TriangleCells, fan_of_template
from ccdepth_addon.core.adaptive.leaf_bounds.fan_bounds import QuarterNets
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import Template, Transitions, triangle_template
from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.evaluation import limit_values
from ccdepth_addon.core.surface.refinement import Refinement
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from ccdepth_addon.core.surface.surface_points import SurfacePoints
from tests import meshes

pytestmark = pytest.mark.thorough

MESHES = {
    "bipyramid": lambda: meshes.bumpy(meshes.bipyramid(6), 0.1),
    "tetrahedron": meshes.tetrahedron,
    "creases": lambda: meshes.with_random_creases(meshes.triangles_and_quads(), seed=4, share=0.4),
}

PATTERNS = range(7)
STEPS = 12

# Corners and middles of the sides of a triangle, in a plane of its own.
FLAT = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.5, 0.5], [0.0, 0.5]])
CENTROID = FLAT[:3].mean(axis=0)

# No result has so many.
MOST_FACES = 1_000_000

# Rounding of some hundred products of values around 1.
ROUNDING = 1e-12


def template_of(pattern: int) -> Template:
    return triangle_template(pattern) if pattern else ((0, 1, 2),)


def sampled(mesh: PolygonMesh, face: int) -> tuple[FloatArray, FloatArray]:
    """(N, 3) points of the surface over a face, and (N, 2) where each belongs on the flat triangle."""
    steps = np.linspace(0, 1, STEPS + 1)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    corners = mesh.face_starts[face] + np.repeat(np.arange(3), len(grid))
    surface = limit_values(mesh, mesh.positions, SurfacePoints(corners, np.tile(grid, (3, 1))))
    u, v = grid.T[:, :, None]
    places = []
    for corner in range(3):
        after, before = FLAT[3 + corner], FLAT[3 + (corner + 2) % 3]
        quarter = (1 - v) * ((1 - u) * FLAT[corner] + u * after) + v * ((1 - u) * before + u * CENTROID)
        places.append(quarter)
    return surface, np.concatenate(places)


def distance(template: Template, surface: FloatArray, places: FloatArray, points: FloatArray) -> float:
    """The largest."""
    largest, seen = 0.0, np.zeros(len(places), dtype=bool)
    for triangle in template:
        a, b, c = FLAT[list(triangle)]
        weights = np.linalg.solve(np.stack([b - a, c - a], axis=1), (places - a).T)
        weights = np.stack([1 - weights.sum(axis=0), *weights], axis=1)
        inside = np.all(weights >= -ROUNDING, axis=1)
        seen |= inside
        gaps = surface[inside] - weights[inside] @ points[list(triangle)]
        largest = max(largest, float(np.linalg.norm(gaps, axis=1).max()))
    assert np.all(seen)
    return largest


@pytest.mark.parametrize("name", MESHES)
def test_no_triangle_is_farther_than_its_bound(name: str) -> None:
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(MESHES[name]()), smooth_corners=True)
    faces = np.flatnonzero(mesh.face_sizes == 3)[:4]
    cells = TriangleCells(faces, Refinement.start(mesh, faces))
    for pattern in PATTERNS:
        hanging = np.array([bool(pattern >> side & 1) for side in range(3)])
        for place, face in enumerate(faces.tolist()):
            surface, places = sampled(mesh, face)
            nearest = [int(np.flatnonzero(np.all(np.isclose(places, point), axis=1))[0]) for point in FLAT]
            found = distance(template_of(pattern), surface, places, surface[nearest])
            # A plain triangle is compared with itself; the others by way of a fan, which takes more.
            for room in (1.2 if pattern == 0 and name != "creases" else 3.0, 100.0):
                request = AdaptiveRequest(room * found, Mode.ADAPTIVE, Transitions.TRIANGLES, MOST_FACES)
                approximation = cells.at(np.array([place])).approximate(hanging, request)
                assert found - ROUNDING <= approximation.bounds[0] <= room * found, (pattern, face)


@pytest.mark.parametrize("valence", [3, 4, 5, 7, 24])
def test_no_facet_is_farther_than_nets_tell(valence: int) -> None:
    """Of wild surfaces, at the quarters of a triangle at vertices of this valence and of valence 4."""
    data, generator = meshes.bipyramid(valence), np.random.default_rng(valence)
    excess = []
    for _ in range(20):
        noise = generator.normal(size=data.positions.shape)
        mesh = apply_boundary_rule(
            meshes.to_polygon_mesh(data).changed(positions=data.positions + noise), smooth_corners=True
        )
        surface, _ = sampled(mesh, 0)
        facets = generator.normal(size=(4, 3, 3))
        nets = QuarterNets.of(Refinement.start(mesh, np.array([0])).refined().numbered())
        assert np.all(nets.is_known)
        found = nets.distances(np.arange(3), facets)
        over = np.einsum("kn,kqi->qni", bilinear_weights(), facets)
        reached = np.linalg.norm(surface.reshape(3, -1, 3) - over, axis=2).max(axis=1)
        assert np.all(reached <= found + ROUNDING)
        excess.append(found / reached)
    # Bernstein coefficients of such wild pieces are not much longer than what is reached at some samples.
    assert np.median(excess) < 1.3


def bilinear_weights() -> FloatArray:
    """(4, N): of the corners of a quarter, at the samples of ``sampled``."""
    steps = np.linspace(0, 1, STEPS + 1)
    u, v = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2).T
    return np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])


def test_triangles_have_nets_where_all_is_smooth_around_them() -> None:
    quads = meshes.landscape(4, 4)
    triangles = quads.corner_vertices.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    data = meshes.MeshData(quads.positions, np.full(len(triangles), 3), triangles.ravel())
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True)
    faces = np.arange(mesh.face_count)
    nets = QuarterNets.of(Refinement.start(mesh, faces).refined().numbered())
    is_boundary = np.bincount(mesh.corner_edges, minlength=mesh.edge_count) == 1
    at_boundary = np.zeros(mesh.vertex_count, dtype=bool)
    at_boundary[mesh.edge_vertices[is_boundary]] = True
    expected = ~at_boundary[triangles].any(axis=1)
    assert 0 < np.count_nonzero(expected) < len(faces)
    assert np.array_equal(nets.is_known, expected)


@pytest.mark.parametrize("pattern", PATTERNS[1:])
def test_templates_and_fans_are_no_farther_apart_than_told(pattern: int) -> None:
    """At random places; and it is found nearly as large there."""
    lifts, gaps = fan_of_template(pattern)
    u, v = np.random.default_rng(pattern).random((2, 200_000, 1))
    for side in (side for side in range(3) if pattern >> side & 1):
        heights = np.zeros((6, 1))
        heights[3 + side] = 1
        # Heights over the flat triangle, so that a distance is one of heights.
        points, centre = np.hstack([FLAT, heights]), np.append(CENTROID, lifts[side])
        fan = np.concatenate(
            [
                (1 - v) * ((1 - u) * points[corner] + u * points[3 + corner])
                + v * ((1 - u) * points[3 + (corner + 2) % 3] + u * centre)
                for corner in range(3)
            ]
        )
        farthest = distance(template_of(pattern), fan, fan[:, :2], points)
        assert 0.99 * gaps[side] <= farthest <= gaps[side]


def test_templates_and_fans_are_apart_by_what_can_be_worked_out() -> None:
    """Where one side is split, and at the side before of two, φ - ψ is min(u, v) - uv over the quarter at the opposite
    corner and 0 over the others: at most 1/4. At the other of two it is 2uv/3 up to the curve u + v = 1 + 2uv/3 over
    the quarter between them, and least and largest there: 2uv/3 = 2 - √3, where u = v = (3 - √3)/2.

    A bound is off by a halving's side times how fast φ - ψ changes, which is less than twice the step."""
    off = 2 * 2.0**-HALVINGS
    for pattern in PATTERNS[1:]:
        _, gaps = fan_of_template(pattern)
        for side in range(3):
            after_split_one = pattern >> side & 1 and pattern >> (side + 2) % 3 & 1
            exact = 0.0 if not pattern >> side & 1 else 2 - np.sqrt(3) if after_split_one else 0.25
            assert exact <= gaps[side] <= exact + off * (exact > 0), (pattern, side)
