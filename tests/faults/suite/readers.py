"""A dashboard that hangs: stations lose nothing, and nobody else waits for their results."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from faults.suite.outcome import Disturbance, Played, Row, played
from faults.suite.stations import TaughtStation, reached
from harness.processes import Process, serving

DASHBOARDS = 3
PATIENCE_S = 2.0  # the lease of a link; closing those of the frozen kept everybody waiting for 10 s
_DASHBOARD = """
import sys
from caesura_clients import connect
with connect(sys.argv[1]) as caesura:
    for _ in caesura.results():
        print("ready", flush=True)
        break
    for _ in caesura.results():
        pass
"""


class DashboardReader(Process):
    """Follows every session; ready once it has seen something."""

    def __init__(self, endpoint: str) -> None:
        super().__init__([sys.executable, "-c", _DASHBOARD, endpoint])


def slow_dashboards(directory: Path) -> Row:
    """Frozen in the middle, for the rest of the demonstrations."""

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        for dashboard in dashboards:
            dashboard.begin()
        for dashboard in dashboards:
            dashboard.ready()
        reached(stations, 0.4)
        for dashboard in dashboards:
            dashboard.freeze()
        disturbance.is_over()

    with serving(directory) as service, ExitStack() as stack:
        dashboards = [DashboardReader(service.endpoint) for _ in range(DASHBOARDS)]
        for dashboard in dashboards:
            stack.callback(dashboard.kill)
        done = played(service.endpoint, directory, disturb)
    wait_s = longest_wait_s(done)
    note = f"{DASHBOARDS} frozen; longest wait of a healthy reader {wait_s:.2f} s"
    return done.row(note=note, met=wait_s < PATIENCE_S)


def longest_wait_s(done: Played) -> float:
    """[s] Between two results of a station, once the dashboards were frozen."""
    (frozen,) = done.disturbance.over
    waits = [
        np.diff([at for at, _ in came if at > frozen]).max(initial=0.0) for came in done.watched.came.values()
    ]
    return float(max(waits))
