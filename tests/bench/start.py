"""How long `caesura serve` takes to be ready, and what a first session loses while kernels compile.

    python tests/bench/start.py [--rounds 5] [--seconds 20] [--json DIR]

From the command to the line that says that it can be found: with kernels that have been compiled, and with
none (a cache directory of its own, empty). Beside the second a demonstration starts at the same moment and,
like a hand, waits for nobody; its bridge is connected with a router and may wait for its close as long as it
takes. Prints seconds, and processor time of the service. Ends with 1 where a sample was lost.
"""

from __future__ import annotations

import math
import os
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from machine import machine, options, report

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_clients import connect
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources.file import FileSource
from caesura_protocol.recording import Recording
from harness.processes import QUICK, RECORDING, SESSION, Router, ServiceProcess, running

STATION, PATIENCE_S = "cell-1", 600.0
PATIENT = replace(QUICK, close_timeout_s=PATIENCE_S)
READY_S = 3.0


class StartTimes(NamedTuple):
    """Of one service."""

    wall_s: float
    processor_s: float


def main() -> None:
    """Measure both."""
    parser = options(__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of the demonstration")
    parser.add_argument("--rounds", type=int, default=5, help="with kernels that have been compiled")
    asked = parser.parse_args()
    print(", ".join(f"{name} {value}" for name, value in machine().items()))
    with tempfile.TemporaryDirectory() as directory:
        journals = (Path(directory) / f"{i}.sqlite" for i in range(asked.rounds + 2))
        start(next(journals))  # whatever was not compiled is now
        warm = [start(next(journals)) for _ in range(asked.rounds)]
        with without_kernels(Path(directory)):
            cold, lost = first_session(next(journals), asked.seconds)
    median = StartTimes(*(statistics.median(column) for column in zip(*warm, strict=True)))
    rows = [("compiled", *median, READY_S, ""), ("not compiled", *cold, "", lost)]
    columns = ("kernels", "ready after [s]", "processor [s]", "at most [s]", "samples lost")
    report("start", "From `caesura serve` to ready", columns, rows, asked.json)
    raise SystemExit(bool(lost))


def start(journal: Path) -> StartTimes:
    """One service, which is ended once it is ready."""
    before, used = time.monotonic(), children_s()
    service = ServiceProcess(journal)
    try:
        service.start()
        taken = time.monotonic() - before
    finally:
        service.kill()
    return StartTimes(taken, children_s() - used)


def first_session(journal: Path, seconds: float) -> tuple[StartTimes, int]:
    """A service, and a hand that does not wait for it; how many samples did not arrive."""
    with running(Router()) as router:
        service = ServiceProcess(journal, router=router.endpoint)
        source = FileSource(lasting(seconds))
        source.can_wait = False
        before, used = time.monotonic(), children_s()
        with (
            connect(router.endpoint, timeout_s=PATIENCE_S) as caesura,
            Bridge(caesura.transport, STATION, source, session=SESSION, settings=PATIENT) as bridge,
            ThreadPoolExecutor(1) as pool,
        ):
            service.begin()
            try:
                done = pool.submit(bridge.run)
                service.ready()
                taken = time.monotonic() - before
                done.result()
                status = caesura.snapshot(STATION, SESSION).status
            finally:
                service.kill()
    return StartTimes(taken, children_s() - used), len(source.recording.t) - status.samples


def lasting(seconds: float) -> Recording:
    """The demonstration again and again, as one."""
    times = math.ceil(seconds / (RECORDING.t[-1] - RECORDING.t[0]))
    each = RECORDING.t.size
    t = np.arange(times * each) * (RECORDING.t[-1] - RECORDING.t[0]) / (each - 1)
    signals = {name: np.tile(values, (times, 1)) for name, values in RECORDING.signals.items()}
    return replace(RECORDING, t=t, signals=signals)


def children_s() -> float:
    """[s] of processor that ended children have used."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@contextmanager
def without_kernels(directory: Path) -> Iterator[None]:
    """For processes that begin meanwhile."""
    before = os.environ.get("NUMBA_CACHE_DIR")
    os.environ["NUMBA_CACHE_DIR"] = str(directory / "kernels")
    try:
        yield
    finally:
        os.environ.pop("NUMBA_CACHE_DIR")
        if before is not None:
            os.environ["NUMBA_CACHE_DIR"] = before


if __name__ == "__main__":
    main()
