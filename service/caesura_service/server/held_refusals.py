"""Ends refused lists of stored sessions HELD_S after they were received.

A client that repeats a refused query at once asks as fast as its queries end. Each takes time of the router
and of the interpreter, which the worker then lacks. So a list that is refused without a reason ends late.
Other queries end at once: a client that does not wait for their end would only fill this store.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.server.query_server import QUERY_BYTES

HELD_S = 0.5
HELD = 1024  # queries; of more the oldest ends earlier


class HeldRefusals:
    """Holds refused queries until they end. Any thread may call it."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._held: deque[tuple[float, IncomingQuery]] = deque()  # with the time [s] at which each ends
        self._turn = threading.Lock()

    def hold(self, query: IncomingQuery) -> None:
        """End a query HELD_S from now on, or at once if it has more than QUERY_BYTES."""
        if query.size > QUERY_BYTES:
            query.drop()
            return
        with self._turn:
            self._held.append((self._clock() + HELD_S, query))
            if len(self._held) > HELD:
                self._held.popleft()[1].drop()

    def end_due(self) -> None:
        """End the queries that are due."""
        self._end(self._clock())

    def end_all(self) -> None:
        """End all queries."""
        self._end(float("inf"))

    def _end(self, until_s: float) -> None:
        with self._turn:
            while self._held and self._held[0][0] <= until_s:
                self._held.popleft()[1].drop()
