"""Liveliness tokens of services and stations, and the instance's own link to the router."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import NamedTuple

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import parse_service_key, parse_station_key, service_key, station_key
from caesura_protocol.transport.inbox import TokenChange
from caesura_service.server.inbound import LivelinessChanged, RouterLinkChanged
from caesura_service.server.transport import Network

SERVICES, STATIONS = service_key("*", "alive"), station_key("*", "alive")


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


def watch_tokens(
    network: Network, report: Callable[[LivelinessChanged | RouterLinkChanged], object], *, client: bool
) -> ExitStack:
    """Report live peers, arrivals and departures, and for a client the loss and return of its router.

    Close what is returned to end it.
    """
    stack = ExitStack()

    def report_token(change: TokenChange) -> None:
        if (presence := _parse_token(*change)) is not None:
            report(presence)

    def report_link(up: bool) -> None:
        report(RouterLinkChanged(up))

    if client:
        stack.callback(network.watch_link(report_link).undeclare)
    for key in (SERVICES, STATIONS):
        stack.callback(network.watch_liveliness(key, report_token).undeclare)
    return stack


def _parse_token(key: str, alive: bool) -> LivelinessChanged | None:
    """Parse the key of a token; None where its name is invalid."""
    try:
        if key.startswith(SERVICES.partition("*")[0]):
            return LivelinessChanged("service", parse_service_key(key)[0], alive)
        return LivelinessChanged("station", parse_station_key(key)[0], alive)
    except ProtocolError:
        return None
