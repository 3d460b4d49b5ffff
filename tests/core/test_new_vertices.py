# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits of the vertices that a step makes, from their rings, against those of ``limit_positions``, which refines."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core import apply_boundary_rule
from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.mesh.submesh import submesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.new_vertices import limits_of_new_vertices
from ccdepth_addon.core.surface.refinement import Refinement
from tests import meshes
from tests.thorough import combinations

# Sums of some twenty terms in double precision, of coordinates up to about 10.
ROUNDING = 1e-13


def creased(seed: int, *, smooth_corners: bool = True) -> PolygonMesh:
    data = meshes.with_random_creases(meshes.landscape(9, 8, seed=seed), seed=seed, share=0.1 * (seed + 1))
    return apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=smooth_corners)


def limits_by_refinement(mesh: PolygonMesh) -> FloatArray:
    return limit_positions(mesh)[mesh.corner_vertices].reshape(-1, 4, 3)


@pytest.mark.parametrize(("seed", "smooth_corners"), combinations(range(6), [True, False]))
def test_limits_from_rings_are_those_by_refinement(seed: int, smooth_corners: bool) -> None:
    mesh = creased(seed, smooth_corners=smooth_corners)
    for _ in range(3):
        mesh = subdivide(mesh).mesh
        expected = limits_by_refinement(mesh)[:, 1:]
        np.testing.assert_allclose(limits_of_new_vertices(mesh, mesh.face_count), expected, rtol=0, atol=ROUNDING)


def test_rings_in_a_submesh_are_enough() -> None:
    mesh = subdivide(creased(3)).mesh
    chosen = np.random.default_rng(1).permutation(mesh.face_count)[:40]
    part = submesh(mesh, chosen)[0]
    expected = limits_by_refinement(mesh)[chosen, 1:]
    np.testing.assert_allclose(limits_of_new_vertices(part, len(chosen)), expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("asked_at", [(0, 1, 2, 3), (1, 3), (3,)])
@pytest.mark.parametrize("name", ["quads", "n-gons"])
def test_limits_are_handed_on_to_descendants(name: str, asked_at: tuple[int, ...]) -> None:
    n_gons = apply_boundary_rule(meshes.to_polygon_mesh(meshes.fan(7, 3)), smooth_corners=True)
    mesh = creased(4) if name == "quads" else n_gons
    refinement = Refinement.start(mesh, np.arange(0, mesh.face_count, 2))
    rng = np.random.default_rng(2)
    for level in range(4):
        if level in asked_at:
            expected = limit_positions(refinement.mesh)[refinement.corner_vertices()]
            np.testing.assert_allclose(refinement.limits_at_corners, expected, rtol=0, atol=ROUNDING)
            inside = limits_by_refinement(subdivide(refinement.mesh).mesh)[: len(expected)]
            for found, corner in zip(refinement.limits_inside(), (1, 2), strict=True):
                np.testing.assert_allclose(found, inside[:, corner], rtol=0, atol=ROUNDING)
        refinement = refinement.keep(rng.random(len(refinement.bases)) < 0.7).numbered().refined()
