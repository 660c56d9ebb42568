"""Holds batches of a station until they complete an observation, and enqueues them together.

A robot at 1 kHz sends five batches for each observation, and the first four change only counts. Processed one
by one they cost as much as the fifth; together, a fraction (docs/speed.md). So a batch waits here, in order,
until one comes that completes an observation, and at most HOLD_S: until then its bridge has it, as for every
message that waits. What else comes of its station, such as a command or another session's batch, has the held
ones enqueued before it. What is enqueued, and in what order, does not change; only when.

Whether a batch completes an observation is predicted from its number and its last time. A wrong prediction
costs time and changes no result: the session looks at the samples themselves.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from struct import Struct, error
from typing import Any, NamedTuple

from caesura_protocol.bounds import bounds_of, unpacked
from caesura_protocol.codec import encoding_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import SampleBatch
from caesura_service.server.inbound import RawPayload
from caesura_service.sessions.session import Awaited

HOLD_S = 0.1  # from one observation to the next
MOST, MOST_BYTES = 16, 1 << 16  # batches, and their payloads, that are held of one station
STEP_S = 0.1  # from one observation to the next
STATIONS = 1024  # with an expected batch

_ENCODING, _BOUNDS = encoding_of(SampleBatch), bounds_of(SampleBatch)
_NUMBER = {4: Struct("<f"), 8: Struct("<d")}  # by its size [bytes]


class _Batch(NamedTuple):
    """What a prediction needs of a batch, none of it validated."""

    session: Any
    epoch: Any
    seq: int
    t_last: float  # [s]


@dataclass(slots=True)
class _Station:
    """The held batches of a station, and what is expected next of it."""

    session: Any = None
    epoch: Any = None
    next_seq: int = -1
    due_s: float = -math.inf  # session time [s] that completes the next observation
    source: str = ""
    contents: list[RawPayload] = field(default_factory=list)
    size: int = 0  # [bytes]

    def expects(self, batch: _Batch) -> bool:
        """Whether it is the batch after the last one."""
        return (batch.seq, batch.session, batch.epoch) == (self.next_seq, self.session, self.epoch)


class BatchCollector:
    """Passes on what was received, batches of one observation together. Any thread may call it."""

    def __init__(
        self,
        awaited: Callable[[str, str], Awaited | None],
        enqueue: Callable[[Sequence[RawPayload], str, str | None, int], None],
        clock: Callable[[], float],
    ) -> None:
        """awaited: what a session of a station awaits; None where it is not here.

        enqueue: gets payloads in order, their source, their station and their size [bytes].
        """
        self._awaited, self._enqueue, self._clock = awaited, enqueue, clock
        self._stations: dict[str, _Station] = {}
        self._held: dict[str, float] = {}  # stations with held batches, oldest first; until when [s]
        self._lock = threading.Lock()

    def take(self, content: RawPayload, source: str, station: str | None) -> None:
        """Hold or pass on what was received of a source."""
        if station is None:
            self._enqueue((content,), source, None, len(content.payload))
            return
        with self._lock:
            self._take(content, source, station)

    def release(self, station: str) -> None:
        """Pass on what is held of a station."""
        with self._lock:
            if station in self._held:
                self._pass_on(station, self._stations[station])

    def release_overdue(self) -> None:
        """Pass on what has been held for HOLD_S."""
        if not self._held:
            return
        now = self._clock()
        with self._lock:
            while (station := next(iter(self._held), None)) is not None and self._held[station] <= now:
                self._pass_on(station, self._stations[station])

    def release_all(self) -> None:
        """Pass on all that is held."""
        for station in tuple(self._held):
            self.release(station)

    def _take(self, content: RawPayload, source: str, station: str) -> None:
        size = len(content.payload)
        known = self._stations.get(station)
        fields = _unpacked(content)
        batch = None if fields is None else _batch_of(fields)
        if batch is not None:
            content = content._replace(payload=b"", fields=fields)  # one copy of the samples
        if batch is None or known is None or not known.expects(batch):
            if known is not None and known.contents:
                self._pass_on(station, known)
            if batch is not None:
                known = known or self._add(station)
                known.session, known.epoch, known.next_seq = batch.session, batch.epoch, batch.seq + 1
                known.due_s = -math.inf
            self._enqueue((content,), source, station, size)
            return
        known.next_seq += 1
        first = batch.seq - len(known.contents)
        awaited = self._awaited(station, batch.session)
        if awaited is not None and awaited.next_seq == first:  # nothing is on its way
            known.due_s = awaited.due_s
        known.source = source
        known.contents.append(content)
        known.size += size
        if batch.t_last >= known.due_s:
            if known.due_s > -math.inf:  # what the session will await once it has these
                known.due_s += STEP_S * (1 + (batch.t_last - known.due_s) // STEP_S)
            self._pass_on(station, known)
        elif len(known.contents) >= MOST or known.size >= MOST_BYTES:
            self._pass_on(station, known)
        elif len(known.contents) == 1:
            self._held[station] = self._clock() + HOLD_S

    def _pass_on(self, station: str, known: _Station) -> None:
        contents, size = known.contents, known.size
        known.contents, known.size = [], 0
        self._held.pop(station, None)
        self._enqueue(contents, known.source, station, size)

    def _add(self, station: str) -> _Station:
        """Return the entry of a station; those without held batches are evicted from STATIONS on."""
        if len(self._stations) >= STATIONS:
            self._stations = {name: self._stations[name] for name in self._held}
        known = self._stations[station] = _Station()
        return known


def _unpacked(content: RawPayload) -> Mapping[str, Any] | None:
    """Return the fields of a batch of the usual size, as `codec.decode` unpacks them; None for others."""
    if content.encoding != _ENCODING or not 0 < len(content.payload) <= _BOUNDS.uncounted:
        return None
    try:
        fields = unpacked(content.payload, _BOUNDS)
    except ProtocolError:
        return None
    return fields if isinstance(fields, dict) else None


def _batch_of(fields: Mapping[str, Any]) -> _Batch | None:
    """Return what fields that are not validated say of a batch; None where they make none."""
    try:
        seq, count, samples = fields["seq"], fields["n"], fields["samples"]
        row = len(samples) // count
        number = _NUMBER[row // len(fields["columns"])]
        (since,) = number.unpack_from(samples, len(samples) - row)
        return _Batch(fields["session"], fields["epoch"], seq + 0, float(fields["t0"] + since))
    except (KeyError, TypeError, ValueError, ArithmeticError, error):
        return None
