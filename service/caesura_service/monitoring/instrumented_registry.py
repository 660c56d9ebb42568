"""The registry with counters and log entries around every call, which do not change its results."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Command, Heartbeat, Refusal, SampleBatch
from caesura_service.monitoring.registry_call_effects import Change, RegistryCall, changes_between
from caesura_service.monitoring.session_event_logger import SessionEventLogger
from caesura_service.monitoring.station_counters import StationCounterSet
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Incoming, Output, ReplayEnded
from caesura_service.publishing.session_state import SessionState
from caesura_service.sessions.same_layout_batches import BatchBlock
from caesura_service.sessions.session import Session


class InstrumentedRegistry(Registry):
    """A Registry that counts and logs every call; any thread may read `station_counters` as well.

    monotonic: a clock [s].
    """

    def __init__(self, *, monotonic: Callable[[], float] = time.monotonic, **given: Any) -> None:
        super().__init__(**given)
        self._monotonic = monotonic
        self.station_counters = StationCounterSet(monotonic())
        self._event_logger = SessionEventLogger(monotonic)
        # Of the calls that are under way: while one gives way, others begin and end.
        self._refusals: dict[str | None, list[Refusal | None]] = {}
        # Each session at its last count: reading it in between does not change the count.
        self._last_states: WeakKeyDictionary[Session, SessionState] = WeakKeyDictionary()

    def handle_command(self, station: str, command: Command, now: float) -> list[Output]:
        """Execute a command; opening may close or release other sessions of the station."""
        return self._instrumented(station, command, partial(super().handle_command, station, command, now))

    def handle_samples(
        self, station: str, message: SampleBatch | Heartbeat | ReplayEnded, now: float
    ) -> list[Output]:
        """Process a bridge's message, which changes no other session. now: [s]."""
        session = self._held.find(station, message.session)
        if session is None:
            return self._instrumented(
                station, message, partial(super().handle_samples, station, message, now)
            )
        before, began = self._last_state(session), self._monotonic()
        outputs = super().handle_samples(station, message, now)
        if (
            session.last_published_state is before
            and station not in self._refusals
            and not outputs
            and isinstance(message, SampleBatch)
        ):
            ended = self._monotonic()
            self.station_counters.count_batch(station, self.index.sessions, ended - began, ended)
            return outputs  # as nearly always: it changes nothing but how many there are
        after = self._update_last_state(session)
        changes = (Change(before, after),) if after is not before else ()
        self._record(station, message, changes, outputs, began)
        return outputs

    def handle_together(self, station: str, block: BatchBlock, now: float) -> tuple[int, list[Output]]:
        """Process several batches together, each of which is counted."""
        session = self._held.find(station, block.session)
        if session is None:
            return 0, []
        before, began = self._last_state(session), self._monotonic()
        count, outputs = super().handle_together(station, block, now)
        if count:
            after = self._update_last_state(session)
            changes = (Change(before, after),) if after is not before else ()
            message = block.layout.message
            self._record(station, message, changes, outputs, began, batches=count)
        return count, outputs

    def make_due_program(self, station: str, session: str) -> list[Output]:
        """Make and publish the program that `handle_together` has postponed."""
        return self._instrumented(station, None, partial(super().make_due_program, station, session))

    def reject(self, station: str | None, error: ProtocolError) -> list[Output]:
        """Count a message that could not be read."""
        return self._instrumented(station, None, partial(super().reject, station, error))

    def report_dropped(self, station: str, messages: int) -> list[Output]:
        """Count messages that the queue dropped."""
        return self._instrumented(station, None, partial(super().report_dropped, station, messages))

    def tick(self, now: float) -> list[Output]:
        """Run the work that is due by time, as Registry. now: [s]."""
        return self._instrumented(None, None, partial(super().tick, now))

    def record_work(self, station: str, seconds: float) -> None:
        """Count the work time [s] of a station with sessions."""
        self.station_counters.add_work(station, self.index.sessions, seconds)

    def _instrumented(
        self, station: str | None, message: Incoming | None, act: Callable[[], list[Output]]
    ) -> list[Output]:
        before = {session.name: self._last_state(session) for session in self._sessions(station)}
        began = self._monotonic()
        outputs = act()
        after = {session.name: self._update_last_state(session) for session in self._sessions(station)}
        self._record(station, message, changes_between(before, after), outputs, began)
        return outputs

    def _record(
        self,
        station: str | None,
        message: Incoming | None,
        changes: Sequence[Change],
        outputs: list[Output],
        began: float,
        *,
        batches: int = 1,
    ) -> None:
        """Count and log a call. began: its start [s]; batches: processed in it."""
        now, refusals = self._monotonic(), self._refusals.pop(station, ())
        refusal = refusals[-1] if refusals else None
        call = RegistryCall(station, message, changes, outputs, len(refusals), refusal, now - began, batches)
        self.station_counters.count_call(call, self.index.sessions, now)
        self._event_logger.log_call(call)

    def _count_refused(self, station: str | None, error: ProtocolError) -> None:
        super()._count_refused(station, error)
        self._refusals.setdefault(station, []).append(self.counters.last_refusal)

    def _sessions(self, station: str | None) -> tuple[Session, ...]:
        return self.index.sessions.get(station or "", ())

    def _last_state(self, session: Session) -> SessionState:
        return self._last_states.get(session) or self._update_last_state(session)

    def _update_last_state(self, session: Session) -> SessionState:
        state = self._last_states[session] = session.last_published_state
        return state
