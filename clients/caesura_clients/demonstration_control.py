"""Starts, stops and describes demonstrations, from any machine that reaches the router."""

from __future__ import annotations

import secrets
from typing import Any

from pydantic import ValidationError

from caesura_clients import query
from caesura_clients.bridge.control_client import ControlClient
from caesura_clients.session_corrections import send
from caesura_protocol.codec import decode, encode
from caesura_protocol.errors import CaesuraError, NotFound, ProtocolError, Unreachable
from caesura_protocol.keys import station_key
from caesura_protocol.messages import (
    Ack,
    BridgeAck,
    BridgeControl,
    Describe,
    Description,
    SessionStatus,
    Start,
    Stop,
)
from caesura_protocol.transport.transport_interface import Transport
from caesura_protocol.validation_words import first_finding

CONTROL_TIMEOUT_S = 15.0  # a stop waits until the service has everything
DESCRIBE_ATTEMPTS = 3


def start(
    transport: Transport,
    station: str,
    description: Description | None = None,
    *,
    session: str | None = None,
    name: str | None = None,
) -> BridgeAck:
    """Start a demonstration at a bridge in standby; return its session.

    name: unique name of this command, by default a new one; a repeated name starts only once. Raises
    ProtocolError if the bridge refuses, Unreachable if no bridge in standby answers.
    """
    command = Start(
        id=name or f"start-{secrets.token_hex(8)}",
        session=session,
        description=description or Description(),
    )
    return ask_bridge(transport, station, command)


def stop(
    transport: Transport, station: str, *, session: str | None = None, success: bool | None = None
) -> BridgeAck:
    """Stop a demonstration; return once the service has every batch except those it states as `lost`.

    session: by default the current one; success: whether the demonstration succeeded, None states nothing.
    Raises as `start`.
    """
    return ask_bridge(transport, station, Stop(session=session, success=success))


def close_left_open(
    transport: Transport, station: str, *, session: str | None = None, success: bool | None = None
) -> list[Ack]:
    """Close the sessions that a bridge left open, after the last batch that the service has.

    session: by default all that are open; success: of one demonstration. Raises CaesuraError where a bridge
    is connected or `success` is of several sessions, NotFound where no session is open, ProtocolError where
    the service refuses, Unreachable where it does not answer.
    """
    found = query.snapshots(transport, station, session or "*", complete=True)
    left = [one.status for one in found if one.status.state == "open"]
    if not left:
        raise NotFound(f"no session is open at {station}")
    if success is not None and len(left) > 1:
        names = ", ".join(status.session for status in left)
        raise CaesuraError(f"{station} has several open sessions: name one of {names}")
    acks = [_close_left_open(transport, station, one, success) for one in left]
    if None in acks:
        raise Unreachable(f"the service has not answered: {station} may still have an open session")
    return [ack for ack in acks if ack is not None]


def _close_left_open(
    transport: Transport, station: str, status: SessionStatus, success: bool | None
) -> Ack | None:
    """Close a session, once more where the service has other batches than its status counts."""
    client = ControlClient(transport, station)
    _check_no_bridge(transport, station)
    try:
        return client.close_left_open(status, success=success)
    except ProtocolError as refusal:
        if not isinstance(refusal.expected, int):
            raise
        _check_no_bridge(transport, station)  # whose batches these are
        return client.close_left_open(status, last_seq=refusal.expected, success=success)


def _check_no_bridge(transport: Transport, station: str) -> None:
    """Raise CaesuraError if a bridge is connected at the station, whose session it then is."""
    if station in query.stations(transport):
        raise CaesuraError(f"a bridge is connected at {station}, which stops its own session")


def describe(transport: Transport, station: str, session: str, *, author: str, **changes: Any) -> Ack:
    """Change fields of a session's description, such as `task="wipe"`; other fields stay.

    Raises ProtocolError where the service refuses, NotFound or Unreachable, CaesuraError for a value that no
    description can have.
    """
    for attempt in range(DESCRIBE_ATTEMPTS):
        before = query.snapshot(transport, station, session).status.description
        command = Describe(
            session=session, author=author, before=before, description=changed(before, **changes)
        )
        try:
            return send(transport, station, command)
        except ProtocolError as refusal:
            if refusal.code != "conflict" or attempt + 1 == DESCRIBE_ATTEMPTS:
                raise
    raise AssertionError("not reached")


def changed(before: Description, **changes: Any) -> Description:
    """Return a description with other values in some fields. Raises CaesuraError, which names the field."""
    if unknown := sorted(set(changes) - set(Description.model_fields)):
        raise CaesuraError(f"unknown field {unknown[0]}, known: {', '.join(Description.model_fields)}")
    try:
        return Description.model_validate({**before.model_dump(), **changes})
    except ValidationError as error:
        raise CaesuraError(first_finding(error)) from error


def ask_bridge(transport: Transport, station: str, command: Start | Stop) -> BridgeAck:
    """Send a command to a bridge in standby. Raises ProtocolError or Unreachable."""
    content = encode(BridgeControl(command=command))
    key = station_key(station, "bridge_control")
    answers = transport.query(key, content, timeout_s=CONTROL_TIMEOUT_S)
    if answers.replies:
        return decode(answers.replies[0].payload, answers.replies[0].encoding, BridgeAck)
    if answers.refusals:
        raise answers.refusals[0]
    raise Unreachable(_why_no_answer(transport, station, command))


def _why_no_answer(transport: Transport, station: str, command: Start | Stop) -> str:
    if station in query.stations(transport):
        return f"the bridge of {station} answers no start or stop: is it in standby, are you an operator?"
    if not query.services(transport):
        nothing = f"neither a bridge of {station} nor a service is found at {transport.endpoint}"
        return f"{nothing}: the service is not started, or the connection is lost; try again once it is back"
    connected = ", ".join(query.stations(transport)) or "none"
    said = f"no bridge is connected at {station}; stations with a bridge: {connected}"
    ended = f"; if its bridge ended for good: `caesura stop {station} --without-bridge`"
    return said + ended if isinstance(command, Stop) else said
