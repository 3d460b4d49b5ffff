# SPDX-License-Identifier: GPL-3.0-or-later
"""Quads with several extraordinary corners: which have stencils, and results where many quads are alike."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.planner import subdivide_adaptively
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import Transitions
from ccdepth_addon.core.deviation import measure_deviation
from ccdepth_addon.core.surface.patches import classify_patches
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from ccdepth_addon.core.surface.stencils import LARGEST_STENCIL_VALENCE, Valences, by_valences
from tests import meshes, soundness
from tests.core.test_adaptive import drawn
from tests.thorough import combinations

COPIES = 8


def copies(data: meshes.MeshData, noise: float, generator: np.random.Generator) -> meshes.MeshData:
    """Side by side, each turned, and its vertices displaced by noise in parts of the diagonal."""
    diagonal = float(np.linalg.norm(np.ptp(data.positions, axis=0)))
    positions = []
    for number in range(COPIES):
        turned, _ = np.linalg.qr(generator.normal(size=(3, 3)))
        displaced = data.positions + noise * diagonal * generator.normal(size=data.positions.shape)
        positions.append(displaced @ turned + [3 * diagonal * number, 0, 0])
    corners = data.corner_vertices + len(data.positions) * np.arange(COPIES)[:, None]
    return meshes.MeshData(np.concatenate(positions), np.tile(data.face_sizes, COPIES), corners.ravel())


def chosen(valences: Valences, least: int) -> list[tuple[Valences, int]]:
    """Those that have stencils of flat quads with corners of these valences, and how many."""
    data = copies(meshes.around_quad(valences), 0, np.random.default_rng(0))
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True)
    faces = np.arange(mesh.face_count)
    found, rest = by_valences(mesh, classify_patches(mesh), faces, least)
    of_corners = [mesh.corner_faces[corners] for _, corners in found]
    assert np.array_equal(np.sort(np.concatenate([*of_corners, rest])), faces)
    for kind, corners in found:
        around = mesh.face_starts[mesh.corner_faces[corners]]
        turned = [around + (corners - around + step) % 4 for step in range(4)]
        seen = np.stack([mesh.vertex_face_counts[mesh.corner_vertices[each]] for each in turned], axis=1)
        assert np.all(seen == kind)
    return [(kind, len(corners)) for kind, corners in found]


def test_quads_alike_have_stencils_however_they_are_turned() -> None:
    for valences in [(6, 3, 5, 7), (3, 5, 7, 6), (7, 6, 3, 5)]:
        assert chosen(valences, COPIES) == [((7, 6, 3, 5), COPIES)]
    assert chosen((6, 3, 5, 7), COPIES + 1) == []


def test_nets_have_no_more_points_than_one_corner_of_the_largest_valence() -> None:
    """2 Σ n - 16 points, of which four corners of valence 64 would have 496."""
    largest = LARGEST_STENCIL_VALENCE
    assert chosen((largest, 4, 4, 4), 1) == [((largest, 4, 4, 4), COPIES)]
    assert chosen((largest - 1, 5, 4, 4), 1) == [((largest - 1, 5, 4, 4), COPIES)]
    assert chosen((largest, 5, 4, 4), 1) == []
    assert chosen((largest + 1, 3, 4, 4), 1) == []


def cut_torus() -> meshes.MeshData:
    """Of triangles: each quad cut along one or the other of its diagonals."""
    data = meshes.torus(7, 5)
    quads = data.corner_vertices.reshape(-1, 4)
    turns = np.random.default_rng(1).integers(0, 2, (len(quads), 1))
    quads = np.take_along_axis(quads, (np.arange(4) + turns) % 4, axis=1)
    return meshes.MeshData(data.positions, np.full(2 * len(quads), 3), quads[:, [0, 1, 2, 0, 2, 3]].ravel())


ODD_MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "valences 3 and 5": lambda: meshes.trapezohedron(5),
    "triangles of any valences": cut_torus,
    "tetrahedra": meshes.tetrahedron,
    "valences 2 and 12": meshes.valences_two_and_twelve,
    "neighbours of 6, 3, 5 and 7": lambda: meshes.around_quad((6, 3, 5, 7)),
    "valences 3 and 9": lambda: meshes.trapezohedron(9),
    "n-gons": lambda: meshes.cylinder(5),
}


@pytest.mark.parametrize(("name", "noise"), combinations(ODD_MESHES, [0.1, 0.02]))
def test_results_are_within_the_tolerance_where_many_quads_are_alike(name: str, noise: float) -> None:
    """As measured by ``measure_deviation``, which knows nothing of stencils of several corners."""
    data = ODD_MESHES[name]()
    limit = 0.02 * float(np.linalg.norm(np.ptp(data.positions, axis=0)))
    mesh = meshes.to_polygon_mesh(copies(data, noise, np.random.default_rng(len(name))))
    mesh = apply_boundary_rule(mesh, smooth_corners=True)
    request = AdaptiveRequest(limit, Mode.ADAPTIVE, Transitions.TRIANGLES, 400_000)
    found = subdivide_adaptively(mesh, request, mesh.positions)
    soundness.assert_sound(mesh, found.mesh)
    measured = measure_deviation(mesh, found.mesh.positions, drawn(found), accuracy=0.05)
    assert measured.reached <= float(found.bounds.max()) <= limit
