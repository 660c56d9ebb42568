"""How long results take to a healthy reader beside dashboards that hardly read.

The service has the pipeline without mathematics: what is measured is the way through it. Each station puts 50
batches a second. A slow dashboard subscribes to everything and is stopped for most of the time, but never so
long that its lease ends: the worst reader that stays connected. Sockets are small, so that its link is full
at once. The latency is from the put of a batch to the arrival of its posterior. Rounds take turns, because
machines have moods. Usage: python tests/bench/slow_dashboard.py
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import threading
import time
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import zenoh

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_protocol.codec import decode, unpack_samples
from caesura_protocol.keys import parse_session_key, session_key
from caesura_protocol.messages import Posterior
from clients.conftest import free_port
from harness.peer import Peer
from harness.processes import Process
from harness.sessions import batch, opening

SMALL_SOCKET = "#so_sndbuf=16384;so_rcvbuf=16384"
STOPPED_S, RUNNING_S = 1.2, 0.02
SLOW = (0, 1, 3)  # dashboards
BATCHES_PER_S = 50.0
_SERVICE = """
import sys, threading
sys.path[:] = sys.argv[2:]
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from harness.fake_pipeline import make_fake_pipeline
config = ServiceConfig(instance="bench", listen=sys.argv[1], preset="fake")
with Service(config, pipeline_factory=make_fake_pipeline):
    print("ready", flush=True)
    threading.Event().wait()
"""
_DASHBOARD = """
import json, sys, threading, zenoh
from caesura_service.server.network_join import SETTINGS
config = zenoh.Config()
for key, value in {**SETTINGS, "mode": "client", "connect/endpoints": [sys.argv[1]]}.items():
    config.insert_json5(key, json.dumps(value))
def count(sample):
    pass
with zenoh.open(config) as network:
    handler = zenoh.handlers.Callback(count, indirect=False)
    declared = network.declare_subscriber("caesura/v1/session/**", handler)
    print("ready", flush=True)
    threading.Event().wait()
"""


class Latencies:
    """Arrivals of posteriors against the batches that they came of."""

    def __init__(self) -> None:
        self.seconds: list[float] = []
        self._ends: dict[str, list[float]] = {}  # by station: session time up to which samples were put
        self._puts: dict[str, list[float]] = {}  # and when

    def put(self, station: str, end: float) -> None:
        self._ends.setdefault(station, []).append(end)
        self._puts.setdefault(station, []).append(time.monotonic())

    def arrived(self, sample: zenoh.Sample) -> None:
        now = time.monotonic()
        station = parse_session_key(str(sample.key_expr))[0]
        posterior = decode(sample.payload.to_bytes(), str(sample.encoding), Posterior)
        place = bisect_left(self._ends[station], posterior.t)
        if place < len(self._puts[station]):
            self.seconds.append(now - self._puts[station][place])


@contextmanager
def dashboards(count: int, endpoint: str) -> Iterator[None]:
    """Processes that are stopped for most of the time."""
    command = [sys.executable, "-c", _DASHBOARD, endpoint + SMALL_SOCKET]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(count)]
    for process in running:
        assert process.stdout is not None
        process.stdout.readline()
    over = threading.Event()

    def stutter() -> None:
        while not over.is_set():
            for number, wait_s in ((signal.SIGSTOP, STOPPED_S), (signal.SIGCONT, RUNNING_S)):
                for process in running:
                    os.kill(process.pid, number)
                over.wait(wait_s)

    thread = threading.Thread(target=stutter, daemon=True)
    thread.start()
    yield
    over.set()
    thread.join()
    for process in running:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()


def measure(slow: int, stations: int, seconds: float) -> tuple[Latencies, int]:
    """Latencies with so many slow dashboards, and how many messages the service dropped."""
    endpoint, latencies = f"tcp/127.0.0.1:{free_port()}", Latencies()
    service = Process([sys.executable, "-c", _SERVICE, endpoint + SMALL_SOCKET, *sys.path])
    service.start()
    try:
        with Peer(endpoint) as robot, Peer(endpoint) as reader:
            handler = zenoh.handlers.Callback(latencies.arrived, indirect=False)
            received = reader.network.declare_subscriber(session_key("*", "*", "posterior"), handler)
            names = [f"cell-{index}" for index in range(stations)]
            for name in names:
                robot.command(opening(), name)
            with dashboards(slow, endpoint):
                teach(robot, names, seconds, latencies)
            dropped = robot.service_status("bench").dropped
            received.undeclare()
    finally:
        service.kill()
    return latencies, dropped


def teach(robot: Peer, names: list[str], seconds: float, latencies: Latencies) -> None:
    """Put batches of every station at their time."""
    made = [batch(seq) for seq in range(round(seconds * BATCHES_PER_S))]
    began = time.monotonic()
    for one in made:
        time.sleep(max(0.0, began + one.seq / BATCHES_PER_S - time.monotonic()))
        for name in names:
            latencies.put(name, float(unpack_samples(one)[-1, 0]))
            robot.send(one, name)


def main() -> None:
    """Print one row for each number of slow dashboards."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stations", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    what = "put of a batch to its posterior [ms]"
    print(f"{options.stations} stations, {options.rounds} rounds of {options.seconds:g} s; {what}")
    print(f"{'slow':>5} {'results':>8} {'median':>8} {'p99':>8} {'max':>8} {'dropped':>8}")
    seconds: dict[int, list[float]] = {slow: [] for slow in SLOW}
    drops = dict.fromkeys(SLOW, 0)
    for slow in SLOW * options.rounds:
        latencies, dropped = measure(slow, options.stations, options.seconds)
        seconds[slow] += latencies.seconds
        drops[slow] += dropped
    for slow in SLOW:
        ms = 1000 * np.array(seconds[slow])
        median, p99 = np.percentile(ms, [50, 99])
        print(f"{slow:5} {ms.size:8} {median:8.1f} {p99:8.1f} {ms.max():8.1f} {drops[slow]:8}")


if __name__ == "__main__":
    main()
