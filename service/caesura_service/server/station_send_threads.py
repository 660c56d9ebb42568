"""Sends messages that a slow client may block, in separate threads: replies to commands, replay requests.

Zenoh sends both with the congestion control that the client, or the bridge, requested. If that client does
not read, the call blocks until its link is closed, five seconds later. In the worker's thread it would block
all stations. So each station has a lane, in which messages are sent one after the other, and a blocked
station occupies one thread.

Where the system gives no further thread, as without memory, those that run do the work. The first starts with
the context.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Self

from caesura_protocol.token_bucket import LOG_RATE, RateLimit
from caesura_service.server.background_thread import JOIN_S

logger = logging.getLogger(__name__)

THREADS = 32  # one for each station that does not read; started when they are needed
WAITING = 128  # of one station: its commands that may wait, and its replays

Job = Callable[[], None]


class StationSendThreads:
    """Runs jobs while the context lasts: those of one lane in order, those of several concurrently."""

    def __init__(self) -> None:
        self._waiting: dict[str, deque[Job]] = {}  # of lanes with a job waiting or under way
        self._ready: deque[str] = deque()  # lanes whose next job no thread has taken
        self._threads: list[threading.Thread] = []
        self._idle = 0
        self._closed = False
        self._log_rate = RateLimit(LOG_RATE)
        self._changed = threading.Condition()

    def __enter__(self) -> Self:
        """Start one thread, so that jobs are done also where no other can be started."""
        self._start_thread()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Run the queued jobs for at most JOIN_S."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        until = time.monotonic() + JOIN_S
        for thread in self._threads:
            thread.join(max(0.0, until - time.monotonic()))

    def submit(self, lane: str, job: Job) -> bool:
        """Enqueue a job; return False if too many of the lane are queued. Never blocks."""
        with self._changed:
            jobs = self._waiting.get(lane)
            if jobs is None:
                self._waiting[lane] = deque([job])
                self._ready.append(lane)
                self._changed.notify()
            elif len(jobs) >= WAITING:
                return False
            else:
                jobs.append(job)
            # An idle thread may have been notified of another lane, and not run yet.
            if self._idle < len(self._ready) and len(self._threads) < THREADS:
                self._start_thread()
        return True

    def _start_thread(self) -> None:
        name = f"caesura-lanes-{len(self._threads)}"
        thread = threading.Thread(target=self._run, name=name, daemon=True)
        try:
            thread.start()
        except RuntimeError as error:
            if self._log_rate.allows(""):
                logger.error(
                    "replies may be late: no further thread starts (%s), check the memory and limits",
                    error,
                )
        else:
            self._threads.append(thread)

    def _run(self) -> None:
        while (taken := self._next_job()) is not None:
            lane, job = taken
            try:
                job()
            except Exception:
                if self._log_rate.allows(lane):
                    logger.exception("a reply or a replay request for %s was not sent", lane)
            self._finish_job(lane)

    def _next_job(self) -> tuple[str, Job] | None:
        """Return the next lane and its job; None if there is none and the context is over."""
        with self._changed:
            while not self._ready:
                if self._closed:
                    return None
                self._idle += 1
                self._changed.wait()
                self._idle -= 1
            lane = self._ready.popleft()
            return lane, self._waiting[lane][0]

    def _finish_job(self, lane: str) -> None:
        with self._changed:
            jobs = self._waiting[lane]
            jobs.popleft()
            if jobs:
                self._ready.append(lane)
            else:
                del self._waiting[lane]
