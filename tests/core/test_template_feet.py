# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaves of several sizes that have bounds by feet, against dense samples of whole surfaces, both ways."""

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
from ccdepth_addon.core.adaptive.template_feet import template_feet
from ccdepth_addon.core.adaptive.templates import QUAD_POINTS, TRIANGLE_COUNTS, TRIANGLES
from ccdepth_addon.core.adaptive.tessellation import TessellationPlan, tessellate
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.bicubic import NET_TO_BERNSTEIN
from tests import meshes, soundness
from tests.core.test_foot_bounds import MESHES, derivative, nets_of, smooth
from tests.drawn_levels import points_of, surface
from tests.thorough import each
from tests.triangle_distances import distances

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
    from all triangles than the bound it has both ways. Returns the share of leaves that have a bound by feet alone."""
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
    # But at equal parameters, the triangles of any leaf around may be the nearest.
    at_vertices, around = np.zeros(len(made.positions)), np.zeros(len(leaves))
    np.maximum.at(at_vertices, triangles, bounds[owners][:, None])
    np.maximum.at(around, owners, at_vertices[triangles].max(axis=1))
    assert np.all(told >= np.where(plan.at_equal.values[leaves] <= plan.request.limit, bounds, around))
    return float(np.mean(bounds < np.minimum(plan.at_equal.values[leaves], plan.along_surface.values[leaves])))


@pytest.mark.parametrize("name", each(["bumpy", "uneven"], ["uneven"]))
def test_leaves_with_feet_are_within_their_bounds_both_ways(name: str) -> None:
    mesh = smooth(MESHES[name](), 0)
    assert assert_both_ways(mesh, *planned(mesh, 3e-4)) > 0.1


@settings(max_examples=settings().max_examples // 6)
@given(seed=st.integers(0, 10_000), size=st.sampled_from([0.02, 0.1, 0.3]), turns=st.floats(0.0, 0.5))
def test_bounds_hold_on_any_closed_surface(seed: int, size: float, turns: float) -> None:
    """Folded and self-intersecting ones as well, and lines that wind."""
    data = meshes.bumpy(meshes.torus(6, 5), size, seed)
    angles = np.arctan2(data.positions[:, 1], data.positions[:, 0])
    data = replace(data, positions=data.positions + turns * np.sin(3 * angles)[:, None] * [0.0, 1.0, 0.3])
    assert_both_ways(smooth(data, 0), *planned(smooth(data, 0), 3e-3))


@pytest.mark.parametrize("kind", ["quadratic", "cubic", "uneven", "bent"])
def test_errors_along_normals_are_those_of_samples_at_most(kind: str) -> None:
    """Of single leaves with every template, without curvature around: normals of all of the leaf count."""
    weights, shares = points_of(np.eye(3)[None], 6)[0], []
    for number in np.flatnonzero(TRIANGLE_COUNTS):
        net = nets_of(kind, 40, np.random.default_rng(number))
        places = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, 5)]), axis=-1).reshape(-1, 2)
        normals = np.cross(derivative(net, places, 1, 0), derivative(net, places, 0, 1))
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        reached = np.zeros(40)
        for triangle in TRIANGLES[number, : TRIANGLE_COUNTS[number]]:
            corners = QUAD_POINTS[triangle]
            flat = np.einsum("sc,cpd->spd", weights, derivative(net, corners, 0, 0))
            off = flat - derivative(net, weights @ corners, 0, 0)
            reached = np.maximum(reached, np.abs(np.einsum("spd,qpd->sqp", off, normals)).max(axis=(0, 1)))
        coefficients = np.einsum("rk,kpd->rpd", NET_TO_BERNSTEIN, net.reshape(16, -1, 3))
        bounds = template_feet(coefficients, np.full(40, number), *np.zeros((3, 40)))
        assert np.all(reached <= bounds)
        shares.append((reached / bounds)[np.isfinite(bounds)])
    # Half of the bounds are less than twice too large.
    assert np.median(np.concatenate(shares)) > 0.5
