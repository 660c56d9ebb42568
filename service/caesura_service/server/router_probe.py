"""Watches whether the router of this process still accepts declarations.

Zenoh compares key expressions with several `$*` in exponential time. While the router compares what a client
has declared, nothing else can be declared: no further client begins. What is declared already works, and
sessions of connected bridges begin (`key_publishers`).
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import suppress

from caesura_protocol.keys import service_key
from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.network_interface import Declaration, Network, NetworkError

logger = logging.getLogger(__name__)

PAUSE_S = 5.0  # between two declarations
STUCK_S = 30.0  # that a declaration takes at most; of 64 stations at once each takes milliseconds
WHY_STUCK = (
    "the router accepts no declaration, so no further client can connect: it is busy with a key expression "
    "of a client, such as one with many `$*`. End that client, and restart the service if it does not recover"
)


class RouterProbe(BackgroundThread):
    """Declares something again and again while the context lasts, and measures how long that takes."""

    def __init__(
        self, declare: Callable[[], Declaration], *, pause_s: float = PAUSE_S, stuck_s: float = STUCK_S
    ) -> None:
        """declare: declares something that concerns no client. pause_s, stuck_s: see PAUSE_S, STUCK_S."""
        self.is_stuck = False
        self._declare, self._pause_s, self._stuck_s = declare, pause_s, stuck_s
        self._ended = 0  # declarations
        self._seen = 0  # of them, by `update`
        self._waited_s = 0.0
        self._woken = threading.Event()
        super().__init__("caesura-router-probe", self._woken.set)

    def update(self, since_s: float) -> None:
        """Record whether the router is stuck; log when that begins and when it ends.

        since_s: [s] since the last call. It adds these up, so the time in which this process was frozen does
        not count.
        """
        if self._ended != self._seen:
            self._seen, self._waited_s = self._ended, 0.0
        self._waited_s += since_s
        is_stuck = self._waited_s >= self._pause_s + self._stuck_s
        if is_stuck and not self.is_stuck:
            logger.error("%s", WHY_STUCK)
        elif self.is_stuck and not is_stuck:
            logger.warning("the router accepts declarations again")
        self.is_stuck = is_stuck

    def _run(self) -> None:
        while not self._stopped.is_set():
            with suppress(NetworkError):  # the session is closed
                self._declare().undeclare()
            self._ended += 1
            self._woken.wait(self._pause_s)


def router_probe(network: Network, instance: str) -> RouterProbe:
    """Return the probe of a router by the session of an instance."""
    key = f"{service_key(instance, 'status')}/watch"  # it has no publisher
    return RouterProbe(lambda: network.declare_subscriber(key, 1))
