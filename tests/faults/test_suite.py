"""A short part of `make faults`: fewer stations, shorter demonstrations, the same bars."""

from __future__ import annotations

from functools import partial

import pytest

from faults.suite import disks, io_errors, killed, lines, reference, rings
from faults.suite.outcome import Scale
from faults.suite.relay import Line

SMALL = Scale(stations=2, seconds=8.0, pace=4.0)
SLOW = Scale(stations=2, seconds=16.0, pace=2.0)  # lasts until the service is gone, also on a busy machine
EVERYTHING = Line(lost=0.1, doubled=0.1, late=0.1)


@pytest.mark.parametrize(
    "fault",
    [
        partial(killed.router_killed, scale=SMALL),
        partial(lines.bad_messages, EVERYTHING, scale=SMALL, least=5),
        partial(disks.disk_unwritable, scale=SMALL),
        partial(rings.ring_too_small, scale=SLOW, away_s=2.0),
        partial(io_errors.io_errors, stride=29),
        partial(reference.reference, scale=Scale(stations=1, seconds=8.0)),
    ],
    ids=[
        "router killed",
        "messages lost, doubled and late",
        "disk unwritable",
        "ring too small",
        "disk errors",
        "no fault",
    ],
)
def test_a_fault_meets_its_bar(fault, tmp_path):
    row = fault(tmp_path)
    assert row.met, row.note
