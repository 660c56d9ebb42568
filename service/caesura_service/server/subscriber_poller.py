"""What stations put, gathered: one look for many messages.

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
from typing import Any

import zenoh

from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.rates import COMPLAINTS, RateLimit

Receive = Callable[[], zenoh.Sample | None]  # from a channel; raises ZError where nothing will come any more

logger = logging.getLogger(__name__)

LOOK_S = 0.005  # a tenth of what a result may take
IDLE_LOOK_S = 0.025  # once no station has put anything for so many looks:
PATIENCE = 40
CHANNEL = 256  # messages of one expression; in a full one the link waits, whose sender then waits too


class SubscriberPoller(BackgroundThread):
    """Hands over what was put, one after the other, while the context lasts."""

    def __init__(self, take: Callable[[zenoh.Sample], None]) -> None:
        """take: only enqueues; called in more threads than one, never at once."""
        self._take = take
        self._declared: dict[str, tuple[Any, Receive]] = {}
        self._turn = threading.Lock()
        self._complaints = RateLimit(COMPLAINTS)
        super().__init__("caesura-gathering", lambda: None)

    def declare(self, network: zenoh.Session, key: str) -> None:
        """Gather what is put on a key, or on all that an expression matches."""
        subscriber = network.declare_subscriber(key, zenoh.handlers.FifoChannel(CHANNEL))
        self._declared[key] = subscriber, subscriber.handler.try_recv

    def undeclare(self, key: str) -> None:
        """No longer; what was put so far is handed over."""
        self._declared[key][0].undeclare()
        self.gather()
        del self._declared[key]

    def gather(self) -> int:
        """Hand over what is there, and say how many; any thread may ask for that."""
        gathered = 0
        with self._turn:
            for _, receive in tuple(self._declared.values()):
                most = CHANNEL  # a station that never stops keeps no other waiting
                try:
                    while most and (sample := receive()) is not None:
                        self._take_one(sample)
                        most -= 1
                except zenoh.ZError:  # empty, and no longer declared
                    pass
                gathered += CHANNEL - most
        return gathered

    def _take_one(self, sample: zenoh.Sample) -> None:
        try:
            self._take(sample)
        except Exception:
            if self._complaints.allows("any"):
                logger.exception("a message was lost to an error of the service")

    def _run(self) -> None:
        in_vain = 0
        while not self._stopped.wait(LOOK_S if in_vain < PATIENCE else IDLE_LOOK_S):
            in_vain = 0 if self.gather() else in_vain + 1
