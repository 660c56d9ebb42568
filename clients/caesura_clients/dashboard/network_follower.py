"""The network side of the dashboard: three threads follow the service, and pages read their state unlocked.

  results   updates of every session, and the current session of each station;
  arrivals  samples, decimated into rings, and liveliness tokens of bridges and instances;
  services  the status of every instance, once a second, and unknown current sessions.

`world` is immutable and replaced. A thread that cannot reach the network states that in
`DashboardState.troubles` and retries; no error ends it.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from functools import partial
from queue import SimpleQueue
from typing import Any, TypeVar

from caesura_clients.dashboard.signal_ring import SignalRing
from caesura_clients.dashboard.station_summary import DashboardState, NewestSamples
from caesura_clients.dashboard.system import rates
from caesura_clients.query import current_sessions, samples, service_status, stored_snapshots
from caesura_clients.repeating_threads import RepeatingThreads
from caesura_clients.session_follower import Event, Key, SessionRemoved, events
from caesura_clients.session_state_reader import SessionReader, Update
from caesura_clients.station_name_conflicts import ParallelSessions
from caesura_protocol.codec import decode, unpack_samples
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.keys import SampleRange, parse_service_key, parse_station_key, service_key, station_key
from caesura_protocol.messages import (
    BridgeStatus,
    Heartbeat,
    Posterior,
    RecordedSamples,
    SampleBatch,
    Snapshot,
)
from caesura_protocol.transport.inbox import Inbox, ReceivedSample, TokenChange
from caesura_protocol.transport.transport_interface import Transport

K = TypeVar("K")
V = TypeVar("V")
POLL_S = 1.0
TICK_S = 0.2  # how soon a thread sees that it is over
REFRESH_S = 2.0  # of silence, then what is known is asked for again
POSTERIORS = 600  # a station: one minute of run lengths
STORED = 512  # sessions that were read from the journal and are kept
STATIONS = 256  # that signals are kept of; as many as a service takes


class NetworkFollower(RepeatingThreads):
    """Follows all sessions and instances while its context lasts.

    transport: is closed by its owner, after this object. unconnected: returns why it has no connection yet,
    empty once it has one. clock: monotonic [s]. Leaving the context takes up to refresh_s.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        unconnected: Callable[[], str] = str,
        clock: Callable[[], float] = time.monotonic,
        refresh_s: float = REFRESH_S,
    ) -> None:
        self.transport = transport
        self._unconnected = unconnected
        self.clock = clock
        self.began = clock()
        self._refresh_s = refresh_s
        self.world = DashboardState()
        self._unsure: set[str] = set()  # stations to ask again for, which session of each is current
        self._asked: dict[str, float] = {}  # when [s] a station was asked for last
        self.received: dict[str, NewestSamples] = {}
        self._doubted: SimpleQueue[Key] = SimpleQueue()  # sessions that may have gone
        self._counts = (0, 0)  # sessions that are known here, and that the services hold
        self._parallel = ParallelSessions()
        self._rings: dict[str, SignalRing] = {}
        self._posteriors: dict[str, deque[Posterior]] = {}
        self._pages: dict[str, int] = {}  # stored sessions that were read, by what was asked for
        self._changing = threading.Lock()
        works = {
            "results": self._follow_results,
            "arrivals": self._follow_arrivals,
            "services": self._ask_services,
        }
        connected = {name: partial(self._once_connected, work) for name, work in works.items()}
        super().__init__(connected, on_error=self._trouble)

    def _once_connected(self, work: Callable[[], None]) -> None:
        while why := self._unconnected():
            self._trouble("connection", why)
            if self._over.wait(TICK_S):
                return
        self._trouble("connection")
        work()

    def samples(self, station: str, session: str, wanted: SampleRange) -> RecordedSamples:
        """Return the samples of a session in a range: the newest from the ring, others from the journal.

        All samples of a closed session are read from the journal, because the last ones may not be in the
        ring. Raises NotFound, Unreachable or ProtocolError.
        """
        ring, update = self._rings.get(station), self.world.update(station, session)
        if ring is None or update is None or update.closed:
            return self.journal_samples(station, session, wanted)
        if ring.covers(session, wanted.t0, wanted.columns):
            found = ring.read(station, wanted, update.status.length_unit, update.status.wrench.frame)
            if found is not None and found.session == session:
                return found
        recorded = self.journal_samples(station, session, wanted)
        ring.set_first_orientation(session, recorded.first_orientation)
        return recorded

    def journal_samples(self, station: str, session: str, wanted: SampleRange) -> RecordedSamples:
        """Return the samples of a range from the journal alone, in bins of one width. Raises as `samples`."""
        return samples(self.transport, station, session, wanted)

    def read_stored(self, station: str = "*", session: str = "*") -> int:
        """Read the next page of stored sessions, or one session; return how many were found.

        Pages that have only known sessions are skipped. Raises CaesuraError or ProtocolError.
        """
        if session != "*":
            found = stored_snapshots(self.transport, station, session)
            self._keep_stored(found)
            return len(found)
        while True:
            skip = self._pages.get(station, 0)
            found = stored_snapshots(self.transport, station, session, skip=skip)
            self._pages[station] = skip + self._least_page(found)
            if self._keep_stored(found) or not found:
                return len(found)

    def _keep_stored(self, found: Iterable[Snapshot]) -> bool:
        """Keep sessions that were read from the journal; return whether one of them is new."""
        read: dict[Key, Update] = {}
        for one in found:
            reader = SessionReader()
            reader.restart(one)
            if reader.update is not None:
                read[one.status.station, one.status.session] = reader.update
        with self._changing:
            known, closed = self.world.stored, self.world.closed + 1
            stored = dict(list({**known, **read}.items())[-STORED:])
            self.world = replace(self.world, stored=stored, closed=closed)
        return not read.keys() <= known.keys()

    def _least_page(self, found: Iterable[Snapshot]) -> int:
        """Return the least number of sessions that any instance returned.

        Each instance pages separately, and the same number is skipped in all of them.
        """
        stations = (self.world.update(one.status.station) for one in found)
        given = Counter("" if update is None else update.status.instance for update in stations)
        return min(given.values(), default=0)

    def posteriors(self, station: str, session: str) -> tuple[Posterior, ...]:
        """The newest posteriors of a session, in order."""
        with self._changing:
            return tuple(one for one in self._posteriors.get(station, ()) if one.session == session)

    def _trouble(self, name: str, why: str = "") -> None:
        """Record why a thread cannot work; an empty reason records that it works."""
        if self.world.troubles.get(name, "") != why:
            others = _without(self.world.troubles, name)
            self._change(troubles={**others, name: why} if why else others)

    # --- results ---

    def _follow_results(self) -> None:
        doubted = self._doubted
        stream = events(self.transport, refresh_s=self._refresh_s, over=self._over, doubted=doubted)
        with closing(stream) as reported:
            for event in reported:
                self._take(event)
                self._trouble("results")

    def _take(self, event: Event) -> None:
        match event:
            case Update():
                self._take_update(event)
            case SessionRemoved():
                self._remove((event.station, event.session))

    def _remove(self, gone: Key) -> None:
        """Remove a session that the service no longer holds, and its copy read from the journal."""
        with self._changing:
            world = self.world
            self.world = replace(
                world,
                updates=_without(world.updates, gone),
                stored=_without(world.stored, gone),
                first_seen=_without(world.first_seen, gone),
                closed=world.closed + 1,
            )
        self._pages.clear()  # it may be on the first page now
        self._forget_samples(*gone)
        self._look_up_current(gone[0])
        self._parallel.close(*gone)
        self._count_bridges(gone[0])

    def _take_update(self, update: Update) -> None:
        key = (update.station, update.session)
        known = self.world.updates
        seen = {key: self.clock(), **self.world.first_seen}
        before = known.get(key)
        if before is not None and before.status.opened != update.status.opened:  # its name is used again
            self._forget_samples(*key)
            seen[key] = self.clock()
        self._change(
            updates={**known, key: update}, first_seen=seen, closed=self.world.closed + update.closed
        )
        if key not in known:
            self._look_up_current(update.station)
        self._parallel.observe(update)
        self._count_bridges(update.station)
        if update.posterior is not None:
            self._keep_posterior(update.station, update.posterior)

    def _forget_samples(self, station: str, session: str) -> None:
        """Forget the newest samples of a session: another one may have its name, and begins at 0."""
        ring = self._rings.get(station)
        if ring is not None and ring.session == session:
            self._rings.pop(station, None)
            self.received.pop(station, None)

    def _count_bridges(self, station: str) -> None:
        """Record the sessions of a station that several bridges send at once."""
        both, known = self._parallel.at(station), self.world.parallel
        if known.get(station, ()) != both:
            others = _without(known, station)
            self._change(parallel={**others, station: both} if both else others)

    def _look_up_current(self, station: str) -> None:
        """Query a station's current session: at once, or later if it was queried just before.

        So the cost does not grow with the number of sessions that a station opens per second.
        """
        if self._may_ask(station):
            self._ask_current(station)
        else:
            self._unsure.add(station)

    def _may_ask(self, station: str) -> bool:
        return self.clock() >= self._asked.get(station, -math.inf) + POLL_S

    def _ask_current(self, station: str) -> None:
        """Query the current session of a station.

        If no service answers in time, keep the known one and retry.
        """
        self._asked[station] = self.clock()
        self._unsure.discard(station)
        try:
            found = current_sessions(self.transport, station)
        except (CaesuraError, ProtocolError):
            self._unsure.add(station)
            return
        with self._changing:
            others = _without(self.world.current, station)
            self.world = replace(self.world, current={**others, **found})

    def _keep_posterior(self, station: str, posterior: Posterior) -> None:
        with self._changing:
            kept = self._posteriors.setdefault(station, deque(maxlen=POSTERIORS))
            if not kept or kept[-1] is not posterior:
                kept.append(posterior)

    # --- samples and tokens ---

    def _follow_arrivals(self) -> None:
        inbox = Inbox()
        self._change(bridges=frozenset(), alive=frozenset(), standby={})
        with ExitStack() as stack:
            stack.enter_context(self.transport.subscribe(station_key("*", "samples"), inbox))
            stack.enter_context(self.transport.subscribe(station_key("*", "bridge_status"), inbox))
            stack.enter_context(self.transport.watch_liveliness(station_key("*", "alive"), inbox))
            stack.enter_context(self.transport.watch_liveliness(service_key("*", "alive"), inbox))
            self._trouble("arrivals")
            while not self._over.is_set():
                item = inbox.get(TICK_S)
                if isinstance(item, TokenChange):
                    self._attend(item)
                elif isinstance(item, ReceivedSample):
                    self._sampled(item)

    def _attend(self, presence: TokenChange) -> None:
        """Apply a token's change. A bridge that comes may be another one: its status is still to come."""
        try:
            bridge = parse_station_key(presence.key)[0]
            bridges = _with(self.world.bridges, bridge, presence.alive)
            self._change(bridges=bridges, standby=_without(self.world.standby, bridge))
        except ProtocolError:
            with suppress(ProtocolError):
                instance = parse_service_key(presence.key)[0]
                self._change(alive=_with(self.world.alive, instance, presence.alive))

    def _sampled(self, delivery: ReceivedSample) -> None:
        """Store a batch of samples, or the status of a bridge in standby.

        Invalid content is dropped: one bad sender must not end the updates of all browsers.
        """
        try:
            station, part = parse_station_key(delivery.key)
            if part == "bridge_status":
                self._take_bridge_status(station, delivery)
                return
            batch = decode(delivery.payload, delivery.encoding, SampleBatch, Heartbeat)
            if not isinstance(batch, SampleBatch):
                return
            matrix = unpack_samples(batch)
        except ProtocolError:
            return
        if station not in self._rings and len(self._rings) >= STATIONS:
            self._forget_longest_silent()
        newest, known = float(matrix[-1, 0]), self.received.get(station)
        if known is not None and known.session != batch.session:
            known = None
        if known is None or newest > known.t:  # else it was sent again
            first = float(matrix[0, 0]) if known is None else known.first
            self.received[station] = NewestSamples(self.clock(), newest, batch.session, first)
        self._rings.setdefault(station, SignalRing()).receive(batch.session, batch.columns, batch.seq, matrix)

    def _forget_longest_silent(self) -> None:
        """Evict the ring of the station that has been silent the longest; the journal has its samples."""
        longest, _ = min(tuple(self.received.items()), key=lambda one: one[1].at)
        self._rings.pop(longest, None)
        self.received.pop(longest, None)

    def _take_bridge_status(self, station: str, delivery: ReceivedSample) -> None:
        status = decode(delivery.payload, delivery.encoding, BridgeStatus)
        known = self.world.standby
        if known.get(station) != status and (station in known or len(known) < STATIONS):
            self._change(standby={**self.world.standby, station: status})

    # --- services ---

    def _ask_services(self) -> None:
        asked_at = self.clock()
        while not self._over.is_set():
            before, then = self.world.services, asked_at
            services, asked_at = tuple(service_status(self.transport)), self.clock()
            self._change(services=services, rates=rates(before, services, asked_at - then))
            self._doubt_sessions()
            for station in filter(self._may_ask, tuple(self._unsure)):
                self._ask_current(station)
            self._trouble("services")
            self._over.wait(POLL_S)

    def _doubt_sessions(self) -> None:
        """Name sessions to be queried where the services hold fewer than are known here.

        One that goes is not published; the oldest closed ones of a station go first.
        """
        updates, services = self.world.updates, self.world.services
        counts = len(updates), sum(one.sessions_open + one.sessions_closed for one in services)
        if counts == self._counts:  # they were queried already
            return
        self._counts, excess = counts, counts[0] - counts[1]
        closed: dict[str, list[Update]] = {}
        for update in updates.values():
            if update.closed:
                closed.setdefault(update.station, []).append(update)
        for station, sessions in closed.items():
            oldest = sorted(sessions, key=lambda one: one.status.opened or 0.0)
            for update in oldest[: max(0, excess)]:
                self._doubted.put((station, update.session))

    def _change(self, **changes: Any) -> None:
        with self._changing:
            self.world = replace(self.world, **changes)


def _with(names: frozenset[str], name: str, there: bool) -> frozenset[str]:
    return names | {name} if there else names - {name}


def _without(known: Mapping[K, V], key: K) -> dict[K, V]:
    return {name: one for name, one in known.items() if name != key}
