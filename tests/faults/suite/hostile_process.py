"""A station that sends what is costly to read, and a dashboard that follows everything, each in a process.

`python hostile_process.py attack ENDPOINT WHAT PER_S REPORT`, or `… dashboard ENDPOINT REPORT`: prints
`ready` and goes on until SIGTERM; then it writes a report.
"""

from __future__ import annotations

import json
import resource
import signal
import sys
import threading
import time
from pathlib import Path

import msgpack
import zenoh

from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_protocol.codec import encode, encoding_of
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Control, Open, SampleBatch
from caesura_protocol.transport.zenoh_transport import SETTINGS, ZenohTransport

STATION = "hostile"
COMMANDS_PER_S = 5.0
ANSWER_S = 10.0
OPENING = Open(session="s1", columns=("t", "px"), wrench_source="none")
HEAD = {"session": "s1", "epoch": 0, "seq": 0, "n": 1, "t0": 0.0, "samples": b""}
MILLION = [1] * 1_000_000
DEEP = b"\x91" * 1000 + b"\x00"


def payloads(what: str) -> tuple[bytes, bytes]:
    """Of a batch and of a command."""
    opening = {"type": "open", "session": "s1"}
    if what == "columns":
        batch = msgpack.packb({**HEAD, "columns": MILLION})
        return batch, msgpack.packb({"command": {**opening, "columns": MILLION}})
    marked = msgpack.packb("deep")
    batch = msgpack.packb({**HEAD, "columns": "deep"}).replace(marked, DEEP)
    return batch, msgpack.packb({"command": {**opening, "columns": "deep"}}).replace(marked, DEEP)


def attack(endpoint: str, what: str, per_s: float, over: threading.Event) -> dict[str, int]:
    """So many batches a second, and a few commands; how many there were, and how many were answered."""
    config = zenoh.Config()
    where = {"mode": "client", "connect/endpoints": [endpoint]}
    for key, value in {**SETTINGS, **where}.items():
        config.insert_json5(key, json.dumps(value))
    batch, command = payloads(what)
    samples, control = station_key(STATION, "samples"), station_key(STATION, "control")
    done = {"put": 0, "asked": 0, "answered": 0}

    def ask() -> None:
        while not over.wait(1.0 / COMMANDS_PER_S):
            done["asked"] += 1
            replies = network.get(control, payload=command, encoding=encoding_of(Control), timeout=ANSWER_S)
            done["answered"] += any(
                reply.err is not None and "caesura.Error" in str(reply.err.encoding) for reply in replies
            )

    with zenoh.open(config) as network:
        opening = encode(Control(command=OPENING))
        list(network.get(control, payload=opening.payload, encoding=opening.encoding, timeout=ANSWER_S))
        asking = threading.Thread(target=ask)
        print("ready", flush=True)
        asking.start()
        began = time.monotonic()
        while not over.wait(max(0.0, began + done["put"] / per_s - time.monotonic())):
            network.put(samples, batch, encoding=encoding_of(SampleBatch))
            done["put"] += 1
        asking.join()
    return done


class Sent(NetworkFollower):
    """A gateway that counts how often one of its threads met something that it did not expect."""

    restarts = 0

    def _trouble(self, name: str, why: str = "") -> None:
        self.restarts += bool(why)
        super()._trouble(name, why)


def dashboard(endpoint: str, over: threading.Event) -> dict[str, int]:
    """Follow everything; how often a thread had to begin again, and the most memory [MB]."""
    with ZenohTransport(endpoint, timeout_s=ANSWER_S) as transport, Sent(transport) as gateway:
        print("ready", flush=True)
        over.wait()
        received = len(gateway.received)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return {"restarts": gateway.restarts, "received": received, "peak_mb": peak_mb}


def main() -> None:
    """Run until SIGTERM."""
    over = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: over.set())
    mode, endpoint, *rest = sys.argv[1:]
    if mode == "attack":
        what, per_s, report = rest
        found = attack(endpoint, what, float(per_s), over)
    else:
        (report,) = rest
        found = dashboard(endpoint, over)
    Path(report).write_text(json.dumps(found))


if __name__ == "__main__":
    main()
