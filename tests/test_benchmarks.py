# SPDX-License-Identifier: GPL-3.0-or-later
"""What the programs in benchmarks/ name is there."""

from __future__ import annotations

from dataclasses import fields, is_dataclass

import pytest

from benchmarks.tuned_constants import CACHES, ENTRIES, WORKLOADS, located


@pytest.mark.parametrize(
    "place", sorted({each.place for each in ENTRIES} | {name for c in CACHES.values() for name in c})
)
def test_what_is_switched_off_is_there(place: str) -> None:
    owner, name = located(place)
    fields_there = {field.name for field in fields(owner)} if is_dataclass(owner) else set()
    assert name in vars(owner).keys() | fields_there


def test_workloads_of_what_is_switched_off_are_there() -> None:
    assert {workload for each in ENTRIES for workload in each.workloads} <= WORKLOADS.keys()
