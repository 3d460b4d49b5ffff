# SPDX-License-Identifier: GPL-3.0-or-later
"""Every test starts with Blender's own startup file, and with the add-on registered, installed or from the checkout."""

import os
import sys
from functools import partial
from typing import Any

import bpy
import pytest

if not hasattr(bpy.types.Scene, "ccdepth"):
    import ccdepth_addon

    ccdepth_addon.register()


# Samples for the largest angles, which take most of the time of a measurement of few faces; tests/core has their tests.
FEW_SAMPLES = 1 << 8


@pytest.fixture(autouse=True)
def few_samples_of_angles(monkeypatch: pytest.MonkeyPatch) -> None:
    # Only now is the add-on registered.
    from tests.blender.addon import module

    task = module("tasks.deviation_task")
    monkeypatch.setattr(task, "SampledSurface", partial(task.SampledSurface, most=FEW_SAMPLES))


@pytest.fixture(autouse=True)
def startup_file() -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes])
    # The quickest method: these tests are about the way from Blender to the core and back.
    bpy.context.scene.ccdepth.method = "SECOND_ORDER"


class EndWithoutWindingUp:
    """Ends the process with pytest's status once all is said, because Blender as a module can crash or hang at exit."""

    def __init__(self) -> None:
        self._status = int(pytest.ExitCode.INTERNAL_ERROR)

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, exitstatus: int) -> None:
        self._status = int(exitstatus)

    # Before pytest collects garbage, which can crash as well.
    @pytest.hookimpl(tryfirst=True)
    def pytest_unconfigure(self) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(self._status)


def pytest_configure(config: pytest.Config) -> None:
    # A worker process has to wind up: it sends its results meanwhile.
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(EndWithoutWindingUp())


@pytest.fixture
def comparison() -> Any:
    """A mesh with everything, subdivided by the add-on and by the modifier."""
    # Only now is the add-on registered.
    from tests.blender.full_mesh import compare, everything

    return compare(everything())
