"""Holds batches of a station until they complete an observation, and passes them on together.

A robot at 1 kHz sends five batches per observation, and the first four change only counters. Processed
separately each costs as much as the fifth; together, a fraction (docs/speed.md). So batches are held, in
order, until one completes an observation, and at most HOLD_S. Until they are recorded their bridge has them,
as for every queued message. Before any other message of the station, such as a command or another session's
batch, the held ones are passed on. So the messages and their order do not change, only their time.

Whether a batch completes an observation is predicted from its last time. A wrong prediction costs time and
changes no result: the session uses the samples themselves.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from caesura_service.server.inbound_events import RawPayload
from caesura_service.server.network_interface import Payload
from caesura_service.sessions.same_layout_batches import ENCODING, BatchBlock, BatchLayout
from caesura_service.sessions.session import Awaited

HOLD_S = 0.1  # from one observation to the next
MOST, MOST_BYTES = 16, 1 << 16  # batches of one station that are held, and their payloads
USUAL_BYTES = 1 << 15  # a longer payload is passed on as it is
STEP_S = 0.1  # from one observation to the next
SOURCES = 1024  # with a layout
MISSES, EVERY = 8, 64  # payloads without a layout, after which only some are looked at


@dataclass(slots=True)
class _Source:
    """The held batches of a station's key, the next expected number, and the time of the next observation."""

    station: str
    layout: BatchLayout | None = None
    next_seq: int = -1
    due_s: float = -math.inf  # session time [s] that completes the next observation
    payloads: list[bytes] = field(default_factory=list)
    misses: int = 0


class BatchCollector:
    """Passes received messages on, batches of one observation together. Any thread may call it."""

    def __init__(
        self,
        awaited: Callable[[str, str], Awaited | None],
        pass_on: Callable[[RawPayload, str, str | None], None],
        pass_on_block: Callable[[BatchBlock, str, str], None],
        clock: Callable[[], float],
    ) -> None:
        """awaited: returns what a station's session awaits; None if this instance does not hold it.

        pass_on, pass_on_block: receive one or several payloads, with their source and station, in order.
        """
        self._awaited, self._clock = awaited, clock
        self._pass_on, self._pass_on_block = pass_on, pass_on_block
        self._sources: dict[str, _Source] = {}
        self._held: dict[str, float] = {}  # sources with held batches, oldest first; until when [s]
        self._lock = threading.Lock()

    def hold(self, source: str, payload: Payload, encoding: str) -> bool:
        """Hold a batch that follows the last one of its source.

        Return False, and hold nothing, if it does not.
        """
        with self._lock:
            known = self._sources.get(source)
            if known is None or (layout := known.layout) is None:
                return False
            if encoding != ENCODING or len(payload) != layout.size:
                return False
            content = bytes(payload)
            if layout.seq_of(content) != known.next_seq:
                return False
            self._hold(source, known, layout, content)
        return True

    def receive(self, content: RawPayload, source: str, station: str | None) -> None:
        """Pass on a message of a source, after the held batches of the source."""
        with self._lock:
            self._release(source)
            self._pass_on(content, source, station)
            if station is not None:
                self._learn(content, source, station)

    def release(self, source: str) -> None:
        """Pass on the held batches of a source."""
        with self._lock:
            self._release(source)

    def release_overdue(self) -> None:
        """Pass on the batches that have been held for HOLD_S."""
        if not self._held:
            return
        now = self._clock()
        with self._lock:
            while (source := next(iter(self._held), None)) is not None and self._held[source] <= now:
                self._release(source)

    def release_all(self) -> None:
        """Pass on all held batches."""
        for source in tuple(self._held):
            self.release(source)

    # --- under the lock ---------------------------------------------------------------------------------

    def _hold(self, source: str, known: _Source, layout: BatchLayout, content: bytes) -> None:
        if not known.payloads:
            known.due_s = self._due_s(known, layout)
        known.payloads.append(content)
        known.next_seq += 1
        t_last = layout.t_last_of(content)
        if t_last >= known.due_s:
            known.due_s = _due_after(known.due_s, t_last)
            self._release(source)
        elif len(known.payloads) >= MOST or len(known.payloads) * layout.size >= MOST_BYTES:
            self._release(source)
        elif len(known.payloads) == 1:
            self._held[source] = self._clock() + HOLD_S

    def _due_s(self, known: _Source, layout: BatchLayout) -> float:
        """Return the session time [s] that completes the next observation: exact if no batch is queued.

        It is a prediction if the session has batches to process first, or waits for a missing one.
        """
        awaited = self._awaited(known.station, layout.message.session)
        if awaited is None:
            return -math.inf
        return awaited.due_s if awaited.next_seq == known.next_seq else known.due_s

    def _release(self, source: str) -> None:
        if self._held.pop(source, None) is None and source not in self._sources:
            return
        known = self._sources[source]
        payloads, known.payloads = known.payloads, []
        if payloads and known.layout is not None:
            block = BatchBlock(known.layout, known.next_seq - len(payloads), payloads)
            self._pass_on_block(block, source, known.station)

    def _learn(self, content: RawPayload, source: str, station: str) -> None:
        """Store the layout of a batch, and the number that the next one should have.

        Ignore other messages.
        """
        if content.encoding != ENCODING or not 0 < len(content.payload) <= USUAL_BYTES:
            return
        known = self._sources.get(source) or self._add(source, station)
        known.layout = None
        if known.misses >= MISSES and known.misses % EVERY:
            known.misses += 1
            return
        known.layout = layout = BatchLayout.of(content.payload)
        if layout is None:
            known.misses += 1
        else:
            known.misses, known.next_seq, known.due_s = 0, layout.message.seq + 1, -math.inf

    def _add(self, source: str, station: str) -> _Source:
        """Return the entry of a source; beyond SOURCES those without held batches are evicted."""
        if len(self._sources) >= SOURCES:
            self._sources = {name: self._sources[name] for name in self._held}
        known = self._sources[source] = _Source(station)
        return known


def _due_after(due_s: float, t_last: float) -> float:
    """Return the due time [s] after the one that a batch has reached; a prediction if none is known."""
    if not math.isfinite(t_last):
        return due_s
    if not math.isfinite(due_s):
        return t_last + STEP_S
    return due_s + STEP_S * (1.0 + (t_last - due_s) // STEP_S)
