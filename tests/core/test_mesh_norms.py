# SPDX-License-Identifier: GPL-3.0-or-later
"""Norms of all patches of a mesh at once, against those of nets that are gathered patch by patch."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.bounds.mesh_norms import MeshNorms
from ccdepth_addon.core.bounds.norms import second_order_norm_extraordinary, second_order_norm_regular
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.patches import PatchKind, classify_patches, extraordinary_nets, regular_nets
from tests.core.test_face_depths import AWKWARD, build

# Sums of three numbers of some ten, in any order.
ROUNDING = 1e-14


@pytest.mark.parametrize("name", AWKWARD)
@pytest.mark.parametrize("smooth_corners", [False, True])
@pytest.mark.parametrize("steps", [0, 1, 2])
def test_norms_are_those_of_nets(name: str, smooth_corners: bool, steps: int) -> None:
    mesh = build(AWKWARD[name](), smooth_corners=smooth_corners)
    for _ in range(steps):
        mesh = subdivide(mesh).mesh
    kinds = classify_patches(mesh)
    norms = MeshNorms.of(mesh, kinds)
    positions = np.random.default_rng(7).normal(size=mesh.positions.shape)
    values = norms.values(positions)
    moved = mesh.changed(positions=positions)
    sharp_sides = np.isinf(mesh.edge_sharpness[mesh.corner_edges])
    has_sharp_side = np.logical_or.reduceat(sharp_sides, mesh.face_starts[:-1])
    is_patch = (kinds.kinds == PatchKind.REGULAR) & ~has_sharp_side | (kinds.kinds == PatchKind.EXTRAORDINARY)
    assert set(norms.faces) <= set(np.flatnonzero(is_patch))
    found = np.full(mesh.face_count, np.nan)
    for valence, places in norms.of_valences.items():
        faces = norms.faces[places]
        found[faces] = values[places]
        np.testing.assert_allclose(found[faces], _of_nets(moved, faces, valence), rtol=ROUNDING)
    assert np.all(np.isfinite(found[norms.faces]))
    assert np.all(np.isfinite(found[kinds.kinds == PatchKind.EXTRAORDINARY]))
    # Those left out are regular ones with a sharp side, or a sharp corner at least.
    left_out = np.flatnonzero(is_patch & np.isnan(found))
    assert np.all(~kinds.inside[left_out])


def _of_nets(mesh: PolygonMesh, faces: np.ndarray, valence: int) -> np.ndarray:
    if valence == 4:
        return second_order_norm_regular(regular_nets(mesh, faces))
    corners = classify_patches(mesh).extraordinary_corners[faces]
    return second_order_norm_extraordinary(extraordinary_nets(mesh, corners, valence))


def test_each_difference_is_computed_once() -> None:
    mesh = build(AWKWARD["landscape with random creases"](), smooth_corners=False)
    norms = MeshNorms.of(mesh, classify_patches(mesh))
    ends = np.sort(np.stack([norms.ones, norms.others]), axis=0)
    differences = np.stack([norms.middles, *ends], axis=1)
    assert len(np.unique(differences, axis=0)) == len(differences)
