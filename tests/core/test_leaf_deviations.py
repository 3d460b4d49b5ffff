# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaves as they may be drawn, over a surface of which all distances are known."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.arrays.vectors import lengths
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from ccdepth_addon.core.deviation import leaf_deviations
from ccdepth_addon.core.deviation.leaf_deviations import DrawnLeaves
from ccdepth_addon.core.deviation.leaf_maps import Charts
from ccdepth_addon.core.surface.bicubic import NET_TO_BERNSTEIN
from ccdepth_addon.core.surface.refinement import Refinement
from ccdepth_addon.core.surface.triangle_coefficients import bicubic_basis
from tests import meshes
from tests.core.test_distance_depth import MESHES
from tests.drawn_levels import points_of
from tests.thorough import cases
from tests.triangle_distances import point_to_triangles

# Second derivatives of z: so small that heights are distances but for a part in ten thousand.
SMALL = 0.01
UU, VV, UV = 2 * SMALL, 2 * SMALL, -1 * SMALL

# Of triangles over a unit square with corners on that surface: along either diagonal, or inside where that is more.
FIRST_DIAGONAL = UU * VV * (UU + VV + 2 * UV) / (8 * (UU * VV - UV * UV))
SECOND_DIAGONAL = (UU + VV - 2 * UV) / 8

MIDDLE = 4


def leaves(*, is_folded: bool) -> DrawnLeaves:
    """Nine quads of a paraboloid's grid; of the one in the middle it may not be known how it is drawn."""
    data = meshes.bent(meshes.grid(5, 5), lambda x, y, _: (x, y, UU * x * x / 2 + VV * y * y / 2 + UV * x * y))
    refinement = Refinement.start(meshes.build(data), np.array([6, 7, 8, 11, 12, 13, 16, 17, 18]))
    found = DrawnLeaves.of(refinement, np.zeros(9, dtype=bool), Vertices.LIMIT, None)
    return replace(found, is_folded=np.arange(9) == (MIDDLE if is_folded else -1))


@pytest.mark.parametrize(("on_surface", "drawn"), [(True, False), (False, True)])
def test_of_what_may_be_folded_either_diagonal_counts(*, on_surface: bool, drawn: bool) -> None:
    middle, limit = np.arange(9) == MIDDLE, (FIRST_DIAGONAL + SECOND_DIAGONAL) / 2
    known, folded = (
        leaves(is_folded=each).deviations(middle & on_surface, middle & drawn, np.arange(9), limit, 0.0)[MIDDLE]
        for each in (False, True)
    )
    assert FIRST_DIAGONAL * (1 - SMALL) <= known <= limit
    assert folded == np.inf


def test_what_is_farther_than_the_limit_is_not_proved() -> None:
    every, alone = np.ones(9, dtype=bool), np.arange(9)
    assert np.all(leaves(is_folded=False).deviations(every, every, alone, 0.97 * FIRST_DIAGONAL, 0.0) == np.inf)
    assert np.all(leaves(is_folded=False).deviations(every, every, alone, 1.03 * FIRST_DIAGONAL, 0.0) < np.inf)


def test_what_is_farther_than_the_limit_takes_its_group_alone_with_it() -> None:
    some = leaves(is_folded=False)
    is_corner = np.all(some.points == some.points[0, 2], axis=2)
    some.points[is_corner] += [0, 0, 2 * FIRST_DIAGONAL]
    every, groups = np.ones(9, dtype=bool), np.arange(9) // 3
    found = some.deviations(every, every, groups, 1.5 * FIRST_DIAGONAL, 0.0)
    assert np.all(np.isinf(found[is_corner.any(axis=1)]))
    assert np.all(found[6:] < np.inf)


def test_at_equal_parameters_either_diagonal_counts() -> None:
    assert np.all(leaves(is_folded=False).at_equal_parameters(0.0) >= SECOND_DIAGONAL * (1 - SMALL))


def test_around_a_pole_few_pieces_are_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the drawn pole is off the surface, beside the surface's pole as seen along a triangle's normal."""
    mesh = meshes.build(meshes.sphere(40, 8))
    refinement = Refinement.start(mesh, np.arange(mesh.face_count)).refined()
    some = DrawnLeaves.of(refinement, np.zeros(len(refinement.bases), dtype=bool), Vertices.CONTROL, None)
    vertices = refinement.corner_vertices().reshape(-1, 4)
    at_pole = np.any(np.bincount(vertices.ravel())[vertices] == 40, axis=1)
    for name, most in (("PIECES_OF_EACH", 4), ("PIECES_BESIDES", 0)):
        monkeypatch.setattr(leaf_deviations, name, most)
    found = some.deviations(np.zeros_like(at_pole), at_pole, np.arange(len(at_pole)), 0.015, 0.0)
    assert np.count_nonzero(at_pole) == 2 * 40
    assert np.all(found[at_pole] < np.inf)


def test_triangles_without_area_are_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """A grid in one line: the surface over each leaf is as thin as its triangles."""
    monkeypatch.delattr(leaf_deviations, "MeshToSurface")
    data = meshes.bent(meshes.grid(5, 5), lambda x, y, _: (x + y * y, 2 * (x + y * y), 0 * x))
    mesh = meshes.build(data, smooth_corners=False)
    every = np.ones(mesh.face_count, dtype=bool)
    some = DrawnLeaves.of(Refinement.start(mesh, np.flatnonzero(every)), ~every, Vertices.LIMIT, None)
    assert some.along_segments(some.pieces).max() <= 1e-12
    moved = replace(some, points=some.points + np.array([100.0, 200.0, 0.0]))
    assert moved.along_segments(some.pieces).min() > 100.0
    assert np.all(some.deviations(every, every, np.arange(len(every)), 0.5, 1e-9) <= 0.5)


# Fine triangles, these levels deeper, are off the surface by at most this part of a leaf's size, on these meshes.
FINE, DEEPER = 0.002, 3

MAPPED: dict[str, Callable[[int], meshes.MeshData]] = MESHES | {
    "pole of 130": lambda seed: meshes.sphere(130, 4),
    "needles": lambda seed: meshes.bent(meshes.landscape(4, 4, seed), lambda x, y, z: (x, 1e-4 * y, z)),
}


def own_distances(quads: FloatArray, fine: FloatArray, is_turned: bool) -> tuple[float, float]:
    """The farthest of the surface's points (n, 4, 3) from the triangles of a quad (4, 3), and of the triangles from
    quads between the points."""
    triangles = np.roll(quads, -int(is_turned), axis=0)[[[0, 1, 2], [0, 2, 3]]]
    points = fine.reshape(-1, 3)
    there = np.min(
        [point_to_triangles(points, np.repeat(each[None], len(points), axis=0)) for each in triangles], axis=0
    )
    drawn, halves = points_of(triangles).reshape(-1, 3), fine[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
    pairs = np.repeat(drawn, len(halves), axis=0), np.tile(halves, (len(drawn), 1, 1))
    back = point_to_triangles(*pairs).reshape(len(drawn), -1).min(axis=1)
    return there.max(), back.max()


@pytest.mark.parametrize(("name", "seed"), cases(product(MAPPED, range(4)), [(n, 1) for n in [*MAPPED][::2]]))
def test_a_map_bounds_both_ways_between_a_leaf_and_its_own_triangles(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = meshes.build(MAPPED[name](seed))
    refinement = Refinement.start(mesh, np.arange(mesh.face_count)).refined()
    if len(refinement.bases) < 200:
        refinement = refinement.refined()
    count = len(refinement.bases)
    fine = refinement
    for _ in range(DEEPER):
        fine = fine.refined()
    surface = fine.limits_at_corners.reshape(count, -1, 4, 3)
    for vertices in Vertices:
        some = DrawnLeaves.of(refinement, rng.random(count) < 0.5, vertices, None)
        # What leaves are mapped along both diagonals does not depend on the reason.
        some = replace(some, is_folded=some.is_folded | (rng.random(count) < 0.3))
        own, folded = (rng.permutation(np.flatnonzero(each))[:20] for each in (~some.is_folded, some.is_folded))
        chosen = np.concatenate([own, folded, folded])
        is_turned = some.is_turned[chosen] ^ (np.arange(len(chosen)) >= len(own) + len(folded))
        found = np.array([own_distances(some.points[i], surface[i], t) for i, t in zip(chosen, is_turned, strict=True)])
        sizes = np.ptp(surface[chosen].reshape(len(chosen), -1, 3), axis=1).max(axis=1)
        assert np.all(found[:, 1] <= some.along_segments(some.pieces)[chosen] + FINE * sizes)
        for factor in (0.8, 1.02, 1.1, 2.0, 4.0):
            limit = factor * float(np.median(found.max(axis=1))) + 1e-9
            bounds = some.mapped(limit, 0.0)
            assert np.all((bounds <= limit) | np.isinf(bounds))
            assert np.all(found[:, 0] <= bounds[chosen] + 1e-12)
            assert np.all(found[:, 1] <= bounds[chosen] + FINE * sizes)


# Of a bicubic patch with uneven parameters, so that sides of its parts cross the diagonal.
UNEVEN = [
    [[0, 0, 0], [0, 1.167, 0.312], [0, 0.485, 0.373], [0, 1, 0.065]],
    [[0.176, 0, 0.591], [-0.042, 0.46, 0.327], [0.698, 0.699, 0.324], [1.046, 1, -0.441]],
    [[0.461, 0, -0.432], [0.689, 0.009, 0.056], [2.322, 0.334, 0.903], [0.808, 1, -0.155]],
    [[1, 0, 0.065], [1, 0.639, 0.645], [1, 0.764, -0.09], [1, 1, 0]],
]


def test_a_map_bounds_what_is_mapped_across_the_diagonal() -> None:
    """Beyond undivided cells the middles of sides are mapped to the middles of places, on either triangle."""
    coefficients = np.array(UNEVEN).reshape(16, 3)
    mesh = meshes.to_polygon_mesh(meshes.grid(3, 3)).changed(positions=np.linalg.solve(NET_TO_BERNSTEIN, coefficients))
    some = DrawnLeaves.of(Refinement.start(mesh, np.array([4])), np.zeros(1, dtype=bool), Vertices.LIMIT, None)
    places = np.stack(np.meshgrid(*[np.linspace(0, 1, 65)] * 2), axis=-1).reshape(-1, 2)
    points = np.repeat((bicubic_basis(places) @ coefficients)[:, None], 4, axis=1)
    far = own_distances(some.points[0], points, is_turned=False)[0]
    bounds = [some.mapped(factor * far, 0.0)[0] for factor in np.linspace(0.97, 1.05, 81)]
    assert min(bounds) >= far


def test_leaves_that_may_be_folded_and_concave_ones_have_maps() -> None:
    """Along both diagonals where either may be drawn: the worse one counts."""
    plain, folded, concave = leaves(is_folded=False), leaves(is_folded=True), leaves(is_folded=False)
    limit = (FIRST_DIAGONAL + SECOND_DIAGONAL) / 2
    assert plain.mapped(limit, 0.0)[MIDDLE] < limit
    assert folded.mapped(limit, 0.0)[MIDDLE] == np.inf
    assert SECOND_DIAGONAL * (1 - SMALL) < folded.mapped(2 * SECOND_DIAGONAL, 0.0)[MIDDLE] < np.inf
    moved = 0.6 * (concave.points[MIDDLE, 2] - concave.points[MIDDLE, 0])
    concave.points[MIDDLE, 0] += moved
    assert lengths(moved) <= concave.mapped(1.0, 0.0)[MIDDLE] < np.inf


@pytest.mark.parametrize("height", [1.0, 1e-3, 1e-5, 1e-7, 0.0])
def test_charts_are_convex_and_linear_over_both_triangles(height: float) -> None:
    """Also of needles, and of leaves that are concave, folded, or without area."""
    rng = np.random.default_rng(1)
    quads = rng.normal(size=(2000, 4, 3)) * [1.0, height, 1.0] + 3.0
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    quads[::5] = square * [1.0, height, 1.0] + 0.1 * height * rng.normal(size=(400, 4, 3))
    charts = Charts.over(quads, np.zeros(2000, dtype=bool))
    sides = np.roll(charts.places, -1, axis=1) - charts.places
    turns = np.cross(sides, np.roll(sides, -1, axis=1))
    assert np.all(turns > 0)
    every = np.arange(2000)
    weights = rng.dirichlet([1, 1, 1], size=2000)
    for some in ([0, 1, 2], [0, 2, 3]):
        of_chart = np.einsum("ni,nij->nj", weights, charts.places[:, some])
        wanted = np.einsum("ni,nij->nj", weights, quads[:, some])
        # Rounding: some dozen units of the largest coordinate.
        np.testing.assert_allclose(charts.points(of_chart[:, None], every)[:, 0], wanted, rtol=0, atol=1e-14)
        back = charts.points(charts.nearest(wanted, every)[:, None], every)[:, 0]
        if height >= 1e-3:
            # Normal equations of needles lose twice their digits.
            np.testing.assert_allclose(back, wanted, rtol=0, atol=1e-7)


def test_a_map_proves_nearly_what_is_so() -> None:
    """Samples of these leaves, long and narrow around a pole, reach 0.0048; at equal parameters they are 0.83 apart."""
    mesh = meshes.build(meshes.sphere(100, 8))
    refinement = Refinement.start(mesh, np.arange(mesh.face_count)).refined()
    some = DrawnLeaves.of(refinement, np.zeros(len(refinement.bases), dtype=bool), Vertices.LIMIT, None)
    assert np.all(some.mapped(0.005, 0.0) < np.inf)
