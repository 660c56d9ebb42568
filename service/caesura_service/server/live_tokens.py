"""Liveliness tokens of services and stations, and the instance's own link to the router."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import NamedTuple

import zenoh

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import parse_service_key, parse_station_key, service_key, station_key
from caesura_protocol.transport.zenoh_transport import direct
from caesura_service.server.inbound import LivelinessChanged, RouterLinkChanged
from caesura_service.server.network import QUERY_TIMEOUT_S

SERVICES, STATIONS = service_key("*", "alive"), station_key("*", "alive")


class LiveTokens(NamedTuple):
    """The services and stations that have a token."""

    services: frozenset[str]
    stations: frozenset[str]


def query_live_tokens(network: zenoh.Session) -> LiveTokens:
    """Query the live tokens, before any are watched: afterwards the answer may be partial."""
    found = [
        _parse_token(key, True) for wanted in (SERVICES, STATIONS) for key in _query_keys(network, wanted)
    ]
    return LiveTokens(
        frozenset(one.name for one in found if one and one.kind == "service"),
        frozenset(one.name for one in found if one and one.kind == "station"),
    )


def watch_tokens(
    network: zenoh.Session, report: Callable[[LivelinessChanged | RouterLinkChanged], object], *, client: bool
) -> ExitStack:
    """Report live peers, arrivals and departures, and for a client the loss and return of its router.

    Close what is returned to end it.
    """
    stack = ExitStack()

    def report_token(sample: zenoh.Sample) -> None:
        presence = _parse_token(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)
        if presence is not None:
            report(presence)

    def report_link(event: zenoh.TransportEvent) -> None:
        report(RouterLinkChanged(event.kind == zenoh.SampleKind.PUT))

    if client:
        listener = network.info.declare_transport_events_listener(direct(report_link))
        stack.callback(listener.undeclare)
    for key in (SERVICES, STATIONS):
        watch = network.liveliness().declare_subscriber(key, direct(report_token), history=True)
        stack.callback(watch.undeclare)
    return stack


def _query_keys(network: zenoh.Session, key: str) -> list[str]:
    replies = network.liveliness().get(key, timeout=QUERY_TIMEOUT_S)
    return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]


def _parse_token(key: str, alive: bool) -> LivelinessChanged | None:
    """Parse the key of a token; None where its name is invalid."""
    try:
        if key.startswith(SERVICES.partition("*")[0]):
            return LivelinessChanged("service", parse_service_key(key)[0], alive)
        return LivelinessChanged("station", parse_station_key(key)[0], alive)
    except ProtocolError:
        return None
