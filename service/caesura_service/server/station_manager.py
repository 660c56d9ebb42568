"""Looks after the stations of this instance: takes those that are its own, lets go of the others.

Alone it serves every station, by wildcards. With others it serves the stations that rendezvous hashing gives
it, of those that have a bridge or a session. Another instance may have served an owned station after an
instance came or the own link was lost. The owner then reads its journal before it accepts new messages, and
publishes under a new epoch. It reads the journal again a little later, when the other instance has let go.

Runs in the worker's thread, a record at a time, so that stations that are served go on meanwhile.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Generator, Set
from contextlib import suppress

from caesura_service.journal import JournalError
from caesura_service.ownership.registry import Registry
from caesura_service.ownership.station_assignment import stations_of
from caesura_service.publishing.events import Output, TakeoverFailed
from caesura_service.server.inbound import LivelinessChanged, RouterLinkChanged, Watching
from caesura_service.server.live_tokens import LiveTokens
from caesura_service.server.membership import Membership

logger = logging.getLogger(__name__)

LOOKS_S = (0.1, 0.5, 3.0)  # after a change: the last owner has let go by then, or was found to hang
STATIONS = 4096  # with a token


class StationManager:
    """One thread uses it."""

    def __init__(
        self,
        registry: Registry,
        me: str,
        declare: Callable[[Set[str] | None], None],
        clock: Callable[[], float],
    ) -> None:
        """declare: makes these stations reach us, None for all."""
        self._registry, self._me, self._declare, self._clock = registry, me, declare, clock
        self._membership = Membership(me)
        self._members = frozenset({me})
        self._bridges: set[str] = set()  # stations with a token
        self._ours: Set[str] = frozenset()
        self._queue: dict[str, bool] = {}  # stations to be taken; also where nothing is behind?
        self._taking: tuple[str, Generator[list[Output], None, None]] | None = None
        self._due = float("inf")  # [s] the next change of membership by time alone
        self._looks: list[float] = []  # [s]

    # --- the beginning, before the token is declared ----------------------------------------------------

    def begin(self, there: LiveTokens) -> list[TakeoverFailed]:
        """Take the stations to own, then let it reach us; returns what could not be taken."""
        if self._me in there.services:
            logger.error("a service named %s is there already: give each its own --instance", self._me)
        now, began = self._clock(), time.monotonic()
        self._membership.begin(there.services)
        self._members = self._membership.members(now)
        self._bridges.update(there.stations)
        served = self._share()
        self._ours = self._known() if served is None else served
        missing = self._registry.restore(now, self._ours)
        self._registry.ownership.served = served
        self._declare(served)
        self._log_start(time.monotonic() - began)
        return missing

    def _log_start(self, took_s: float) -> None:
        if states := self._registry.index.all_states():
            opened = sum(state.is_open for state in states)
            logger.info("%d open and %d closed sessions in %.2f s", opened, len(states) - opened, took_s)
        if len(self._members) > 1:
            names = ", ".join(sorted(self._members))
            logger.info(
                "%s share the stations; this instance owns %s", names, ", ".join(sorted(self._ours)) or "none"
            )

    # --- in the worker's thread -------------------------------------------------------------------------

    def receive(self, arrival: LivelinessChanged | RouterLinkChanged | Watching) -> None:
        """Process a change of instances, bridges or the own link."""
        now = self._clock()
        match arrival:
            case Watching():
                self._membership.watching(now)
                self._look_again(now)
            case RouterLinkChanged(up):
                logger.warning("the router is %s", "back" if up else "gone: trying until it is back")
                self._membership.link_back(now) if up else self._membership.link_lost()
                self._share_out(now, renew=up)
            case LivelinessChanged("service", name, alive):
                fresh = alive and self._membership.came(name, now)
                if not alive:
                    self._membership.went(name, now)
                self._share_out(now, renew=fresh)
            case LivelinessChanged("station", name, True) if name not in self._bridges:
                if len(self._bridges) < STATIONS:
                    self._bridges.add(name)
                    self._share_out(now)
            case LivelinessChanged("station", name, False):
                self._bridges.discard(name)  # whose sessions may go on
        self._due = self._membership.due(now)

    def patience_s(self) -> float:
        """How long nothing is to be done here unless an instance or a bridge comes or goes."""
        if self._queue or self._taking:
            return 0.0
        return max(0.0, min([self._due, *self._looks]) - self._clock())

    def step(self) -> list[Output]:
        """Do the next little thing, and say what comes of it."""
        now = self._clock()
        if now >= self._due:
            self._due = self._membership.due(now)
            self._share_out(now)
        if self._looks and now >= self._looks[0]:
            self._looks.pop(0)
            for station in sorted(self._ours):
                self._queue.setdefault(station, False)
        if self._taking is None and self._queue:
            station = next(iter(self._queue))
            self._taking = station, self._registry.take_over(station, now, renew=self._queue.pop(station))
        return self._go_on()

    def _go_on(self) -> list[Output]:
        if self._taking is None:
            return []
        try:
            return next(self._taking[1])
        except StopIteration:
            self._taking = None
        except Exception:
            self._taking = None
            raise
        return []

    # --- whose stations are whose -----------------------------------------------------------------------

    def _share_out(self, now: float, *, renew: bool = False) -> None:
        """Release stations of others, take the own ones. renew: also take again those already owned."""
        before, self._members = self._members, self._membership.members(now)
        if before != self._members:
            logger.info("instances: %s", ", ".join(sorted(self._members)))
        if before == self._members == {self._me} and not renew:
            return  # a bridge whose station is served already
        served = self._share()
        ours = self._known() if served is None else served
        fresh = ours if renew else ours - self._ours
        for station in self._registry.held_stations() & fresh:  # are there at once
            self._take_later(station)
        for station in sorted(fresh - self._registry.held_stations()):
            self._take_later(station)
        self._registry.ownership.served = served
        self._declare(served)
        for station in (self._ours | self._registry.held_stations()) - ours:
            self._leave(station)
        self._ours = ours
        if renew or before != self._members:
            self._look_again(now)

    def _share(self) -> Set[str] | None:
        """Return the stations of this instance; None where it is alone and owns all."""
        return None if self._members == {self._me} else stations_of(self._me, self._members, self._known())

    def _known(self) -> Set[str]:
        with suppress(JournalError):  # which it has said already, or will
            return self._registry.known_stations() | self._bridges
        return self._registry.held_stations() | self._bridges

    def _take_later(self, station: str) -> None:
        if self._taking is not None and self._taking[0] == station:
            self._give_up_taking()
        self._registry.ownership.begin_takeover(station)
        self._queue[station] = True

    def _leave(self, station: str) -> None:
        self._queue.pop(station, None)
        if self._taking is not None and self._taking[0] == station:
            self._give_up_taking()
        self._registry.release(station)
        logger.info("%s is let go of", station, extra={"station": station})

    def _give_up_taking(self) -> None:
        assert self._taking is not None
        taking, self._taking = self._taking[1], None
        taking.close()

    def _look_again(self, now: float) -> None:
        if len(self._members) > 1:
            self._looks = [now + delay_s for delay_s in LOOKS_S]
