"""Tells everybody that the service is overloaded, before anything is dropped, and when it is over.

In a thread of its own: whatever keeps the worker may be what overloads it. It is said when it begins, every
REPEAT_S while it lasts, with what was dropped meanwhile, and when it ends; the log has the first and last.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from caesura_service.edge.inbox import Inbox

logger = logging.getLogger(__name__)

REPEAT_S = 1.0
JOIN_S = 2.0


class Announcer:
    """Watches the inbox while the context lasts; `tell` publishes the service's status."""

    def __init__(self, inbox: Inbox[Any], tell: Callable[[], None]) -> None:
        self._inbox = inbox
        self._tell = tell
        self._stopped = threading.Event()
        self._dropped = 0  # before the overload that lasts
        self._thread = threading.Thread(target=self._run, name="caesura-announcer", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self._inbox.changed.set()
        self._thread.join(JOIN_S)

    def _run(self) -> None:
        lasts = False
        while not self._stopped.is_set():
            self._inbox.changed.wait(REPEAT_S if lasts else None)
            self._inbox.changed.clear()
            before, lasts = lasts, bool(self._inbox.pressed)
            if not (before or lasts):
                continue
            try:
                self._tell()
            except Exception:
                logger.exception("the overload was not announced")
            if lasts:
                self._inbox.has_announced()
            if lasts != before:
                self._log(lasts)

    def _log(self, lasts: bool) -> None:
        if lasts:
            self._dropped = self._inbox.dropped
            logger.warning(
                "overloaded: %d messages wait, %.0f %% of what the queue or a station's share of it holds; "
                "new sessions are refused",
                len(self._inbox),
                100 * self._inbox.fill(),
            )
        else:
            dropped = self._inbox.dropped - self._dropped
            logger.warning("no longer overloaded; %d messages were dropped and are asked for again", dropped)
