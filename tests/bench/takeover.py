"""Two instances, 16 stations that are taught in real time; one is killed, and comes back: what it costs.

    python tests/bench/takeover.py [--stations 16] [--seconds 30] [--pace 1]

Prints samples lost and doubled, whether every field of the results is that of an undisturbed run, and the
times from the kill, or from the return, to the first result of the new owner, median and worst over its
stations, and how long nothing new came from any owner.
Real processes and a real router over loopback. Ends with 1 where something was lost, doubled or differs.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from caesura_protocol.codec import decode
from caesura_protocol.keys import session_key
from caesura_protocol.messages import Posterior, Snapshot
from caesura_protocol.transport.inbox import Inbox, ReceivedSample
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.ownership.station_assignment import stations_of
from faults.suite.stations import StationResults, TaughtStation, asked, reached, station_name, teaching
from harness.processes import DEADLINE_S, Router, ServiceProcess, eventually, running

EAST, WEST = "east", "west"
KILLED_AT, BACK_AT = 0.3, 0.55  # of the demonstrations


class ArrivedResult(NamedTuple):
    """One that arrived."""

    at: float  # [s]
    station: str
    instance: str
    t: float  # [s] session clock


@contextmanager
def receiving(endpoint: str) -> Iterator[list[ArrivedResult]]:
    """Every result, as it comes."""
    received: list[ArrivedResult] = []
    inbox, over = Inbox(1 << 20), threading.Event()

    def listen() -> None:
        while not over.is_set():
            item = inbox.get(0.05)
            if isinstance(item, ReceivedSample):
                said = decode(item.payload, item.encoding, Posterior)
                received.append(ArrivedResult(time.monotonic(), said.station, said.instance, said.t))

    thread = threading.Thread(target=listen, daemon=True)
    with (
        ZenohTransport(endpoint, timeout_s=DEADLINE_S) as transport,
        transport.subscribe(session_key("*", "*", "posterior"), inbox),
    ):
        thread.start()
        yield received
        over.set()
        thread.join()


class Times(NamedTuple):
    """[s] From a moment to the first result of the new owner; and how long nobody said anything new."""

    first: list[float]
    silence: list[float]

    def __str__(self) -> str:
        return (
            f"first result of the new owner {spread(self.first)}; without a new result {spread(self.silence)}"
        )


def spread(times_s: list[float]) -> str:
    return f"median {statistics.median(times_s):.2f} s, worst {max(times_s):.2f} s"


def times_since(moment: float, owner: str, stations: list[str], received: list[ArrivedResult]) -> Times:
    """How a change of owners was seen from outside."""
    first, silence = [], []
    for station in stations:
        came = [one for one in received if one.station == station]
        new = first_of(station, owner, (one for one in came if one.at > moment and one.instance == owner))
        known = max((one.t for one in came if one.at < new.at and one.instance != owner), default=-1.0)
        later = (one for one in came if one.at >= new.at and one.instance == owner and one.t > known)
        fresh = first_of(station, owner, later).at
        last = max((one.at for one in came if one.instance != owner and one.at < fresh), default=moment)
        first.append(new.at - moment)
        silence.append(fresh - last)
    return Times(first, silence)


def first_of(station: str, owner: str, results: Iterator[ArrivedResult]) -> ArrivedResult:
    """The first of a new owner's results; the process exits where there is none."""
    found = next(results, None)
    if found is None:
        sys.exit(f"{station}: instance {owner} published no result before the end: expected longer --seconds")
    return found


def main() -> int:
    """Run it and print what came of it."""
    options = parsed()
    names = [station_name(number) for number in range(options.stations)]
    wests = sorted(stations_of(WEST, (EAST, WEST), names))
    with tempfile.TemporaryDirectory() as directory:
        found, moments, received = run(Path(directory), options)
    print(f"{len(names)} stations for {options.seconds:g} s; the instance that is killed has {len(wests)}")
    for what, owner in (("kill", EAST), ("return", WEST)):
        print(f"{what}: {times_since(moments[what], owner, wests, received)}")
    print(f"return: started to ready {moments['ready'] - moments['return']:.2f} s")
    return report(
        [StationResults(station, station.end.result(), snapshot, np.empty(0)) for station, snapshot in found]
    )


def run(
    directory: Path, options: argparse.Namespace
) -> tuple[list[tuple[TaughtStation, Snapshot]], dict[str, float], list[ArrivedResult]]:
    """The demonstrations at their end, when what happened, and what was heard."""
    moments: dict[str, float] = {}
    with (
        running(Router()) as router,
        running(ServiceProcess(directory, "--instance", EAST, router=router.endpoint)),
        running(ServiceProcess(directory, "--instance", WEST, router=router.endpoint)) as west,
        receiving(router.endpoint) as received,
        teaching(
            router.endpoint, numbers=range(options.stations), seconds=options.seconds, pace=options.pace
        ) as stations,
    ):
        reached(stations, KILLED_AT)
        moments["kill"] = time.monotonic()
        west.kill()
        reached(stations, BACK_AT)
        moments["return"] = time.monotonic()
        west.start()
        moments["ready"] = time.monotonic()
        for station in stations:
            station.end.result(DEADLINE_S + options.seconds)
        with ZenohTransport(router.endpoint, timeout_s=DEADLINE_S) as transport:
            eventually(lambda: all(closed(asked(transport, station.name)) for station in stations))
            found = [(station, asked(transport, station.name)) for station in stations]
    return found, moments, received


def closed(snapshot: Snapshot) -> bool:
    """Nothing is to come."""
    return snapshot.status.state == "closed"


def report(found: list[StationResults]) -> int:
    """Print what was lost, doubled, and differs; 1 where anything was."""
    lost = sum(max(0, len(one.station.recording.t) - one.snapshot.status.samples) for one in found)
    doubled = sum(one.snapshot.status.repeats for one in found)
    # The journal's samples are not read here; `lost` counts those that are missing.
    compared = {one.station.name: one.difference(ignoring=("samples",)) for one in found}
    differ = {name: field for name, field in compared.items() if field}
    sent = sum(len(one.station.recording.t) for one in found)
    print(f"{sent} samples sent, {lost} lost, {doubled} doubled; results equal: {differ or 'yes'}")
    return int(bool(lost or doubled or differ))


def parsed() -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stations", type=int, default=16)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--pace", type=float, default=1.0)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
