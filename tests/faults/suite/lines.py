"""Bad lines: jitter, stalls and cuts below TCP; loss, doubles and disorder above it."""

from __future__ import annotations

import threading
from pathlib import Path

from caesura_protocol.keys import service_key
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from faults.suite.outcome import FULL, Disturbance, Row, Scale, played
from faults.suite.proxy import proxied
from faults.suite.relay import Line, relayed
from faults.suite.stations import CONNECT_S, TaughtStation, reached
from harness.processes import Router, eventually, running, serving

JITTER_S = 0.3
STALL_S = 4.0  # longer than the lease


def bad_line(directory: Path) -> Row:
    """300 ms of jitter all the time, connections that are cut, and one stall."""

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        proxy.jitter_s = JITTER_S
        for share in (0.2, 0.4):
            reached(stations, share)
            disturbance.is_over()
            proxy.cut()
        reached(stations, 0.5)
        proxy.flows = False
        threading.Event().wait(STALL_S)
        disturbance.is_over()
        proxy.flows = True

    with serving(directory) as service, proxied(service.endpoint) as proxy:
        done = played(service.endpoint, directory, disturb, through=proxy.endpoint)
        return done.row(note=f"{1e3 * JITTER_S:g} ms jitter, cut twice, nothing for {STALL_S:g} s")


def bad_messages(line: Line, directory: Path, scale: Scale = FULL, least: int = 100) -> Row:
    """Such a share of samples and answers lost, doubled or late; least: so many, or it proves nothing."""
    line = Line(line.lost, line.doubled, line.late)
    with (
        running(Router()) as near,
        serving(directory) as service,
        relayed(near.endpoint, service.endpoint, line),
    ):
        there(near.endpoint)
        done = played(service.endpoint, directory, lambda *_: None, through=near.endpoint, scale=scale)
        note = ", ".join(f"{count} {what}" for what, count in line.counts.items())
        hurt = min(
            line.counts[what]
            for what, share in (("lost", line.lost), ("doubled", line.doubled), ("late", line.late))
            if share
        )
        return done.row(note=f"messages: {note}", met=hurt >= least)


def there(endpoint: str) -> None:
    """Wait until a service is seen here."""
    with ZenohTransport(endpoint, timeout_s=CONNECT_S) as transport:
        eventually(lambda: bool(transport.list_tokens(service_key("*", "alive"))))
