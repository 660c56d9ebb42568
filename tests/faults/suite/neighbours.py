"""A station that does as much as it can, beside seven that are taught: nothing of theirs is lost or late."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from caesura_clients.query import service_status
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from faults.suite.outcome import Disturbance, Played, Row, Scale, played
from faults.suite.stations import CONNECT_S, Station, reached
from harness.attacker import Attacker
from harness.processes import running, serving

HONEST = Scale(stations=7, pace=1.0)
LIMIT_MS = 100.0  # of the 99th percentile
LASTS = 0.9  # of the demonstrations


def hostile_station(how: str, directory: Path, scale: Scale = HONEST) -> Row:
    """`harness.attacker` for as long as the others are taught."""

    def disturb(stations: list[Station], disturbance: Disturbance) -> None:
        reached(stations, LASTS)
        with ZenohTransport(service.endpoint, timeout_s=CONNECT_S) as transport:
            (status,) = service_status(transport)
        disturbance.note = f"{status.dropped} messages dropped, {status.refused} refused, none of theirs"

    with serving(directory) as service, running(Attacker(how, service.endpoint)):
        done = played(service.endpoint, directory, disturb, scale=scale)
        late_ms = np.array(lateness_ms(done))
        p99, most = np.percentile(late_ms, [99, 100])
        note = f"results {p99:.0f} ms late (p99), {most:.0f} ms at most"
        return done.row(note=note, met=bool(p99 < LIMIT_MS))


def lateness_ms(done: Played) -> list[float]:
    """[ms] of every result of the honest stations, compared with the promptest one of its station."""
    late: list[float] = []
    for one in done.found:
        came = np.array(done.watched.came[one.station.name])
        lag = came[:, 0] - came[:, 1]
        late += (1e3 * (lag - lag.min())).tolist()
    return late
