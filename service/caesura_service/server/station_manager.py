"""Manages the stations of this instance: takes over its own, releases the others.

A single instance serves every station, by wildcards. Several instances divide the stations with a bridge or a
session by rendezvous hashing. After an instance has appeared, or the own link was lost, another instance may
have served an owned station. The owner then reads that instance's journal before it accepts new messages, and
publishes under a new epoch. It reads the journal again a little later, when the other instance has released
the station.

It runs in the worker's thread, one record at a time, so that other stations are served meanwhile. Takeovers
take turns by the time that they took, so that none waits for a long one. A start of a single instance
completes what it can within START_S.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Set
from contextlib import suppress
from math import inf

from caesura_service.journal import JournalError
from caesura_service.ownership.registry import Registry
from caesura_service.ownership.station_assignment import stations_of
from caesura_service.ownership.takeovers_in_turns import TakeoversInTurns
from caesura_service.publishing.events import Output, TakeoverFailed
from caesura_service.server.inbound_events import LivelinessChanged, RouterLinkChanged, Watching
from caesura_service.server.live_tokens import LiveTokens
from caesura_service.server.membership import Membership

logger = logging.getLogger(__name__)

TAKEOVER = "/taking"  # the lane of `step`, and its name among the slices; no station's name
POLL_DELAYS_S = (0.1, 0.5, 3.0)  # after a change: the last owner has released by then, or hangs
STATIONS = 4096  # with a token
START_S = 60.0  # of takeovers before a start serves anything; half of what a bridge's ring has at least
RETRY_S = 0.5  # after a takeover for which the journal could not be read


class StationManager:
    """Decides which stations to take over and release; only one thread may call it."""

    def __init__(
        self,
        registry: Registry,
        me: str,
        declare: Callable[[Set[str] | None], None],
        clock: Callable[[], float],
    ) -> None:
        """declare: subscribes to the given stations, None for all."""
        self._registry, self._me, self._declare, self._clock = registry, me, declare, clock
        self._membership = Membership(me)
        self._members = frozenset({me})
        self._bridges: set[str] = set()  # stations with a token
        self._has_new_bridge = False  # whose station is to be assigned
        self._owned: Set[str] = frozenset()
        self._queue: dict[str, bool] = {}  # stations to take over; also where no record is missing?
        self._takeovers = TakeoversInTurns()
        self._renews: dict[str, bool] = {}  # does a takeover in progress set a new epoch in any case?
        self._next_takeover_s = float("-inf")  # [s] after one that failed
        self._last_error = ""  # why one failed
        self._next_change_s = float("inf")  # [s] the next change of membership by time alone
        self._polls_s: list[float] = []  # [s]

    # --- the beginning, before the token is declared ----------------------------------------------------

    def start(self, there: LiveTokens) -> list[TakeoverFailed]:
        """Take over the own stations, then subscribe to them; return the sessions that failed.

        Raises JournalError if the existing stations cannot be determined.
        """
        now, began = self._clock(), time.monotonic()
        self._membership.begin(there.services)
        self._members = self._membership.members(now)
        self._bridges.update(there.stations)
        known = self._registry.known_stations() | self._bridges
        served = self._assigned_stations(known)
        self._owned = known if served is None else served
        most_s = START_S if served is None else inf  # other instances serve the stations meanwhile
        for station in sorted(self._owned):
            self._registry.ownership.begin_takeover(station)  # some may not have their turn in that time
            self._begin_takeover(station, now, renew=True)
        missing = self._takeovers.complete(most_s)
        self._registry.ownership.served = served
        self._polls_s = [float("inf")]  # until the last owner can learn that it has lost them
        self._update_settling()
        self._declare(served)
        self._log_start(time.monotonic() - began)
        return missing

    def _log_start(self, took_s: float) -> None:
        if left := self._takeovers.stations:
            logger.info("other stations are served while these are taken over: %s", ", ".join(sorted(left)))
        if states := self._registry.index.all_states():
            opened = sum(state.is_open for state in states)
            logger.info("%d open and %d closed sessions in %.2f s", opened, len(states) - opened, took_s)
        if len(self._members) > 1:
            names = ", ".join(sorted(self._members))
            logger.info(
                "%s share the stations; this instance owns %s",
                names,
                ", ".join(sorted(self._owned)) or "none",
            )

    # --- in the worker's thread -------------------------------------------------------------------------

    def handle_event(self, arrival: LivelinessChanged | RouterLinkChanged | Watching) -> None:
        """Process a change of instances, bridges or the own link."""
        now = self._clock()
        match arrival:
            case Watching():
                self._membership.start_watching(now)
                self._polls_s = []
                self._schedule_polls(now)
            case RouterLinkChanged(up):
                logger.warning("the router is %s", "back" if up else "gone: trying until it is back")
                self._membership.link_restored(now) if up else self._membership.link_lost()
                self._reassign(now, renew=up)
                self._registry.ownership.is_unlinked = not up
            case LivelinessChanged("service", name, alive):
                fresh = alive and self._membership.add(name, now)
                if not alive:
                    self._membership.remove(name, now)
                self._reassign(now, renew=fresh)
            case LivelinessChanged("station", name, True) if name not in self._bridges:
                if len(self._bridges) < STATIONS:
                    self._bridges.add(name)
                    self._has_new_bridge = True
            case LivelinessChanged("station", name, False):
                self._bridges.discard(name)  # whose sessions may go on
        self._next_change_s = self._membership.next_change_s(now)
        self._update_settling()

    def _update_settling(self) -> None:
        """Record whether takeovers are left; until then another instance may have an own station.

        What is known of takeovers in progress goes with the last of them.
        """
        if not self._takeovers:
            self._renews.clear()
        is_settled = not self._takeovers and not self._queue and not self._polls_s
        self._registry.ownership.is_settling = not is_settled

    def idle_s(self) -> float:
        """Return the time [s] until the next step is due, unless an event arrives."""
        if self._takeovers or self._has_new_bridge or self._registry.ownership.superseded:
            return 0.0
        takeover_s = [self._next_takeover_s] if self._queue else []
        return max(0.0, min([self._next_change_s, *self._polls_s, *takeover_s]) - self._clock())

    def step(self) -> list[Output]:
        """Run the next step of a takeover that is due; return its outputs."""
        now = self._clock()
        if self._has_new_bridge or now >= self._next_change_s:
            self._next_change_s = self._membership.next_change_s(now)
            self._reassign(now)
        if self._polls_s and now >= self._polls_s[0]:
            self._polls_s.pop(0)
            for station in sorted(self._owned):
                self._queue.setdefault(station, False)
        self._take_back_superseded()
        if now >= self._next_takeover_s:
            for station in [station for station in self._queue if station not in self._takeovers.stations]:
                self._begin_takeover(station, now, renew=self._queue.pop(station))
        outputs = self._continue_takeover()
        self._update_settling()
        return outputs

    def stop(self) -> None:
        """Abandon the takeovers in progress."""
        self._takeovers.stop()

    def _begin_takeover(self, station: str, now: float, *, renew: bool) -> None:
        self._renews[station] = renew
        self._takeovers.begin(station, self._registry.take_over(station, now, renew=renew))

    def _take_back_superseded(self) -> None:
        """Take over again the stations of this instance that another one has acquired."""
        ownership = self._registry.ownership
        while ownership.superseded:
            station = ownership.superseded.pop()
            if ownership.served is None or station in ownership.served:
                self._schedule_takeover(station)

    def _continue_takeover(self) -> list[Output]:
        if not self._takeovers:
            return []
        station = self._takeovers.next_station()
        try:
            return self._takeovers.step(station) or []
        except JournalError as error:
            self._retry_takeover(station, error)
        return []

    def _retry_takeover(self, station: str, error: JournalError) -> None:
        """Schedule another takeover of a station.

        Until then its messages are rejected if another instance may have served it. This instance may lack
        records that the other one has acknowledged.
        """
        self._next_takeover_s = self._clock() + RETRY_S
        if self._renews[station]:
            self._registry.ownership.begin_takeover(station)
        self._queue[station] = self._renews[station] or self._queue.get(station, False)
        if self._last_error != str(error):
            self._last_error = str(error)
            fields = {"station": station}
            logger.error("%s could not be taken over, which is tried again: %s", station, error, extra=fields)

    # --- whose stations are whose -----------------------------------------------------------------------

    def _reassign(self, now: float, *, renew: bool = False) -> None:
        """Release stations of others, take over the own ones. renew: also those that are already owned."""
        self._has_new_bridge = False
        before, self._members = self._members, self._membership.members(now)
        if before != self._members:
            logger.info("instances: %s", ", ".join(sorted(self._members)))
        if before == self._members == {self._me} and not renew:
            return  # a bridge whose station is served already
        known = self._known_stations()
        served = self._assigned_stations(known)
        owned = known if served is None else served
        if served is None:
            self._bridges.clear()  # whose tokens are not watched meanwhile
        fresh = owned if renew else owned - self._owned
        for station in self._registry.held_stations() & fresh:  # are there at once
            self._schedule_takeover(station)
        for station in sorted(fresh - self._registry.held_stations()):
            self._schedule_takeover(station)
        self._registry.ownership.served = served
        self._declare(served)
        for station in (self._owned | self._registry.held_stations()) - owned:
            self._release(station)
        self._owned = owned
        if renew or before != self._members:
            self._schedule_polls(now)

    def _assigned_stations(self, known: Set[str]) -> Set[str] | None:
        """Return the stations of this instance among the known ones; None for all, if it is the only one."""
        return None if self._members == {self._me} else stations_of(self._me, self._members, known)

    def _known_stations(self) -> Set[str]:
        with suppress(JournalError):  # which it has said already, or will
            return self._registry.known_stations() | self._bridges
        return self._registry.held_stations() | self._bridges

    def _schedule_takeover(self, station: str) -> None:
        self._cancel_takeover(station)
        self._registry.ownership.begin_takeover(station)
        self._queue[station] = True

    def _release(self, station: str) -> None:
        self._cancel_takeover(station)  # first: one that fails is queued again
        self._queue.pop(station, None)
        self._registry.release(station)
        logger.info("%s is released", station, extra={"station": station})

    def _cancel_takeover(self, station: str) -> None:
        if station in self._takeovers.stations:
            self._registry.slices.finish(TAKEOVER)  # it may be in the middle of a record
            self._takeovers.cancel(station)

    def _schedule_polls(self, now: float) -> None:
        if len(self._members) > 1:
            self._polls_s = [now + delay_s for delay_s in POLL_DELAYS_S]
