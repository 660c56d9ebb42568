"""Subscriptions and queryables of stations: all by one expression, or some by name.

Tokens of stations are watched only if stations are declared by name: a wildcard needs none.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Set

from caesura_protocol.keys import station_key
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.server.channel_poller import ChannelPoller
from caesura_service.server.live_tokens import STATIONS, TokenChanges
from caesura_service.server.network_interface import Declaration, Network

ALL = "*"


class StationSubscriptions:
    """The subscriptions and queryables of stations. Any thread may close it."""

    def __init__(
        self,
        network: Network,
        *,
        poller: ChannelPoller,
        control: Callable[[IncomingQuery], None],
        program: Callable[[IncomingQuery], None],
        tokens: TokenChanges,
    ) -> None:
        self._network = network
        self._poller, self._control, self._program, self._tokens = poller, control, program, tokens
        self._declared: dict[str, tuple[Declaration, ...]] = {}
        self._closed = False
        self._lock = threading.Lock()

    def set(self, stations: Set[str] | None) -> None:
        """Declare these stations, None for all. New ones are declared before others are undeclared."""
        with self._lock:
            if stations is None or self._closed:
                self._tokens.unwatch(STATIONS)
            else:
                self._tokens.watch(self._network, STATIONS)
            wanted = set() if self._closed else {ALL} if stations is None else stations
            for station in wanted - self._declared.keys():
                self._declared[station] = self._declare(station)
            for station in self._declared.keys() - wanted:
                self._undeclare(station)

    def close(self) -> None:
        """Undeclare everything, and declare nothing afterwards."""
        self._closed = True
        self.set(frozenset())

    def _declare(self, station: str) -> tuple[Declaration, ...]:
        network, poller = self._network, self._poller
        poller.subscribe(network, station_key(station, "samples"))
        return (
            poller.declare_queryable(network, station_key(station, "control"), self._control),
            poller.declare_queryable(network, station_key(station, "program"), self._program),
        )

    def _undeclare(self, station: str) -> None:
        self._poller.unsubscribe(station_key(station, "samples"))
        for entity in self._declared.pop(station):
            entity.undeclare()
