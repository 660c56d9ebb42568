"""Takeovers of several stations in turns: the one that has taken least time so far is continued.

So a station with hours of open sessions does not delay the others, whichever was begun first. A long record
gives way within itself, to the takeovers of other stations too.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Set
from contextlib import suppress
from math import inf

from caesura_service.cooperative_scheduler import Slices
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
        self.slices = Slices()  # of the records under way
        self._outputs: dict[str, list[Output]] = {}  # of these, so far

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

    def step(self, station: str, *, sliced: bool = True) -> list[Output] | None:
        """Continue a takeover up to its next record; return its outputs, None at its end.

        sliced: for a slice at most, after which a long record goes on in a later step, of the same thread.
        Raises what the takeover raises, which ends it.
        """
        began, outputs = self._clock(), self._outputs.setdefault(station, [])
        work = self._under_way[station]
        try:
            if not self.slices.is_under_way(station):
                if sliced:
                    done = self.slices.begin(station, lambda: outputs.extend(next(work)))
                else:
                    outputs.extend(next(work))
                    done = True
            elif sliced:
                done = self.slices.go_on(station)
            else:
                self.slices.finish(station)
                done = True
        except BaseException as error:
            del self._under_way[station], self._took_s[station], self._outputs[station]
            if isinstance(error, StopIteration):
                return None
            raise
        self._took_s[station] += self._clock() - began
        return self._outputs.pop(station) if done else []

    def cancel(self, station: str) -> None:
        """Give up the takeover of a station, if there is one, at the end of its record under way."""
        with suppress(Exception):  # it is given up anyway
            self.slices.finish(station)
        self._took_s.pop(station, None)
        self._outputs.pop(station, None)
        if (work := self._under_way.pop(station, None)) is not None:
            work.close()

    def stop(self) -> None:
        """Abandon all takeovers, also within a record; in the thread that does the work."""
        self.slices.stop()
        for work in self._under_way.values():
            work.close()
        self._under_way, self._took_s, self._outputs = {}, {}, {}

    def complete(self, most_s: float = inf) -> list[TakeoverFailed]:
        """Continue all for most_s at most; return the sessions that could not be taken over.

        The takeover of a station whose records cannot be read or copied ends, and must be repeated.
        """
        failed: list[TakeoverFailed] = []
        until = self._clock() + most_s
        while self and self._clock() < until:
            with suppress(NotRecordedError, PeerJournalError):
                outputs = self.step(self.next_station(), sliced=False) or ()
                failed += [output for output in outputs if isinstance(output, TakeoverFailed)]
        return failed
