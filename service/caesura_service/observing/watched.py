"""The registry, watched: every call is counted and told, and does what it does unwatched."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Command, Heartbeat, SampleBatch
from caesura_service.observing.chronicle import Chronicle
from caesura_service.observing.counting import Counting
from caesura_service.observing.steps import Step, changes_between
from caesura_service.session.ports import Incoming, Output, ReplayEnded
from caesura_service.session.registry import Registry
from caesura_service.session.session import Session
from caesura_service.session.standing import Standing, Tally


class WatchedRegistry(Registry):
    """As Registry; any thread may read `counting` as well. watch: a clock [s] of the watcher's own."""

    def __init__(self, *, watch: Callable[[], float] = time.monotonic, **given: Any) -> None:
        super().__init__(**given)
        self._watch = watch
        self.counting = Counting(watch())
        self._chronicle = Chronicle()

    def command(self, station: str, command: Command, now: float) -> list[Output]:
        """Carry out a command; opening may close or forget other sessions of the station."""
        act = partial(super().command, station, command, now)
        return self._watched(station, command, act, partial(self._sessions, station))

    def samples(
        self, station: str, message: SampleBatch | Heartbeat | ReplayEnded, now: float
    ) -> list[Output]:
        """Take what a bridge sent; no other session changes by that."""
        own = self._find(station, message.session)
        act = partial(super().samples, station, message, now)
        return self._watched(station, message, act, lambda: () if own is None else (own,))

    def refuse(self, station: str | None, error: ProtocolError) -> list[Output]:
        """Charge a message that could not be read."""
        act = partial(super().refuse, station, error)
        return self._watched(station, None, act, partial(self._sessions, station))

    def dropped(self, station: str, messages: int) -> list[Output]:
        """There was no room for so many messages of a station."""
        act = partial(super().dropped, station, messages)
        return self._watched(station, None, act, partial(self._sessions, station))

    def tick(self, now: float) -> list[Output]:
        """Time has passed."""
        return self._watched(None, None, partial(super().tick, now), tuple)

    def _watched(
        self,
        station: str | None,
        message: Incoming | None,
        act: Callable[[], list[Output]],
        sessions: Callable[[], Iterable[Session]],
    ) -> list[Output]:
        """sessions: those that may change."""
        before, tally, began = _standings(sessions()), self.tally, self._watch()
        said = act()
        now = self._watch()
        step = Step(
            station=station,
            message=message,
            changes=changes_between(before, _standings(sessions())),
            outputs=said,
            refused=0 if self.tally is tally else _refusals(self.tally) - _refusals(tally),
            refusal=self.tally.last_refusal if self.tally is not tally else None,
            took_s=now - began,
        )
        self.counting.take(step, self.board.sessions, now)
        self._chronicle.take(step, now)
        return said

    def _sessions(self, station: str | None) -> tuple[Session, ...]:
        return self.board.sessions.get(station or "", ())


def _standings(sessions: Iterable[Session]) -> dict[str, Standing]:
    return {session.name: session.standing for session in sessions}


def _refusals(tally: Tally) -> int:
    return sum(tally.refused.values())
