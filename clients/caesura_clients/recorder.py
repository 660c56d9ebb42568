"""Records a live session from the wire: samples as they were sent, and results at the end.

`Recorder` is the fold over numbered batches, which also lists missing ones. `record` receives the messages.
It requests missing batches from the bridge's ring, as the service does. A batch that the ring no longer has,
or that access rules forbid, is a gap and is reported. Samples stay in memory until the end: an hour of 30
columns at 1 kHz is 900 MB.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from caesura_clients import query
from caesura_clients.session_to_recording import stated_recording
from caesura_protocol.codec import decode, signals_of, unpack_samples
from caesura_protocol.errors import CaesuraError, NotFound, ProtocolError, Unreachable
from caesura_protocol.keys import ReplayRange, replay_parameters, session_key, station_key
from caesura_protocol.lost_samples import Loss, losses_of
from caesura_protocol.messages import (
    MAX_BATCHES_AHEAD,
    Heartbeat,
    SampleBatch,
    SessionStatus,
    Snapshot,
)
from caesura_protocol.recording import ASSUMED_FRAME, Recording
from caesura_protocol.session_time_display import clock_from, is_of_day
from caesura_protocol.transport.inbox import Inbox, Item, ReceivedSample
from caesura_protocol.transport.transport_interface import Transport

ASK_EVERY_S = 0.5  # for what is missing
AT_ONCE = 200  # batches in one question
ATTEMPTS = 3  # without an answer, until it is a gap
SILENT_S = 2.0  # a bridge says something every half second: without it, the service is asked
LAST_S = 30.0  # at the end, for what is still missing
UNREADABLE = 10_000  # batches that are remembered so as not to be asked for again
TICK_S = 0.1


@dataclass
class Recorder:
    """Batches of one session, and the ranges that are missing.

    A sender may state any number, also a billion: only the beginning of the missing numbers is stored.
    """

    session: str
    batches: dict[int, SampleBatch] = field(default_factory=dict)
    spoiled: int = 0  # batches that cannot be read
    known: int = -1  # the newest number in any message
    began_s: float = float("inf")  # [s] time of day at session time 0, estimated from the batches
    _whole: int = 0  # all before this one are here, unreadable or given up
    _unreadable: set[int] = field(default_factory=set)  # from there on
    _asked: tuple[int, int] = (-1, 0)  # what was asked for last and not answered, and how often

    def add_batch(self, batch: SampleBatch, now_s: float | None = None) -> None:
        """Store a batch, unless its number is stored already.

        now_s: time of day of its arrival, if it was received live.
        """
        if self.known < 0:
            self.known = batch.seq  # of a session that has gone on for hours
        self.announce_seq(batch.seq)
        if batch.seq in self.batches or batch.seq > self.known:
            return
        try:
            end = float(unpack_samples(batch)[-1, 0])
        except ProtocolError:
            self.spoiled += 1
            if batch.seq >= self._whole and len(self._unreadable) < UNREADABLE:
                self._unreadable.add(batch.seq)
            return
        self.batches[batch.seq] = batch
        if now_s is not None:  # a batch cannot come before its last sample was taken
            self.began_s = min(self.began_s, now_s - end)

    def announce_seq(self, seq: int) -> None:
        """Record that the sender has reached this number."""
        if seq <= max(self.known, 0) + MAX_BATCHES_AHEAD:
            self.known = max(self.known, seq)

    def missing(self) -> ReplayRange | None:
        """Return the next range to request; None where nothing is missing."""
        while self._whole in self.batches or self._whole in self._unreadable:
            self._unreadable.discard(self._whole)
            self._whole += 1
        if self._whole > self.known:
            return None
        first = last = self._whole
        while last + 1 <= self.known and last + 1 not in self.batches and last - first + 1 < AT_ONCE:
            last += 1
        return ReplayRange(first, last, last - first + 1, self.session)

    def count_unanswered(self, asked: ReplayRange, *, no_reply: bool = False) -> None:
        """Count a replay that did not return these batches; after ATTEMPTS declare them lost."""
        first, tried = self._asked
        self._asked = (asked.first, tried + 1 if first == asked.first else 1)
        if self._asked[1] >= ATTEMPTS:
            self.give_up_before(self.known + 1 if no_reply else asked.last + 1)

    def give_up_before(self, oldest: int) -> None:
        """Declare the batches before the oldest one of the ring lost."""
        self._whole = max(self._whole, min(oldest, self.known + 1))
        self._unreadable = {seq for seq in self._unreadable if seq >= self._whole}

    @property
    def lost(self) -> int:
        """Return how many batches exist and are not stored."""
        return self.known + 1 - len(self.batches)

    def holes(self) -> Iterator[tuple[float, float]]:
        """Yield each gap between stored batches: the times of the samples before and after it [s]."""
        for before, after in pairwise(sorted(self.batches)):
            if after > before + 1:
                ends = (unpack_samples(self.batches[seq]) for seq in (before, after))
                yield float(next(ends)[-1, 0]), float(next(ends)[0, 0])

    def recording(self, found: Snapshot | None) -> Recording:
        """Return the stored samples as a recording, with the statements of the results, if there are any.

        Raises CaesuraError without samples.
        """
        if not self.batches:
            raise CaesuraError(f"{self.session}: no samples came")
        columns = self.batches[min(self.batches)].columns
        alike = [seq for seq in sorted(self.batches) if self.batches[seq].columns == columns]
        rows = np.concatenate([unpack_samples(self.batches[seq]) for seq in alike])
        if found is None:
            signals = signals_of(columns, rows)
            made = Recording(rows[:, 0], signals, name=self.session, assumed=(ASSUMED_FRAME,))
        else:
            unit = found.status.length_unit
            made = stated_recording(columns, rows, found.status, found.program, unit=unit)
        return replace(made, lost=losses_of(self._ends(alike), self.known), began_s=self._known_began_s)

    @property
    def _known_began_s(self) -> float | None:
        return self.began_s if is_of_day(self.began_s) else None

    def _ends(self, seqs: Sequence[int]) -> dict[int, Loss]:
        """Return the times [s] of the first and the last sample of batches, by their number."""
        samples = {seq: unpack_samples(self.batches[seq]) for seq in seqs}
        return {seq: (float(one[0, 0]), float(one[-1, 0])) for seq, one in samples.items()}


@dataclass(frozen=True)
class RecordedSession:
    """One session, as far as it was received."""

    recording: Recording
    snapshot: Snapshot | None  # the results; None where no service has any
    recorder: Recorder
    closed: bool  # did it end while it was recorded?

    @property
    def missed(self) -> str:
        """Return text on what is missing from the recording; empty if nothing is."""
        said = []
        if self.recorder.lost:
            count = f"{self.recorder.lost} of {self.recorder.known + 1} batches"
            said.append(f"{count} are missing: gaps{self._gap_times()}")
        status = None if self.snapshot is None else self.snapshot.status
        if status is None:
            said.append(
                "no service reported results, units and frames: m and base are assumed; "
                "the wrench source is not stated"
            )
        elif status.samples > self.recording.t.size:
            said.append(f"the service has {status.samples} samples, these are {self.recording.t.size}")
        if not self.closed:
            said.append("the session goes on")
        return "; ".join(said)

    def _gap_times(self) -> str:
        clock, holes = clock_from(float(self.recording.t[0])), [*self.recorder.holes()]
        if not holes:
            return " before the first sample or after the last"
        return f" {clock.newest(holes, len(holes))}" + (f" ({clock.words})" if clock.words else "")


def record(
    transport: Transport,
    station: str,
    session: str | None = None,
    *,
    over: threading.Event | None = None,
    on_message: Callable[[Recorder], None] = lambda recorder: None,
    clock: Callable[[], float] = time.monotonic,
    time_of_day: Callable[[], float] = time.time,
) -> RecordedSession:
    """Record a session until it is closed or `over` is set: the one named, or the first that is received.

    on_message: called after every received message. Raises CaesuraError if nothing was received.
    """
    ending = over or threading.Event()
    inbox = Inbox()
    live = _LiveRecording(
        transport, station, session, on_message=on_message, clock=clock, time_of_day=time_of_day
    )
    with ExitStack() as stack:
        for key in (station_key(station, "samples"), session_key(station, session or "*", "status")):
            stack.enter_context(transport.subscribe(key, inbox))
        while not ending.is_set() and not live.closed:
            live.receive(inbox.get(TICK_S))
            live.request_missing()
        while (rest := inbox.get(0.0)) is not None:
            live.receive(rest)
        recorder = live.recorder
        if recorder is None:
            raise CaesuraError(f"{station}: no session{f' {session}' if session else ''} was received")
        until = clock() + LAST_S
        while _ask(transport, station, recorder) and clock() < until:
            pass
    found = _snapshot(transport, station, recorder.session)
    recording = recorder.recording(found)
    return RecordedSession(recording, found, recorder, live.closed)


class _LiveRecording:
    """Receives a session from its first message on, and requests what is missing."""

    def __init__(
        self,
        transport: Transport,
        station: str,
        session: str | None,
        *,
        on_message: Callable[[Recorder], None],
        clock: Callable[[], float],
        time_of_day: Callable[[], float],
    ) -> None:
        self.recorder: Recorder | None = None
        self.closed = False
        self._transport = transport
        self._station = station
        self._session = session
        self._on_message = on_message
        self._clock = clock
        self._time_of_day = time_of_day
        self._received_s = self._asked_s = clock()

    def receive(self, item: Item | None) -> None:
        """Store a received message if it belongs to the session."""
        message = _decoded(item) if isinstance(item, ReceivedSample) else None
        if message is None or message.session != (self._session or message.session):
            return
        if self.recorder is None:
            if isinstance(message, SessionStatus) and message.state == "closed":
                return  # a correction of a session that is closed
            self._session, self.recorder = message.session, Recorder(message.session)
        self._received_s = self._clock()
        self.closed |= _take(self.recorder, message, self._time_of_day)
        self._on_message(self.recorder)

    def request_missing(self) -> None:
        """Request missing batches from the bridge.

        After a time without messages, query the service whether the session is closed.
        """
        now = self._clock()
        if self.recorder is None:
            return
        if now - self._asked_s >= ASK_EVERY_S:
            _ask(self._transport, self._station, self.recorder)
            self._asked_s = now
        if now - self._received_s > SILENT_S:
            self.closed = _is_closed(self._transport, self._station, self.recorder.session)
            self._received_s = self._clock()


RecordedMessage = SampleBatch | Heartbeat | SessionStatus
RECORDED_TYPES: tuple[type[RecordedMessage], ...] = (SampleBatch, Heartbeat, SessionStatus)


def _decoded(delivery: ReceivedSample) -> RecordedMessage | None:
    try:
        message = decode(delivery.payload, delivery.encoding, *RECORDED_TYPES)
    except ProtocolError:  # any other payload on these keys
        return None
    return message if isinstance(message, RECORDED_TYPES) else None


def _take(recorder: Recorder, message: RecordedMessage, time_of_day: Callable[[], float]) -> bool:
    """Store a message; return whether the session is over."""
    match message:
        case SampleBatch():
            recorder.add_batch(message, time_of_day())
        case Heartbeat():
            recorder.announce_seq(message.seq)
        case SessionStatus():
            return message.state == "closed"
    return False


def _ask(transport: Transport, station: str, recorder: Recorder) -> bool:
    """Request the next missing range from the bridge; return whether there was one."""
    wanted = recorder.missing()
    if wanted is None:
        return False
    try:
        answers = transport.query(station_key(station, "replay"), parameters=replay_parameters(wanted))
    except Unreachable:
        recorder.count_unanswered(wanted)
        return True
    before = len(recorder.batches)
    for reply in answers.replies:
        batch = _decoded(reply)
        if isinstance(batch, SampleBatch) and batch.session == recorder.session:
            recorder.add_batch(batch)
    for refusal in answers.refusals:
        if refusal.code == "evicted" and isinstance(refusal.limit, int):
            recorder.give_up_before(refusal.limit)
    if len(recorder.batches) == before:
        recorder.count_unanswered(wanted, no_reply=not (answers.replies or answers.refusals))
    return True


def _is_closed(transport: Transport, station: str, session: str) -> bool:
    found = _snapshot(transport, station, session)
    return found is not None and found.status.state == "closed"


def _snapshot(transport: Transport, station: str, session: str) -> Snapshot | None:
    with suppress(NotFound, Unreachable, ProtocolError):
        return query.snapshot(transport, station, session)
    return None
