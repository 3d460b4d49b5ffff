# SPDX-License-Identifier: GPL-3.0-or-later
"""Control meshes that are flat, or nearly, or flat in parts take few faces, which Measure Deviation checks."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.planner import AdaptiveMesh, subdivide_adaptively
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import Transitions
from ccdepth_addon.core.arrays.types import BoolArray, FloatArray, IndexArray
from ccdepth_addon.core.deviation import measure_deviation
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes

pytestmark = pytest.mark.thorough

# Within a thousandth of a nearly flat pole of valence 16.
ENOUGH_AT_A_POLE = 1250

# The deviation is proved to a twentieth, with an allowance for rounding.
ACCURACY = 0.05


def explicit(data: meshes.MeshData) -> PolygonMesh:
    return apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True)


def sheet(size: int, *, as_triangles: bool, noise: float, seed: int = 1) -> meshes.MeshData:
    """A grid in one plane, its inner points moved about; every other quad cut along the other diagonal."""
    data = meshes.grid(size, size)
    generator = np.random.default_rng(seed)
    positions = data.positions.copy()
    positions[:, :2] += generator.uniform(-noise, noise, (len(positions), 2))
    if not as_triangles:
        return meshes.MeshData(positions, data.face_sizes, data.corner_vertices)
    quads = data.corner_vertices.reshape(-1, 4)
    turned = np.where(np.arange(len(quads))[:, None] % 2 == 0, quads, np.roll(quads, 1, axis=1))
    triangles = turned[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    return meshes.MeshData(positions, np.full(len(triangles), 3), triangles.ravel())


def uneven(data: meshes.MeshData) -> meshes.MeshData:
    """A grid in one plane, with spacing that grows both ways."""
    return meshes.MeshData((data.positions - data.positions.min(axis=0)) ** 2, data.face_sizes, data.corner_vertices)


def needles(each_side: int) -> meshes.MeshData:
    """A square, cut into triangles from its centre to as many parts of each side."""
    along = np.arange(each_side) / each_side
    sides = [np.column_stack([along, np.zeros((each_side, 2))])]
    for _ in range(3):
        sides.append([1, 0, 0] + sides[-1] @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    around = np.arange(4 * each_side)
    faces = [[0, 1 + i, 1 + (i + 1) % len(around)] for i in around.tolist()]
    return meshes.from_faces(np.concatenate([[[0.5, 0.5, 0.0]], *sides]), faces)


def turned(data: meshes.MeshData) -> meshes.MeshData:
    """By some angle in space, in single precision."""
    axes, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    return meshes.single_precision(meshes.MeshData(data.positions @ axes.T, data.face_sizes, data.corner_vertices))


def made(mesh: PolygonMesh, limit: float, transitions: Transitions = Transitions.TRIANGLES) -> AdaptiveMesh:
    request = AdaptiveRequest(limit, Mode.ADAPTIVE, transitions, 1_000_000)
    return subdivide_adaptively(mesh, request, mesh.positions)


def triangles_of(found: AdaptiveMesh) -> tuple[FloatArray, IndexArray]:
    """Quads along their first diagonals. Other polygons around the means of their vertices: in a plane these triangles
    cover what any others do (``tests/blender/test_adaptive_guarantee.py`` has Blender's)."""
    starts, vertices = found.mesh.face_starts, found.mesh.corner_vertices.astype(np.intp)
    sizes = np.diff(starts)
    triangles = [vertices[starts[:-1, None] + [0, 1, 2]][sizes <= 4]]
    triangles.append(vertices[starts[:-1][sizes == 4][:, None] + [0, 2, 3]])
    points = found.mesh.positions
    for size in np.unique(sizes[sizes > 4]).tolist():
        around = vertices[starts[:-1][sizes == size][:, None] + np.arange(size)]
        middles = np.broadcast_to(len(points) + np.arange(len(around))[:, None], around.shape)
        triangles.append(np.stack([around, np.roll(around, -1, axis=1), middles], axis=2).reshape(-1, 3))
        points = np.concatenate([points, points[around].mean(axis=1)])
    return points, np.concatenate(triangles)


def diagonal_of(mesh: PolygonMesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))


def assert_kept(mesh: PolygonMesh, found: AdaptiveMesh, limit: float) -> None:
    """Measure Deviation proves the limit, or as much of it as it can tell; and reaches none beyond it."""
    deviation = measure_deviation(mesh, *triangles_of(found), accuracy=ACCURACY, time_limit=120.0)
    assert deviation.accuracy_met
    assert deviation.reached <= limit
    assert deviation.proved <= (1 + ACCURACY) * limit
    assert found.bounds.max() <= limit


SHEETS = {
    "quads": lambda: sheet(8, as_triangles=False, noise=0.2),
    "uneven": lambda: uneven(sheet(8, as_triangles=False, noise=0.0)),
    "triangles": lambda: sheet(8, as_triangles=True, noise=0.2),
    "turned": lambda: turned(sheet(7, as_triangles=True, noise=0.2)),
    "turned over": lambda: sheet(5, as_triangles=True, noise=0.45, seed=3),
    "thin": lambda: meshes.MeshData(
        (data := sheet(6, as_triangles=True, noise=0.2)).positions * [1, 0.02, 1], data.face_sizes, data.corner_vertices
    ),
    "needles": lambda: needles(8),
    "hexagons": lambda: turned(meshes.hexagons(4, 6, 0.1)),
    "dented hexagons": lambda: turned(meshes.hexagons(4, 6, 0.3)),
}


@pytest.mark.parametrize("transitions", Transitions)
@pytest.mark.parametrize("name", SHEETS)
def test_flat_sheets_are_within_the_limit(name: str, transitions: Transitions) -> None:
    mesh = explicit(SHEETS[name]())
    limit = 3e-3 * diagonal_of(mesh)
    assert_kept(mesh, made(mesh, limit, transitions), limit)


@pytest.mark.parametrize("transitions", Transitions)
@pytest.mark.parametrize("name", ["triangles", "hexagons", "uneven"])
def test_what_is_flat_is_split_at_the_border_alone(name: str, transitions: Transitions) -> None:
    data = SHEETS[name]() if name != "hexagons" else turned(meshes.hexagons(7, 14, 0.1))
    mesh = explicit(data)
    found = made(mesh, 3e-3 * diagonal_of(mesh), transitions)
    at_border = np.zeros(mesh.vertex_count, dtype=bool)
    at_border[mesh.edge_vertices[mesh.edge_face_counts == 1]] = True
    near = touching(mesh, at_border)
    # Beside a face at the border one may be split once, for balance, and faces beside that have transitions.
    faces = np.bincount(found.mesh.base_faces, minlength=mesh.face_count)
    assert np.count_nonzero(faces[~near] == 1) > 0.8 * np.count_nonzero(~near)
    assert np.all(found.depths[~near[found.mesh.base_faces]] <= 2)


def touching(mesh: PolygonMesh, vertices: BoolArray) -> BoolArray:
    """(F,) which faces have one of some vertices (V,)."""
    found: BoolArray = np.logical_or.reduceat(vertices[mesh.corner_vertices], mesh.face_starts[:-1])
    return found


def test_a_bump_is_no_flat_part() -> None:
    """Faces are divided where the surface is lifted; far from there and from the border none is."""
    data = sheet(12, as_triangles=False, noise=0.0)
    positions = data.positions.copy()
    middle = np.linalg.norm(positions[:, :2] - positions[:, :2].mean(axis=0), axis=1).argmin()
    positions[middle, 2] = 0.5
    mesh = explicit(meshes.MeshData(positions, data.face_sizes, data.corner_vertices))
    limit = 5e-4 * diagonal_of(mesh)
    found = made(mesh, limit)
    assert_kept(mesh, found, limit)
    lifted = np.zeros(mesh.vertex_count, dtype=bool)
    lifted[middle] = True
    counts = np.bincount(found.mesh.base_faces, minlength=mesh.face_count)
    assert np.all(counts[touching(mesh, lifted)] >= 4)
    for _ in range(3):
        lifted[mesh.corner_vertices[np.repeat(touching(mesh, lifted), 4)]] = True
    far = ~touching(mesh, lifted)
    # Beside the sheet's corners, which are round, some are divided.
    assert np.mean(counts[far] == 1) > 0.7


def test_a_nearly_flat_pole_needs_few_faces() -> None:
    """Sixteen quads around a vertex on a paraboloid, so flat that hardly anything is off but along the surface."""
    data = meshes.fan(16, 1)
    data.positions[:, 2] = -0.05 * (data.positions[:, :2] ** 2).sum(axis=1)
    mesh = explicit(data)
    found = made(mesh, 1e-3)
    assert_kept(mesh, found, 1e-3)
    assert len(found.bounds) <= ENOUGH_AT_A_POLE


@pytest.mark.parametrize(("part", "enough"), [(1e-3, 281), (3e-4, 608)])
def test_a_bent_plate_needs_few_faces(part: float, enough: int) -> None:
    """An uneven grid, flat but for an end."""
    mesh = explicit(meshes.bent_plate())
    limit = part * diagonal_of(mesh)
    found = made(mesh, limit)
    assert_kept(mesh, found, limit)
    assert len(found.bounds) <= enough
