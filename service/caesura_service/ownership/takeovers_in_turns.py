"""Takeovers of several stations in turns: the one that has taken least time so far is continued.

So a station with hours of open sessions does not delay the others, whichever was begun first.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Set
from contextlib import suppress
from math import inf

from caesura_service.journal import PeerJournalError
from caesura_service.ownership.takeover import NotRecordedError
from caesura_service.publishing.events import Output, TakeoverFailed

Takeover = Generator[list[Output], None, None]


class TakeoversInTurns:
    """The takeovers in progress, by station. clock: [s], of the thread that does the work."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._under_way: dict[str, Takeover] = {}
        self._took_s: dict[str, float] = {}

    @property
    def stations(self) -> Set[str]:
        """The stations with a takeover in progress."""
        return self._under_way.keys()

    def __bool__(self) -> bool:
        return bool(self._under_way)

    def begin(self, station: str, work: Takeover) -> None:
        """Add a takeover; the station must have none in progress."""
        self._under_way[station], self._took_s[station] = work, 0.0

    def next_station(self) -> str:
        """Return the station to continue, of at least one in progress."""
        return min(self._took_s, key=self._took_s.__getitem__)

    def step(self, station: str) -> list[Output] | None:
        """Continue a takeover up to its next record; return its outputs, None at its end.

        Raises what the takeover raises, which ends it.
        """
        began = self._clock()
        try:
            outputs = next(self._under_way[station])
        except BaseException as error:
            del self._under_way[station], self._took_s[station]
            if isinstance(error, StopIteration):
                return None
            raise
        self._took_s[station] += self._clock() - began
        return outputs

    def cancel(self, station: str) -> None:
        """Give up the takeover of a station, if there is one: its sessions are as before."""
        self._took_s.pop(station, None)
        if (work := self._under_way.pop(station, None)) is not None:
            work.close()

    def complete(self, most_s: float = inf) -> list[TakeoverFailed]:
        """Continue all for most_s at most; return the sessions that could not be taken over.

        The takeover of a station whose records cannot be read or copied ends, and must be repeated.
        """
        failed: list[TakeoverFailed] = []
        until = self._clock() + most_s
        while self and self._clock() < until:
            with suppress(NotRecordedError, PeerJournalError):
                outputs = self.step(self.next_station()) or ()
                failed += [output for output in outputs if isinstance(output, TakeoverFailed)]
        return failed
