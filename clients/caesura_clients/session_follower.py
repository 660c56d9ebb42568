"""Follows sessions: start from the snapshot, apply updates, and start again after a loss.

A lost last message leaves no gap in the numbers. So the snapshot of a session without messages for
`refresh_s` is queried: once if it is closed, otherwise repeatedly at increasing intervals.

A station whose sessions begin faster than they can be queried delays only its own results.

A session that is missing from query results for CONFIRM_S is dropped: the service was restarted without it.
Just after an instance has left, the next one does not hold its sessions yet. While no service is live, the
last results stay. A session that makes room for others is detected at the next query of
all sessions, or of those that another thread names (`doubted`). `events` yields both cases; `follow` yields
the updates alone.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Generator, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from queue import SimpleQueue

from caesura_clients.program_decoder import ProgramDecoder
from caesura_clients.query import CONFIRM_S, services, snapshots
from caesura_clients.service_liveliness import Change, LiveServices
from caesura_clients.session_state_reader import PUBLISHED, Published, SessionReader, Update
from caesura_clients.silent_session_refresh import RefreshBackoff, TimeShares
from caesura_protocol.codec import Encoded, decode, encoding_of, is_other_version
from caesura_protocol.errors import ProtocolError, Unreachable
from caesura_protocol.fragments import Reassembler
from caesura_protocol.keys import SessionPart, service_key, session_key, station_key
from caesura_protocol.messages import MAX_WHOLE_BYTES, Program, Snapshot
from caesura_protocol.transport.inbox import Inbox, ReceivedSample, TokenChange
from caesura_protocol.transport.transport_interface import Transport

STREAMS: tuple[SessionPart, ...] = ("changepoints", "segments", "posterior", "hints", "status")
SNAPSHOT_ATTEMPTS = 3
PROGRAM = encoding_of(Program)
ALL = ("*", "*")
ALL_S = 600.0  # after which all are queried, whatever is received: the service may have dropped some


@dataclass(frozen=True)
class SessionRemoved:
    """The service no longer holds a session."""

    station: str
    session: str


@dataclass(frozen=True)
class ServiceAvailability:
    """The last live service disappeared, or a first one appeared."""

    state: Change


Key = tuple[str, str]  # station and session
Event = Update | SessionRemoved | ServiceAvailability


def follow(
    transport: Transport,
    station: str = "*",
    session: str = "*",
    *,
    refresh_s: float = 2.0,
    silence_s: float | None = None,
) -> Iterator[Update]:
    """Yield updates of all matching sessions, the current state first.

    refresh_s: time without messages after which a session's snapshot is queried again; silence_s: time
    without any message after which the iteration ends, None for never. Raises ProtocolError
    `unsupported_version` if the service is newer.
    """
    stream = events(transport, station, session, refresh_s=refresh_s, silence_s=silence_s)
    with closing(stream):
        for event in stream:
            if isinstance(event, Update):
                yield event


def events(
    transport: Transport,
    station: str = "*",
    session: str = "*",
    *,
    refresh_s: float = 2.0,
    silence_s: float | None = None,
    over: threading.Event | None = None,
    doubted: SimpleQueue[Key] | None = None,
) -> Generator[Event, None, None]:
    """Yield the updates of `follow`, removed sessions, and changes of the service's availability.

    over: set by another thread, it ends the iteration within `refresh_s`. doubted: sessions that the service
    may no longer hold, from another thread; they are queried within `refresh_s`.
    """
    with _listening(transport, station, session) as inbox:
        follower = _Follower(transport, station, session, refresh_s)
        yield from follower.refresh()
        silent_s = 0.0
        while (silence_s is None or silent_s < silence_s) and not (over and over.is_set()):
            wait_s = refresh_s if silence_s is None else min(refresh_s, silence_s)
            item = inbox.get(wait_s)
            if item is None:
                silent_s += wait_s
            if isinstance(item, ReceivedSample):
                silent_s = 0.0
                yield from follower.receive(item)
            elif isinstance(item, TokenChange):
                yield from follower.apply_liveliness(item)
            while doubted is not None and not doubted.empty():
                follower.doubt(doubted.get())
            yield from follower.refresh_silent()


class _Follower:
    """The readers of all sessions received so far, and the queries for their snapshots."""

    def __init__(self, transport: Transport, station: str, session: str, refresh_s: float) -> None:
        self._transport = transport
        self._station = station
        self._session = session
        self._readers: dict[Key, SessionReader] = {}
        self._backoff: RefreshBackoff[Key] = RefreshBackoff(refresh_s)  # of sessions, and of all of them
        self._shares: TimeShares[str] = TimeShares()  # of stations
        self._live_services = LiveServices()
        self._reassembler = Reassembler()
        self._programs: dict[str, ProgramDecoder] = {}  # by their keys
        self._asked_all = float("-inf")  # [s]
        self._missing: dict[Key, float] = {}  # since when [s] query results lack a known session

    def apply_liveliness(self, presence: TokenChange) -> Iterator[Event]:
        """Yield a change of the service's availability, and query its sessions."""
        change = self._live_services.receive(presence)
        if change is not None:
            yield ServiceAvailability(change)
        yield from self.refresh()

    def refresh(self) -> Iterator[Event]:
        """Query snapshots; yield the sessions that changed, and those that are gone."""
        self._asked_all = time.monotonic()
        known = self._ask()
        yield from self._restart(known or ())
        for key in self._readers:
            self._record_query(key, answered=known is not None)
        if known is None:
            self._backoff.retry_after_silence(ALL)
            return
        self._backoff.remove(ALL)
        yield from self._remove_missing(set(self._readers) - _keys(known))

    def doubt(self, key: Key) -> None:
        """Query a session at the next occasion."""
        if key in self._readers:
            self._backoff.hasten(key)

    def refresh_silent(self) -> Iterator[Event]:
        """Query the sessions without recent messages; yield as `refresh`."""
        due = self._backoff.due()
        if ALL in due or time.monotonic() - self._asked_all >= ALL_S:
            yield from self.refresh()
            return
        for station in dict(due):
            if self._shares.allows(station):
                yield from self._refresh_station(station, {key for key in due if key[0] == station})

    def _refresh_station(self, station: str, keys: set[Key]) -> Iterator[Event]:
        """Query sessions of a station, by one query if there are several."""
        (_, session), *others = sorted(keys)
        with self._shares.charged(station):
            known = self._ask(station, "*" if others else session)
        yield from self._restart(known or ())
        for key in keys:
            self._record_query(key, answered=known is not None)
        if known is not None and (missing := keys - _keys(known)):
            yield from self._remove_missing(missing, station)

    def receive(self, delivery: ReceivedSample) -> Iterator[Event]:
        """Apply a published message; yield the session if it changed."""
        message = self._read(delivery)
        if message is None or self._session not in {"*", message.session}:
            return  # a station's program may be that of another session
        self._backoff.reset(ALL)
        self._backoff.reset((message.station, message.session))
        self._missing.pop((message.station, message.session), None)
        reader = self._reader(message.station, message.session)
        before = reader.update
        may_ask = self._shares.allows(message.station)  # if not, the next message asks, or its silence
        for _ in range(SNAPSHOT_ATTEMPTS):
            if reader.receive(message) != "hole" or not may_ask:
                break
            with self._shares.charged(message.station):
                found = self._ask(message.station, message.session)
            for snapshot in found or ():
                reader.restart(snapshot)
        if reader.update is not None and reader.update != before:
            yield reader.update

    def _restart(self, known: Iterable[Snapshot]) -> Iterator[Update]:
        for snapshot in known:
            key = (snapshot.status.station, snapshot.status.session)
            self._missing.pop(key, None)
            reader = self._reader(*key)
            if reader.restart(snapshot) == "changed" and reader.update is not None:
                yield reader.update

    def _record_query(self, key: Key, *, answered: bool) -> None:
        update = self._reader(*key).update
        if not answered:
            self._backoff.retry_after_silence(key)
        elif update is not None and update.closed:
            self._backoff.remove(key)
        else:
            self._backoff.back_off(key)

    def _remove_missing(self, missing: set[Key], station: str | None = None) -> Iterator[SessionRemoved]:
        """Remove the sessions of a station that a complete query after CONFIRM_S does not return either."""
        now = time.monotonic()
        for key in sorted(missing):
            if now - self._missing.setdefault(key, now) < CONFIRM_S:
                missing = missing - {key}
                self._backoff.hasten(key)
        again = self._ask(station, complete=True) if missing else None
        if again is None:
            for key in missing:
                self._backoff.retry_after_silence(key)
        if again is None or not self._is_served():
            return
        for key in sorted(missing - _keys(again)):
            del self._readers[key], self._missing[key]
            self._backoff.remove(key)
            yield SessionRemoved(*key)

    def _is_served(self) -> bool:
        try:
            return bool(services(self._transport))
        except Unreachable:
            return False

    def _ask(
        self, station: str | None = None, session: str | None = None, *, complete: bool = False
    ) -> list[Snapshot] | None:
        """Return the snapshots; None if the service did not answer in time, is gone, or denies access."""
        station, session = station or self._station, session or self._session
        try:
            return snapshots(self._transport, station, session, complete=complete)
        except ProtocolError as error:
            if error.code != "overloaded":
                raise
            return None
        except Unreachable:
            return None

    def _read(self, delivery: ReceivedSample) -> Published | None:
        """Return the message that this payload completes; None if fragments are missing.

        Invalid content is dropped: one bad sender must not end every reader. Raises ProtocolError
        `unsupported_version`.
        """
        try:
            whole = self._reassembler.add(delivery.key, Encoded(delivery.payload, delivery.encoding))
            if whole is None:
                return None
            if whole.encoding == PROGRAM:
                return self._programs.setdefault(delivery.key, ProgramDecoder()).decode(whole.payload)
            return decode(*whole, *PUBLISHED, limit=MAX_WHOLE_BYTES)
        except ProtocolError as error:
            if is_other_version(error):
                raise
            return None

    def _reader(self, station: str, session: str) -> SessionReader:
        return self._readers.setdefault((station, session), SessionReader())


def _keys(known: Iterable[Snapshot]) -> set[Key]:
    return {(one.status.station, one.status.session) for one in known}


@contextmanager
def _listening(transport: Transport, station: str, session: str) -> Iterator[Inbox]:
    inbox = Inbox()
    with ExitStack() as stack:
        for stream in STREAMS:
            stack.enter_context(transport.subscribe(session_key(station, session, stream), inbox))
        stack.enter_context(transport.subscribe(station_key(station, "program"), inbox))
        stack.enter_context(transport.watch_liveliness(service_key("*", "alive"), inbox))
        yield inbox
