# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes and random operators on them end without a traceback, and keep what is the user's.

These are some tens of seeds. Any others, in processes that may crash, with every fault reduced to the steps it needs:

    python -m tests.blender.random_runs FIRST LAST

or here, in this process: ``CCDEPTH_SEEDS=FIRST:LAST pytest tests/blender/test_random_scenes.py``.
"""

from __future__ import annotations

import os

import pytest

from tests.blender import random_runs

FIRST, LAST = (int(number) for number in os.environ.get("CCDEPTH_SEEDS", "0:40").split(":"))


@pytest.mark.parametrize("seed", range(FIRST, LAST))
def test_random_scene(seed: int) -> None:
    random_runs.run(seed)
