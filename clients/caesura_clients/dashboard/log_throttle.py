"""Rate limits and shortens the log messages of the dashboard's libraries.

An event that no page has made raises an error in these libraries. Each such event of a visitor would write a
traceback, and a visitor's text would be logged unchanged.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from caesura_protocol.errors import printable
from caesura_protocol.token_bucket import Rate, RateLimit

LOGGERS = ("asyncio", "nicegui", "uvicorn.error")
AT_ONCE = 50.0  # messages of each
PER_S = 0.2
TEXT = 2000  # characters of a message, and of its traceback

_FORMAT = logging.Formatter()


class BoundedLog(logging.Filter):
    """Passes AT_ONCE messages, then PER_S per second, each cut to TEXT and on one line. Thread-safe."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._limit = RateLimit(Rate(PER_S, AT_ONCE), clock=clock)
        self._lock = threading.Lock()
        self._left_out = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a message passes.

        A message that passes states how many did not since the last one.
        """
        with self._lock:
            if not self._limit.allows("library"):
                self._left_out += 1
                return False
            left_out, self._left_out = self._left_out, 0
        more = f" ({left_out} messages before it were left out)" if left_out else ""
        record.msg, record.args = printable(record.getMessage(), TEXT) + more, ()
        if record.exc_info:
            record.exc_text = _FORMAT.formatException(record.exc_info)[-TEXT:]
        return True


def bound_logs() -> None:
    """Attach a separate limit to each logger of the libraries."""
    for name in LOGGERS:
        logging.getLogger(name).addFilter(BoundedLog())
