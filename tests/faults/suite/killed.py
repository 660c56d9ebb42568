"""kill −9, and machines that hang: service, router and bridges."""

from __future__ import annotations

import random
import time
from pathlib import Path

from faults.suite.outcome import FULL, Disturbance, Row, Scale, played
from faults.suite.stations import TaughtStation, reached
from harness.processes import Process, Router, running, serving

FROZEN_S = 10.0
SEED = 4


def service_killed(directory: Path) -> Row:
    """Three times, at a random moment of each third."""
    rng = random.Random(SEED)
    moments = [(third + rng.uniform(0.1, 0.7)) / 3 for third in range(3)]

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        for share in moments:
            reached(stations, share)
            service.kill()
            disturbance.is_over()
            service.start()
            starting_s.append(time.monotonic() - disturbance.over[-1])

    with serving(directory) as service:
        starting_s: list[float] = []
        done = played(service.endpoint, directory, disturb)
        note = "killed at " + ", ".join(f"{share:.0%}" for share in moments)
        times = zip(done.recoveries_s, starting_s, strict=True)
        each = ", ".join(f"{recovery:.1f} ({start:.1f})" for recovery, start in times)
        return done.row(note=f"{note}; recovery, of which starting: {each} s")


def router_killed(directory: Path, scale: Scale = FULL) -> Row:
    """Twice; service and bridges are its clients."""

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        for share in (0.25, 0.6):
            reached(stations, share)
            router.kill()
            time.sleep(1.0)  # so long is it away
            disturbance.is_over()
            router.start()

    with running(Router()) as router, serving(directory, router=router.endpoint) as service:
        return played(service.endpoint, directory, disturb, scale=scale).row(note="away 1 s, twice")


def frozen(which: str, directory: Path) -> Row:
    """SIGSTOP for FROZEN_S, of the service or of the router between it and the bridges."""

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        reached(stations, 0.2)
        process: Process = {"service": service, "router": router}[which]
        process.freeze()
        time.sleep(FROZEN_S)
        disturbance.is_over()
        process.thaw()

    with running(Router()) as router, serving(directory, router=router.endpoint) as service:
        done = played(service.endpoint, directory, disturb, scale=Scale(pace=1.0))
        return done.row(note=f"for {FROZEN_S:g} s")
