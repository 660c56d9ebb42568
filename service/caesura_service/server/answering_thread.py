"""Answers queries in a separate thread, a part of an answer at a time.

Queries are queued as in the worker: fair by the measured time of the answers, with a lane for each station in
a key, and one for all keys without a station. A long answer is interrupted after each reply.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator

from caesura_protocol.token_bucket import LOG_RATE, RateLimit
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.work_queue import QueueSettings, WorkQueue

logger = logging.getLogger(__name__)

TICK_S = 0.1


class AnsweringThread(BackgroundThread):
    """Sends queued answers while the context lasts."""

    def __init__(self, name: str, capacity: int) -> None:
        """name: of the thread; capacity: queries that may wait, a quarter of them in one lane."""
        self._log_rate = RateLimit(LOG_RATE)
        self._queue: WorkQueue[tuple[IncomingQuery, Iterator[None]]] = WorkQueue(
            QueueSettings(capacity=capacity)
        )
        super().__init__(name, self._queue.wake)

    def _run(self) -> None:
        while not self._stopped.is_set():
            if (queued := self._queue.get(TICK_S)) is None:
                continue
            began = time.perf_counter()
            if self._has_more(*queued):
                self._queue.put_back(queued)
            self._queue.charge(time.perf_counter() - began)

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
