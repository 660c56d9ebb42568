"""The registry with counters and log around every call, whose effect they do not change."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Command, Heartbeat, SampleBatch
from caesura_service.monitoring.registry_calls import Change, RegistryCall, changes_between
from caesura_service.monitoring.session_event_logger import SessionEventLogger
from caesura_service.monitoring.station_counters import StationCounterSet
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Incoming, Output, ReplayEnded
from caesura_service.publishing.session_state import SessionCounters, SessionState
from caesura_service.sessions.session import Session


class InstrumentedRegistry(Registry):
    """As Registry; any thread may read `counting` as well. watch: a clock [s] of the watcher's own."""

    def __init__(self, *, watch: Callable[[], float] = time.monotonic, **given: Any) -> None:
        super().__init__(**given)
        self._watch = watch
        self.counting = StationCounterSet(watch())
        self._chronicle = SessionEventLogger()
        # Each session at its last count: reading it in between does not change the count.
        self._seen: WeakKeyDictionary[Session, SessionState] = WeakKeyDictionary()

    def handle_command(self, station: str, command: Command, now: float) -> list[Output]:
        """Carry out a command; opening may close or forget other sessions of the station."""
        return self._watched(station, command, partial(super().handle_command, station, command, now))

    def handle_samples(
        self, station: str, message: SampleBatch | Heartbeat | ReplayEnded, now: float
    ) -> list[Output]:
        """Take what a bridge sent; no other session changes by that."""
        session = self._find_session(station, message.session)
        if session is None:
            return self._watched(station, message, partial(super().handle_samples, station, message, now))
        before, counters, began = self._seen_of(session), self.counters, self._watch()
        outputs = super().handle_samples(station, message, now)
        if (
            session.last_published_state is before
            and self.counters is counters
            and not outputs
            and isinstance(message, SampleBatch)
        ):
            ended = self._watch()
            self.counting.hear(station, self.index.sessions, ended - began, ended)
            return outputs  # as nearly always: it changes nothing but how many there are
        after = self._noted(session)
        changes = (Change(before, after),) if after is not before else ()
        self._tell(station, message, changes, outputs, counters, began)
        return outputs

    def reject(self, station: str | None, error: ProtocolError) -> list[Output]:
        """Charge a message that could not be read."""
        return self._watched(station, None, partial(super().reject, station, error))

    def report_dropped(self, station: str, messages: int) -> list[Output]:
        """There was no room for so many messages of a station."""
        return self._watched(station, None, partial(super().report_dropped, station, messages))

    def tick(self, now: float) -> list[Output]:
        """Time has passed."""
        return self._watched(None, None, partial(super().tick, now))

    def record_work(self, station: str, seconds: float) -> None:
        """Count it for the station, if it is known."""
        self.counting.spend(station, self.index.sessions, seconds)

    def _watched(
        self, station: str | None, message: Incoming | None, act: Callable[[], list[Output]]
    ) -> list[Output]:
        before = {session.name: self._seen_of(session) for session in self._sessions(station)}
        counters, began = self.counters, self._watch()
        outputs = act()
        after = {session.name: self._noted(session) for session in self._sessions(station)}
        self._tell(station, message, changes_between(before, after), outputs, counters, began)
        return outputs

    def _tell(
        self,
        station: str | None,
        message: Incoming | None,
        changes: Sequence[Change],
        outputs: list[Output],
        counters: SessionCounters,
        began: float,
    ) -> None:
        """Count and log what was done. tally: as it was when that began [s]."""
        now, same = self._watch(), self.counters is counters
        refused = 0 if same else _refusals(self.counters) - _refusals(counters)
        refusal = None if same else self.counters.last_refusal
        step = RegistryCall(station, message, changes, outputs, refused, refusal, now - began)
        self.counting.take(step, self.index.sessions, now)
        self._chronicle.take(step, now)

    def _sessions(self, station: str | None) -> tuple[Session, ...]:
        return self.index.sessions.get(station or "", ())

    def _seen_of(self, session: Session) -> SessionState:
        return self._seen.get(session) or self._noted(session)

    def _noted(self, session: Session) -> SessionState:
        looked = self._seen[session] = session.last_published_state
        return looked


def _refusals(counters: SessionCounters) -> int:
    return sum(counters.refused.values())
