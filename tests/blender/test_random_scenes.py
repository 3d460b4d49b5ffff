# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes and random operators on them end without a traceback, and keep what is the user's.

Any range of seeds, each a test; a process that crashes is replaced by another:

    CCDEPTH_SEEDS=300:2000 scripts/test.sh --thorough tests/blender/test_random_scenes.py
"""

from __future__ import annotations

import os
from typing import Any

import pytest

from tests.blender import random_scenes

FIRST, LAST = (int(number) for number in os.environ.get("CCDEPTH_SEEDS", "0:300").split(":"))

# Those of the first 300 that together reach all operators, with every way they end, and the most lines of ours.
IN_EVERY_BLENDER = (89, 90, 183, 202)
SHORT = (*IN_EVERY_BLENDER, 3, 23, 46, 82, 94, 101, 131, 188)


def seed_with_marks(seed: int) -> Any:
    marks: list[Any] = [] if seed in SHORT else [pytest.mark.thorough]
    marks += [pytest.mark.every_blender] if seed in IN_EVERY_BLENDER else []
    return pytest.param(seed, marks=marks)


@pytest.mark.parametrize("seed", [seed_with_marks(seed) for seed in range(FIRST, LAST)])
def test_random_scene(seed: int, capfd: pytest.CaptureFixture[str]) -> None:
    random_scenes.run(seed, lambda: capfd.readouterr().err)
