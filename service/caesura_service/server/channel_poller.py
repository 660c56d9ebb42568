"""Polls the channels of samples and queries: one poll returns many messages.

A callback in the network's thread needs the interpreter lock for every message, and delays the thread that
held it. So a flood of one station would block the link of all. Therefore Zenoh writes received messages into
channels, without the interpreter, and all channels are emptied every few milliseconds. At 48 stations this
reduces the total cost of a batch by a fifth (docs/speed.md).

A link is read in order: samples published before a query are passed on before it.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from itertools import chain
from typing import TypeVar

from caesura_protocol.token_bucket import LOG_RATE, RateLimit
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.network_interface import Channel, Declaration, Incoming, Network, received

logger = logging.getLogger(__name__)

POLL_S = 0.005  # a tenth of what a result may take
IDLE_POLL_S = 0.025  # once no station has put anything for so many looks:
IDLE_AFTER = 40
CHANNEL = 256  # messages of one expression; in a full one the link waits, whose sender then waits too
FLOOD = CHANNEL // 4

Answer = Callable[[IncomingQuery], None]
Received = TypeVar("Received")


class ChannelPoller(BackgroundThread):
    """Passes received samples and queries to callbacks, one at a time, while the context lasts."""

    def __init__(self, handle: Callable[[Incoming], None], polled: Callable[[], None] = lambda: None) -> None:
        """handle: receives a sample, and must only enqueue it, like `Answer`.

        polled: called after each poll.
        """
        self._handle, self._polled = handle, polled
        self._subscribed: dict[str, Channel[Incoming]] = {}
        self._queryables: dict[str, tuple[Channel[IncomingQuery], Answer]] = {}
        self._turn = threading.Lock()
        self._log_rate = RateLimit(LOG_RATE)
        super().__init__("caesura-polling", lambda: None)

    def subscribe(self, network: Network, key: str) -> None:
        """Subscribe to a key expression."""
        self._subscribed[key] = network.declare_subscriber(key, CHANNEL)

    def unsubscribe(self, key: str) -> None:
        """Unsubscribe, after passing on the received messages."""
        self._subscribed[key].undeclare()
        self.poll()
        del self._subscribed[key]

    def declare_queryable(self, network: Network, key: str, answer: Answer) -> Declaration:
        """Pass every query on the key expression on until it is undeclared."""
        self._queryables[key] = network.declare_queryable(key, CHANNEL), answer
        return PolledQueryable(self, key)

    def undeclare_queryable(self, key: str) -> None:
        """Undeclare a queryable, after passing on the received queries."""
        self._queryables[key][0].undeclare()
        self.poll()
        del self._queryables[key]

    def poll(self) -> int:
        """Pass on the received messages; return the highest number in one channel. Any thread may call it."""
        with self._turn:
            asked = [
                (answer, received(channel, CHANNEL)) for channel, answer in tuple(self._queryables.values())
            ]  # before the samples: those that were put before a query are in their channel by now
            put = [received(channel, CHANNEL) for channel in tuple(self._subscribed.values())]
            for sample in chain(*put):
                self._pass_on(self._handle, sample)
            for answer, queries in asked:
                for query in queries:
                    self._pass_on(answer, query)
        counts = [*map(len, put), *(len(queries) for _, queries in asked)]
        return max(counts, default=0)

    def _pass_on(self, handle: Callable[[Received], None], item: Received) -> None:
        try:
            handle(item)
        except Exception:
            if self._log_rate.allows("any"):
                logger.exception("a message was lost to an error of the service")

    def _run(self) -> None:
        idle_polls, wait_s = 0, POLL_S
        while not self._stopped.wait(wait_s):
            most = self.poll()
            self._polled()
            idle_polls = 0 if most else idle_polls + 1
            wait_s = _wait_s(most, idle_polls)


class PolledQueryable:
    """A queryable that lasts until it is undeclared."""

    def __init__(self, poller: ChannelPoller, key: str) -> None:
        self._poller, self._key = poller, key

    def undeclare(self) -> None:
        """Undeclare the queryable, after passing on the received queries."""
        self._poller.undeclare_queryable(self._key)


def _wait_s(most: int, idle_polls: int) -> float:
    """Return the time [s] to wait after a poll; 0 in a flood, which would fill the channel."""
    if most >= FLOOD:
        return 0.0
    return POLL_S if idle_polls < IDLE_AFTER else IDLE_POLL_S
