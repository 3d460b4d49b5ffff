# SPDX-License-Identifier: GPL-3.0-or-later
"""The constants of the methods as upper bounds, and those of Sharp as the least ones but for 1 %.

Every point of a facet, of a refined net and of the surface is a linear function of the net, so each constant is at
least the largest value of some functionals c·V over all nets with |DV| ≤ 1, D being the second (or first) differences:
a linear program for each, apart from the certificates of ``proofs``. Points in space come down to numbers by projection
on the direction of the largest value.
"""

import numpy as np
import pytest
from scipy.optimize import linprog

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.facet_bounds import later_bounds, sampled_error
from ccdepth_addon.core.bounds.norm_bounds import (
    PATCH_METHODS,
    Method,
    PatchBounds,
    Vertices,
    first_order_rate,
    limit_displacement,
    published_divisor,
    published_rate,
    support_bounds,
)
from ccdepth_addon.core.bounds.norms import (
    first_order_norm_extraordinary,
    first_order_norm_regular,
    second_differences,
    second_order_norm_extraordinary,
    second_order_norm_regular,
)
from ccdepth_addon.core.bounds.sharp_constants import CONTROL_FACTORS, LIMIT_FACTORS, PERIOD, RATES
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.patches import (
    PatchKind,
    classify_patches,
    extraordinary_nets,
    faces_on_grids,
    regular_nets,
)
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes, nets
from tests.brute_force import Levels, quad_places
from tests.core.test_face_depths import QUADS, both_vertices
from tests.meshes import build

# Distances are sampled at steps of 2⁻³, of unrefined facets at 2⁻⁴.
SAMPLES = 3

FACTORS = {"CONTROL": CONTROL_FACTORS, "LIMIT": LIMIT_FACTORS}
LEVELS = len(CONTROL_FACTORS[3])

every_valence = pytest.mark.parametrize("valence", [3, 5, 6, 7, 8, 9, 10, 11, 12, 16, 32])

# Rounding of sums of some products of values around 1, where faces are flat.
ROUNDING = 1e-13


# What HiGHS leaves unsatisfied of a constraint, relative to coefficients of about 1.
PROGRAM_TOLERANCE = 1e-7

# How far functionals may be from what the differences make of them, by rounding.
PROGRAM_ROUNDING = 1e-9


def worst_of(functionals: FloatArray, differences: FloatArray) -> tuple[float, FloatArray]:
    """The largest value over many functionals, (…, D), and a net that has it.

    Least squares gives weights y with Dᵀy = c, and Σ|y| is at least the largest c·V: once it is below the largest value
    found so far, that row and all the following need no program.
    """
    rows = functionals.reshape(-1, functionals.shape[-1])
    rows = rows[np.abs(rows).max(axis=1) > 1e-12]
    # Functionals that are the same but for rounding are solved once.
    rows = rows[np.unique(np.round(rows, 12), axis=0, return_index=True)[1]]
    weights = rows @ np.linalg.pinv(differences.T, rcond=1e-10).T
    size = max(1.0, np.abs(rows).max(initial=0.0))
    assert np.all(np.abs(weights @ differences - rows) <= PROGRAM_ROUNDING * size), "not made of the differences"
    most = np.abs(weights).sum(axis=1)
    both_signs = np.vstack([differences, -differences])
    found, net = 0.0, np.zeros(rows.shape[1])
    for row in np.argsort(-most):
        if most[row] <= found:
            break
        scale = np.abs(rows[row]).max()
        solution = linprog(-rows[row] / scale, A_ub=both_signs, b_ub=np.ones(len(both_signs)), bounds=(None, None))
        assert solution.status == 0, "the functional is not made of the differences"
        if -scale * solution.fun > found:
            found, net = -scale * solution.fun, solution.x
    return found, net


def steps(valence: int, levels: int) -> FloatArray:
    """(2n + 8, 2n + 8): from a net to that at its extraordinary vertex so many levels later."""
    fine = nets.refined(nets.net_mesh(np.eye(2 * valence + 8)), 1)
    nearest = extraordinary_nets(fine, classify_patches(fine).extraordinary_corners[:1], valence)[:, 0]
    power: FloatArray = np.linalg.matrix_power(nearest, levels)
    return power


def distance_stencils(valence: int, level: int, vertices: str) -> FloatArray:
    """(M, D): Lᵏ - S on face 0, at eighths or at level 0 sixteenths.

    Only where u ≥ v: what lies beyond the diagonal is the mirror image.
    """
    samples = SAMPLES + (level == 0)
    places = quad_places(samples)
    offsets = Levels(nets.net_mesh(np.eye(2 * valence + 8))).facet_offsets(level, vertices, samples - level)
    return offsets[: len(places)][places[:, 0] >= places[:, 1]]


def bounds_of(method: str, valence: int, size: float, vertices: str) -> PatchBounds:
    """A method's bounds for a net with that norm, of either order."""
    if valence == 4:
        net = np.zeros((4, 4, 1, 3))
        net[0, 0, 0, 0] = size
        return PATCH_METHODS[Method(method)].regular(net, Vertices(vertices))
    net = np.zeros((2 * valence + 8, 1, 3))
    net[2 * valence + 1, 0, 0] = size
    return PATCH_METHODS[Method(method)].extraordinary(net, Vertices(vertices))


def fan_positions(valence: int) -> FloatArray:
    """(2n + 8, 3): a flat net of a size of some units, for noise to be added."""
    around = 2 * np.pi * np.arange(2 * valence) / (2 * valence)
    outer = around[1] * np.array([3, 3.5, 4, 5, 2.5, 2, 1])
    angles = np.concatenate([[0], around, outer])
    radii = np.concatenate([[0], np.tile([1, 1.4], valence), np.full(7, 2.5)])
    return np.stack([radii * np.cos(angles), -radii * np.sin(angles), 0 * radii], axis=1)


@every_valence
@both_vertices
def test_facets_lie_within_the_second_order_distance(valence: int, vertices: str) -> None:
    """The least factors for a control facet are 3/8 at valence 3, and 1/3 elsewhere as on regular patches."""
    bounds = bounds_of("SECOND_ORDER", valence, 1, vertices)
    differences = nets.difference_matrix(valence)
    found = [worst_of(distance_stencils(valence, level, vertices), differences)[0] for level in range(3)]
    for level in range(3):
        assert found[level] <= bounds.after(level)[0] + PROGRAM_TOLERANCE
        assert bounds.after(level)[0] == pytest.approx(bounds.after(0)[0] * published_rate(valence) ** level)
    if vertices == "CONTROL":
        assert bounds.after(0)[0] == pytest.approx(1 / published_divisor(valence))
        assert found[0] == pytest.approx(3 / 8 if valence == 3 else 1 / 3, abs=PROGRAM_TOLERANCE)
    elif valence == 3:
        # 7/27 is the least factor there, reached between the samples.
        assert bounds.after(0)[0] == pytest.approx(7 / 27)
        assert found[0] == pytest.approx(7 / 27, rel=0.005)


@every_valence
def test_corners_go_no_farther_than_the_limit_displacement(valence: int) -> None:
    mesh = nets.net_mesh(np.eye(2 * valence + 8))
    corners = mesh.corner_vertices[:4]
    found = worst_of(limit_positions(mesh)[corners] - mesh.positions[corners], nets.difference_matrix(valence))[0]
    # At valence 3 it is the extraordinary corner, elsewhere a regular one, that goes farthest.
    assert found == pytest.approx(limit_displacement(valence), abs=PROGRAM_TOLERANCE)


@both_vertices
@pytest.mark.parametrize("level", [0, 1, 2])
def test_regular_facets_reach_their_distance_and_no_more(vertices: str, level: int) -> None:
    factor = {"CONTROL": 1 / 3, "LIMIT": 1 / 4}[vertices] / 4**level
    # The 16 differences of a 4×4 net over Stam's numbers of valence 4.
    net = regular_nets(nets.net_mesh(np.eye(16)), np.array([0]))[:, :, 0]
    differences = np.stack([2 * net[a] - net[b] - net[c] for a, b, c in nets.listed_regular_differences()])
    found = worst_of(distance_stencils(4, level, vertices), differences)[0]
    assert 0.74 * factor <= found <= factor + PROGRAM_TOLERANCE
    assert bounds_of("SECOND_ORDER", 4, 1, vertices).after(level)[0] == pytest.approx(factor)


@every_valence
def test_first_order_norm_shrinks_as_derived(valence: int) -> None:
    edges = nets.edge_matrix(valence)
    fine = nets.refined(nets.net_mesh(np.eye(2 * valence + 8)), 1)
    assert classify_patches(fine).kinds[:4].tolist() == [PatchKind.EXTRAORDINARY, *[PatchKind.REGULAR] * 3]
    regular = regular_nets(fine, np.arange(1, 4))
    steps_between = [np.diff(regular, axis=axis).reshape(-1, regular.shape[-1]) for axis in (0, 1)]
    for differences in (edges @ steps(valence, 1), np.concatenate(steps_between)):
        assert worst_of(differences, edges)[0] <= first_order_rate(valence) + PROGRAM_TOLERANCE


@pytest.mark.parametrize("valence", [3, 4, 5, 6, 8, 12, 32])
@both_vertices
def test_facets_lie_within_the_first_order_distance(valence: int, vertices: str) -> None:
    bounds = bounds_of("FIRST_ORDER", valence, 1, vertices)
    for level in range(3 if valence == 4 else 2):
        found = worst_of(distance_stencils(valence, level, vertices), nets.edge_matrix(valence))[0]
        assert found <= bounds.after(level)[0] + PROGRAM_TOLERANCE


@both_vertices
@pytest.mark.parametrize("level", range(4))
def test_regular_nets_stay_within_the_bounds_of_later_levels(level: int, vertices: str) -> None:
    """Those that certified depths rest on: between the sampled and the proved distance lies the true one."""
    generator, face, samples = np.random.default_rng(7), np.array([0]), min(level + 4, 6)
    # Where each of the 16 points is on a grid.
    numbers = regular_nets(nets.net_mesh(np.eye(16)), face)[:, :, 0].argmax(axis=-1).ravel()
    x, y = np.stack(np.unravel_index(np.argsort(numbers), (4, 4)))[:, :, None]
    wild = generator.uniform(-1, 1, (16, 20, 3))
    # Gently curved, a little uneven.
    a, b, c = generator.uniform(-0.3, 0.3, (3, 20))
    gentle = np.stack(np.broadcast_arrays(x, y, a * x * x + b * y * y + c * x * y), axis=2) + 0.02 * wild
    # The surface of heights u³/6 + (1 - u)v²/2, whose second derivatives make up for each other at equal
    # parameters, and not where they count.
    u, v = x[:, 0] - 1, y[:, 0] - 1
    wild[:, 0] = np.stack([u, v, (u**3 - u) / 6 + (1 - u) * (v**2 - 1 / 3) / 2], axis=1)
    points = np.concatenate([wild, gentle], axis=1).reshape(16, -1)
    net, kind = regular_nets(nets.net_mesh(points), face).reshape(4, 4, 40, 3), Vertices(vertices)
    stencils = Levels(nets.net_mesh(np.eye(16))).facet_offsets(level, vertices, samples - level)[: 4 * 4**samples]
    dense = np.linalg.norm((stencils @ points).reshape(-1, 40, 3), axis=2).max(axis=0)
    bounds, lower = later_bounds(net, kind), sampled_error(net, kind, level)
    upper = bounds.after(level)
    assert np.all((bounds.least(level) <= dense * (1 + 1e-12)) & (dense <= upper * (1 + 1e-12)))
    # Between samples at 16ths (8ths) of a facet a distance can be larger by about a hundredth (some hundredths).
    assert np.all(lower <= dense * (1.015 if level < 3 else 1.05))
    # On nets like those of modelled surfaces the two meet, the closer the more levels follow.
    assert np.median(upper[20:] / dense[20:]) < 1 + 0.5 * 0.6**level
    assert np.median(dense[20:] / lower[20:]) < 1.1


@both_vertices
@pytest.mark.parametrize("name", QUADS)
def test_faces_stay_within_the_bound_of_their_support(name: str, vertices: str) -> None:
    mesh = build(meshes.AWKWARD[name]())
    distances = Levels(mesh).distances(0, vertices, 4)
    assert np.all(distances <= support_bounds(mesh, Vertices(vertices)) + ROUNDING)


@both_vertices
@pytest.mark.parametrize("seed", range(6))
def test_faces_on_grids_stay_within_the_bound_of_their_nets(seed: int, vertices: str) -> None:
    """Semi-sharp and infinitely sharp creases and corners on a grid, dense and sparse, straight and turning."""
    generator = np.random.default_rng(seed)
    data = meshes.with_random_creases(meshes.landscape(5, 5), seed=seed, share=(0.1, 0.2, 0.4)[seed % 3])
    mesh = meshes.to_polygon_mesh(data)
    sharpness = np.where(generator.random(mesh.vertex_count) < 0.1, generator.choice([0.5, 1.7, 3.0, 10.0]), 0.0)
    creases = np.where(generator.random(mesh.edge_count) < 0.05, 10.0, mesh.edge_sharpness)
    mesh = mesh.changed(vertex_sharpness=sharpness, edge_sharpness=creases if seed % 2 else mesh.edge_sharpness)
    mesh = apply_boundary_rule(mesh, smooth_corners=bool(seed % 2))
    on_grids = faces_on_grids(mesh)
    assert np.any(on_grids & (classify_patches(mesh).kinds == PatchKind.IRREGULAR))
    for height in (1.0, 1e-3):
        flattened = mesh.changed(positions=mesh.positions * [1.0, 1.0, height])
        bounds = support_bounds(flattened, Vertices(vertices))
        assert np.all(Levels(flattened).distances(0, vertices, 4) <= bounds + ROUNDING)
    # Not the size of a face counts then, which is 1, but how far its net is from bilinear.
    assert np.all(bounds[on_grids] < 0.02)


@pytest.mark.parametrize("valence", [3, 5, 8, 17, 32])
def test_tabled_rates_are_the_least(valence: int) -> None:
    differences = nets.difference_matrix(valence)
    growth = worst_of(differences @ steps(valence, PERIOD), differences)[0]
    assert growth <= RATES[valence] * (1 + PROGRAM_TOLERANCE)
    assert RATES[valence] == pytest.approx(growth, rel=2e-4)


@pytest.mark.parametrize("valence", [3, 5, 6, 7, 8, 9, 24, 32])
@both_vertices
def test_sharp_factors_are_the_least(valence: int, vertices: str) -> None:
    """The largest ‖Lᵏ - S‖ sampled on the level-k facet at the extraordinary vertex, over all nets with M ≤ 1; and on
    the whole face of the worst net, subdivided."""
    facets = distance_stencils(valence, 0, vertices)
    bounds = bounds_of("SHARP", valence, 1, vertices)
    beyond = [LEVELS, LEVELS + 4, LEVELS + PERIOD] if valence < 32 else []
    for level in [*range(LEVELS), *beyond]:
        found, heights = worst_of(facets @ steps(valence, level), nets.difference_matrix(valence))
        bound = bounds.after(level)[0]
        if level >= LEVELS:
            # Beyond the table, where the factors recur.
            assert 0.3 * bound < found < bound
            continue
        assert bound == FACTORS[vertices][valence][level]
        # The regular corner opposite goes M/3 · 4⁻ᵏ to its limit, on a net whose differences are all equal.
        at_corner = 4.0**-level / 3 if vertices == "CONTROL" else 0.0
        assert 0.99 * bound <= max(found, at_corner) <= bound * (1 + PROGRAM_TOLERANCE)
        if level < 3 and valence < 32 and valence != 9:
            net = heights[:, None] * [0.0, 0.0, 1.0]
            own = PATCH_METHODS[Method.SHARP].extraordinary(net[:, None], Vertices(vertices)).after(level)[0]
            distance = Levels(nets.net_mesh(net)).distances(level, vertices, SAMPLES + 1)[0]
            assert 0.99 * own <= distance <= own


def test_every_row_of_the_tables_has_all_it_needs() -> None:
    assert list(RATES) == list(CONTROL_FACTORS) == list(LIMIT_FACTORS) == [3, *range(5, 33), 48, 64, 96, 128]
    assert all(len(row) == LEVELS for table in FACTORS.values() for row in table.values())


@both_vertices
def test_sharp_bounds_fall_with_every_level_and_lie_below_the_published(vertices: str) -> None:
    """Where the factors begin to recur a bound can be a little above the one before, never above the last but one."""
    for valence in [3, *range(5, max(RATES) + 1)]:
        sharp, published = (
            np.array([bounds.after(level)[0] for level in range(40)])
            for bounds in (bounds_of(method, valence, 1, vertices) for method in ("SHARP", "SECOND_ORDER"))
        )
        assert np.all(np.diff(sharp[:LEVELS]) < 0)
        assert np.all(sharp[1:] < 1.09 * sharp[:-1])
        assert np.all(sharp[2:] < sharp[:-2])
        assert np.all(sharp < published)
    for valence in (4, max(RATES) + 1):
        sharp, published = (bounds_of(method, valence, 1, vertices) for method in ("SHARP", "SECOND_ORDER"))
        assert all(sharp.after(level) == published.after(level) for level in range(5))


# Sums of three numbers of some ten, in any order.
SUM_ROUNDING = 1e-14

some_valences = pytest.mark.parametrize("valence", [3, 5, 6, 7, 8, 12, 64])


def test_norms_of_regular_nets() -> None:
    v = np.random.default_rng(61).normal(size=(4, 4, 50, 3))
    listed = nets.listed_regular_differences()
    assert len(set(listed)) == 16
    second = np.linalg.norm([2 * v[a] - v[b] - v[c] for a, b, c in listed], axis=-1).max(axis=0)
    np.testing.assert_allclose(second_order_norm_regular(v), second, rtol=SUM_ROUNDING)
    along_i = [v[i + 1, j] - v[i, j] for i in range(3) for j in range(4)]
    along_j = [v[i, j + 1] - v[i, j] for i in range(4) for j in range(3)]
    first = np.linalg.norm(along_i + along_j, axis=-1).max(axis=0)
    np.testing.assert_allclose(first_order_norm_regular(v), first, rtol=SUM_ROUNDING)


@some_valences
def test_norms_of_extraordinary_nets(valence: int) -> None:
    net = np.random.default_rng(valence).normal(size=(2 * valence + 8, 20, 3))
    listed, edges = nets.listed_differences(valence), nets.net_edges(valence)
    second = np.linalg.norm([2 * net[a - 1] - net[b - 1] - net[c - 1] for a, b, c in listed], axis=-1).max(axis=0)
    np.testing.assert_allclose(second_order_norm_extraordinary(net), second, rtol=SUM_ROUNDING)
    assert len(edges) == 3 * valence + 12
    first = np.linalg.norm([net[a] - net[b] for a, b in edges], axis=-1).max(axis=0)
    np.testing.assert_allclose(first_order_norm_extraordinary(net), first, rtol=SUM_ROUNDING)
    assert np.all(second <= 2 * first)
    # Random nets do not reach each of the 2n + 10 as the largest, so the list itself is compared too.
    assert len(set(listed)) == len(listed) == 2 * valence + 10
    core = [(a + 1, *sorted((b + 1, c + 1))) for a, b, c in second_differences(valence).T.tolist()]
    assert sorted(core) == sorted((a, *sorted((b, c))) for a, b, c in listed)
