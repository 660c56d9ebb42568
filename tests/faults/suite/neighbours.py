"""A station that does as much as it can, beside seven that are taught: nothing of theirs is lost or late."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from caesura_clients.query import service_status, snapshot
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from faults.suite.lateness import lateness_ms
from faults.suite.outcome import Disturbance, Row, Scale, played
from faults.suite.stations import CONNECT_S, Station, reached
from harness.attacker import SESSION, STATION, Attacker
from harness.processes import running, serving

HONEST = Scale(stations=7, pace=1.0)
LIMIT_MS = 100.0  # of the 99th percentile
LASTS = 0.9  # of the demonstrations
# What the attacker did at least, or it proves nothing: what it sent, and what the service did of it.
LEAST: Mapping[str, Mapping[str, int]] = {
    "dense": {"put": 4000, "observations": 5000},
    "edits": {"put": 2000, "accepted": 1, "overloaded": 1000},
}


def hostile_station(how: str, directory: Path, scale: Scale = HONEST) -> Row:
    """`harness.attacker` for as long as the others are taught."""
    did = Counter[str]()

    def disturb(stations: list[Station], disturbance: Disturbance) -> None:
        reached(stations, LASTS)
        with ZenohTransport(service.endpoint, timeout_s=CONNECT_S) as transport:
            (status,) = service_status(transport)
            did["observations"] = observations(transport)
        disturbance.note = f"{status.dropped} messages dropped, {status.refused} refused, none of theirs"

    with serving(directory) as service, running(Attacker(how, service.endpoint)) as attacker:
        done = played(service.endpoint, directory, disturb, scale=scale)
        did += attacker.report()
        p50, p99, most = np.percentile(lateness_ms(done), [50, 99, 100])
        late = f"results {p50:.0f} ms late (median), {p99:.0f} ms (p99), {most:.0f} ms at most"
        did_least = all(did[what] >= least for what, least in LEAST[how].items())
        note = f"{late}; it did {dict(did)}" + ("" if did_least else f", expected {dict(LEAST[how])}")
        return done.row(note=note, met=bool(p99 < LIMIT_MS) and did_least)


def observations(transport: ZenohTransport) -> int:
    """How many the service has made of what the attacker sent."""
    try:
        return snapshot(transport, STATION, SESSION).status.observations
    except (CaesuraError, ProtocolError):
        return 0
