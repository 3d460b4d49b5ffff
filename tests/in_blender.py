# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the Blender-side tests inside a real Blender, against the extension that is installed in it.

    CCDEPTH_PACKAGES=FOLDER blender -b --python-exit-code 1 --python tests/in_blender.py -- [PYTEST-OPTION…]

The folder holds pytest, as ``pip install --target FOLDER pytest`` puts it there.
"""

import os
import sys
from pathlib import Path

import bpy

CHECKOUT = Path(__file__).resolve().parent.parent
OPTIONS = ["tests/blender", "-q", "-pno:cacheprovider", "-ptests.progress", "-oconsole_output_style=classic"]


def run(options: list[str]) -> None:
    """Run pytest; SystemExit with its status."""
    sys.path.append(os.environ["CCDEPTH_PACKAGES"])
    import pytest

    module = bpy.types.CCDEPTH_OT_compute.__module__
    if not module.startswith("bl_ext."):
        raise SystemExit(f"the add-on under test is {module}, and not an installed extension")
    os.chdir(CHECKOUT)
    sys.path.append(str(CHECKOUT))
    # Nothing may be written into the checkout, nor read from what another Python left there.
    sys.dont_write_bytecode = True
    raise SystemExit(int(pytest.main([*OPTIONS, *options])))


if __name__ == "__main__":
    run(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
