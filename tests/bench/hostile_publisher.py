"""How late a dashboard reads the samples of seven stations beside one that publishes without measure.

    python tests/bench/hostile_publisher.py [--kind none full small status junk] [--rate 1000] [--seconds 8]

Router, stations, the hostile one and the dashboard are processes. Prints for each kind how many batches the
seven sent and the dashboard read, and how late it read them after their last sample: median, 99th percentile
and longest.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_protocol.codec import Encoded, decode, encode, encoding_of, pack_samples, unpack_samples
from caesura_protocol.keys import station_key
from caesura_protocol.messages import MAX_BATCH_SAMPLES, MAX_COLUMNS, BridgeStatus, SampleBatch
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from clients.conftest import RouterNetwork

STATIONS = 7
BATCH_S = 0.02
COLUMNS = ("t", "px", "py", "pz", "qx", "qy", "qz", "qw", "fx", "fy", "fz", "mx", "my", "mz")
SETTLED_S = 1.0  # until the routers know the subscription of the reader


def batch_of(shape: tuple[int, int], seq: int = 0, end_s: float = 0.0) -> Encoded:
    """A batch of (n, columns) zeros, a sample a millisecond, the last one at `end_s`."""
    matrix = np.zeros(shape)
    matrix[:, 0] = end_s - np.arange(shape[0])[::-1] * 1e-3
    columns = (*COLUMNS, *(f"c{number}" for number in range(shape[1])))[: shape[1]]
    return encode(pack_samples(matrix, columns, session="s1", epoch=0, seq=seq))


HOSTILE = {
    "none": None,
    "full": batch_of((MAX_BATCH_SAMPLES, MAX_COLUMNS)),
    "small": batch_of((1, 2)),
    "status": encode(BridgeStatus(station="hostile", bridge="b", state="ready", source="x")),
    "junk": Encoded(b"\xc0" * 20, encoding_of(SampleBatch)),
}


def send_honest(endpoint: str, over: Event, sent: Any) -> None:
    """Send a batch of every station fifty times a second."""
    with ZenohTransport(endpoint) as transport:
        due = time.monotonic()
        while not over.is_set():
            content = batch_of((20, len(COLUMNS)), sent.value, time.monotonic())
            for number in range(STATIONS):
                transport.put(station_key(f"cell-{number}", "samples"), content)
            sent.value += 1
            due += BATCH_S
            time.sleep(max(0.0, due - time.monotonic()))


def send_hostile(endpoint: str, over: Event, kind: str, rate: float, sent: Any) -> None:
    """Send the same message `rate` times a second; as fast as it can with 0."""
    content = HOSTILE[kind]
    key = station_key("hostile", "bridge_status" if kind == "status" else "samples")
    with ZenohTransport(endpoint) as transport:
        due = time.monotonic()
        while content is not None and not over.is_set():
            transport.put(key, content)
            sent.value += 1
            if rate:
                due += 1.0 / rate
                time.sleep(max(0.0, due - time.monotonic()))


class _Timed(NetworkFollower):
    """A dashboard's reader that notes how late the batches of the seven are."""

    def __init__(self, transport: ZenohTransport) -> None:
        self.late_s: list[float] = []
        super().__init__(transport)

    def _sampled(self, delivery: Any) -> None:
        super()._sampled(delivery)
        if "hostile" not in delivery.key:
            batch = decode(delivery.payload, delivery.encoding, SampleBatch)
            self.late_s.append(time.monotonic() - float(unpack_samples(batch)[-1, 0]))


def follow(endpoint: str, ready: Event, over: Event, found: Any) -> None:
    """Read as a dashboard does; pass on how late each batch was [s]."""
    with ZenohTransport(endpoint) as transport, _Timed(transport) as follower:
        time.sleep(SETTLED_S)
        ready.set()
        before = len(follower.late_s)
        over.wait()
        found.put(follower.late_s[before:])


def measure(endpoint: str, kind: str, rate: float, seconds: float) -> str:
    """One line on one kind of hostile message."""
    context = multiprocessing.get_context("spawn")
    ready, over, found = context.Event(), context.Event(), context.Queue()
    honest, hostile = context.Value("L", 0), context.Value("L", 0)
    children = [
        context.Process(target=send_honest, args=(endpoint, over, honest)),
        context.Process(target=follow, args=(endpoint, ready, over, found)),
        context.Process(target=send_hostile, args=(endpoint, over, kind, rate, hostile)),
    ]
    try:
        for child in children[:2]:
            child.start()
        if not ready.wait(60.0):
            raise SystemExit("the dashboard did not start")
        before = honest.value
        children[2].start()
        time.sleep(seconds)
        over.set()
        sent = honest.value - before
        late_ms = 1e3 * np.array(found.get(timeout=60.0))
    finally:
        over.set()
        for child in children:
            if child.pid is not None:
                child.join(10.0)
                child.kill()
    median, most, longest = np.percentile(late_ms, (50, 99, 100))
    return (
        f"{kind}: {hostile.value} messages; of {STATIONS * sent} batches {late_ms.size} were read, "
        f"late by {median:.1f} ms (median), {most:.1f} (99th percentile), {longest:.1f} (longest)"
    )


def main() -> None:
    """Print a line for each kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", nargs="+", choices=HOSTILE, default=[*HOSTILE])
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--seconds", type=float, default=8.0)
    options = parser.parse_args()
    with RouterNetwork() as network:
        for kind in options.kind:
            print(measure(network.endpoint, kind, options.rate, options.seconds), flush=True)


if __name__ == "__main__":
    main()
