# SPDX-License-Identifier: GPL-3.0-or-later
"""Depths of meshes with like parts: found of one of each, and proved for all of them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from ccdepth_addon.core.depth import like_parts as module
from ccdepth_addon.core.depth.face_depths import face_depths, uniform_level
from ccdepth_addon.core.depth.like_parts import LikeParts, like_parts
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from tests import meshes
from tests.drawn_levels import OFF, Level, sampled
from tests.thorough import cases

# The distance between rows of parts: their coordinates are rounded differently.
APART = 6.7


def joined(parts: list[meshes.MeshData]) -> PolygonMesh:
    """Several meshes as one, in single precision."""
    whole = parts[0]
    for part in parts[1:]:
        whole = meshes.welded(whole, part, {})
    return meshes.build(meshes.single_precision(whole))


def rows(data: meshes.MeshData, count: int, apart: float = APART) -> PolygonMesh:
    return joined([meshes.moved(data, 3 + apart * place, 0.7 * place, 0.1 * place) for place in range(count)])


def look(mesh: PolygonMesh) -> LikeParts:
    return like_parts(mesh, np.inf, 1e-3)


PARTS: dict[str, Callable[[], meshes.MeshData]] = {
    "bumpy cube": lambda: meshes.bumpy(meshes.cube(), 0.2, 3),
    "creased cube": meshes.creased_cube,
    "landscape": lambda: meshes.landscape(4, 4, 2),
    "hexagons": lambda: meshes.hexagons(2, 2, 0.2, 1),
    "tetrahedron": lambda: meshes.bumpy(meshes.tetrahedron(), 0.1, 2),
    "bow tie": meshes.bow_tie,
}


@pytest.mark.parametrize("name", PARTS)
def test_copies_of_a_part_have_its_faces_and_vertices(name: str) -> None:
    mesh = rows(PARTS[name](), 5)
    found, count = look(mesh), mesh.face_count // 5
    np.testing.assert_array_equal(found.faces, np.tile(np.arange(count), 5))
    assert found.mesh.face_count == count
    own = [positions - positions.mean(axis=0) for positions in np.split(mesh.positions, 5)]
    # Both are moved by their middles here, which is up to twice as far from the best.
    assert max(np.linalg.norm(each - own[0], axis=1).max() for each in own) <= 2 * found.off
    assert found.off <= 2.0**-22 * np.linalg.norm(np.abs(mesh.positions).max(axis=0))


def test_parts_that_differ_in_anything_are_not_alike() -> None:
    cube = meshes.cube()
    turned = replace(cube, corner_vertices=np.roll(cube.corner_vertices, 4))
    for other in (
        meshes.bumpy(cube, 1e-3, 1),
        meshes.creased(cube, {(0, 1): 0.5}),
        meshes.creased(cube, {}, {0: 0.5}),
        turned,
    ):
        mesh = joined([meshes.moved(part, 4 * place) for place, part in enumerate((cube, other, cube, cube))])
        np.testing.assert_array_equal(look(mesh).faces, [*range(12), *range(6), *range(6)])
        assert look(joined([cube, meshes.moved(other, 4)])).mesh.face_count == 12


def test_what_shares_a_vertex_is_one_part() -> None:
    strip = meshes.grid(6, 1)
    assert look(meshes.build(strip)).mesh.face_count == 6
    both = meshes.welded(meshes.cube(), meshes.moved(meshes.cube(), 2), {1: 0})
    assert look(meshes.build(both)).mesh.face_count == 12


@pytest.mark.parametrize(
    ("name", "vertices", "share"),
    cases(
        [(name, vertices, share) for name in PARTS for vertices in Vertices for share in (1e-2, 1e-3)],
        [(name, Vertices.LIMIT, 1e-2) for name in PARTS] + [("bumpy cube", Vertices.CONTROL, 1e-3)],
    ),
)
def test_depths_hold_for_every_copy_and_are_those_without_like_parts(
    name: str, vertices: Vertices, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = rows(PARTS[name](), 4)
    tolerance = share * meshes.diagonal(mesh)
    found = face_depths(mesh, tolerance, "DISTANCE", vertices)
    level = uniform_level(mesh, tolerance, "DISTANCE", vertices, found)
    monkeypatch.setattr(module, "LARGEST_SHARE", 0.0)
    assert look(mesh).mesh is mesh
    alone = face_depths(mesh, tolerance, "DISTANCE", vertices)
    # Like parts take less than this share of the tolerance.
    tighter = face_depths(mesh, (1 - 2.0**-7) * tolerance, "DISTANCE", vertices)
    deepest = tighter.depths.reshape(4, -1).max(axis=0)
    assert np.all(found.depths <= np.tile(deepest, 4))
    assert np.all(found.depths[found.exact] <= alone.depths[found.exact])
    assert level <= uniform_level(mesh, tolerance, "DISTANCE", vertices, tighter)
    assert np.all(found.bounds <= tolerance)
    there, back, step = sampled(mesh, max(level, 1), vertices)
    assert max(there.max() - OFF * step, back.max()) <= tolerance


def corner_distances(mesh: PolygonMesh) -> FloatArray:
    """(V,): the distances of the control points of cubes from their limits: 9 parts of a point, 4 of its neighbours and
    1 of the opposite corners of its faces, in 24 (Halstead and others, 1993)."""
    found = []
    for vertex, point in enumerate(mesh.positions):
        corners = np.flatnonzero(mesh.corner_vertices == vertex)
        sides = np.concatenate([mesh.next_corner[corners], mesh.previous_corner[corners]])
        beside = np.unique(mesh.corner_vertices[sides])
        across = mesh.corner_vertices[mesh.next_corner[mesh.next_corner[corners]]]
        limit = (9 * point + 4 * mesh.positions[beside].sum(axis=0) + mesh.positions[across].sum(axis=0)) / 24
        found.append(np.linalg.norm(limit - point))
    return np.array(found)


def test_the_distances_of_copies_include_the_differences_of_vertices() -> None:
    """Of copies pulled at a corner, one at a time, by less than single precision shows."""
    cube, size = meshes.cube(), 1.5
    mesh = joined([meshes.moved(cube, 3 * size * place) for place in range(3)])
    steps = 2.0**-23 * np.abs(mesh.positions).max()
    mesh.positions[8 + 7] += steps * np.sign(mesh.positions[7])
    mesh.positions[16 + 3] += steps * np.sign(mesh.positions[3])
    parts = like_parts(mesh, np.inf, 1e-3)
    assert parts.mesh.face_count == 6
    farthest = corner_distances(mesh)
    assert np.ptp(farthest) > 0.5 * steps
    # The tolerance lies between the distance of the first cube and those of the others.
    tolerance = (farthest[:8].max() + farthest.max()) / 2
    found = face_depths(mesh, tolerance, "DISTANCE", "CONTROL")
    beyond = np.unique(mesh.corner_faces[np.isin(mesh.corner_vertices, np.flatnonzero(farthest > tolerance))])
    assert len(beyond) == 6
    assert np.all(found.depths[beyond] > 0)


def test_copies_near_one_another_are_looked_at_together() -> None:
    """Copies that lie upon one another, a little apart: triangles of one are within the tolerance of the other."""
    data = meshes.landscape(3, 3, 4)
    size = meshes.diagonal(data)
    tolerance = 0.05
    near = joined([meshes.moved(data, 0, 0, 0.06 * place) for place in range(8)])
    far = joined([meshes.moved(data, 0, 0, 2 * size * place) for place in range(8)])
    assert like_parts(near, np.inf, tolerance).mesh is near
    assert like_parts(far, np.inf, tolerance).mesh.face_count == 9
    found, alone = (face_depths(mesh, tolerance, "DISTANCE", "CONTROL") for mesh in (near, far))
    assert alone.exact.mean() > found.exact.mean()
    for mesh, depths in ((near, found), (far, alone)):
        back = sampled(mesh, 0, Vertices.CONTROL)[1]
        # Samples miss the farthest points by less than the distance changes over a sixteenth of a face.
        assert np.all(back[depths.exact & (depths.depths == 1)] > 0.9 * tolerance)
    assert np.any(sampled(near, 0, Vertices.CONTROL)[1][alone.exact & (alone.depths == 1)] < 0.9 * tolerance)


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_copies_without_the_neighbour_of_the_first_part_are_as_near_as_proved(share: float) -> None:
    """The first part lies on its own finer mesh, which is within the tolerance of its surface; the others are alone."""
    data = meshes.landscape(4, 4, 2)
    finer = Level(meshes.build(data)).refined().mesh
    support = meshes.from_faces(finer.positions, finer.corner_vertices.reshape(-1, 4).tolist())
    size = meshes.diagonal(data)
    mesh = joined([data, support, *(meshes.moved(data, 3 * size * place) for place in range(1, 9))])
    there, back, _ = sampled(mesh, 0, Vertices.CONTROL)
    tolerance = share * float(np.maximum(there, back)[-16:].max())
    found = face_depths(mesh, tolerance, "DISTANCE", "CONTROL")
    own = np.maximum(there, back)[-16:]
    assert np.all(found.depths[-16:][own > tolerance] > 0)
    level = uniform_level(mesh, tolerance, "DISTANCE", "CONTROL", found)
    there, back, step = sampled(mesh, level, Vertices.CONTROL)
    assert max(back.max(), there.max() - 2 * step) <= tolerance
