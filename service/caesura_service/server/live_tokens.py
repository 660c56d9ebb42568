"""Liveliness tokens of services and stations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import parse_service_key, parse_station_key, service_key, station_key
from caesura_protocol.transport.inbox import TokenChange
from caesura_service.server.budgets import Budgets
from caesura_service.server.inbound_events import Arrival, LivelinessChanged
from caesura_service.server.network_interface import TOKENS, Channel, Network, received
from caesura_service.server.work_queue import WorkQueue

SERVICES, STATIONS = service_key("*", "alive"), station_key("*", "alive")
HELD = 4096  # tokens whose last change waits


class LiveTokens(NamedTuple):
    """The services and stations that have a token."""

    services: frozenset[str]
    stations: frozenset[str]


def query_live_tokens(network: Network) -> LiveTokens:
    """Query the live tokens, before any are watched: afterwards the answer may be partial."""
    keys = (*network.list_tokens(SERVICES), *network.list_tokens(STATIONS))
    found = [_parse_token(key, True) for key in keys]
    return LiveTokens(
        frozenset(one.name for one in found if one and one.kind == "service"),
        frozenset(one.name for one in found if one and one.kind == "station"),
    )


class TokenChanges:
    """Enqueues changes of tokens for the worker, those of a station in its lane and within its budget.

    If the budget is used up, the last change of each token is held and earlier ones are dropped.
    """

    def __init__(self, queue: WorkQueue[Arrival], budgets: Budgets) -> None:
        self._queue, self._budgets = queue, budgets
        self._channels: dict[str, Channel[TokenChange]] = {}
        self._held: dict[str, LivelinessChanged] = {}  # by key

    def watch(self, network: Network, key: str) -> None:
        """Watch the tokens of a key expression; existing ones are reported first. Any thread may call it."""
        if key not in self._channels:
            self._channels[key] = network.watch_liveliness(key)

    def unwatch(self, key: str) -> None:
        """End a watch, if there is one. Any thread may call it."""
        if (channel := self._channels.pop(key, None)) is not None:
            channel.undeclare()

    def poll(self) -> None:
        """Read the changes, and enqueue those within the budgets. Only one thread at a time may call it."""
        for channel in tuple(self._channels.values()):
            if changes := received(channel, TOKENS):
                self._hold(changes)
        if self._held:
            self._held = {key: one for key, one in self._held.items() if not self._enqueue(one)}

    def _hold(self, changes: Sequence[TokenChange]) -> None:
        """Store the last change of each token; count the others if the budget is used up."""
        counts = Counter(change.key for change in changes)
        for key, alive in dict(changes).items():
            presence = _parse_token(key, alive)
            if presence is None or (key not in self._held and len(self._held) >= HELD):
                continue
            overtaken = counts[key] - (key not in self._held)
            if overtaken and self._budgets.tokens_exhausted(presence.lane):
                self._budgets.count_refused(presence.lane, "tokens", overtaken)
            self._held[key] = presence

    def _enqueue(self, change: LivelinessChanged) -> bool:
        if self._budgets.tokens_exhausted(change.lane) or not self._queue.put_command(change, change.lane):
            return False
        if change.kind == "station":
            self._budgets.charge_token(change.name)
        return True


def _parse_token(key: str, alive: bool) -> LivelinessChanged | None:
    """Parse the key of a token; None if its name is invalid."""
    try:
        if key.startswith(SERVICES.partition("*")[0]):
            return LivelinessChanged("service", parse_service_key(key)[0], alive)
        return LivelinessChanged("station", parse_station_key(key)[0], alive)
    except ProtocolError:
        return None
