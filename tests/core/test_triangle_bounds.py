# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of templates' triangles against the surface itself, by refining a patch and going to the limit."""

from __future__ import annotations

from collections import defaultdict
from fractions import Fraction
from functools import cache
from itertools import combinations, pairwise, product
from math import comb, factorial, prod

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.leaf_bounds import triangle_bounds
from ccdepth_addon.core.adaptive.leaf_bounds.descent import Descent
from ccdepth_addon.core.adaptive.leaf_bounds.irregular_bounds import template_distances
from ccdepth_addon.core.adaptive.templates import ALL_SPLIT, QUAD_POINTS, Template, templates
from ccdepth_addon.core.arrays.types import BoolArray, FloatArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.mesh.submesh import submesh
from ccdepth_addon.core.surface.bicubic import patch_coefficients
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.patches import PatchKind, classify_patches, extraordinary_nets, regular_nets
from ccdepth_addon.core.surface.refinement import Refinement
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from ccdepth_addon.core.surface.stencils import Valences, quad_nets
from tests import meshes
from tests.brute_force import linear_children

pytestmark = pytest.mark.thorough

CHOICES = [(pattern, number) for pattern in range(ALL_SPLIT) for number in range(len(templates(pattern)))]
LEVELS = 5
NETS = 24

# Rounding of some hundred products of values around 1.
ROUNDING = 1e-12


def random_nets(mesh: PolygonMesh, seed: int) -> FloatArray:
    """(V, NETS, 3): positions of the vertices; wild ones, wavy ones on the flat mesh, and single displaced points."""
    generator = np.random.default_rng(seed)
    wild = generator.normal(size=(mesh.vertex_count, NETS // 3, 3))
    waves = np.einsum("vi,ijn->vnj", mesh.positions[:, :2], generator.normal(size=(2, 3, NETS // 3)))
    smooth = np.sin(waves) + mesh.positions[:, None]
    single = np.repeat(mesh.positions[:, None], NETS // 3, axis=1)
    first = mesh.corner_vertices[:4]
    for number in range(NETS // 3):
        single[first[number % 4], number] += generator.normal(size=3)
    return np.concatenate([wild, smooth, single], axis=1)


class Samples:
    """A face of a mesh whose sharpness is explicit: points of its surface and their parameters.

    Every position is a weighted sum of the control points, found once with the points at unit vectors.
    """

    def __init__(self, mesh: PolygonMesh, face: int = 0) -> None:
        self.mesh = mesh
        part = submesh(self.mesh.changed(positions=np.eye(self.mesh.vertex_count)), np.array([face]))[0]
        parameters = QUAD_POINTS[:4]
        for level in range(LEVELS):
            parameters = linear_children(part, parameters)
            part = submesh(subdivide(part).mesh, np.arange(4 ** (level + 1)))[0]
        self.parameters, first = np.unique(parameters, axis=0, return_index=True)
        self.weights = limit_positions(part)[part.corner_vertices[first]]

    def surface(self, nets: FloatArray) -> FloatArray:
        """(samples, NETS, 3)."""
        return np.tensordot(self.weights, nets, axes=1)

    def distances(self, template: Template, surface: FloatArray) -> FloatArray:
        """(NETS,) the largest at equal parameters, over all samples."""
        gaps = surface - drawn(template, self.parameters, surface[self.corners()])
        return np.linalg.norm(gaps, axis=2).max(axis=0)

    def corners(self) -> list[int]:
        """Which of the samples are the eight points of the quad."""
        return [int(np.flatnonzero(np.all(self.parameters == point, axis=1))[0]) for point in QUAD_POINTS]


def drawn(template: Template, parameters: FloatArray, points: FloatArray) -> FloatArray:
    """(N, …): the triangles over the eight points of a quad (8, …), at parameters (N, 2), which they all cover."""
    result = np.full((len(parameters), *points.shape[1:]), np.nan)
    for triangle in template:
        a, b, c = QUAD_POINTS[list(triangle)]
        weights = np.linalg.solve(np.stack([b - a, c - a], axis=1), (parameters - a).T)
        weights = np.stack([1 - weights.sum(axis=0), *weights], axis=1)
        inside = np.all(weights >= 0, axis=1)
        result[inside] = np.tensordot(weights[inside], points[list(triangle)], axes=1)
    assert not np.any(np.isnan(result))
    return result


@cache
def samples(valence: int) -> Samples:
    """A fan's first face, whose corner 0 is the only extraordinary vertex."""
    return Samples(apply_boundary_rule(meshes.to_polygon_mesh(meshes.fan(valence, 2)), smooth_corners=True))


def bounds_of(valence: int, pattern: int, alternative: int, nets: FloatArray, *, fine: bool) -> FloatArray:
    """(NETS,): what the distances are at most."""
    mesh = samples(valence).mesh.changed(positions=nets.reshape(len(nets), -1))
    if valence == 4:
        coefficients = patch_coefficients(regular_nets(mesh, np.array([0]))).reshape(16, -1, 3)
        every = np.arange(coefficients.shape[1])
        if fine:
            return triangle_bounds.bicubic_distances(
                triangle_bounds.bicubic_rows(pattern, alternative), coefficients, every
            )
        rows = triangle_bounds.quadratic_rows(pattern, alternative)
        return np.add(*triangle_bounds.quadratic_distances(rows, coefficients, every))
    net = extraordinary_nets(mesh, np.array([0]), valence).reshape(2 * valence + 8, -1, 3)
    matrices = triangle_bounds.extraordinary_rows((valence, 4, 4, 4), pattern, alternative)
    return triangle_bounds.extraordinary_distances(matrices, net)


# A matrix of a large valence takes some seconds to make, so not all of them are.
FEW_CHOICES = [(0, 0), (0, 1), (1, 0), (3, 0), (10, 2), (14, 1)]


@pytest.mark.parametrize("fine", [False, True])
@pytest.mark.parametrize("valence", [3, 4, 5, 6, 7, 12, 64])
def test_no_triangle_is_farther_than_its_bound(valence: int, fine: bool) -> None:
    nets = random_nets(samples(valence).mesh, valence)
    surface = samples(valence).surface(nets)
    for pattern, alternative in CHOICES if valence < 6 else FEW_CHOICES:
        distances = samples(valence).distances(templates(pattern)[alternative], surface)
        bounds = bounds_of(valence, pattern, alternative, nets, fine=fine)
        assert np.all(distances <= bounds + ROUNDING), (pattern, alternative)


def test_bounds_of_regular_quads_are_tight() -> None:
    """Parts of triangles, quartered once more: the bound is the largest distance but for a few per cent."""
    nets = random_nets(samples(4).mesh, 1)
    surface = samples(4).surface(nets)
    ratios = []
    for pattern, alternative in CHOICES:
        distances = samples(4).distances(templates(pattern)[alternative], surface)
        ratios.append(distances / bounds_of(4, pattern, alternative, nets, fine=True))
    assert np.mean(np.concatenate(ratios) >= 0.9) > 0.9
    assert np.min(ratios) > 0.75


def test_bounds_of_quadratic_distances_need_no_closer_look() -> None:
    """Over a paraboloid S - T is quadratic. The first bound is the largest of its values at the middles of sides, or
    half the sum of these three; the value in the middle of the triangle is 4/9 of the sum: so it is 9/8 too large at
    most, and the samples are another 1 % too small there."""
    square, mixed, other = np.random.default_rng(2).normal(size=(3, NETS))

    def paraboloids(x: FloatArray, y: FloatArray) -> FloatArray:
        heights = np.multiply.outer(x * x, square) + np.multiply.outer(x * y, mixed) + np.multiply.outer(y * y, other)
        return np.stack([np.broadcast_to(each[..., None], heights.shape) for each in (x, y)] + [heights], axis=-1)

    # The spline over values of a quadratic polynomial is that polynomial, but for a constant.
    coefficients = patch_coefficients(paraboloids(*np.mgrid[-1.0:3.0, -1.0:3.0])).reshape(16, NETS, 3)
    parameters = np.mgrid[0:33, 0:33].reshape(2, -1).T / 32
    exact = []
    for pattern, alternative in CHOICES:
        points = paraboloids(*QUAD_POINTS.T)
        on_triangles = drawn(templates(pattern)[alternative], parameters, points)
        distances = np.abs(paraboloids(*parameters.T) - on_triangles)[..., 2].max(axis=0)
        rows = triangle_bounds.quadratic_rows(pattern, alternative)
        bounds = np.add(*triangle_bounds.quadratic_distances(rows, coefficients, np.arange(NETS)))
        assert np.all((distances <= bounds + ROUNDING) & (bounds <= 9 / 8 * 1.01 * distances))
        exact.append(bounds <= distances + ROUNDING)
    assert np.mean(exact) > 0.8


def exact_blossom(places: list[tuple[Fraction, Fraction]]) -> list[Fraction]:
    """The weights of 16 tensor coefficients in the blossom of total degree 6 at six places, by its definition, the mean
    over the choices of three places for u and the others for v, of de Casteljau with another argument at each step."""
    weights = [Fraction(0)] * 16
    for chosen in combinations(range(6), 3):
        along = de_casteljau([places[i][0] for i in chosen])
        across = de_casteljau([places[i][1] for i in range(6) if i not in chosen])
        weights = [w + a * b / 20 for w, (a, b) in zip(weights, product(along, across), strict=True)]
    return weights


def de_casteljau(arguments: list[Fraction]) -> list[Fraction]:
    """The weights of a cubic's four coefficients."""
    rows = [[Fraction(int(i == j)) for j in range(4)] for i in range(4)]
    for x in arguments:
        rows = [[(1 - x) * a + x * b for a, b in zip(*pair, strict=True)] for pair in pairwise(rows)]
    return rows[0]


def cubic_basis(x: Fraction) -> list[Fraction]:
    return [comb(3, i) * x**i * (1 - x) ** (3 - i) for i in range(4)]


UNIT = Fraction(1, 2**53)

PARTS = [[(0, 0), (4, 0), (4, 4)], [(1, 0), (2, 4), (0, 3)], [(0, 4), (1, 3), (0, 2)], [(2, 1), (3, 3), (1, 4)]]


@pytest.mark.parametrize("part", PARTS)
def test_coefficients_over_a_triangle_make_the_same_polynomial(part: list[tuple[int, int]]) -> None:
    """At as many places as determine it, in rational numbers; and they are means, but for half a unit in the last place
    of each weight."""
    matrix = triangle_bounds.coefficients_over(np.array(part) / 4)
    assert matrix.min() >= 0
    exact = [[Fraction(weight) for weight in row] for row in matrix.tolist()]
    assert all(abs(sum(row) - 1) <= UNIT for row in exact)
    counts = [(6 - a - b, a, b) for a, b in product(range(7), repeat=2) if a + b <= 6]
    # The order of the coefficients: by arguments.
    counts.sort(key=lambda each: [0] * each[0] + [1] * each[1] + [2] * each[2])
    for place in counts:
        weights = [Fraction(count, 6) for count in place]
        basis = [
            Fraction(factorial(6), prod(map(factorial, each))) * prod(w**e for w, e in zip(weights, each, strict=True))
            for each in counts
        ]
        u, v = (sum(w * Fraction(each[i], 4) for w, each in zip(weights, part, strict=True)) for i in range(2))
        for number, (along, across) in enumerate(product(cubic_basis(u), cubic_basis(v))):
            value = sum(b * row[number] for b, row in zip(basis, exact, strict=True))
            assert abs(value - along * across) <= UNIT * along * across


@pytest.mark.parametrize("path", ["1", "12", "1021", "10000003"])
def test_rows_are_exact_but_for_the_rounding_of_their_weights(path: str) -> None:
    """A weight of S is rounded once, one of T where it is divided by an area and by six."""
    square = square_of(path)
    for (pattern, alternative), fine in product(FEW_CHOICES, (False, True)):
        rows = triangle_bounds.template_rows(pattern, alternative, int(path, 4), fine=fine)
        chosen = np.random.default_rng(1).permutation(len(rows.matrix))[:12]
        for row in chosen.tolist():
            places = rows.places[row].reshape(6, 2)
            within = square.from_parent(places)
            assert np.all(within % (1 / 4 if fine else 1 / 2) == 0)
            assert np.all((within >= 0) & (within <= 1))
            of_surface = exact_blossom([(Fraction(u), Fraction(v)) for u, v in within.tolist()])
            triangle = next(each for each in templates(pattern)[alternative] if are_inside(each, places[None])[0])
            of_points = [Fraction(0)] * 8
            for point, weight in zip(triangle, exact_weights(triangle, places), strict=True):
                of_points[point] = -weight
            for found, exact in zip(rows.matrix[row].tolist(), of_surface + of_points, strict=True):
                assert abs(Fraction(found) - exact) <= 2 * UNIT * abs(exact)


def square_of(path: str) -> triangle_bounds.Square:
    square = triangle_bounds.WHOLE_QUAD
    for digit in path[1:]:
        square = square.child(int(digit))
    return square


def are_inside(triangle: tuple[int, int, int], places: FloatArray) -> BoolArray:
    """(N,): which rows of places (N, 6, 2) lie in a triangle of a quad."""
    return np.all(triangle_bounds.barycentric(QUAD_POINTS[list(triangle)], places) >= 0, axis=(1, 2))


def exact_weights(triangle: tuple[int, int, int], places: FloatArray) -> list[Fraction]:
    """Of a triangle's vertices, for the mean of some places."""
    (ax, ay), (bx, by), (cx, cy) = ([Fraction(x) for x in point] for point in QUAD_POINTS[list(triangle)].tolist())
    x, y = (sum(map(Fraction, each)) / len(places) for each in places.T.tolist())
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    second = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
    third = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
    return [1 - second - third, second, third]


def test_rows_belong_to_places_of_their_triangles() -> None:
    """But not to their vertices, where there is no distance."""
    for (pattern, alternative), path in product(CHOICES, (1, 0o15, 0o23)):
        rows = triangle_bounds.template_rows(pattern, alternative, path)
        places = rows.places.reshape(-1, 6, 2)
        own = [places[are_inside(triangle, places)] for triangle in templates(pattern)[alternative]]
        assert len(np.unique(np.concatenate(own), axis=0)) == len(np.unique(places, axis=0)) == len(places)
        corners = QUAD_POINTS[np.unique(templates(pattern)[alternative])]
        assert not np.any(np.all(places[:, None] == corners[:, None], axis=(2, 3)))


def test_monomials_are_no_farther_off_their_quadratic_parts_than_told() -> None:
    """Sampled; the quadratic polynomials are fitted to the six values."""
    exponents = [(i, j) for i in range(4) for j in range(4) if i + j > 2]
    inside = np.array([(i, j) for i in range(41) for j in range(41 - i)]) / 40
    six = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
    triangles = {triangle for pattern in range(ALL_SPLIT) for template in templates(pattern) for triangle in template}
    in_all = np.abs(triangle_bounds.to_monomials()).sum(axis=1)
    for triangle in sorted(triangles):
        a, b, c = vertices = QUAD_POINTS[list(triangle)]

        def monomials(weights: FloatArray, a: FloatArray = a, b: FloatArray = b, c: FloatArray = c) -> FloatArray:
            u, v = (a + weights[:, :1] * (b - a) + weights[:, 1:] * (c - a) - 0.5).T
            return np.stack([u**i * v**j for i, j in exponents], axis=1)

        def quadratics(weights: FloatArray) -> FloatArray:
            x, y = weights.T
            return np.stack([np.ones(len(x)), x, y, x * x, x * y, y * y], axis=1)

        off = monomials(inside) - quadratics(inside) @ np.linalg.solve(quadratics(six), monomials(six))
        told, sampled = triangle_bounds.off_quadratic([vertices]), np.abs(off).max(axis=0)
        assert np.all(sampled <= told)
        # By quarters, 1.26 at most; finer parts would be closer, and take longer than they save.
        assert in_all @ told <= 1.3 * (in_all @ sampled)


def test_monomials_take_no_more_rounding_than_told() -> None:
    """docs/adaptive.md, Rounding: the sums of their rows' weights, times how far they are off their quadratic parts."""
    in_all = np.abs(triangle_bounds.to_monomials()).sum(axis=1)
    for pattern, alternative in CHOICES:
        assert in_all @ triangle_bounds.quadratic_rows(pattern, alternative).weights[:, 0] < 8.1


# A limit of so many times the largest distance should be seen to hold.
TIGHT = 1.1

SEVERAL_VALENCES = [(6, 4, 3, 4), (3, 3, 3, 3), (5, 3, 7, 4), (4, 4, 8, 6), (12, 3, 4, 4)]


@pytest.mark.parametrize("valences", SEVERAL_VALENCES)
def test_no_triangle_over_several_extraordinary_corners_is_farther_than_its_bound(valences: Valences) -> None:
    around = meshes.around_quad(valences)
    of_face = Samples(apply_boundary_rule(meshes.to_polygon_mesh(around), smooth_corners=True))
    nets = random_nets(of_face.mesh, sum(valences))
    surface = of_face.surface(nets)
    own = quad_nets(of_face.mesh.changed(positions=nets.reshape(len(nets), -1)), np.array([0]), valences)
    own = own.reshape(len(own), *nets.shape[1:])
    np.testing.assert_allclose(
        np.tensordot(triangle_bounds.extraordinary_points(valences)[:8], own, axes=1),
        surface[of_face.corners()],
        rtol=0,
        atol=ROUNDING,
    )
    for pattern, alternative in FEW_CHOICES:
        template = templates(pattern)[alternative]
        distances = of_face.distances(template, surface)
        rows = triangle_bounds.extraordinary_rows(valences, pattern, alternative)
        bounds = triangle_bounds.extraordinary_distances(rows, own)
        assert np.all(distances <= bounds * (1 + ROUNDING) + ROUNDING)
        # As near as at one extraordinary vertex: wild nets bend most there.
        assert np.median(bounds / distances) < 1.6


OTHER_QUADS = {
    "semi-sharp creases": lambda: meshes.with_random_creases(meshes.landscape(4, 4), seed=2, share=0.5),
    "creases at a pole": lambda: meshes.with_random_creases(meshes.fan(5, 2), seed=3, share=0.6),
    "several poles": lambda: meshes.bumpy(meshes.trapezohedron(9), 0.05),
    "a pole without stencils": lambda: meshes.bumpy(meshes.trapezohedron(65), 0.05),
    "valence 2": lambda: meshes.with_random_creases(meshes.valence_two(), seed=5, share=0.8),
    "not manifold": lambda: meshes.with_random_creases(meshes.face_soup(), share=0.3),
}


@pytest.mark.parametrize("name", OTHER_QUADS)
def test_no_triangle_over_a_refined_quad_is_farther_than_its_bound(name: str) -> None:
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(OTHER_QUADS[name]()), smooth_corners=True)
    generator = np.random.default_rng(1)
    quads = np.flatnonzero((mesh.face_sizes == 4) & (classify_patches(mesh).kinds != PatchKind.REGULAR))
    seen_within: dict[float, list[bool]] = defaultdict(list)
    for face in generator.choice(quads, 3, replace=False).tolist():
        of_face = Samples(mesh, face)
        for noise in (0.05, 1.0):
            net = mesh.positions + noise * generator.normal(size=mesh.positions.shape)
            surface = of_face.surface(net[:, None])
            points = surface[of_face.corners()]
            descent = Descent.of_quads(Refinement.start(mesh.changed(positions=net), np.array([face])))
            for key in CHOICES[::4]:
                template = templates(key[0])[key[1]]
                distance = of_face.distances(template, surface)[0]
                for ratio in (0.9, TIGHT, np.inf):
                    limit, number = ratio * distance, np.array([key[0] + 16 * key[1]])
                    bound = template_distances(descent, np.array([0]), points, number, limit)[0]
                    assert distance <= bound + ROUNDING, (key, limit)
                    seen_within[ratio].append(bool(bound <= limit))
    assert np.mean(seen_within[TIGHT]) > 0.9
