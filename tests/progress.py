# SPDX-License-Identifier: GPL-3.0-or-later
"""A pytest plugin that writes what each process of a test run does into a file, for `scripts/supervise_tests.py`.

The file is named by the environment variable CCDEPTH_PROGRESS; each line is a JSON object:
``{"total": 1234}``, ``{"start": TEST, "pid": 17}``, ``{"finish": TEST, "failed": false}``, ``{"over": STATUS}``.
"""

import json
import os
from collections.abc import Generator
from typing import Any

import pytest


def write(**event: object) -> None:
    """Append one event; each fits into one write, so that events of several processes do not mix."""
    with open(os.environ["CCDEPTH_PROGRESS"], "a", encoding="utf-8") as file:
        file.write(json.dumps(event) + "\n")


class Progress:
    """The events of this process."""

    def __init__(self, config: pytest.Config) -> None:
        # Whether another process hands out the tests, and whether this one runs tests itself.
        self._is_worker = hasattr(config, "workerinput")
        self._runs_tests = self._is_worker or not config.getoption("numprocesses", None)
        self._failed: set[str] = set()

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        if self._runs_tests:
            write(total=len(session.items))

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        if self._runs_tests:
            write(start=nodeid, pid=os.getpid())

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self._failed.add(report.nodeid)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        if self._runs_tests:
            write(finish=nodeid, failed=nodeid in self._failed)

    def pytest_sessionfinish(self, exitstatus: int) -> None:
        if not self._is_worker:
            write(over=int(exitstatus))

    @pytest.hookimpl(wrapper=True)
    def pytest_report_teststatus(self) -> Generator[None, Any, tuple[str, str, Any]]:
        """No letters: the line of progress says more."""
        category, _, word = yield
        return category, "", word


def pytest_configure(config: pytest.Config) -> None:
    if "CCDEPTH_PROGRESS" in os.environ:
        config.pluginmanager.register(Progress(config))
