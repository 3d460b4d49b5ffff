# SPDX-License-Identifier: GPL-3.0-or-later
"""The search for few triangles, with meshes that are known to be near enough or too far off."""

from functools import cache
from unittest.mock import Mock

import numpy as np
import pytest

from ccdepth_addon.core import Reduction, TriangleMesh, measure_deviation
from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.deviation.triangles import Triangles
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.progress import no_report
from ccdepth_addon.core.reduction.sampled_distances import SampledDistances
from tests import meshes
from tests.uniform import uniform

LIMIT = 0.02


@cache
def control() -> PolygonMesh:
    return meshes.build(meshes.torus(9, 6))


@cache
def at_level(level: int) -> TriangleMesh:
    """Triangles between points of the limit surface."""
    quads = uniform(control(), level)
    corners = quads.corner_vertices.reshape(-1, 4).astype(np.intp)
    return TriangleMesh(quads.positions, np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]))


def moved(mesh: TriangleMesh, chosen: np.ndarray, by: float) -> TriangleMesh:
    """Some of the vertices moved upwards."""
    positions = mesh.positions.copy()
    positions[chosen, 2] += by
    return TriangleMesh(positions, mesh.corners)


def sampled(fine: TriangleMesh, coarse: TriangleMesh) -> FloatArray:
    triangles = Triangles.of(coarse.positions, coarse.corners, lambda: None)
    return SampledDistances(fine.positions, fine.corners, lambda: None).of(
        triangles, coarse.positions, coarse.corners, lambda: None
    )


def test_samples_never_exceed_the_true_distance() -> None:
    fine, coarse = at_level(4), at_level(2)
    truth = measure_deviation(control(), coarse.positions, coarse.corners)
    # The fine mesh itself is off by a sixteenth of a sixteenth.
    assert sampled(fine, coarse).max() <= truth.proved * (1 + 1 / 16)
    assert sampled(fine, coarse).max() >= truth.reached / 2
    assert sampled(fine, fine).max() < 1e-12


def test_samples_belong_to_the_triangles_they_are_near() -> None:
    fine, coarse = at_level(4), at_level(2)
    chosen = np.arange(len(coarse.positions)) == 7
    around = (coarse.corners == 7).any(axis=1)
    distances = sampled(fine, moved(coarse, chosen, 0.3))
    assert np.all(distances[around] > 0.05)
    assert np.median(distances[~around]) < 0.05


def test_what_is_within_the_limit_is_taken_and_proved() -> None:
    search = Reduction(control(), at_level(4), LIMIT, no_report)
    attempt = search.attempt()
    assert attempt is not None
    assert attempt.triangles < len(search.current.corners)
    coarser = at_level(3)
    assert measure_deviation(control(), coarser.positions, coarser.corners).proved < LIMIT
    assert search.judge(coarser, no_report)
    assert search.current is coarser
    proof = search.prove(no_report)
    assert proof is not None
    assert search.is_proved
    assert proof.mesh is coarser
    assert proof.reached <= proof.bounds.max() <= LIMIT


def test_what_is_beyond_the_limit_is_never_taken_and_vertices_there_are_fixed() -> None:
    fine, coarse = at_level(4), at_level(3)
    search = Reduction(control(), fine, LIMIT, no_report)
    off = moved(coarse, np.arange(len(coarse.positions)) == 5, 2 * LIMIT)
    refused, first_fixed = 0, np.zeros(0, dtype=bool)
    while (attempt := search.attempt()) is not None:
        if not first_fixed.any():
            first_fixed = attempt.is_fixed
        assert not search.judge(off, no_report)
        refused += 1
    # No attempt is made without end, whatever comes of it.
    assert 0 < refused < 30
    assert search.proof is None
    everywhere = np.linalg.norm(fine.positions - coarse.positions[5], axis=1)
    assert everywhere[first_fixed].max() < np.median(everywhere)
    assert first_fixed[everywhere.argmin()]


def test_two_triangles_of_the_same_vertices_are_never_taken() -> None:
    coarser = at_level(3)
    turned = np.roll(coarser.corners[:1, ::-1], 1, axis=1)
    doubled = TriangleMesh(coarser.positions, np.concatenate([coarser.corners, turned]))
    search = Reduction(control(), at_level(4), LIMIT, no_report)
    assert not search.judge(doubled, no_report)
    assert search.beyond(doubled, no_report).any()
    assert not search.beyond(coarser, no_report).any()


def test_nothing_is_proved_where_nothing_is_within_the_limit() -> None:
    start = at_level(3)
    search = Reduction(control(), moved(start, np.full(len(start.positions), True), 0.5), LIMIT, no_report)
    assert search.prove(no_report) is None


def test_a_search_can_be_stopped() -> None:
    stop = Mock(side_effect=LookupError)
    with pytest.raises(LookupError):
        Reduction(control(), at_level(3), LIMIT, stop)
    search = Reduction(control(), at_level(3), LIMIT, no_report)
    with pytest.raises(LookupError):
        search.judge(at_level(2), stop)
