# SPDX-License-Identifier: GPL-3.0-or-later
"""The search for few triangles, as far as no reduced mesh shows it: it ends, and it can be stopped."""

from dataclasses import replace
from functools import cache
from unittest.mock import Mock

import numpy as np
import pytest

from ccdepth_addon.core import Reduction, TriangleMesh
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.progress import no_report
from tests import meshes
from tests.core.test_deviation import result

LIMIT = 0.02


@cache
def control() -> PolygonMesh:
    return meshes.build(meshes.torus(9, 6))


@cache
def at_level(level: int) -> TriangleMesh:
    """Triangles between points of the limit surface."""
    positions, corners = result(control(), level, limit=True)
    return TriangleMesh(positions, corners, np.ones(len(corners), dtype=bool))


def moved(mesh: TriangleMesh, chosen: np.ndarray, by: float) -> TriangleMesh:
    """Some of the vertices moved upwards."""
    positions = mesh.positions.copy()
    positions[chosen, 2] += by
    return replace(mesh, positions=positions)


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


def test_a_search_can_be_stopped() -> None:
    stop = Mock(side_effect=LookupError)
    with pytest.raises(LookupError):
        Reduction(control(), at_level(3), LIMIT, stop)
    search = Reduction(control(), at_level(3), LIMIT, no_report)
    with pytest.raises(LookupError):
        search.judge(at_level(2), stop)


def test_a_search_can_be_stopped_while_the_surface_is_sampled(monkeypatch: pytest.MonkeyPatch) -> None:
    sampled = Mock(side_effect=lambda _control, _tolerance, tick, _most: tick())
    monkeypatch.setattr("ccdepth_addon.core.reduction.search.SampledSurface", sampled)

    def stop(_: float) -> None:
        if sampled.called:
            raise LookupError

    search = Reduction(control(), at_level(3), 1.0, no_report, facet_angle=0.1)
    with pytest.raises(LookupError):
        search.judge(at_level(2), stop)
