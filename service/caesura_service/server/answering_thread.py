"""Answers queries in a separate thread, a part of an answer at a time.

Queries are queued as in the worker: fair by the measured time of the answers, with a lane for each station in
a key, and one for all keys without a station. A long answer is interrupted after each reply.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator

from caesura_protocol.token_bucket import LOG_RATE, Rate, RateLimit
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.work_queue import QueueSettings, WorkQueue

logger = logging.getLogger(__name__)

TICK_S = 0.1


class Pace:
    """The rests of a thread that works for a share of the time.

    A thread that decodes and encodes without a pause holds the interpreter most of the time. The worker then
    waits for the interpreter at each of its steps, which delays the results of all stations.
    """

    def __init__(self, rate: Rate, *, clock: Callable[[], float] = time.monotonic) -> None:
        """rate: [s] of the thread's processor time, each second and at once."""
        self._rate, self._limit = rate, RateLimit(rate, clock=clock)

    def rest_s(self, worked_s: float) -> float:
        """Charge processor time [s]; return how long to rest after it [s], 0 or more."""
        self._limit.charge("", worked_s)
        (used_s,) = self._limit.used("")
        return max(0.0, used_s - self._rate.burst) / self._rate.per_s


class AnsweringThread(BackgroundThread):
    """Sends queued answers while the context lasts."""

    def __init__(self, name: str, capacity: int, pace: Pace | None = None) -> None:
        """name: of the thread; capacity: queries that may wait, a quarter of them in one lane.

        pace: of its work; None: without a rest.
        """
        self._pace = pace
        self._log_rate = RateLimit(LOG_RATE)
        self._queue: WorkQueue[tuple[IncomingQuery, Iterator[None]]] = WorkQueue(
            QueueSettings(capacity=capacity)
        )
        super().__init__(name, self._queue.wake)

    def _run(self) -> None:
        while not self._stopped.is_set():
            if (queued := self._queue.get(TICK_S)) is None:
                continue
            began, worked = time.perf_counter(), time.thread_time()
            if self._has_more(*queued):
                self._queue.put_back(queued)
            self._queue.charge(time.perf_counter() - began)
            if self._pace is not None:
                self._stopped.wait(self._pace.rest_s(time.thread_time() - worked))

    def _has_more(self, query: IncomingQuery, answer: Iterator[None]) -> bool:
        """Send a part of an answer; return whether more of it is left."""
        try:
            next(answer)
        except StopIteration:
            return False
        except Exception:
            if self._log_rate.allows("any"):
                logger.exception("a question was not answered")
            query.drop()
            return False
        return True
