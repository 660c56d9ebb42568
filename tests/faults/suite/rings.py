"""The service is away for longer than the bridges remember: the results say what is missing, and go on."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from caesura_clients import connect
from faults.suite.outcome import FULL, Disturbance, Row, Scale, played
from faults.suite.stations import SETTINGS, TaughtStation, reached
from harness.processes import DEADLINE_S, eventually, reaches, serving

SMALL = replace(SETTINGS, ring_samples=400, window_batches=8)  # 2 s
AWAY_S = 4.0


def ring_too_small(directory: Path, scale: Scale = FULL, away_s: float = AWAY_S) -> Row:
    """A ring of 2 s, a service that is away for longer."""

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        reached(stations, 0.2)
        with connect(service.endpoint, timeout_s=DEADLINE_S) as caesura:
            for station in stations:  # what the journal never had has no beginning
                reaches(caesura, station.name, 1)
            eventually(lambda: all(one.journal and not one.journal.waiting for one in caesura.services()))
        service.kill()
        time.sleep(away_s)
        disturbance.is_over()
        service.start()

    with serving(directory) as service:
        done = played(service.endpoint, directory, disturb, settings=SMALL, scale=scale)
    gaps = [gap for one in done.found for gap in one.snapshot.status.gaps]
    noted = all(
        any("gap" in note or "missing" in note for note in one.snapshot.program.notes) for one in done.found
    )
    lengths = f"{min(gap.tn - gap.t0 for gap in gaps):.1f} to {max(gap.tn - gap.t0 for gap in gaps):.1f} s"
    named = all(gap.reason == "evicted" for gap in gaps)
    note = f"{len(gaps)} gaps of {lengths}, all evicted: {named}; the programs say so: {noted}"
    return done.row("gap", note=note, met=named and len(gaps) >= len(done.found))
