# SPDX-License-Identifier: GPL-3.0-or-later
"""The programs in benchmarks/ and proofs/: what they name is there, tables are found again, certificates checked."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ccdepth_addon.core.bounds import sharp_constants
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from proofs import certify_sharp_constants
from proofs.certificates import Certifier
from tests.thorough import each

CHECKOUT = Path(__file__).resolve().parent.parent

# It does its work when it is imported, as a script that Blender runs.
SCRIPTS = {"responsiveness"}


def test_programs_find_all_that_they_import() -> None:
    names = sorted({path.stem for path in (CHECKOUT / "benchmarks").glob("*.py")} - SCRIPTS)
    imports = "".join(f"import benchmarks.{name}\n" for name in names)
    # The bpy module can hang while the interpreter winds up.
    program = f"import os, bpy\n{imports}os._exit(0)"
    subprocess.run([sys.executable, "-c", program], cwd=CHECKOUT, check=True, timeout=120)


compact = certify_sharp_constants.compact


@pytest.mark.parametrize("valence", each([3, *range(5, 129)], short=[3, 45]))
def test_constants_of_the_table_are_found_again(valence: int) -> None:
    """The rows of valences over 32 are common to several."""
    found = certify_sharp_constants.sharp_constants(valence)
    assert certify_sharp_constants.TABLES.name == "sharp_constants.py"
    assert certify_sharp_constants.TABLES.is_file()
    tables = {Vertices.CONTROL: sharp_constants.CONTROL_FACTORS, Vertices.LIMIT: sharp_constants.LIMIT_FACTORS}
    for kind, table in tables.items():
        row = table[min(last for last in table if last >= valence)]
        own = [float(compact(factor)) for factor in found.factors[kind]]
        assert list(row) == own if valence <= 32 else np.all(np.array(row) >= own)


@pytest.mark.parametrize("valence", [5, 12])
def test_a_combination_that_makes_another_functional_is_no_certificate(valence: int) -> None:
    certifier = Certifier.of(valence)
    functionals = np.random.default_rng(1).normal(size=(20, len(certifier.differences))) @ certifier.differences
    certifier.solve(functionals[0])
    before = certifier.upper(functionals)
    assert before[0] < np.abs(functionals[0] @ certifier.least_squares.T).sum()
    # An addition that changes the functional may shorten it at will.
    certifier.solved.additions[0] = -certifier.solved.weights[0]
    certifier.solved.off[0] = float(certifier._off(certifier.solved.additions[0], np.zeros_like(functionals[0])))
    alone = np.abs(functionals @ certifier.least_squares.T).sum(axis=1)
    assert (certifier.upper(functionals) >= alone).all()
