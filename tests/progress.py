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

failed: set[str] = set()


def write(**event: object) -> None:
    """Append one event; each fits into one write, so that events of several processes do not mix."""
    with open(os.environ["CCDEPTH_PROGRESS"], "a", encoding="utf-8") as file:
        file.write(json.dumps(event) + "\n")


def is_worker(config: pytest.Config) -> bool:
    """Whether another process hands out the tests."""
    return hasattr(config, "workerinput")


def runs_tests(config: pytest.Config) -> bool:
    """Whether this process runs tests itself."""
    return is_worker(config) or not config.getoption("numprocesses", None)


class Progress:
    """The events of this process."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        if runs_tests(self._config):
            write(total=len(session.items))

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        if runs_tests(self._config):
            write(start=nodeid, pid=os.getpid())

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            failed.add(report.nodeid)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        if runs_tests(self._config):
            write(finish=nodeid, failed=nodeid in failed)

    def pytest_sessionfinish(self, exitstatus: int) -> None:
        if not is_worker(self._config):
            write(over=int(exitstatus))

    @pytest.hookimpl(wrapper=True)
    def pytest_report_teststatus(self) -> Generator[None, Any, tuple[str, str, Any]]:
        """No letters: the line of progress says more."""
        category, _, word = yield
        return category, "", word


def pytest_configure(config: pytest.Config) -> None:
    if "CCDEPTH_PROGRESS" in os.environ:
        config.pluginmanager.register(Progress(config))
