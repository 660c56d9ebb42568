"""Publishes that the service is overloaded, before messages are dropped, and when the overload ends.

It runs in a separate thread, because the task that blocks the worker may cause the overload. The status is
published at the beginning, every REPEAT_S while it lasts, and at its end; the log has the first and last.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Set
from typing import Any

from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.inbound_events import station_of
from caesura_service.server.work_queue import WHOLE, WorkQueue

logger = logging.getLogger(__name__)

REPEAT_S = 1.0


class OverloadMonitor(BackgroundThread):
    """Watches the work queue while the context lasts; `publish` puts the service's status."""

    def __init__(self, queue: WorkQueue[Any], publish: Callable[[], None]) -> None:
        self._queue = queue
        self._publish = publish
        self._dropped = 0  # before the overload that lasts
        super().__init__("caesura-announcer", queue.overload_changed.set)

    def _run(self) -> None:
        lasts = False
        while not self._stopped.is_set():
            self._queue.overload_changed.wait(REPEAT_S if lasts else None)
            self._queue.overload_changed.clear()
            overloaded = self._queue.overloaded_sources
            before, lasts = lasts, bool(overloaded)
            if not (before or lasts):
                continue
            try:
                self._publish()
            except Exception:
                logger.exception("the overload was not announced")
            if lasts:
                self._queue.confirm_announced()
            if lasts != before:
                self._log(overloaded)

    def _log(self, overloaded: Set[str]) -> None:
        """Log the overloaded stations, or the end of the overload."""
        if overloaded:
            self._dropped = self._queue.dropped
            logger.warning(
                "overloaded by %s: %d messages are queued, the fullest share of the queue is %.0f %% full; "
                "new sessions of these stations are refused",
                ", ".join(sorted(map(_named, overloaded))),
                len(self._queue),
                100 * self._queue.fill_ratio(),
            )
        else:
            dropped = self._queue.dropped - self._dropped
            logger.warning("no longer overloaded; %d messages were dropped and are requested again", dropped)


def _named(source: str) -> str:
    return "all stations together" if source == WHOLE else f"station {station_of(source)}"
