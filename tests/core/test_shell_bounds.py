# SPDX-License-Identifier: GPL-3.0-or-later
"""Places in shells, piece by piece: pieces moved anywhere, against distances by quadratic programming."""

from itertools import combinations_with_replacement
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccdepth_addon.core.distance.leaf_surfaces import support_points
from ccdepth_addon.core.distance.piece_hulls import SIDES, Pieces
from ccdepth_addon.core.distance.pieces import TRIANGLE_FORM
from ccdepth_addon.core.distance.shell_bounds import shell_bounds
from ccdepth_addon.core.distance.shells import JoinedTriangles, Shell
from ccdepth_addon.core.distance.side_bounds import Beside, raised_at_sides
from ccdepth_addon.core.mesh.level_quads import QUAD_TRIANGLES
from ccdepth_addon.core.surface.triangle_coefficients import bicubic_basis
from tests import meshes
from tests.triangle_distances import distances

SIDE = 5

# Barycentric coordinates of parts of a triangle: all of it, its corners, its sides' middles, its middle.
PARTS = np.array(
    [
        np.eye(3),
        [[1, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5]],
        [[0.5, 0.5, 0], [0, 1, 0], [0, 0.5, 0.5]],
        [[0.5, 0, 0.5], [0, 0.5, 0.5], [0, 0, 1]],
        [[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]],
        [[0.4, 0.3, 0.3], [0.3, 0.4, 0.3], [0.3, 0.3, 0.4]],
    ]
)

# The places of the Bernstein coefficients of total degree 6.
DEGREE_6 = [[each.count(corner) / 6 for corner in range(3)] for each in combinations_with_replacement(range(3), 6)]


def landscape(bumps: float, seed: int, limit: float = 1.0, away: float = 0.0) -> Shell:
    """Over a grid of quads with bumps, up to a limit, so far from the origin."""
    generator = np.random.default_rng(seed)
    mesh = meshes.to_polygon_mesh(meshes.grid(SIDE, SIDE))
    positions = mesh.positions + generator.normal(size=mesh.positions.shape) * [0.15, 0.15, bumps] + away
    mesh = mesh.changed(positions=positions)
    is_turned = generator.random(mesh.face_count) < 0.5
    quads = mesh.corner_vertices.reshape(-1, 4)
    vertices = np.take_along_axis(quads[:, None], QUAD_TRIANGLES[is_turned.astype(int)], axis=2).reshape(-1, 3)
    triangles = JoinedTriangles.of(mesh.positions[vertices], vertices)
    return Shell.of(triangles, np.ones(mesh.vertex_count, dtype=bool), np.full(len(vertices), limit))


def moved_pieces(shell: Shell, size: float, seed: int) -> Pieces:
    """Parts of all triangles, every one moved by a vector of about that size, and bent by a tenth of that."""
    generator = np.random.default_rng(seed)
    count = len(shell.triangles.vertices)
    flats = np.einsum("pkc,tcd->tpkd", PARTS, shell.triangles.corners[:count]).reshape(-1, 3, 3)
    away = generator.normal(size=(len(flats), 1, 3)) * size * generator.random((len(flats), 1, 1)) ** 2
    hulls = flats + away + generator.normal(size=flats.shape) * size / 10
    return Pieces(np.repeat(np.arange(count), len(PARTS)), hulls.swapaxes(0, 1), flats.swapaxes(0, 1))


@given(
    bumps=st.sampled_from([0.0, 0.05, 0.2, 0.5]),
    size=st.sampled_from([0.01, 0.05, 0.2, 0.6]),
    seed=st.integers(0, 10_000),
)
def test_no_point_of_a_piece_is_farther_than_its_bound(bumps: float, size: float, seed: int) -> None:
    """Corners, middles and averages of the hull: all of them are points of the piece, if it is flat."""
    shell = landscape(bumps, seed)
    pieces = moved_pieces(shell, size, seed + 1)
    bounds = shell_bounds(shell, pieces)
    placed = np.flatnonzero(np.isfinite(bounds))
    weights = np.concatenate([np.eye(3), np.full((1, 3), 1 / 3), (1 - np.eye(3)) / 2])
    points = np.einsum("rk,kpd->prd", weights, pieces.hulls[:, placed])
    real = np.arange(3 * len(shell.triangles.vertices)).reshape(-1, 3)
    off = distances(points.reshape(-1, 3), shell.triangles.corners.reshape(-1, 3), real, 0.0)
    assert np.all(off.reshape(points.shape[:2]).max(axis=1) <= bounds[placed] * (1 + 1e-9) + 1e-12)


@pytest.mark.parametrize(
    ("slope", "columns", "hull"),
    [
        (0.1, [-2, -1, 0, 1, 2], [(-0.09, 0), (0.0012, -0.0195), (-0.09, 0), (-0.09, 0)]),
        (0.0, [0, 1, 2], [(-0.0097, 0), (0.000001, -0.019), (-0.0097, -0.001), (-0.0097, 0)]),
    ],
    ids=["beside a fold", "beside a border"],
)
def test_hulls_higher_than_their_surface_count_at_walls(
    slope: float, columns: list[int], hull: list[tuple[float, float]]
) -> None:
    """All coefficients of a bicubic piece but those just inside the side are beyond the side at x = 0."""
    positions = np.array([[x, y, slope * max(-x, 0)] for y in (-1.5, -0.5, 0.5, 1.5) for x in columns])
    count = len(columns)
    first = (np.arange(3)[:, None] * count + np.arange(count - 1)).reshape(-1, 1, 1)
    vertices = (first + np.array([[0, 1, count + 1], [0, count + 1, count]])).reshape(-1, 3)
    limits = np.full(len(vertices), 0.01)
    shell = Shell.of(JoinedTriangles.of(positions[vertices], vertices), np.ones(len(positions), dtype=bool), limits)
    corners = positions[vertices]
    own = (corners[..., 0].min(axis=1) == 0) & (np.abs(corners[..., 1]).max(axis=1) < 1)
    own &= np.count_nonzero(corners[..., 0] == 0, axis=1) == 2
    points = np.array([[x, 0.01 * j / 3, z] for x, z in hull for j in range(4)])
    flats = np.array([[0.01 + 0.05 * i / 3, 0.01 * j / 3, 0] for i in range(4) for j in range(4)])
    bound = shell_bounds(shell, Pieces(np.flatnonzero(own)[:1], points[:, None], flats[:, None]))[0]
    places = np.stack(np.meshgrid(np.linspace(0, 1, 101), [0.0, 0.5, 1.0]), axis=-1).reshape(-1, 2)
    assert distances(bicubic_basis(places) @ points, positions, vertices, 0.0).max() <= bound


@pytest.mark.parametrize(("bumps", "seed"), [(0.05, 5), (0.2, 5), *((0.5, seed) for seed in range(5))])
def test_no_prism_is_turned_inside_out(bumps: float, seed: int) -> None:
    """At any height within its range its triangle faces the way of the vectors at all three corners."""
    shell = landscape(bumps, seed, limit=100.0)
    count = len(shell.ranges)
    corners, vectors = shell.triangles.corners[:count], shell.triangles.vectors[:count]
    for share in np.linspace(-1, 1, 9):
        a, b, c = (corners + share * shell.ranges[:, None, None] * vectors).swapaxes(0, 1)
        faces = np.einsum("nd,nkd->nk", np.cross(b - a, c - a), vectors)
        assert np.all(faces[shell.ranges > 0] > 0)
    assert np.count_nonzero(shell.ranges) > count / 2
    assert shell.ranges.max() < 100.0


def test_most_pieces_that_are_near_have_places() -> None:
    shell = landscape(0.05, 1)
    inside = ~np.any(shell.is_border[shell.triangles.vertices], axis=1)
    near = np.isfinite(shell_bounds(shell, moved_pieces(shell, 0.02, 2))).reshape(-1, len(PARTS))
    assert near[inside].mean() > 0.9


@pytest.mark.parametrize("away", [0.0, 1e6])
@pytest.mark.parametrize("by_maps", [False, True])
def test_ways_from_sides_to_another_comparison_count(by_maps: bool, away: float) -> None:
    """Also where points that are drawn on a side are off it by more than its size tells, being far from the origin."""
    shell, lift = landscape(0.05, 3, away=away), 0.1
    count = len(shell.triangles.vertices)
    corners, normals = shell.triangles.corners[:count], shell.triangles.normals[:count]
    flats = np.array(DEGREE_6) @ corners
    lifted = (flats + lift * normals[:, None]).swapaxes(0, 1)
    pieces = Pieces(np.arange(count), lifted, flats.swapaxes(0, 1)).divided(TRIANGLE_FORM.quarters)
    is_open = ~shell.triangles.is_closed
    beside = Beside(np.where(is_open & (not by_maps), 1.0, np.inf), is_open & by_maps)
    found = raised_at_sides(shell, pieces, np.zeros(4 * count), beside).reshape(4, count)
    # Three quarters of a triangle are at each side together, two of them at one side.
    is_raised = found[:3] >= lift / 2
    assert np.all(is_raised[:, is_open.all(axis=1)])


@pytest.mark.parametrize(("bumps", "size"), [(0.0, 0.3), (0.1, 0.05), (0.1, 0.2), (0.3, 0.1)])
def test_ways_from_all_of_a_side_to_a_map_are_near_the_two_triangles_there(bumps: float, size: float) -> None:
    """Of surfaces that are bent any way between the triangles' corners, of total degree 6."""
    shell, generator = landscape(bumps, 7), np.random.default_rng(8)
    triangles, count = shell.triangles, len(shell.triangles.vertices)
    flats = (np.array(DEGREE_6) @ triangles.corners[:count]).swapaxes(0, 1)
    moved = generator.normal(size=flats.shape) * size * generator.random((count, 1)) ** 2
    moved[[0, 21, 27]] = 0.0
    pieces = Pieces(np.arange(count), flats + moved, flats)
    found = raised_at_sides(shell, pieces, np.zeros(count), Beside(np.full((count, 3), np.inf), ~triangles.is_closed))
    inner = np.flatnonzero(~triangles.is_closed.any(axis=1) & np.isfinite(found))
    assert len(inner) > 3
    shares = np.linspace(0.0, 1.0, 7)
    basis = np.stack([comb(6, k) * shares**k * (1 - shares) ** (6 - k) for k in range(7)], axis=1)
    for own in inner.tolist():
        for side, (_, _, rows) in enumerate(SIDES[28]):
            start, end = triangles.corners[own, [side, (side + 1) % 3]]
            on_side, curve = start + shares[:, None] * (end - start), basis @ pieces.hulls[rows, own]
            ways = (1 - shares[:, None, None, None]) * on_side[:, None] + shares[:, None, None, None] * curve[
                :, None, None
            ]
            near = triangles.corners[[own, triangles.across[own, side]]].reshape(-1, 3)
            off = distances(ways.reshape(-1, 3), near, np.arange(6).reshape(2, 3), 0.0)
            assert off.max() <= found[own] * (1 + 1e-9)


@pytest.mark.parametrize("bumps", [0.0, 0.2])
def test_what_is_moved_beyond_the_triangles_around_has_no_place(bumps: float) -> None:
    """Along the surface, by three quads: its height over its own triangle proves nothing."""
    shell = landscape(bumps, 3)
    pieces = moved_pieces(shell, 0.0, 4)
    far = Pieces(pieces.triangles, pieces.hulls + np.array([3.0, 0.0, 0.0]), pieces.flats)
    assert np.all(np.isinf(shell_bounds(shell, far)))


@pytest.mark.parametrize("valence", [12, 100])
def test_hulls_around_a_vertex_hold_all_faces_there(valence: int) -> None:
    """At a large valence that is a box: no direction in which a control point is beyond it."""
    generator = np.random.default_rng(6)
    mesh = meshes.to_polygon_mesh(meshes.bumpy(meshes.fan(valence, 2), 0.2))
    faces = np.flatnonzero(np.any(mesh.corner_vertices.reshape(-1, 4) == mesh.vertex_face_counts.argmax(), axis=1))
    hulls = support_points(mesh, faces)
    touching = np.isin(mesh.corner_vertices.reshape(-1, 4), mesh.corner_vertices.reshape(-1, 4)[faces]).any(axis=1)
    assert np.count_nonzero(touching) > len(faces) == valence
    for direction in generator.normal(size=(50, 3)):
        reached = mesh.positions[mesh.corner_vertices.reshape(-1, 4)[faces].ravel()] @ direction
        assert np.all((hulls @ direction).max(axis=0) >= reached.max() - 1e-12)
    assert len(hulls) <= 2 * min(valence, 12) + 8 + 8
