"""Somebody who hears what the service publishes of a station, beside the dashboard."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from caesura_clients import Caesura
from caesura_clients.session_follower import events
from caesura_clients.session_state_reader import Update
from harness.processes import DEADLINE_S


class Subscriber:
    """Hears what the service publishes of a station, beside the dashboard."""

    def __init__(self, caesura: Caesura, station: str) -> None:
        self.update: Update | None = None
        self.over = threading.Event()
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._listen, args=(caesura, station), daemon=True)

    @contextmanager
    def listening(self) -> Iterator[Subscriber]:
        self._thread.start()
        try:
            yield self
        finally:
            self.over.set()
            self._thread.join()

    def _listen(self, caesura: Caesura, station: str) -> None:
        for event in events(caesura.transport, station, refresh_s=0.2, over=self.over):
            if isinstance(event, Update):
                with self._changed:
                    self.update = event
                    self._changed.notify_all()

    def until(self, true: Callable[[], bool]) -> None:
        """Wait for the update with which it is true."""
        with self._changed:
            assert self._changed.wait_for(true, DEADLINE_S)

    @property
    def now(self) -> Update:
        assert self.update is not None
        return self.update

    def corrected(self) -> list[float]:
        return [one.t for one in self.now.changepoints if one.corrected]

    def taught(self) -> list[object]:
        """What nothing changes any more while the hand rests: the first segments, and the apps of them."""
        segments = [(one.t0, one.tn, one.kind) for one in self.now.segments[:3]]
        return [*segments, *((one.kind, one.target, one.force) for one in self.now.program.apps[:2])]
