# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes and random operators on them end without a traceback, and keep what is the user's.

Each part is some scenes of its own, those of a seed; what fails is reported with the fewest steps that were found.
"""

from __future__ import annotations

import pytest
from hypothesis import seed, settings
from hypothesis.stateful import run_state_machine_as_test

from tests.blender.random_scenes import Scenes
from tests.thorough import each


@pytest.mark.every_blender
@pytest.mark.parametrize("part", each(range(25), short=[0]))
def test_random_scenes(part: int, capfd: pytest.CaptureFixture[str]) -> None:
    machine = seed(part)(type("Scenes", (Scenes,), {"errors": staticmethod(lambda: capfd.readouterr().err)}))
    run_state_machine_as_test(machine, settings=settings(max_examples=25, stateful_step_count=12, derandomize=False))
