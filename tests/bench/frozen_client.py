"""What a station feels of a client that asks for results and is frozen before it reads them: latencies.

A real service over loopback; a station sends a batch every 10 ms and looks when it is processed. Beside it
another process opens sessions of its own, asks for their snapshots thousands of times, sends commands, and
stops itself (SIGSTOP). Rows: how long an answer waits until Zenoh closes the client's link.
Usage: python tests/bench/frozen_client.py [--seconds 8] [--wait 5.0 0.5] [--json DIR]
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import sys
import time
from multiprocessing.synchronize import Event
from pathlib import Path
from unittest import mock

import numpy as np
import zenoh
from machine import options, report

sys.path.append(str(Path(__file__).resolve().parents[1]))

from caesura_protocol.codec import encode
from caesura_protocol.keys import session_key, station_key
from caesura_protocol.messages import Control
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.server import network_join
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import Peer
from harness.sessions import batches, opening

QUESTIONS, COMMANDS, SESSIONS = 3000, 30, 4
GIVEN_UP_S = 12.0
COLUMNS = ("an answer waits [s]", "batches", "p50 [ms]", "p99", "most", "never")


def main() -> None:
    """A row for each time."""
    parser = options(__doc__)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--wait", type=float, nargs="*", default=[5.0, 0.5])
    asked = parser.parse_args()
    report(
        "frozen_client", "a frozen client", COLUMNS, [row(s, asked.seconds) for s in asked.wait], asked.json
    )


def row(wait_s: float, seconds: float) -> tuple[object, ...]:
    """As it is printed."""
    config = ServiceConfig(instance="bench", listen="tcp/127.0.0.1:0", preset="fake")
    waits = mock.patch.object(network_join, "BLOCKED_US", round(1e6 * wait_s))
    with (
        waits,
        Service(config, pipeline_factory=make_fake_pipeline) as service,
        Peer(service.endpoint) as peer,
    ):
        peer.command(opening())
        context = multiprocessing.get_context("spawn")
        asked = context.Event()
        client = context.Process(target=frozen, args=(service.endpoint, asked))
        client.start()
        try:
            took = latencies(service, peer, asked, seconds)
        finally:
            os.kill(client.pid or 0, signal.SIGKILL)
            client.join()
    p50, p99, most = (1e3 * float(np.percentile(took, p)) for p in (50, 99, 100))
    return wait_s, len(took), p50, p99, most, sum(s >= GIVEN_UP_S for s in took)


def latencies(service: Service, peer: Peer, asked: Event, seconds: float) -> list[float]:
    """[s] from putting a batch until it is processed, until so long after the client has asked."""
    took: list[float] = []
    until = math.inf
    for number, batch in enumerate(batches(10_000)):
        began = time.monotonic()
        if until == math.inf and asked.is_set():
            until = began + seconds
        if began >= until:
            break
        peer.send(batch)
        (session,) = service.registry.index.sessions["cell-1"]
        while session.state.counters.batches <= number and time.monotonic() < began + GIVEN_UP_S:
            time.sleep(0.002)
        took.append(time.monotonic() - began)
        if took[-1] >= GIVEN_UP_S:
            break  # what comes behind a batch that is lost waits for it
        time.sleep(0.01)
    return took


def frozen(endpoint: str, asked: Event) -> None:
    """The client, until it stops itself."""
    peer, station = Peer(endpoint), "hostile"
    for number in range(SESSIONS):
        peer.command(opening(f"s{number}"), station)
        for batch in batches(60, f"s{number}"):
            peer.send(batch, station)
    payload, encoding = encode(Control(command=opening("s0")))
    for _ in range(QUESTIONS):
        peer.network.get(session_key(station, "*", "snapshot"), ignored(), timeout=60.0)
    for _ in range(COMMANDS):
        key = station_key(station, "control")
        peer.network.get(key, ignored(), payload=payload, encoding=encoding, timeout=60.0)
    asked.set()
    os.kill(os.getpid(), signal.SIGSTOP)


def ignored() -> zenoh.handlers.Callback[zenoh.Reply]:
    """Takes replies, if any are read."""
    return zenoh.handlers.Callback(lambda _: None, indirect=False)


if __name__ == "__main__":
    main()
