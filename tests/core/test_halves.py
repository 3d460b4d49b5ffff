# SPDX-License-Identifier: GPL-3.0-or-later
"""Halves: fewer faces where the surface bends one way, never more elsewhere, and sound; measured by other means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from ccdepth_addon.core.adaptive import halves, planner
from ccdepth_addon.core.adaptive.planner import AdaptiveMesh, subdivide_adaptively
from ccdepth_addon.core.adaptive.quadtree import NONE, Quadtree
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import Transitions
from ccdepth_addon.core.arrays.types import IndexArray
from ccdepth_addon.core.deviation import measure_deviation
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes, soundness

pytestmark = pytest.mark.thorough


def tube() -> meshes.MeshData:
    """A grid bent to half a tube."""
    data = meshes.grid(6, 4)
    x, y, _ = data.positions.T
    angles = np.pi * (x - x.min()) / np.ptp(x)
    return replace(data, positions=np.stack([np.cos(angles), 3 * y / np.ptp(y), np.sin(angles)], axis=1))


MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "tube": tube,
    "cube": meshes.cube,
    "torus": lambda: meshes.torus(7, 5),
    "landscape": lambda: meshes.landscape(6, 5),
    "n-gons": lambda: meshes.bumpy(meshes.cylinder(7), 0.1),
    "valences 3 and 7": lambda: meshes.trapezohedron(7),
    "doubled face": meshes.doubled_face,
    "fin through": meshes.fin_through,
    "creased cube": meshes.creased_cube,
    "random creases": lambda: meshes.with_random_creases(meshes.landscape(3, 2), share=0.4),
}

every_mesh = pytest.mark.parametrize("name", MESHES)


@cache
def build(name: str) -> PolygonMesh:
    return apply_boundary_rule(meshes.to_polygon_mesh(MESHES[name]()), smooth_corners=True)


def request_of(mesh: PolygonMesh, tolerance: float, transitions: Transitions) -> AdaptiveRequest:
    """tolerance: in parts of the diagonal."""
    diagonal = float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))
    return AdaptiveRequest(tolerance * diagonal, Mode.ADAPTIVE, transitions, 1_000_000)


def triangles_of(found: AdaptiveMesh) -> IndexArray:
    """(T, 3): quads along their first diagonal."""
    starts, sizes = found.mesh.face_starts[:-1], np.diff(found.mesh.face_starts)
    corners = np.concatenate([starts[:, None] + [0, 1, 2], starts[sizes == 4, None] + [0, 2, 3]])
    return found.mesh.corner_vertices[corners].astype(np.intp)


def without_halves(mesh: PolygonMesh, request: AdaptiveRequest) -> AdaptiveMesh:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planner, "halve", lambda plan: None)
        return subdivide_adaptively(mesh, request, mesh.positions)


@pytest.mark.parametrize("transitions", Transitions)
@every_mesh
def test_never_more_faces_than_without(name: str, transitions: Transitions) -> None:
    mesh = build(name)
    for tolerance in (0.02, 4e-3):
        request = request_of(mesh, tolerance, transitions)
        found, plain = subdivide_adaptively(mesh, request, mesh.positions), without_halves(mesh, request)
        assert len(found.bounds) <= len(plain.bounds)
        assert np.sum(np.diff(found.mesh.face_starts) - 2) <= np.sum(np.diff(plain.mesh.face_starts) - 2)
        soundness.assert_sound(mesh, found.mesh)
        assert np.all(found.bounds <= request.limit)
        if transitions is Transitions.TRIANGLES:
            soundness.assert_no_thin_triangles(mesh, found.mesh)


@pytest.mark.parametrize("tolerance", [1e-3, 2e-4])
def test_a_tube_takes_about_half_the_triangles(tolerance: float) -> None:
    mesh = build("tube")
    request = request_of(mesh, tolerance, Transitions.TRIANGLES)
    found, plain = subdivide_adaptively(mesh, request, mesh.positions), without_halves(mesh, request)
    # Half of them, but for its ends, where the surface bends otherwise.
    assert len(triangles_of(found)) <= 0.65 * len(triangles_of(plain))
    measured = measure_deviation(mesh, found.mesh.positions, triangles_of(found), accuracy=0.05)
    assert measured.reached <= request.limit


@pytest.mark.parametrize("name", ["tube", "cube", "torus", "landscape", "n-gons", "creased cube"])
def test_what_is_measured_is_within_what_is_proved(name: str) -> None:
    """By Measure Deviation, which knows nothing of leaves."""
    mesh = build(name)
    request = request_of(mesh, 3e-3, Transitions.TRIANGLES)
    found = subdivide_adaptively(mesh, request, mesh.positions)
    measured = measure_deviation(mesh, found.mesh.positions, triangles_of(found), accuracy=0.05)
    # Positions and distances are rounded a few times, to sixteen digits.
    assert measured.reached <= found.bounds.max() * (1 + 1e-9)


@pytest.mark.parametrize("name", ["tube", "landscape", "n-gons"])
def test_leaves_that_exceed_the_limit_beside_halves_stay(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever leaves these are: here some are said to be, at each attempt but the last."""
    mesh = build(name)
    request = request_of(mesh, 3e-3, Transitions.TRIANGLES)
    stayed: list[tuple[Quadtree, IndexArray]] = []
    draw = halves._Drawn.draw

    def exceeding(drawn: halves._Drawn, *given: Any) -> IndexArray:
        found = draw(drawn, *given)
        if len(stayed) < halves.ATTEMPTS - 1:
            tree = drawn._plan.tree
            leaves = tree.leaves()
            found = leaves[(leaves < tree.first_half) & (leaves % halves.ATTEMPTS == len(stayed))]
            stayed.append((tree, found))
        return found

    monkeypatch.setattr(halves._Drawn, "draw", exceeding)
    found = subdivide_adaptively(mesh, request, mesh.positions)
    assert len(stayed) == halves.ATTEMPTS - 1
    for tree, leaves in stayed:
        assert np.all(tree.first_child[leaves] == NONE)
    assert tree.leaf_count == len(tree.leaves()) == found.leaf_count
    soundness.assert_sound(mesh, found.mesh)
    assert len(found.bounds) <= len(without_halves(mesh, request).bounds)


def test_a_halved_tree_can_be_made_as_it_was() -> None:
    mesh = subdivide(build("torus")).mesh
    tree = Quadtree(mesh)
    generator = np.random.default_rng(3)
    quads = np.flatnonzero(generator.random(mesh.face_count) < 0.3)
    tree.split(quads)
    leaves, slots = tree.leaves(), tree.slots(tree.leaves())
    before = tree.hanging(slots), tree.midpoints[tree.slot_edges[slots]], tree.leaf_count
    turns = generator.integers(0, 2, len(quads))
    nodes = tree.halves(quads, turns)
    assert np.array_equal(tree.leaves(), leaves)
    tree.halve(nodes, tree.slot_edges[tree.first_slots(quads) + turns])
    assert np.array_equal(np.sort(nodes.ravel()), np.setdiff1d(tree.leaves(), leaves))
    assert tree.leaf_count == len(tree.leaves()) == len(leaves) - 2 * len(quads)
    tree.undo_halves(nodes)
    assert np.array_equal(tree.leaves(), leaves)
    after = tree.hanging(slots), tree.midpoints[tree.slot_edges[slots]], tree.leaf_count
    for one, other in zip(before, after, strict=True):
        assert np.array_equal(one, other)


def uneven_ramp() -> meshes.MeshData:
    """A ramp that winds round, with uneven heights: 20 rows of three vertices."""
    heights = np.random.default_rng(5051).choice([1.0, 0.1], size=(20, 3))
    angles, radii = np.linspace(0, 8.4, 20)[:, None], np.linspace(0.05, 1, 3)
    positions = np.stack([radii * np.cos(angles), radii * np.sin(angles), 0.02 * angles * heights], axis=-1)
    return replace(meshes.grid(2, 19), positions=positions.reshape(-1, 3))


def test_the_last_attempt_leaves_nothing_to_new_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here a leaf that was within the limit by itself has lost a vertex in its side, and would need its neighbours."""
    monkeypatch.setattr(halves, "ATTEMPTS", 2)
    exceeding: list[int] = []
    draw = halves._Drawn.draw

    def counted(drawn: halves._Drawn, *given: Any) -> IndexArray:
        found = draw(drawn, *given)
        exceeding.append(len(found))
        return found

    monkeypatch.setattr(halves._Drawn, "draw", counted)
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(uneven_ramp()), smooth_corners=True)
    request = request_of(mesh, 1.4e-4, Transitions.TRIANGLES)
    found = subdivide_adaptively(mesh, request, mesh.positions)
    first, last = exceeding
    assert first > 0 == last
    assert np.all(found.bounds <= request.limit)
    soundness.assert_sound(mesh, found.mesh)
    assert len(found.bounds) <= len(without_halves(mesh, request).bounds)
