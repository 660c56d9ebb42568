"""The registry, watched: every call is counted and told, and does what it does unwatched."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Close, Command, Heartbeat, Open, SampleBatch
from caesura_service.observing.chronicle import Chronicle
from caesura_service.observing.counting import Counting
from caesura_service.observing.steps import Step, changes_between
from caesura_service.session.ports import Incoming, Output, ReplayEnded
from caesura_service.session.registry import Registry
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
        return self._watched(station, command, partial(super().command, station, command, now))

    def samples(
        self, station: str, message: SampleBatch | Heartbeat | ReplayEnded, now: float
    ) -> list[Output]:
        """Take what a bridge sent."""
        return self._watched(station, message, partial(super().samples, station, message, now))

    def refuse(self, station: str | None, error: ProtocolError) -> list[Output]:
        """Charge a message that could not be read."""
        return self._watched(station, None, partial(super().refuse, station, error))

    def dropped(self, station: str, messages: int) -> list[Output]:
        """There was no room for so many messages of a station."""
        return self._watched(station, None, partial(super().dropped, station, messages))

    def tick(self, now: float) -> list[Output]:
        """Time has passed."""
        return self._watched(None, None, partial(super().tick, now))

    def _watched(
        self, station: str | None, message: Incoming | None, act: Callable[[], list[Output]]
    ) -> list[Output]:
        before, tally, began = self._standings(station, message), self.tally, self._watch()
        said = act()
        now = self._watch()
        step = Step(
            station=station,
            message=message,
            changes=changes_between(before, self._standings(station, message)),
            outputs=said,
            refused=_refusals(self.tally) - _refusals(tally),
            refusal=self.tally.last_refusal if self.tally is not tally else None,
            took_s=now - began,
        )
        self.counting.take(step, self.board.sessions, now)
        self._chronicle.take(step, now)
        return said

    def _standings(self, station: str | None, message: Incoming | None) -> dict[str, Standing]:
        """Of the sessions that may change: a command any of its station, samples only their own."""
        sessions = self.board.sessions.get(station or "", ())
        own = None if message is None or isinstance(message, Open | Close) else message.session
        return {session.name: session.standing for session in sessions if own in {None, session.name}}


def _refusals(tally: Tally) -> int:
    return sum(tally.refused.values())
