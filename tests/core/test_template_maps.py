# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaves of several sizes that have bounds by maps, against dense samples of the surface, both ways."""

from dataclasses import replace
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccdepth_addon.core.adaptive.leaf_bounds import bounds_both_ways
from ccdepth_addon.core.adaptive.plan import Plan
from ccdepth_addon.core.adaptive.planner import plan_within
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.template_maps import template_maps
from ccdepth_addon.core.adaptive.templates import COUNTS, QUAD_POINTS, TRIANGLE_COUNTS, TRIANGLES
from ccdepth_addon.core.adaptive.tessellation import TessellationPlan, tessellate
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.bicubic import NET_TO_BERNSTEIN
from tests import meshes, soundness
from tests.core.test_foot_bounds import GRID, MESHES, derivative, nets_of, smooth
from tests.drawn_levels import points_of, surface
from tests.thorough import combinations, each
from tests.triangle_distances import distances, point_to_triangles

# The level whose triangles stand for the surface; sizes of leaves on them are multiples of their own.
FINE = 4

# Places all over a leaf, and the products of cubic Bernstein polynomials there.
PLACES = np.linspace(0, 1, 5)
CUBICS = np.stack([comb(3, i) * PLACES**i * (1 - PLACES) ** (3 - i) for i in range(4)], axis=1)
BASIS = np.kron(CUBICS, CUBICS)


def planned(mesh: PolygonMesh, part: float) -> tuple[Plan, TessellationPlan]:
    """For a part of the mesh's diagonal."""
    limit = part * meshes.diagonal(mesh)
    return plan_within(mesh, AdaptiveRequest(limit, Mode.ADAPTIVE, 100_000), lambda _: None)


def assert_both_ways(mesh: PolygonMesh, plan: Plan, tessellation: TessellationPlan) -> float:
    """No triangle of a leaf is farther from the surface than its bound, and no point of the surface over a leaf farther
    from all triangles than the bound it has both ways. Returns the share of leaves that have a bound by a map alone."""
    leaves = tessellation.leaves
    made = tessellate(tessellation, plan.positions.in_space_of(mesh.positions, tessellation.used))
    triangles, sizes = soundness.drawn(made), soundness.sizes(made)
    owners = np.concatenate([tessellation.drawn, tessellation.drawn[sizes > 3]])
    fine, fine_triangles, _, step = surface(mesh, FINE)
    points = points_of(made.positions[triangles], 3)
    there = distances(points.reshape(-1, 3), fine, fine_triangles).reshape(len(points), -1).max(axis=1)
    bounds = plan.bounds(leaves)
    assert np.all(bounds <= plan.request.limit)
    # A level takes about three quarters off.
    assert np.all(there <= bounds[owners] + step / 2)
    over = np.einsum("gk,kni->gni", BASIS, plan.surfaces.coefficients(leaves))
    back = distances(over.reshape(-1, 3), made.positions, triangles).reshape(len(BASIS), -1).max(axis=0)
    told, _ = bounds_both_ways(plan, leaves)
    # Points are off by a few roundings.
    assert np.all(back <= told * (1 + 1e-9))
    # But at equal parameters and by a map, the triangles of any leaf around may be the nearest.
    at_vertices, around = np.zeros(len(made.positions)), np.zeros(len(leaves))
    np.maximum.at(at_vertices, triangles, bounds[owners][:, None])
    np.maximum.at(around, owners, at_vertices[triangles].max(axis=1))
    is_own = np.minimum(plan.at_equal.values[leaves], plan.mapped.values[leaves]) <= plan.request.limit
    assert np.all(told >= np.where(is_own, bounds, around))
    return float(np.mean(bounds < np.minimum(plan.at_equal.values[leaves], plan.along_surface.values[leaves])))


@pytest.mark.parametrize("name", each(["bumpy", "uneven", "cubed"], ["cubed"]))
def test_leaves_with_maps_are_within_their_bounds_both_ways(name: str) -> None:
    mesh = smooth(MESHES["even" if name == "cubed" else name](), 0)
    if name == "cubed":
        mesh = mesh.changed(positions=np.sign(mesh.positions) * np.abs(mesh.positions) ** 3)
    assert assert_both_ways(mesh, *planned(mesh, 1e-3)) > (0.1 if name == "cubed" else 0.0)


@settings(max_examples=settings().max_examples // 6)
@given(seed=st.integers(0, 10_000), size=st.sampled_from([0.02, 0.1, 0.3]), turns=st.floats(0.0, 0.5))
def test_bounds_hold_on_any_closed_surface(seed: int, size: float, turns: float) -> None:
    """Folded and self-intersecting ones as well, and lines that wind."""
    data = meshes.bumpy(meshes.torus(6, 5), size, seed)
    angles = np.arctan2(data.positions[:, 1], data.positions[:, 0])
    data = replace(data, positions=data.positions + turns * np.sin(3 * angles)[:, None] * [0.0, 1.0, 0.3])
    assert_both_ways(smooth(data, 0), *planned(smooth(data, 0), 3e-3))


# Each template.
NUMBERS = [16 * alternative + pattern for pattern, count in enumerate(COUNTS) for alternative in range(count)]

# The number of nets of a kind for each template, and the steps of the grids of triangles that stand for their surface.
NETS, GRID_STEPS = 4, 5


def surface_of(net: FloatArray, steps: int) -> tuple[FloatArray, IndexArray]:
    """Points (P, N, 3) all over nets (4, 4, P, 3), and triangles of these for each."""
    places = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, steps + 1)], indexing="ij"), axis=-1).reshape(-1, 2)
    corners = np.arange((steps + 1) ** 2).reshape(steps + 1, -1)
    quads = np.stack([corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]], axis=-1).reshape(-1, 4)
    return derivative(net, places, 0, 0).swapaxes(0, 1), quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def to_own(points: FloatArray, positions: FloatArray, triangles: IndexArray) -> FloatArray:
    """(P,): the largest distance of points (P, N, 3) from triangles (T, 3) of positions (P, M, 3), net by net."""
    corners = positions[:, None, triangles]
    shape = (*points.shape[:2], len(triangles))
    pairs = np.broadcast_to(points[:, :, None], (*shape, 3)), np.broadcast_to(corners, (*shape, 3, 3))
    found = point_to_triangles(pairs[0].reshape(-1, 3), pairs[1].reshape(-1, 3, 3)).reshape(shape)
    return found.min(axis=2).max(axis=1)


def moved_nets(kind: str, generator: np.random.Generator) -> FloatArray:
    """Nets (4, 4, NETS, 3) of a kind of ``nets_of``; squeezed and slanted; or with a ridge from corner 0 to 2, and with
    points moved along the surface."""
    if kind == "creased":
        flat = GRID[:, :, None] + generator.normal(size=(4, 4, NETS, 2)) * 0.15
        ridge = np.broadcast_to(np.abs(GRID[..., :1] - GRID[..., 1:]), (4, 4, NETS))
        return np.concatenate([flat, ridge[..., None]], axis=-1)
    if kind == "skewed":
        slanted = np.array([[1.0, 0.0, 0.0], [0.025, 0.05, 0.0], [0.0, 0.0, 0.05]])
        return nets_of("uneven", NETS, generator) @ slanted
    return nets_of(kind, NETS, generator)


@pytest.mark.parametrize(("kind", "number"), combinations(["uneven", "bent", "skewed", "creased"], NUMBERS))
def test_maps_bound_the_distance_of_single_leaves_both_ways(kind: str, number: int) -> None:
    """Within any limit, and within twice the distance. On skewed leaves two sides are nearly
    parallel to the other two; on creased leaves triangles are at right angles, about."""
    net = moved_nets(kind, np.random.default_rng(number))
    own = TRIANGLES[number, : TRIANGLE_COUNTS[number]]
    drawn = derivative(net, QUAD_POINTS, 0, 0).swapaxes(0, 1)
    surface, fine = surface_of(net, GRID_STEPS)
    # Steps half as large take three quarters off.
    off = 2 * to_own(surface_of(net, 2 * GRID_STEPS)[0], surface, fine)
    there = to_own(surface, drawn, own)
    points = np.einsum("sc,ptcd->ptsd", points_of(np.eye(3)[None], 3)[0], drawn[:, own]).reshape(NETS, -1, 3)
    back = to_own(points, surface, fine)
    coefficients = np.einsum("rk,kpd->rpd", NET_TO_BERNSTEIN, net.reshape(16, -1, 3))
    for limits in (np.full(NETS, np.inf), 2 * there):
        bounds = template_maps(coefficients, np.full(NETS, number), limits)
        # Distances of samples are off by a few roundings.
        assert np.all(there <= bounds * (1 + 1e-9))
        assert np.all(back <= bounds + off)
    # Of the others, sides bend along the surface.
    assert np.any(np.isfinite(bounds))
