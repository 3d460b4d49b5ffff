# SPDX-License-Identifier: GPL-3.0-or-later
"""The short suite, and with ``--thorough`` all combinations, dense oracles, linear programs and random scenes as well.

A slice of the thorough tests (``--slice SEED``) runs them alone, in an order that the seed decides, and begins none
after two minutes.
"""

import random
import shlex
import time

import pytest
from hypothesis import settings

SLICE_SECONDS = 120.0


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--thorough", action="store_true", help="also all combinations and dense oracles")
    parser.addoption("--slice", metavar="SEED", help="two minutes of the thorough tests, chosen by this text")


def pytest_configure(config: pytest.Config) -> None:
    settings.register_profile("short", derandomize=True, database=None, deadline=None, max_examples=30)
    settings.register_profile("thorough", derandomize=True, database=None, deadline=None, max_examples=500)
    settings.load_profile("thorough" if config.getoption("--thorough") else "short")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    is_thorough = {item: item.get_closest_marker("thorough") is not None for item in items}
    chosen = items[:]
    if (seed := config.getoption("--slice")) is not None:
        chosen = [item for item in items if is_thorough[item]]
        random.Random(seed).shuffle(chosen)
        config.stash[_END] = time.monotonic() + SLICE_SECONDS
    elif not config.getoption("--thorough"):
        chosen = [item for item in items if not is_thorough[item]]
    left_out = set(items) - set(chosen)
    if left_out:
        config.hook.pytest_deselected(items=[item for item in items if item in left_out])
        items[:] = chosen


_END = pytest.StashKey[float]()


def pytest_runtest_setup(item: pytest.Item) -> None:
    if time.monotonic() > item.config.stash.get(_END, float("inf")):
        pytest.skip("the time for this slice is over")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if config.getoption("--slice") is None:
        return
    for report in terminalreporter.getreports("failed") + terminalreporter.getreports("error"):
        terminalreporter.write_line(f"Repeat it with: scripts/test.sh --thorough -n 0 {shlex.quote(report.nodeid)}")
