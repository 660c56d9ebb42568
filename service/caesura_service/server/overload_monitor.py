"""Publishes that the service is overloaded, before anything is dropped, and when it is over.

In a thread of its own: whatever keeps the worker may be what overloads it. It is said when it begins, every
REPEAT_S while it lasts, with what was dropped meanwhile, and when it ends; the log has the first and last.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Set
from typing import Any

from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.inbound import station_of
from caesura_service.server.work_queue import WHOLE, WorkQueue

logger = logging.getLogger(__name__)

REPEAT_S = 1.0


class OverloadMonitor(BackgroundThread):
    """Watches the inbox while the context lasts; `publish` puts the service's status."""

    def __init__(self, inbox: WorkQueue[Any], publish: Callable[[], None]) -> None:
        self._inbox = inbox
        self._publish = publish
        self._dropped = 0  # before the overload that lasts
        super().__init__("caesura-announcer", inbox.changed.set)

    def _run(self) -> None:
        lasts = False
        while not self._stopped.is_set():
            self._inbox.changed.wait(REPEAT_S if lasts else None)
            self._inbox.changed.clear()
            pressed = self._inbox.pressed
            before, lasts = lasts, bool(pressed)
            if not (before or lasts):
                continue
            try:
                self._publish()
            except Exception:
                logger.exception("the overload was not announced")
            if lasts:
                self._inbox.has_announced()
            if lasts != before:
                self._log(pressed)

    def _log(self, pressed: Set[str]) -> None:
        """Whose messages are too many, or that it is over."""
        if pressed:
            self._dropped = self._inbox.dropped
            logger.warning(
                "overloaded by %s: %d messages wait in all, its part of the queue is %.0f %% full; "
                "its new sessions are refused",
                ", ".join(sorted(map(_named, pressed))),
                len(self._inbox),
                100 * self._inbox.fill(),
            )
        else:
            dropped = self._inbox.dropped - self._dropped
            logger.warning("no longer overloaded; %d messages were dropped and are asked for again", dropped)


def _named(source: str) -> str:
    return "all stations together" if source == WHOLE else f"station {station_of(source)}"
