# SPDX-License-Identifier: GPL-3.0-or-later
"""Certified depths are the least ones, by Blender's own modifier: a small part of benchmarks/tightness.py."""

from __future__ import annotations

import pytest

from benchmarks import tightness
from tests.blender.named_meshes import NAMED
from tests.brute_force import Comparison

QUADS = 100_000
NAMES = ("cube", "torus", "Suzanne", "landscape with random creases", "valence 2", "valence 5", "valence 12", "n-gons")


@pytest.mark.parametrize("boundary", [pytest.param("ALL", marks=pytest.mark.mathematics), "PRESERVE_CORNERS"])
def test_depths_are_the_least_ones(boundary: str) -> None:
    total = Comparison()
    for name in NAMES:
        found, apart, _ = tightness.compare_mesh(NAMED[name](), boundary, QUADS, (3e-2, 1e-2, 3e-3, 1e-3))
        # The core's own surface is Blender's, but for rounding.
        assert apart < 1, name
        for compared in found.values():
            assert compared.below == 0, name
            assert compared.wrongly_exact == 0, name
            total += compared
    assert total.faces > 1000
    assert total.equal_share >= tightness.LEAST_EQUAL_SHARE
