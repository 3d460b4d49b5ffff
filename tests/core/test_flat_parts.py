# SPDX-License-Identifier: GPL-3.0-or-later
"""Flat parts of control meshes: which they are, and adaptive meshes over them, which Measure Deviation checks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ccdepth_addon.core.adaptive import neighbour_bounds, planner
from ccdepth_addon.core.adaptive.cells.cell_store import in_blocks
from ccdepth_addon.core.adaptive.flat_parts import NONE, FlatParts
from ccdepth_addon.core.adaptive.leaf_approximation import LeafApproximation
from ccdepth_addon.core.adaptive.plan import Plan
from ccdepth_addon.core.adaptive.planner import AdaptiveMesh, subdivide_adaptively
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import Transitions
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.deviation import measure_deviation
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.progress import no_report
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes

pytestmark = pytest.mark.thorough

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
    "triangles": lambda: sheet(8, as_triangles=True, noise=0.2),
    "turned": lambda: turned(sheet(7, as_triangles=True, noise=0.2)),
    "turned over": lambda: sheet(5, as_triangles=True, noise=0.45, seed=3),
    "thin": lambda: meshes.MeshData(
        (data := sheet(6, as_triangles=True, noise=0.2)).positions * [1, 0.02, 1], data.face_sizes, data.corner_vertices
    ),
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
@pytest.mark.parametrize("name", ["triangles", "hexagons"])
def test_what_is_flat_is_split_at_the_border_alone(name: str, transitions: Transitions) -> None:
    data = sheet(8, as_triangles=True, noise=0.2) if name == "triangles" else turned(meshes.hexagons(7, 14, 0.1))
    mesh = explicit(data)
    found = made(mesh, 3e-3 * diagonal_of(mesh), transitions)
    at_border = np.zeros(mesh.vertex_count, dtype=bool)
    at_border[mesh.edge_vertices[mesh.edge_face_counts == 1]] = True
    near = np.logical_or.reduceat(at_border[mesh.corner_vertices], mesh.face_starts[:-1])
    inner = ~near
    # Beside a face at the border one may be split once, for balance, and faces beside that have transitions.
    faces = np.bincount(found.mesh.base_faces, minlength=mesh.face_count)
    assert np.count_nonzero(faces[inner] == 1) > 0.8 * np.count_nonzero(inner)
    assert np.all(found.depths[~near[found.mesh.base_faces]] <= 2)


def test_a_bump_is_no_flat_part() -> None:
    data = sheet(12, as_triangles=False, noise=0.0)
    positions = data.positions.copy()
    middle = np.linalg.norm(positions[:, :2] - positions[:, :2].mean(axis=0), axis=1).argmin()
    positions[middle, 2] = 0.5
    mesh = explicit(meshes.MeshData(positions, data.face_sizes, data.corner_vertices))
    parts = FlatParts.of(mesh, 1e-2)
    # The faces at the bump, and those around them, whose surface it lifts.
    lifted = np.any(mesh.corner_vertices.reshape(-1, 4) == middle, axis=1)
    touched = np.isin(mesh.corner_vertices.reshape(-1, 4), mesh.corner_vertices.reshape(-1, 4)[lifted]).any(axis=1)
    np.testing.assert_array_equal(parts.parts == NONE, touched)
    assert len(np.unique(parts.parts[~touched])) == 1
    limit = 2e-3 * diagonal_of(mesh)
    assert_kept(mesh, made(mesh, limit), limit)


def test_planes_of_a_cube_are_parts_of_their_own() -> None:
    """A cube of 6 × 16 squares: of each side the inner four squares lie flat with all around them."""
    mesh = explicit(fine_cube())
    parts = FlatParts.of(mesh, 1e-2)
    counts = np.bincount(parts.parts[parts.parts != NONE])
    assert sorted(counts[counts > 0].tolist()) == [4] * 6
    for part in np.unique(parts.parts[parts.parts != NONE]).tolist():
        assert np.sort(np.abs(parts.normals[part])).tolist() == pytest.approx([0, 0, 1])
        assert parts.thicknesses[part] < 1e-12


def fine_cube() -> meshes.MeshData:
    along = np.linspace(-1, 1, 5)
    points, faces = {}, []
    for axis in range(3):
        for side in (-1.0, 1.0):
            for i in range(4):
                for j in range(4):
                    corners = [(along[i + a], along[j + b]) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
                    places = [tuple(np.roll([side, *corner], axis).tolist()) for corner in corners]
                    faces.append([points.setdefault(place, len(points)) for place in places[:: int(side)]])
    corner_vertices = np.array(faces).ravel()
    return meshes.MeshData(np.array(list(points)), np.full(len(faces), 4), corner_vertices)


def test_a_leaf_that_gets_a_bound_of_its_own_is_no_longer_bounded_by_its_flat_part(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = explicit(meshes.bent_plate())
    request = AdaptiveRequest(3e-4 * diagonal_of(mesh), Mode.ADAPTIVE, Transitions.TRIANGLES, 10_000)
    plan = Plan(mesh, request, np.zeros(mesh.face_count, dtype=np.int8), no_report)
    planner._settle(plan)
    leaves = np.flatnonzero(plan.by_flat_part.values & (plan.tree.first_child == NONE))
    assert len(leaves)

    def alone(plan: Plan, exceeding: IndexArray) -> LeafApproximation:
        known = plan.approximations.without_star_bounds(exceeding)
        return replace(known, bounds=np.full(len(exceeding), request.limit), alone=np.ones(len(exceeding), dtype=bool))

    monkeypatch.setattr(neighbour_bounds, "_alone", alone)
    plan.approximated.put(leaves)
    assert not len(neighbour_bounds.bound_along_surface(plan))
    assert np.all(plan.approximations.of(leaves).bounds == request.limit)
    assert not np.any(plan.by_flat_part.values[leaves])


@pytest.mark.parametrize("name", ["hexagons", "dented hexagons"])
def test_polygons_over_flat_parts_are_as_thick_without_their_neighbours(name: str) -> None:
    """The bounds of all others in their parts have to count it, however they are accepted."""
    mesh = explicit(SHEETS[name]())
    request = AdaptiveRequest(3e-3 * diagonal_of(mesh), Mode.ADAPTIVE, Transitions.NGONS, 10_000)
    plan = Plan(mesh, request, np.zeros(mesh.face_count, dtype=np.int8), no_report)
    planner._settle(plan)
    tree, count = plan.tree, 0
    leaves = np.flatnonzero(plan.by_flat_part.values & (tree.first_child == NONE))
    for cells in in_blocks(plan.cells.of(leaves)):
        known = plan.approximations.without_star_bounds(cells.nodes)
        alone = plan.approximate(cells, tree.hanging(tree.slots(cells.nodes)), known)
        same = alone.alternatives == known.alternatives
        assert np.array_equal(alone.thickness[same], plan.approximations.thickness[cells.nodes][same])
        # None is accepted because it lies over a flat part.
        assert np.all(alone.bounds[alone.accepted] <= request.limit)
        count += np.count_nonzero(alone.thickness[same])
    assert count
