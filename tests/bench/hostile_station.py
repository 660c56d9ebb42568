"""What seven stations feel of an eighth that does as much as it can: latencies, and what they lose.

As in `service_load.py`: robots of 1 kHz, 20 samples a batch, real processes over loopback, each with a task
of its own; beside them nobody, then a station that sends dense batches, then one that edits a session of an
hour 200 times a second (`tests/harness/attacker.py`). Latency is from putting the batch that completes an
observation to receiving its result.
Usage: python tests/bench/hostile_station.py [--stations 7] [--only none|dense|edits …] [--json DIR]
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path

import numpy as np
from machine import machine, options, report
from service_load import measured

sys.path.append(str(Path(__file__).resolve().parents[1]))
from harness.attacker import Attacker
from harness.processes import running

TESTS = Path(__file__).resolve().parents[1]
WAYS = ("none", "dense", "edits")
COLUMNS = ("beside them", "lost", "results", "p50 [ms]", "p99", "most", "cores", "pace [ms]")


def main() -> None:
    """A row for each kind of neighbour."""
    parser = options(__doc__)
    parser.add_argument("--stations", type=int, default=7)
    parser.add_argument("--only", nargs="*", choices=WAYS, default=WAYS)
    asked = parser.parse_args()
    os.environ["PYTHONPATH"] = os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")])
    print(", ".join(f"{name} {value}" for name, value in machine().items()))
    rows = [row(how, asked.stations) for how in asked.only]
    report("hostile_station", f"{asked.stations} stations beside", COLUMNS, rows, asked.json)


def row(how: str, stations: int) -> tuple[object, ...]:
    """As it is printed."""
    load = measured(stations, 1, lockstep=False, beside=partial(attacking, how))
    p50, p99, most = (float(np.percentile(load.latencies_ms, p)) for p in (50, 99, 100))
    return how, load.lost, len(load.latencies_ms), p50, p99, most, load.processor, load.pace_ms


@contextmanager
def attacking(how: str, endpoint: str) -> Iterator[None]:
    """Somebody beside the stations."""
    with nullcontext() if how == "none" else running(Attacker(how, endpoint)):
        yield


if __name__ == "__main__":
    main()
