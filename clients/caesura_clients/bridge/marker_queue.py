"""Sends the marks of a source in a separate thread, so that the robot's loop never waits for the service.

Marks wait in a queue of `CAPACITY`. A hand cannot fill it; a mark beyond it is counted as failed.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Self

from caesura_protocol.errors import CaesuraError, ProtocolError

CAPACITY = 64
LAST_S = 10.0  # for the marks that wait when the demonstration is over


class MarkerQueue:
    """A thread that sends marks one after the other until the context ends and the queue is empty.

    make: sends a mark at a time [s]; it may wait for the network. `failed` lists the reasons of marks that
    failed.
    """

    def __init__(self, make: Callable[[float], object], name: str) -> None:
        self.made = 0
        self.failed: list[str] = []
        self._make = make
        self._waiting: queue.Queue[float | None] = queue.Queue(CAPACITY)
        self._thread = threading.Thread(target=self._run, name=f"marks {name}", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._give_up("the demonstration was ended")
        with suppress(queue.Full):
            self._waiting.put(None, timeout=LAST_S)
        self._thread.join(LAST_S)
        if self._thread.is_alive():
            self._give_up(f"no service accepted it within {LAST_S:g} s of the end")
            self._waiting.put(None)

    def put(self, t: float) -> None:
        """Enqueue a mark at a time [s]; never blocks. One beyond the capacity is noted in `failed`."""
        try:
            self._waiting.put_nowait(t)
        except queue.Full:
            self.failed.append(f"mark at {t:.2f} s: {CAPACITY} marks wait already")

    def _give_up(self, why: str) -> None:
        """Move the queued marks to `failed` with the reason, so that the demonstration need not wait."""
        with suppress(queue.Empty):
            while (t := self._waiting.get_nowait()) is not None:
                self.failed.append(f"mark at {t:.2f} s: {why}")

    def _run(self) -> None:
        while (t := self._waiting.get()) is not None:
            try:
                self._make(t)
                self.made += 1
            except (CaesuraError, ProtocolError) as error:
                self.failed.append(f"mark at {t:.2f} s: {error}")
