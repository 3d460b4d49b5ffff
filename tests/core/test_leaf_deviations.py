# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaves as they may be drawn, over a surface of which all distances are known."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import BoolArray, FloatArray
from ccdepth_addon.core.arrays.vectors import lengths
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from ccdepth_addon.core.deviation import leaf_deviations
from ccdepth_addon.core.deviation.charts import Charts
from ccdepth_addon.core.deviation.leaf_deviations import DrawnLeaves
from ccdepth_addon.core.deviation.open_sides import OpenSides
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
    triangles = triangles_of(quads, is_turned=is_turned)
    return farthest(fine.reshape(-1, 3), triangles), farthest(points_of(triangles).reshape(-1, 3), halves_of(fine))


def triangles_of(quads: FloatArray, *, is_turned: bool) -> FloatArray:
    """(2, 3, 3): the triangles of a quad (4, 3)."""
    return np.roll(quads, -int(is_turned), axis=0)[[[0, 1, 2], [0, 2, 3]]]


def halves_of(fine: FloatArray) -> FloatArray:
    """(2n, 3, 3): triangles of quads (n, 4, 3)."""
    return fine[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)


def farthest(points: FloatArray, triangles: FloatArray) -> float:
    """The largest distance of points (n, 3) from the nearest of triangles (m, 3, 3)."""
    pairs = np.repeat(points, len(triangles), axis=0), np.tile(triangles, (len(points), 1, 1))
    return point_to_triangles(*pairs).reshape(len(points), -1).min(axis=1).max()


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


def beside(refinement: Refinement) -> BoolArray:
    """(K, K) bool: whether leaves share a side, or are the same."""
    quads = refinement.corner_vertices().reshape(-1, 4)
    sides = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2), axis=2)
    keys = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)[1].reshape(-1, 4)
    return np.any([[keys[:, None, i] == keys[None, :, j] for i in range(4)] for j in range(4)], axis=(0, 1))


@pytest.mark.parametrize(
    ("name", "seed"),
    cases([(n, s) for n in MAPPED for s in range(4)], [(n, 1) for n in ("sheared", "Möbius strip", "landscape")]),
)
def test_maps_of_leaves_together_bound_both_ways(name: str, seed: int) -> None:
    """Between the surface over a leaf and the triangles of leaves beside it, and between its triangles and the surface
    over these."""
    rng = np.random.default_rng(seed)
    mesh = meshes.build(MAPPED[name](seed))
    refinement = Refinement.start(mesh, np.arange(mesh.face_count)).refined()
    count, fine = len(refinement.bases), refinement
    for _ in range(DEEPER):
        fine = fine.refined()
    surface = fine.limits_at_corners.reshape(count, -1, 4, 3)
    neighbours = beside(refinement)
    for vertices in Vertices:
        some = DrawnLeaves.of(refinement, rng.random(count) < 0.5, vertices, None)
        some = replace(some, is_folded=some.is_folded | (rng.random(count) < 0.1))
        chosen = rng.permutation(np.flatnonzero(~some.is_folded))[:20]
        drawn = np.stack([triangles_of(q, is_turned=t) for q, t in zip(some.points, some.is_turned, strict=True)])
        near = [np.flatnonzero(neighbours[i]) for i in chosen]
        there = [
            farthest(surface[i].reshape(-1, 3), drawn[n].reshape(-1, 3, 3)) for i, n in zip(chosen, near, strict=True)
        ]
        back = [
            farthest(points_of(drawn[i]).reshape(-1, 3), halves_of(surface[n].reshape(-1, 4, 3)))
            for i, n in zip(chosen, near, strict=True)
        ]
        sizes = np.ptp(surface[chosen].reshape(len(chosen), -1, 3), axis=1).max(axis=1)
        is_sought = rng.random(count) < 0.9
        is_both = is_sought & (rng.random(count) < 0.8)
        for factor in (0.3, 0.8, 1.02, 1.3, 2.0, 4.0):
            limit = factor * float(np.median(np.maximum(there, back))) + 1e-9
            bounds = some.joined(limit, 0.0, is_sought, is_both)
            assert np.all((bounds <= limit) | np.isinf(bounds))
            assert np.all(np.isinf(bounds[some.is_folded | ~is_sought]))
            assert np.all(there <= bounds[chosen] + 1e-12)
            assert np.all(np.where(is_both[chosen], back, 0.0) <= bounds[chosen] + FINE * sizes)


def test_leaves_together_have_maps_where_sides_run_along_the_surface() -> None:
    """A plane whose lines are bent: the surface is the triangles, but hardly any leaf is covered by its own."""
    data = meshes.bent(meshes.grid(8, 8), lambda x, y, _: (x + 0.3 * np.sin(2 * y), y + 0.3 * np.sin(2 * x), 0 * x))
    mesh = meshes.build(data)
    refinement = Refinement.start(mesh, np.arange(mesh.face_count)).refined()
    every = np.ones(len(refinement.bases), dtype=bool)
    some = DrawnLeaves.of(refinement, ~every, Vertices.LIMIT, None)
    quads = refinement.corner_vertices().reshape(-1, 4)
    inside = np.all(np.bincount(quads.ravel())[quads] == 4, axis=1)
    limit = 0.005
    assert np.isfinite(some.mapped(limit, 0.0)[inside]).mean() < 0.5
    assert np.isfinite(some.joined(limit, 0.0, every, every)[inside]).mean() > 0.9
    # Not onto leaves that may be folded, as all that share a side with these here.
    neighbours, alone = beside(refinement), ~every
    for leaf in range(len(every)):
        alone[leaf] = not alone[neighbours[leaf]].any()
    among = replace(some, is_folded=~alone)
    assert np.isfinite(among.joined(limit, 0.0, every, every)[inside & alone]).mean() < 0.5


@pytest.mark.parametrize("name", ["Möbius strip", "flipped face", "landscape", "pole of 16"])
def test_places_on_both_flaps_of_an_open_side_are_the_same_in_both_charts(name: str) -> None:
    rng = np.random.default_rng(1)
    mesh = meshes.build(MAPPED[name](1))
    refinement = Refinement.start(mesh, np.arange(mesh.face_count)).refined()
    is_turned = rng.random(len(refinement.bases)) < 0.5
    some = DrawnLeaves.of(refinement, is_turned, Vertices.LIMIT, None)
    known = np.ones(len(is_turned), dtype=bool)
    opened, charts = OpenSides.of(Charts.over(some.points, is_turned), some.pieces, is_turned, known)
    count = len(opened.leaves)
    assert count > len(is_turned) / 2
    every = np.arange(count)
    places = (rng.dirichlet([1, 1, 1, 1], size=count)[:, :, None] * opened.kites.places).sum(axis=1)
    wanted = opened.kites.points(places[:, None], every)[:, 0]
    for way in (0, 1):
        images = opened.images(every, np.full(count, way), places)
        found = charts.points(images[:, None], opened.leaves[:, way])[:, 0]
        # Rounding: some dozen units of the largest coordinate.
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14)
        assert np.all((opened.beside[opened.leaves[:, way]] == opened.leaves[:, 1 - way, None]).any(axis=1))
