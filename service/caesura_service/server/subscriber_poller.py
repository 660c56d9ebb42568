"""Polls the subscribers of samples: one poll returns many messages.

A callback in the network's thread waits for the interpreter at every message, and then keeps the thread
waiting that had it. So Zenoh puts what it reads into channels of its own, for which it needs no interpreter,
and all of them are emptied every few milliseconds. At 48 stations that takes a fifth off what a batch costs
in all (docs/speed.md).

What must not overtake what was put before it, as a command, has them emptied first: a link is read in order.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.transport import Incoming, Network, Subscriber
from caesura_service.token_bucket import LOG_RATE, RateLimit

logger = logging.getLogger(__name__)

POLL_S = 0.005  # a tenth of what a result may take
IDLE_POLL_S = 0.025  # once no station has put anything for so many looks:
IDLE_AFTER = 40
CHANNEL = 256  # messages of one expression; in a full one the link waits, whose sender then waits too


class SubscriberPoller(BackgroundThread):
    """Passes received samples to a callback, one at a time, while the context lasts."""

    def __init__(self, handle: Callable[[Incoming], None], polled: Callable[[], None] = lambda: None) -> None:
        """handle: only enqueues; called in more threads than one, never at once. polled: after each poll."""
        self._handle, self._polled = handle, polled
        self._declared: dict[str, Subscriber] = {}
        self._turn = threading.Lock()
        self._log_rate = RateLimit(LOG_RATE)
        super().__init__("caesura-gathering", lambda: None)

    def declare(self, network: Network, key: str) -> None:
        """Subscribe to a key expression."""
        self._declared[key] = network.declare_subscriber(key, CHANNEL)

    def undeclare(self, key: str) -> None:
        """Unsubscribe, after passing on what was received."""
        self._declared[key].undeclare()
        self.drain()
        del self._declared[key]

    def drain(self) -> int:
        """Pass on every received sample; return how many. Any thread may call it."""
        handled = 0
        with self._turn:
            for subscriber in tuple(self._declared.values()):
                most = CHANNEL  # a station that never stops keeps no other waiting
                while most and (sample := subscriber.try_recv()) is not None:
                    self._handle_one(sample)
                    most -= 1
                handled += CHANNEL - most
        return handled

    def _handle_one(self, sample: Incoming) -> None:
        try:
            self._handle(sample)
        except Exception:
            if self._log_rate.allows("any"):
                logger.exception("a message was lost to an error of the service")

    def _run(self) -> None:
        idle_polls = 0
        while not self._stopped.wait(POLL_S if idle_polls < IDLE_AFTER else IDLE_POLL_S):
            idle_polls = 0 if self.drain() else idle_polls + 1
            self._polled()
