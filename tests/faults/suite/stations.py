"""Eight live robots that are taught at once, what the service makes of them, and what it should have made.

A live robot does not wait: its samples come at their time, whoever listens. Every station has its own
demonstration, and its own connection, as it would have on a floor.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from caesura_clients.bridge import Bridge, BridgeSettings
from caesura_clients.bridge.sources import Chunk
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.query import snapshot
from caesura_protocol.codec import decode, unpack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import session_key
from caesura_protocol.messages import Ack, Posterior, SampleBatch, Snapshot
from caesura_protocol.recording import Recording
from caesura_protocol.transport.inbox import Inbox, ReceivedSample
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.journal import SqliteJournal
from caesura_service.offline_segmentation import segment_recording
from caesura_service.segmentation.pipeline_interface import PipelineView
from harness.demonstrations import taught
from harness.processes import SESSION, eventually

STATIONS = 8
PACE = 2.0
SECONDS = 20.0  # of a demonstration
CONNECT_S = 10.0
CLOSE_S = 60.0
SETTINGS = BridgeSettings(batch_samples=10, close_timeout_s=CLOSE_S)


class LiveRobot(FileSource):
    """Plays a recording at its pace and waits for nobody."""

    can_wait = False

    def __init__(self, recording: Recording, *, pace: float = 1.0) -> None:
        super().__init__(recording, pace=pace)
        self.given: list[tuple[float, float]] = []  # of each chunk: monotonic [s], its last sample's time [s]

    def chunks(self) -> Iterator[Chunk]:
        """Note when each is given."""
        for chunk in super().chunks():
            self.given.append((time.monotonic(), float(chunk[-1, 0])))
            yield chunk


@cache
def demonstration(number: int, seconds: float = SECONDS) -> Recording:
    """What is taught at a station."""
    return taught(number, seconds)


@cache
def undisturbed(number: int, seconds: float = SECONDS) -> PipelineView:
    """What comes of it without a network, a service or a journal."""
    return segment_recording(demonstration(number, seconds))


def station_name(number: int) -> str:
    return f"cell-{number}"


@dataclass
class TaughtStation:
    """One of them."""

    number: int
    seconds: float
    bridge: Bridge | None  # None: in another process
    end: Future[Ack]
    robot: LiveRobot | None = None  # likewise

    @property
    def name(self) -> str:
        return station_name(self.number)

    def has_given(self, share: float) -> bool:
        """Such a share of its samples, or all that it will."""
        assert self.bridge is not None
        batches = len(self.recording.t) / self.bridge.settings.batch_samples
        return self.bridge.sent >= share * batches or self.end.done()

    @property
    def recording(self) -> Recording:
        return demonstration(self.number, self.seconds)

    @property
    def expected(self) -> PipelineView:
        return undisturbed(self.number, self.seconds)


@dataclass
class Watched:
    """When results came: (monotonic [s], session time [s]) by station."""

    came: dict[str, list[tuple[float, float]]] = field(default_factory=dict)

    def newest(self, station: str) -> float:
        """[s] session time."""
        return max((t for _, t in self.came.get(station, ())), default=-1.0)

    def recovery_s(self, stations: list[str], since: float) -> float:
        """From a moment until every station has a result of something new; inf where one never has."""
        return max(self._recovery_s(station, since) for station in stations)

    def _recovery_s(self, station: str, since: float) -> float:
        came = self.came.get(station, [])
        known = max((t for at, t in came if at <= since), default=-1.0)
        return min((at - since for at, t in came if at > since and t > known), default=float("inf"))


@contextmanager
def watching(endpoint: str) -> Iterator[Watched]:
    """A reader of every session, with a connection of its own."""
    watched, inbox, over = Watched(), Inbox(1 << 20), threading.Event()

    def listen() -> None:
        while not over.is_set():
            item = inbox.get(0.05)
            if isinstance(item, ReceivedSample):
                message = decode(item.payload, item.encoding, Posterior)
                watched.came.setdefault(message.station, []).append((time.monotonic(), message.t))

    with (
        ZenohTransport(endpoint, timeout_s=CONNECT_S) as transport,
        transport.subscribe(session_key("*", "*", "posterior"), inbox),
    ):
        thread = threading.Thread(target=listen, daemon=True)
        thread.start()
        yield watched
        over.set()
        thread.join()


@contextmanager
def teaching(
    endpoint: str,
    *,
    numbers: range = range(STATIONS),
    seconds: float = SECONDS,
    pace: float = PACE,
    settings: BridgeSettings = SETTINGS,
) -> Iterator[list[TaughtStation]]:
    """The stations, from when every session is open until every bridge is gone."""
    recordings = [demonstration(number, seconds) for number in numbers]
    with ExitStack() as stack:
        pool = stack.enter_context(ThreadPoolExecutor(len(recordings)))
        stations = []
        for number, recording in zip(numbers, recordings, strict=True):
            transport = stack.enter_context(ZenohTransport(endpoint, timeout_s=CONNECT_S))
            source = LiveRobot(recording, pace=pace)
            bridge = Bridge(transport, station_name(number), source, session=SESSION, settings=settings)
            stack.enter_context(bridge)
            bridge.wait_open(CONNECT_S)
            stations.append(TaughtStation(number, seconds, bridge, pool.submit(bridge.run), source))
        yield stations


def reached(stations: list[TaughtStation], share: float) -> None:
    """Wait until every robot has given such a share of its samples."""
    for station in stations:
        eventually(partial(station.has_given, share))


@dataclass(frozen=True)
class StationResults:
    """A station at its end."""

    station: TaughtStation
    ack: Ack | None
    snapshot: Snapshot
    taken_t: NDArray[np.float64]  # [s] of every sample of every batch in the journal, as it is there

    @property
    def lost_t(self) -> tuple[float, ...]:
        """[s] of the samples that the service does not have."""
        return tuple(np.setdiff1d(np.round(self.station.recording.t, 4), self.taken_t).tolist())

    @property
    def lost(self) -> int:
        return len(self.lost_t)

    @property
    def duplicated(self) -> int:
        """Samples that are in the journal again, and those that the pipeline was given again."""
        return len(self.taken_t) - len(np.unique(self.taken_t)) + self.snapshot.status.repeats

    @property
    def undeclared_t(self) -> tuple[float, ...]:
        """[s] of the lost samples that lie in no declared gap."""
        gaps = self.snapshot.status.gaps
        return tuple(t for t in self.lost_t if not any(gap.t0 < t < gap.tn for gap in gaps))

    def difference(self, ignoring: Collection[str] = ()) -> str | None:
        """The first field in which it differs from an undisturbed run."""
        status, expected, program = self.snapshot.status, self.station.expected, self.snapshot.program
        pairs = {
            "state": (status.state, "closed"),
            "samples": (status.samples, len(self.taken_t)),
            "gaps": (status.gaps, ()),
            "refusals": (status.refused, {}),
            "observations": (status.observations, expected.observations),
            "time": (status.t, expected.t),
            "segments": (self.snapshot.segments.segments, expected.segments),
            "changepoints": (self.snapshot.changepoints.changepoints, expected.changepoints),
            "completeness": (program.complete, True),
            "apps": (program.apps, expected.apps),
            "notes": (program.notes, expected.notes),
        }
        differ = [name for name, (is_, should) in pairs.items() if is_ != should]
        return next((name for name in differ if name not in ignoring), None)


def found(endpoint: str, stations: list[TaughtStation], journal: Path) -> list[StationResults]:
    """Every station at its end. Raises where a bridge could not close its session."""
    acks = [station.end.result(CLOSE_S + station.seconds) for station in stations]
    with ZenohTransport(endpoint, timeout_s=CONNECT_S) as transport:
        return [
            StationResults(station, ack, asked(transport, station.name), taken(journal, station))
            for station, ack in zip(stations, acks, strict=True)
        ]


def asked(transport: ZenohTransport, station: str) -> Snapshot:
    """A station's snapshot, once somebody has it."""
    known: list[Snapshot] = []

    def there() -> bool:
        try:
            known[:] = [snapshot(transport, station, SESSION)]
        except (ProtocolError, Exception):
            return False
        return True

    eventually(there)
    return known[0]


def taken(journal: Path, station: TaughtStation) -> NDArray[np.float64]:
    """[s] times of a station's samples in the journal, record by record, whatever their numbers are."""
    with SqliteJournal(journal / "caesura-1.sqlite", alone=False) as opened:
        messages = [record.message for record in opened.replay(station.name, SESSION)]
    parts = [unpack_samples(one)[:, 0] for one in messages if isinstance(one, SampleBatch)]
    return np.round(np.concatenate([np.empty(0), *parts]), 4)
