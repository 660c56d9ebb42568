"""Clocks that jump: the robot's own, and the time of day where the service runs."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources import Chunk
from caesura_clients.query import service_status, snapshot
from caesura_protocol.messages import Snapshot
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from faults.suite.outcome import Disturbance, Row, played
from faults.suite.stations import (
    CLOSE_S,
    CONNECT_S,
    PACE,
    SETTINGS,
    LiveRobot,
    TaughtStation,
    demonstration,
    reached,
    station_name,
    undisturbed,
)
from harness.processes import SESSION, ServiceProcess, serving

NO_LIBRARY = "not run: there is no libfaketime (scripts/debian.sh faketime)"
HALF_S = 10.0  # where the clock jumps
SHARES = (
    (0.2, 3600),
    (0.35, -86400),
)  # of the demonstrations, and how far the service's clock is off then [s]
RESTART, OFF_S = 0.5, -604800  # likewise, where it is started again
SLACK_S = 60.0  # between asking for a time and having it
LIBRARIES = ("/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1", "/usr/lib/faketime/libfaketime.so.1")
Jump = Callable[[np.ndarray], np.ndarray]

# What the robot's clock says of its times → what the session says of that.
JUMPS: dict[str, tuple[Jump, Callable[[Snapshot], bool]]] = {
    "30 s forth": (
        lambda t: t + 30.0 * (t > HALF_S),
        lambda found: [gap.reason for gap in found.status.gaps] == ["source"] and not found.status.refused,
    ),
    "5 s back": (
        lambda t: t - 5.0 * (t > HALF_S),
        lambda found: found.status.refused["malformed"] > 0 and bool(found.status.gaps),
    ),
    "2 h forth and back": (
        lambda t: t + 7200.0 * ((t > HALF_S) & (t < HALF_S + 2.0)),
        lambda found: found.status.refused["malformed"] > 0 and bool(found.status.gaps),
    ),
    "none": (lambda t: t, lambda found: found.status.gaps == () and found.status.refused == {}),
}


class Jumping(LiveRobot):
    """A robot whose clock is set in the middle."""

    def __init__(self, number: int, jump: Jump) -> None:
        super().__init__(demonstration(number), pace=PACE)
        self._jump = jump

    def chunks(self) -> Iterator[Chunk]:
        for chunk in super().chunks():
            reported = chunk.copy()
            reported[:, 0] = self._jump(chunk[:, 0])
            yield reported


def robot_clocks(directory: Path) -> Row:
    """Two stations for every jump, all at once."""
    with serving(directory) as service, ExitStack() as stack:
        pool = stack.enter_context(ThreadPoolExecutor(2 * len(JUMPS)))
        ends, jumps = [], [*JUMPS, *JUMPS]
        for number, name in enumerate(jumps):
            transport = stack.enter_context(ZenohTransport(service.endpoint, timeout_s=CONNECT_S))
            robot, where = Jumping(number, JUMPS[name][0]), station_name(number)
            bridge = Bridge(transport, where, robot, session=SESSION, settings=SETTINGS)
            ends.append(pool.submit(stack.enter_context(bridge).run))
        closed = [end.result(CLOSE_S).state == "closed" for end in ends]
        found = [snapshot(transport, station_name(number), SESSION) for number in range(len(jumps))]
    reported = {name: JUMPS[name][1](one) for name, one in zip(jumps, found, strict=True)}
    whole = [one.segments.segments == undisturbed(number).segments for number, one in enumerate(found)]
    equal = all(same for same, name in zip(whole, jumps, strict=True) if name == "none")
    sent = sum(len(demonstration(number).t) for number in range(len(jumps)))
    refused = sum(sum(one.status.refused.values()) for one in found)
    taken = sum(one.status.samples for one in found)
    note = (
        f"said so: {reported}; {refused} batches refused, {sum(len(one.status.gaps) for one in found)} gaps"
    )
    repeats = sum(one.status.repeats for one in found)
    met = all(reported.values()) and all(closed) and equal
    return Row(len(jumps), sent, sent - taken, repeats, "yes (others)" if equal else "no", None, note, met)


def wall_clock(directory: Path) -> Row:
    """An hour forth and a day back while the service runs; a week back over a restart."""
    library = next((name for name in LIBRARIES if Path(name).exists()), None)
    if library is None or shutil.which("env") is None:
        return Row(0, 0, 0, 0, "–", None, NO_LIBRARY, met=False)
    reported, seen_s = directory / "offset", list[float]()
    jump(reported, 0)
    service = ServiceProcess(directory)
    environment = {"LD_PRELOAD": library, "FAKETIME_TIMESTAMP_FILE": reported, "FAKETIME_NO_CACHE": 1}
    fake = [f"{name}={value}" for name, value in environment.items()]
    service.command = [
        "env",
        *fake,
        "DONT_FAKE_MONOTONIC=1",
        "FAKETIME_DONT_FAKE_MONOTONIC=1",
        *service.command,
    ]

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        for share, off_s in SHARES:
            reached(stations, share)
            jump(reported, off_s)
            seen_s.append(off_by_s(service.endpoint))
        reached(stations, RESTART)
        service.kill()
        jump(reported, OFF_S)
        disturbance.is_over()
        service.start()
        seen_s.append(off_by_s(service.endpoint))

    try:
        service.start()
        done = played(service.endpoint, directory, disturb)
    finally:
        service.kill()
    wanted = np.array([*(off_s for _, off_s in SHARES), OFF_S])
    jumped = bool((np.abs(np.array(seen_s) - wanted) < SLACK_S).all())
    note = "1 h forth, 1 day back, killed, started 1 week back"
    return done.row(note=note if jumped else f"its clock was off by {seen_s} s", met=jumped)


def jump(reported: Path, off_s: int) -> None:
    """Let the time of day be off [s]. The library reads the file at any time, and finds a whole one."""
    whole = reported.with_suffix(".whole")
    whole.write_text(f"{off_s:+d}")
    whole.replace(reported)


def off_by_s(endpoint: str) -> float:
    """How far a service's time of day is ahead of ours [s], by its own status."""
    with ZenohTransport(endpoint, timeout_s=CONNECT_S) as transport:
        (status,) = service_status(transport)
    return status.time - time.time()
