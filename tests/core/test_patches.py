# SPDX-License-Identifier: GPL-3.0-or-later
"""Control nets: which points they hold, and that the surface they stand for is the limit surface."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from ccdepth_addon.core.deviation.extraordinary_pieces import (
    LEVELS,
    children_of_nets,
    largest_rest,
    near_points,
    piece_stencils,
    pieces_of_nets,
)
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.bicubic import CORNERS, NET_TO_BERNSTEIN
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.patches import PatchKind, classify_patches, regular_nets
from ccdepth_addon.core.surface.stencils import patch_stencils
from ccdepth_addon.core.surface.triangle_coefficients import bicubic_basis
from tests import meshes, nets
from tests.brute_force import quad_places
from tests.core.test_foot_bounds import derivative
from tests.meshes import build

ROUNDING = 1e-13


MIDDLE, AT_MIDDLE, AT_EDGE = 24, [14, 15, 20, 21], [14, 15, 16, 20, 21, 22]


@pytest.mark.parametrize(
    ("edges", "vertices", "smooth_corners", "irregular"),
    [
        ({}, {}, False, []),
        ({}, {}, True, [0, 5, 30, 35]),
        ({}, {MIDDLE: 0.3}, False, AT_MIDDLE),
        ({}, {MIDDLE: 1.0}, False, AT_MIDDLE),
        ({(MIDDLE, MIDDLE + 1): 0.3}, {}, False, AT_EDGE),
        ({(MIDDLE, MIDDLE + 1): 1.0}, {}, False, AT_EDGE),
    ],
)
def test_features_make_faces_irregular(
    edges: meshes.EdgeCreases, vertices: dict[int, float], smooth_corners: bool, irregular: list[int]
) -> None:
    """A round corner, a semi-sharp or fixed vertex, a semi-sharp edge and a crease's end each spoil the faces at their
    vertices; all others of a grid are regular."""
    data = meshes.creased(meshes.landscape(6, 6), edges, vertices)
    kinds = classify_patches(build(data, smooth_corners=smooth_corners)).kinds
    expected = np.where(np.isin(np.arange(36), irregular), PatchKind.IRREGULAR, PatchKind.REGULAR)
    np.testing.assert_array_equal(kinds, expected)


def test_quads_beside_triangles_are_irregular() -> None:
    """Also where they meet the triangles in a vertex of four faces alone."""
    data = meshes.landscape(6, 6)
    faces = [face.copy() for face in data.faces]
    a, b, c, d = faces.pop(14)
    mesh = build(meshes.from_faces(data.positions, [*faces, [a, b, c], [a, c, d]]), smooth_corners=False)
    beside = np.array([bool({a, b, c, d} & set(face)) for face in faces] + [True, True])
    kinds = classify_patches(mesh).kinds
    np.testing.assert_array_equal(kinds, np.where(beside, PatchKind.IRREGULAR, PatchKind.REGULAR))


def creased_lines() -> tuple[meshes.MeshData, meshes.MeshData]:
    """A landscape with a sharp line right across, and with two; there a corner in each sector where they meet."""
    row = {(3 * 7 + x, 3 * 7 + x + 1): 1.0 for x in range(6)}
    column = {(7 * y + 2, 7 * y + 9): 1.0 for y in range(6)}
    landscape = meshes.landscape(6, 6)
    return meshes.creased(landscape, row), meshes.creased(landscape, row | column)


def row_with_triangles() -> meshes.MeshData:
    """A row of quads between two borders, one of them cut in two."""
    data = meshes.landscape(5, 1)
    first, (a, b, c, d), *others = data.faces
    return meshes.from_faces(data.positions, [first, *others, [a, b, c], [a, c, d]])


def creased_around_a_pole() -> meshes.MeshData:
    """A closed mesh with a sharp line past a vertex of valence 6, three faces on one side."""
    fan = meshes.fan(6, 3)
    sides = [edge for edge in fan.edges.tolist() if 0 in edge]
    return meshes.creased(fan, {(0, sides[0][1]): 1.0, (0, sides[2][1]): 1.0})


WITH_REGULAR_FACES = ("landscape", "single quad", "fin through", "flipped face", "soup", "soup with random creases")
FEATURES: dict[str, Callable[[], PolygonMesh]] = {
    **{name: partial(build, meshes.AWKWARD[name](), smooth_corners=False) for name in WITH_REGULAR_FACES},
    "boundary": lambda: build(meshes.landscape(4, 3)),
    "one row": lambda: build(meshes.landscape(4, 1), smooth_corners=False),
    "crease": lambda: build(creased_lines()[0]),
    "row with triangles": lambda: build(row_with_triangles(), smooth_corners=False),
    "crossing creases": lambda: build(creased_lines()[1], smooth_corners=False),
    "creased valence 6": lambda: build(creased_around_a_pole()),
    "random creases": lambda: build(meshes.with_random_creases(meshes.landscape(8, 8), share=0.1)),
    "closed": lambda: nets.refined(build(meshes.trapezohedron(5)), 2),
    "all edges sharp": lambda: build(
        meshes.creased(meshes.landscape(3, 3), {(int(a), int(b)): 1.0 for a, b in meshes.landscape(3, 3).edges})
    ),
}


@pytest.mark.parametrize("name", FEATURES)
def test_nets_are_the_surface(name: str) -> None:
    mesh = FEATURES[name]()
    faces = np.flatnonzero(classify_patches(mesh).kinds == PatchKind.REGULAR)
    assert len(faces)
    net, fine = regular_nets(mesh, faces), nets.refined(mesh, 3)
    corners = 4**3 * mesh.face_starts[faces, None] + np.arange(4**4)
    found = limit_positions(fine)[fine.corner_vertices[corners]]
    np.testing.assert_allclose(found.swapaxes(0, 1), derivative(net, quad_places(3), 0, 0), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("valence", [5, 54, 55, 64, 130])
def test_few_columns_and_fourier_transforms_give_what_matrices_give(valence: int) -> None:
    """The net of a child, the coefficients of its pieces, and all points that bound their excess."""
    net = np.random.default_rng(valence).normal(size=(2 * valence + 8, 3, 3))
    whole = patch_stencils(valence)
    refined, regular = children_of_nets(net, valence)
    np.testing.assert_allclose(refined, np.tensordot(whole.refined, net, 1), rtol=0, atol=ROUNDING)
    wanted = np.stack([NET_TO_BERNSTEIN @ each for each in np.split(whole.regular, 3)])
    np.testing.assert_allclose(regular, np.einsum("cij,jpd->pcdi", wanted, net), rtol=0, atol=10 * ROUNDING)
    coefficients, middles, excess = pieces_of_nets(net, valence, lambda: None)
    stencils, power = piece_stencils(valence), np.linalg.matrix_power(whole.refined, LEVELS)
    points = near_points(net, valence)
    rest = np.tensordot(power - whole.limits[0], net, 1)
    found = largest_rest(stencils, net, points)
    np.testing.assert_allclose(found, np.linalg.norm(rest, axis=2).max(axis=0), rtol=0, atol=ROUNDING)
    rows = [np.tensordot(each, points, 1) for each in (stencils.apart, stencils.piece)]
    apart, piece, rest = (np.linalg.norm(each, axis=2).max(axis=0) for each in (*rows, rest))
    np.testing.assert_allclose(excess, np.maximum(apart, rest + piece), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(coefficients[:, :, CORNERS], np.einsum("ij,jpd->pdi", whole.limits, net), atol=1e-12)
    np.testing.assert_allclose(middles, regular[:, 1, :, CORNERS[2]], rtol=0, atol=ROUNDING)
    # Middles of regular parts of the surface, beside points of the piece with the same parameters.
    for level in range(LEVELS):
        refined, regular = children_of_nets(net, valence)
        places = np.array([[0.5, 0.5], [0.75, 0.75]]) * [[1], [0.5**level]]
        at_middle, at_place = bicubic_basis(places)
        assert np.all(np.linalg.norm(regular[:, 1] @ at_middle - coefficients @ at_place, axis=1) <= excess)
        net = refined
