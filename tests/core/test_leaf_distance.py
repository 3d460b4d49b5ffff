# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of leaves on their own against dense samples of the surface and of the triangles, both ways."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.leaf_bounds import triangle_bounds
from ccdepth_addon.core.adaptive.leaf_bounds.descent import Descent
from ccdepth_addon.core.adaptive.leaf_bounds.fan_bounds import QuarterNets
from ccdepth_addon.core.adaptive.leaf_bounds.leaf_distance import (
    Hull,
    Leaves,
    _bicubic_rows,
    bicubic_hull,
    extraordinary_hull,
    leaf_distances,
)
from ccdepth_addon.core.adaptive.leaf_bounds.refined_hulls import hull_of_fans, hull_of_quads
from ccdepth_addon.core.adaptive.leaf_bounds.triangle_shapes import triangle_normals
from ccdepth_addon.core.adaptive.templates import ALL_SPLIT, QUAD_POINTS, Template, templates
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.mesh.submesh import submesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.patches import extraordinary_nets
from ccdepth_addon.core.surface.refinement import Refinement
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from ccdepth_addon.core.surface.stencils import Valences, quad_nets
from tests import meshes
from tests.brute_force import linear_children

pytestmark = pytest.mark.thorough

CHOICES = [(pattern, number) for pattern in range(ALL_SPLIT) for number in range(len(templates(pattern)))]
KINDS = ("wild", "flat", "uneven", "bent", "folded", "sheared", "line")
NETS = 2
STEPS = 16
POINTS_ON_A_TRIANGLE = 25

# Rounding of some hundred products of values around 1.
ROUNDING = 1e-11

GRID = np.stack(np.meshgrid(np.arange(4) / 3, np.arange(4) / 3, indexing="ij"), axis=-1).reshape(16, 2)


def random_coefficients(kind: str, generator: np.random.Generator) -> FloatArray:
    """(16, NETS, 3)."""
    points = np.zeros((16, NETS, 3))
    points[..., :2] = GRID[:, None]
    noise = generator.normal(size=points.shape)
    if kind == "wild":
        return noise
    if kind == "flat":
        points += noise * [0.1, 0.1, 1.0] * 10 ** generator.uniform(-3, -1, (NETS, 1))
    elif kind == "uneven":
        points[..., :2] = GRID[:, None] ** generator.uniform(0.3, 4, (NETS, 2))
        points += 0.02 * noise
    elif kind == "bent":
        radii = generator.uniform(0.5, 5, NETS)
        angles = GRID[:, :1] / radii
        points[..., 0], points[..., 2] = radii * np.sin(angles), radii * (1 - np.cos(angles))
        points += 0.01 * noise
    elif kind == "folded":
        points += noise * [0.4, 0.4, 0.1]
    elif kind == "sheared":
        points[..., 0] += GRID[:, 1:] * generator.normal(size=NETS) * 2
        points[..., 1] *= generator.uniform(0.05, 1, NETS)
        points += 0.02 * noise
    elif kind == "plane":
        points[..., :2] = GRID[:, None] ** generator.uniform(0.3, 4, (NETS, 2))
    elif kind == "line":
        points[..., 1] *= 1e-7
    return points


def leaves_of(points: FloatArray, pattern: int, template: Template) -> Leaves:
    return Leaves.alike(points, [bool(pattern >> side & 1) for side in range(4)], template)


def bounds_of(coefficients: FloatArray, pattern: int, alternative: int, limit: float) -> FloatArray:
    """Of bicubic leaves (16, P, 3)."""
    template = templates(pattern)[alternative]
    points = of_rows(triangle_bounds.BICUBIC_POINTS, coefficients)
    rows, normals = triangle_bounds.bicubic_rows(pattern, alternative), triangle_normals(points, template)
    normal = triangle_bounds.bicubic_error_bounds(rows, coefficients, normals).normal
    return leaf_distances(leaves_of(points, pattern, template), bicubic_hull(coefficients), normal, limit)


def distances_to_triangles(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """(N,): of points (N, 3) to the nearest of triangles (T, 3, 3)."""
    a, b, c = (corner[None] for corner in triangles.swapaxes(0, 1))
    nearest = np.full((len(points), len(triangles)), np.inf)
    normals = np.cross(b - a, c - a)
    squares = np.maximum((normals**2).sum(axis=-1), np.finfo(float).tiny)
    off = points[:, None] - a
    heights = (off * normals).sum(axis=-1)
    feet = off - (heights / squares)[..., None] * normals
    second = (np.cross(feet, c - a) * normals).sum(axis=-1)
    third = (np.cross(b - a, feet) * normals).sum(axis=-1)
    inside = (second >= 0) & (third >= 0) & (second + third <= squares)
    nearest[inside] = (np.abs(heights) / np.sqrt(squares))[inside]
    for start, end in ((a, b), (b, c), (c, a)):
        side, way = end - start, points[:, None] - start
        lengths = np.maximum((side**2).sum(axis=-1), np.finfo(float).tiny)
        part = np.clip((way * side).sum(axis=-1) / lengths, 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(way - part[..., None] * side, axis=-1))
    return nearest.min(axis=1)


def assert_within(surface: FloatArray, facets: IndexArray, triangles: FloatArray, bound: float, missed: float) -> None:
    """Samples of the surface (N, 3), and facets over these, by which it is missed by so much at most."""
    assert distances_to_triangles(surface, triangles).max() <= bound + ROUNDING
    weights = np.random.default_rng(1).dirichlet((0.6, 0.6, 0.6), POINTS_ON_A_TRIANGLE)
    drawn = np.concatenate([weights @ triangle for triangle in triangles])
    assert distances_to_triangles(drawn, surface[facets]).max() <= bound + missed + ROUNDING


def grid_facets() -> IndexArray:
    """Of samples at (STEPS + 1)² parameters."""
    number = np.arange((STEPS + 1) ** 2).reshape(STEPS + 1, STEPS + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    return np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in ((a, b, c), (a, c, d))])


def most_missed(grid: FloatArray) -> float:
    """By facets over a grid of samples (n, n, 3): (A + B + 2C)/8 with A, B, C second differences (docs/methods.md); a
    fifth more for what these miss themselves."""
    along, across = (np.linalg.norm(np.diff(grid, 2, axis=axis), axis=-1).max() for axis in (0, 1))
    mixed = np.linalg.norm(np.diff(np.diff(grid, axis=0), axis=1), axis=-1).max()
    return float(1.2 * (along + across + 2 * mixed) / 8)


@pytest.mark.parametrize("kind", KINDS)
def test_bicubic_leaves_are_within_their_bounds(kind: str) -> None:
    generator = np.random.default_rng(KINDS.index(kind))
    along = np.linspace(0, 1, STEPS + 1)
    basis = triangle_bounds.bicubic_basis(np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2))
    facets, found = grid_facets(), 0
    for pattern, alternative in CHOICES:
        template, coefficients = templates(pattern)[alternative], random_coefficients(kind, generator)
        points = of_rows(triangle_bounds.BICUBIC_POINTS, coefficients)
        bounds = bounds_of(coefficients, pattern, alternative, np.inf)
        for leaf in np.flatnonzero(np.isfinite(bounds)).tolist():
            surface, triangles = basis @ coefficients[:, leaf], points[[list(own) for own in template], leaf]
            missed = most_missed(surface.reshape(STEPS + 1, STEPS + 1, 3))
            assert_within(surface, facets, triangles, bounds[leaf], missed)
        found += np.count_nonzero(np.isfinite(bounds))
        # A limit takes away the bounds above it, and changes no others.
        limit = float(np.median(bounds))
        limited = bounds_of(coefficients, pattern, alternative, limit)
        np.testing.assert_array_equal(limited, np.where(bounds <= limit, bounds, np.inf))
    assert found > 0


def test_what_is_off_within_the_plane_costs_nothing() -> None:
    """Spacing is uneven both ways, and the sides are straight."""
    coefficients = np.zeros((16, 1, 3))
    coefficients[:, 0, :2] = GRID**3
    points = np.einsum("rk,kpi->rpi", triangle_bounds.BICUBIC_POINTS, coefficients)
    for alternative in (0, 1):
        leaves = leaves_of(points, 0, templates(0)[alternative])
        assert leaf_distances(leaves, bicubic_hull(coefficients), np.zeros(1), np.inf)[0] < ROUNDING


def test_parabolas_are_bounded_exactly() -> None:
    """Bent along one direction, both the surface over the middle and the two sides there are off by an eighth of the
    second derivative."""
    coefficients = np.zeros((16, 1, 3))
    coefficients[:, 0, :2] = GRID
    coefficients[:, 0, 2] = np.repeat([0.0, 0.0, 1 / 3, 1.0], 4) * 0.02
    bound = bounds_of(coefficients, 0, 0, np.inf)[0]
    assert 0.02 / 4 * 0.999 < bound < 0.02 / 4 * 1.001


def test_what_reaches_beyond_the_outline_adds_little() -> None:
    """A twisted leaf that bends along one direction, one side of which curves a little within the leaf's plane. Hull
    points are three times as high over the planes as the surface is over the triangles."""
    coefficients, (i, j) = np.zeros((16, 1, 3)), np.divmod(np.arange(16), 4)
    coefficients[:, 0, :2] = GRID * [1.0, 0.5]
    coefficients[:, 0, 2] = 0.02 * (np.array([0.0, 0.0, 1 / 3, 1.0])[i] + 2 * i * j / 9)
    coefficients[[7, 11], 0, 1] += 4 / 3 * 1e-4
    bound = bounds_of(coefficients, 0, 1, np.inf)[0]
    # Off by 0.02 / 4 along the normals, but for their tilt, and beyond the outline by 1e-4.
    assert 0.02 / 4 * 0.999 < bound < 0.02 / 4 * 1.01


# Rounding

PLACES = (0.0, 1.0, 1e4, 1e7)


@pytest.mark.parametrize("size", [1e-7, 1.0, 1e7])
@pytest.mark.parametrize("kind", ["plane", "flat", "uneven", "bent", "sheared", "line"])
def test_rounding_takes_nothing_off_bounds(kind: str, size: float) -> None:
    """Against the same bounds in extended precision, with the vertices as they are: of leaves turned in space, of
    needles, and far from the origin."""
    assert np.finfo(np.longdouble).eps < 1e-18
    generator, found = np.random.default_rng(4), 0
    for (pattern, alternative), place in product(CHOICES, PLACES):
        turned, _ = np.linalg.qr(generator.normal(size=(3, 3)))
        coefficients = (random_coefficients(kind, generator) @ turned + place * generator.normal(size=3)) * size
        points = of_rows(triangle_bounds.BICUBIC_POINTS, coefficients)
        # What is allowed on a regular patch (``rounding_allowance``).
        rounding = 128 * 26 * 2.0**-53 * np.abs(coefficients).max()
        bounds, exact = (
            leaf_distances(
                leaves_of(points.astype(precision), pattern, templates(pattern)[alternative]),
                hull_in(precision, coefficients),
                np.full(NETS, 0.0 if kind == "plane" else 0.1 * size),
                np.inf,
                rounding if precision is np.float64 else 0.0,
            )
            for precision in (np.float64, np.longdouble)
        )
        near = np.isfinite(bounds)
        assert np.all(bounds[near] >= exact[near])
        found += np.count_nonzero(near)
    assert found > len(CHOICES)


def hull_in(precision: type, coefficients: FloatArray) -> Hull:
    """Of bicubic leaves."""
    hull = bicubic_hull(coefficients)
    points = of_rows(_bicubic_rows(), coefficients.astype(precision))
    return replace(hull, points=points, spread=points[:0])


def of_rows(rows: FloatArray, coefficients: FloatArray) -> FloatArray:
    """In the precision of the coefficients."""
    return np.einsum("rk,kpi->rpi", rows.astype(coefficients.dtype), coefficients)


# Faces of other kinds: a hull has to hold the surface, and its rows for half a side the curve there.

LEVELS = 4


class Face:
    """The first face of a mesh whose sharpness is explicit: samples of its surface, their parameters in the quarters,
    one after the other, or in the whole quad; and facets over them."""

    def __init__(self, mesh: PolygonMesh) -> None:
        self.mesh, self.size = mesh, int(mesh.face_sizes[0])
        part = subdivide(submesh(mesh, np.array([0]))[0]).mesh
        parameters = np.concatenate([QUAD_POINTS[:4]] * self.size)
        part = submesh(part, np.arange(self.size))[0]
        for level in range(LEVELS):
            parameters = linear_children(part, parameters)
            part = submesh(subdivide(part).mesh, np.arange(self.size * 4 ** (level + 1)))[0]
        corners = part.corner_vertices[: 4 * self.size * 4**LEVELS]
        limits = limit_positions(part)
        self.surface, self.quads = limits[corners], np.arange(len(corners)).reshape(-1, 4)
        self.parameters, self.quarters = parameters, np.repeat(np.arange(self.size), 4 ** (LEVELS + 1))

    def point(self, quarter: int, parameters: tuple[float, float]) -> FloatArray:
        """(1, 3): of the surface."""
        here = (self.quarters == quarter) & np.all(self.parameters == parameters, axis=1)
        return self.surface[np.flatnonzero(here)[:1]]

    def curve(self, side: int, half: int) -> FloatArray:
        """(N, 3): the surface over a half side."""
        quarter, axis = (side, 1) if half == 0 else ((side + 1) % self.size, 0)
        return self.surface[(self.quarters == quarter) & (self.parameters[:, axis] == 0)]

    def points(self) -> FloatArray:
        """(2n, 1, 3): corners, then middles of sides."""
        corners = [self.point(quarter, (0, 0)) for quarter in range(self.size)]
        return np.stack(corners + [self.point(quarter, (1, 0)) for quarter in range(self.size)])


def is_beyond(points: FloatArray, hull: Hull, rows: IndexArray, directions: FloatArray) -> bool:
    """Whether points (N, 3) stand out from rows of the first leaf's hull in one of the directions (K, 3)."""
    room = np.abs(hull.spread[:, 0] @ directions.T).max(axis=0, initial=0.0)
    reached = hull.points[rows, 0] @ directions.T + np.where(hull.is_near[rows, None], room, 0.0)
    return bool(np.any((points @ directions.T).max(axis=0) > reached.max(axis=0) + ROUNDING))


def assert_holds(hull: Hull, face: Face) -> None:
    directions = np.random.default_rng(1).normal(size=(200, 3))
    assert not is_beyond(face.surface, hull, hull.parts.ravel(), directions)
    for side in range(face.size):
        for half in range(2):
            assert not is_beyond(face.curve(side, half), hull, hull.sides[side][half], directions)


def displaced(data: meshes.MeshData, seed: int, size: float) -> PolygonMesh:
    noise = np.random.default_rng(seed).normal(size=data.positions.shape) * size
    mesh = meshes.to_polygon_mesh(data)
    return apply_boundary_rule(mesh.changed(positions=data.positions + noise), smooth_corners=True)


@pytest.mark.parametrize("valence", [3, 5, 6, 12, 40])
def test_hulls_at_extraordinary_vertices(valence: int) -> None:
    face = Face(displaced(meshes.fan(valence, 2), valence, 0.1))
    nets = extraordinary_nets(face.mesh, np.array([0]), valence).reshape(2 * valence + 8, 1, 3)
    hull = extraordinary_hull(nets, (valence, 4, 4, 4))
    assert_holds(hull, face)
    # What the last square adds is small.
    assert hull.reach()[0] < 0.03 * np.ptp(face.surface, axis=0).max()


@pytest.mark.parametrize("valences", [(6, 4, 3, 4), (3, 3, 3, 3), (5, 3, 7, 4), (4, 4, 8, 6)])
def test_hulls_at_several_extraordinary_vertices(valences: Valences) -> None:
    face = Face(displaced(meshes.around_quad(valences), sum(valences), 0.05))
    hull = extraordinary_hull(quad_nets(face.mesh, np.array([0]), valences), valences)
    assert_holds(hull, face)
    assert hull.reach()[0] < 0.03 * np.ptp(face.surface, axis=0).max()
    assert_bounded(face, hull, templates(0)[0])


QUADS = {
    "boundary": lambda: meshes.landscape(2, 2),
    "creases": lambda: meshes.with_random_creases(meshes.landscape(3, 3), share=0.5),
    "two poles": meshes.cube,
}


FIRST = np.array([0])


@pytest.mark.parametrize("name", QUADS)
def test_hulls_of_irregular_quads(name: str) -> None:
    face = Face(displaced(QUADS[name](), 1, 0.05))
    corners = face.points()[:4]
    hull = hull_of_quads(Descent.of_quads(Refinement.start(face.mesh, FIRST)), FIRST, corners, 0.01)
    assert_holds(hull, face)
    assert_bounded(face, hull, templates(0)[0])


@pytest.mark.parametrize("valence", [3, 4, 5, 7])
def test_hulls_of_triangles(valence: int) -> None:
    face = Face(displaced(meshes.bipyramid(valence), valence, 0.05))
    corners = face.points()[:3]
    hull = hull_of_fans(Descent.of_fans(Refinement.start(face.mesh, FIRST)), FIRST, corners, 0.01)
    assert_holds(hull, face)
    assert_bounded(face, hull, ((0, 1, 2),))


@pytest.mark.parametrize("valence", [3, 4, 5, 7, 24])
def test_hulls_of_triangles_by_nets(valence: int) -> None:
    # At the first face, corners of this valence and of valence 4.
    face = Face(displaced(meshes.bipyramid(valence), valence, 0.05))
    nets = QuarterNets.of(Refinement.start(face.mesh, FIRST).refined().numbered())
    hull = nets.hull(FIRST)
    assert_holds(hull, face)
    assert hull.reach()[0] < 0.03 * np.ptp(face.surface, axis=0).max()
    assert_bounded(face, hull, ((0, 1, 2),))


@pytest.mark.parametrize("valence", [3, 5, 8])
def test_last_squares_alone_are_off_their_hulls(valence: int) -> None:
    """What lies over another part of a quad is in the hull of that part's own points."""
    face = Face(displaced(meshes.fan(valence, 2), valence, 0.2))
    nets = extraordinary_nets(face.mesh, np.array([0]), valence).reshape(2 * valence + 8, 1, 3)
    hull = extraordinary_hull(nets, (valence, 4, 4, 4))
    # Beside the extraordinary corner, the quarters at the others are the last parts.
    directions = np.random.default_rng(1).normal(size=(200, 3))
    for quarter, part in zip((1, 2, 3), hull.parts[-3:], strict=True):
        assert not np.any(hull.is_near[part])
        assert not is_beyond(face.surface[face.quarters == quarter], hull, part, directions)


def assert_bounded(face: Face, hull: Hull, template: Template) -> None:
    """With what is sampled along the normals."""
    points = face.points()
    leaves = Leaves.alike(points, [False] * face.size, template)
    normals = triangle_normals(points, template)[:, 0]
    off = [np.abs((face.surface - points[own[0], 0]) @ normal) for own, normal in zip(template, normals, strict=True)]
    bound = leaf_distances(leaves, hull, np.max(off, axis=(0, 1))[None], np.inf)[0]
    triangles = points[[list(own) for own in template], 0]
    facets = np.concatenate([face.quads[:, [0, 1, 2]], face.quads[:, [0, 2, 3]]])
    middles = face.surface[face.quads].mean(axis=1)
    missed = float(np.linalg.norm(face.surface[face.quads] - middles[:, None], axis=-1).max())
    assert np.isfinite(bound)
    assert_within(face.surface, facets, triangles, bound, missed)
