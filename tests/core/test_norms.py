# SPDX-License-Identifier: GPL-3.0-or-later
"""The norms of control nets against the differences they are defined by, and those of all patches of a mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.mesh_norms import MeshNorms
from ccdepth_addon.core.bounds.norms import (
    first_order_norm_extraordinary,
    first_order_norm_regular,
    second_differences,
    second_order_norm_extraordinary,
    second_order_norm_regular,
)
from ccdepth_addon.core.surface.patches import PatchKind, classify_patches, extraordinary_nets, regular_nets
from tests import meshes, nets
from tests.core.test_face_depths import build

# Sums of three numbers of some ten, in any order.
ROUNDING = 1e-14

every_valence = pytest.mark.parametrize("valence", [3, 5, 6, 7, 8, 12, 64])


def random_net(*shape: int) -> FloatArray:
    return np.random.default_rng(sum(shape)).normal(size=shape)


def longest(vectors: list[FloatArray]) -> FloatArray:
    """(P,): of several (P, 3) vectors."""
    return np.max([np.sqrt(x * x + y * y + z * z) for x, y, z in (vector.T for vector in vectors)], axis=0)


def test_norms_of_regular_nets() -> None:
    v = random_net(4, 4, 50, 3)
    listed = nets.listed_regular_differences()
    assert len(set(listed)) == 16
    second = longest([2 * v[a] - v[b] - v[c] for a, b, c in listed])
    np.testing.assert_allclose(second_order_norm_regular(v), second, rtol=ROUNDING)
    along_i = [v[i + 1, j] - v[i, j] for i in range(3) for j in range(4)]
    along_j = [v[i, j + 1] - v[i, j] for i in range(4) for j in range(3)]
    np.testing.assert_allclose(first_order_norm_regular(v), longest(along_i + along_j), rtol=ROUNDING)


@every_valence
def test_norms_of_extraordinary_nets(valence: int) -> None:
    net = random_net(2 * valence + 8, 20, 3)
    listed, edges = nets.listed_differences(valence), nets.net_edges(valence)
    second = longest([2 * net[a - 1] - net[b - 1] - net[c - 1] for a, b, c in listed])
    np.testing.assert_allclose(second_order_norm_extraordinary(net), second, rtol=ROUNDING)
    assert len(edges) == 3 * valence + 12
    first = longest([net[a] - net[b] for a, b in edges])
    np.testing.assert_allclose(first_order_norm_extraordinary(net), first, rtol=ROUNDING)
    assert np.all(second <= 2 * first)
    # Random nets do not reach each of the 2n + 10 as the largest, so the list itself is compared too.
    assert len(set(listed)) == len(listed) == 2 * valence + 10
    core = [(a + 1, *sorted((b + 1, c + 1))) for a, b, c in second_differences(valence).T.tolist()]
    assert sorted(core) == sorted((a, *sorted((b, c))) for a, b, c in listed)


def test_differences_of_valence_four_are_those_of_the_regular_net() -> None:
    """At valence 4 the list has the two differences across V₁ twice, and is otherwise the 16 of a 4×4 net."""
    assert len({(a, *sorted((b, c))) for a, b, c in nets.listed_differences(4)}) == 16


@pytest.mark.parametrize(
    ("norm", "shape"),
    [
        (second_order_norm_regular, (4, 4, 10, 3)),
        (first_order_norm_regular, (4, 4, 10, 3)),
        (second_order_norm_extraordinary, (18, 10, 3)),
        (first_order_norm_extraordinary, (18, 10, 3)),
    ],
)
def test_norms_of_moved_turned_scaled_and_coinciding_points(
    norm: Callable[[FloatArray], FloatArray], shape: tuple[int, ...]
) -> None:
    net = random_net(*shape)
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    np.testing.assert_allclose(norm(-3 * net @ turn + [5.0, -2.0, 1.0]), 3 * norm(net), rtol=1e-13)
    assert np.all(norm(np.ones(shape)) == 0)


@pytest.mark.parametrize("name", meshes.AWKWARD)
@pytest.mark.parametrize("smooth_corners", [False, True])
def test_norms_of_meshes_are_those_of_nets(name: str, smooth_corners: bool) -> None:
    """At three levels, at random positions; on a plain mesh each difference is computed once."""
    mesh = build(meshes.AWKWARD[name](), smooth_corners=smooth_corners)
    for _ in range(3):
        kinds = classify_patches(mesh)
        norms = MeshNorms.of(mesh, kinds)
        if name == "landscape with random creases":
            # Around edges of several orientations a difference may have several numbers.
            ends = np.sort(np.stack([norms.ones, norms.others]), axis=0)
            assert len(np.unique([norms.middles, *ends], axis=1).T) == len(norms.middles)
        positions = np.random.default_rng(7).normal(size=mesh.positions.shape)
        values, moved = norms.values(positions), mesh.changed(positions=positions)
        sharp_sides = np.isinf(mesh.edge_sharpness[mesh.corner_edges])
        has_sharp_side = np.logical_or.reduceat(sharp_sides, mesh.face_starts[:-1])
        is_extraordinary = kinds.kinds == PatchKind.EXTRAORDINARY
        is_patch = (kinds.kinds == PatchKind.REGULAR) & ~has_sharp_side | is_extraordinary
        assert set(norms.faces) <= set(np.flatnonzero(is_patch))
        found = np.full(mesh.face_count, np.nan)
        for valence, places in norms.of_valences.items():
            faces = norms.faces[places]
            found[faces] = values[places]
            corners = kinds.extraordinary_corners[faces]
            expected = (
                second_order_norm_regular(regular_nets(moved, faces))
                if valence == 4
                else second_order_norm_extraordinary(extraordinary_nets(moved, corners, valence))
            )
            np.testing.assert_allclose(found[faces], expected, rtol=ROUNDING)
        assert np.all(np.isfinite(found[norms.faces]))
        assert np.all(np.isfinite(found[is_extraordinary]))
        # Those left out are regular ones with a sharp side, or a sharp corner at least.
        assert np.all(~kinds.inside[is_patch & np.isnan(found)])
        mesh = nets.refined(mesh, 1)
