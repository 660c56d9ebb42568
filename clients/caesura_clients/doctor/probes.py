"""Collects facts about a service by queries and subscriptions in a few seconds; it does not judge them."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass, field

from caesura_clients.query import (
    QUERY_ATTEMPTS,
    decoded,
    lost_replies,
    services,
    stations,
)
from caesura_clients.station_name_conflicts import ParallelSessions
from caesura_protocol.codec import decode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import (
    NOTHING_SAID,
    ROOT,
    parse_session_key,
    parse_station_key,
    service_key,
    session_key,
    station_key,
)
from caesura_protocol.messages import (
    BridgeStatus,
    Heartbeat,
    SampleBatch,
    ServiceStatus,
    SessionStatus,
    Snapshot,
)
from caesura_protocol.transport.inbox import Inbox, ReceivedSample
from caesura_protocol.transport.transport_interface import NOTHING, Transport

MOST_BATCHES = 20_000  # that are kept while listening: 400 s of one station, 12 s of 32
_ANY_MAJOR = service_key("*", "alive").replace(ROOT, f"{ROOT.partition('/')[0]}/*", 1)


@dataclass(frozen=True)
class TimedServiceStatus:
    """A service's status, and the local times of day at which it was queried and received [s]."""

    status: ServiceStatus
    asked: float
    answered: float


@dataclass(frozen=True)
class ReceivedStatus:
    """A status received while listening. at: time [s] since listening began."""

    at: float
    status: SessionStatus


@dataclass
class ProbeResult:
    """Everything that the probe received. listened_s: duration of listening; refusals: of the queries."""

    alive: list[str] = field(default_factory=list)  # instances
    other_versions: list[str] = field(default_factory=list)  # keys of services that speak another protocol
    reported: list[TimedServiceStatus] = field(default_factory=list)
    bridges: list[str] = field(default_factory=list)  # stations whose bridge is connected
    snapshots: list[Snapshot] = field(default_factory=list)  # at the end; every answer, also two of a session
    statuses: dict[tuple[str, str], list[ReceivedStatus]] = field(
        default_factory=dict
    )  # of each session, in order
    batches: dict[tuple[str, str], list[SampleBatch]] = field(default_factory=dict)  # where that is allowed
    parallel: ParallelSessions = field(default_factory=ParallelSessions)
    standby: dict[str, BridgeStatus] = field(default_factory=dict)  # the last of each station's, in standby
    refusals: list[ProtocolError] = field(default_factory=list)
    listened_s: float = 0.0
    others: list[str] = field(default_factory=list)  # stations, where the one that was asked for is not there


def probe_network(transport: Transport, station: str = "*", *, seconds: float) -> ProbeResult:
    """Query the network, subscribe for some seconds, query again; return everything received.

    Raises Unreachable if the router disappears meanwhile.
    """
    probed = ProbeResult(alive=services(transport), bridges=[])
    probed.other_versions = [
        key for key in transport.list_tokens(_ANY_MAJOR) if not key.startswith(f"{ROOT}/")
    ]
    probed.reported = _statuses(transport, probed)
    if not probed.reported:
        probed.alive = services(transport)  # one that was frozen has gone while it was asked
    with ExitStack() as stack:
        inbox = Inbox(MOST_BATCHES)
        listened = [station_key(station, part) for part in ("samples", "bridge_status")]
        for key in (session_key(station, "*", "status"), *listened):
            stack.enter_context(transport.subscribe(key, inbox))
        began = time.monotonic()
        for one in _snapshots(transport, station, probed):
            _add_status(probed, ReceivedStatus(0.0, one.status))
        _listen(inbox, probed, began, seconds)
    probed.listened_s = time.monotonic() - began
    probed.snapshots = _snapshots(transport, station, probed)
    for one in probed.snapshots:
        _add_status(probed, ReceivedStatus(time.monotonic() - began, one.status))
    connected = stations(transport)
    probed.bridges = [name for name in connected if station in {"*", name}]
    if not probed.bridges and not probed.statuses and station != "*":
        sessions = (one.status.station for one in _snapshots(transport, "*", probed))
        probed.others = sorted({*connected, *sessions})
    return probed


def _statuses(transport: Transport, probed: ProbeResult) -> list[TimedServiceStatus]:
    for _ in range(QUERY_ATTEMPTS):  # a busy network loses answers
        asked = time.time()
        answers = transport.query(service_key("*", "status"))
        answered = time.time()
        if answers.replies:
            break
    probed.refusals += answers.refusals
    found = [decode(reply.payload, reply.encoding, ServiceStatus) for reply in answers.replies]
    return [TimedServiceStatus(one, asked, answered) for one in sorted(found, key=lambda one: one.instance)]


def _snapshots(transport: Transport, station: str, probed: ProbeResult) -> list[Snapshot]:
    for _ in range(QUERY_ATTEMPTS):
        answers = transport.query(session_key(station, "*", "snapshot"), parameters=NOTHING_SAID)
        lost = lost_replies(answers)
        if (answers.replies or answers.refusals) and lost is None:
            break
    if lost is not None:
        probed.refusals.append(lost)
    probed.refusals += (refusal for refusal in answers.refusals if refusal.code != NOTHING)
    try:
        return decoded(answers._replace(refusals=()), Snapshot)
    except ProtocolError as error:
        if error.code != "overloaded":
            raise
        probed.refusals.append(error)
        return []


def _listen(inbox: Inbox, probed: ProbeResult, began: float, seconds: float) -> None:
    while (left := began + seconds - time.monotonic()) > 0:
        item = inbox.get(left)
        if isinstance(item, ReceivedSample):
            try:
                _add_message(probed, item, time.monotonic() - began)
            except ProtocolError as error:
                probed.refusals.append(error)  # a publisher sends messages that no reader can decode


def _add_message(probed: ProbeResult, item: ReceivedSample, at: float) -> None:
    if item.key.endswith("/status"):
        parse_session_key(item.key)
        status = decode(item.payload, item.encoding, SessionStatus)
        _add_status(probed, ReceivedStatus(at, status))
        probed.parallel.reach(status.station, status.session, status.t)
        return
    name, part = parse_station_key(item.key)
    if part == "bridge_status":
        probed.standby[name] = decode(item.payload, item.encoding, BridgeStatus)
        return
    message = decode(item.payload, item.encoding, SampleBatch, Heartbeat)
    if isinstance(message, SampleBatch):
        probed.batches.setdefault((name, message.session), []).append(message)
        probed.parallel.reach(name, message.session, message.t0)


def _add_status(probed: ProbeResult, received: ReceivedStatus) -> None:
    """Append a status unless it is older than the last one: delayed, or of a replaced owner."""
    known = probed.statuses.setdefault((received.status.station, received.status.session), [])
    if not known or _rank(known[-1].status) < _rank(received.status):
        known.append(received)


def _rank(status: SessionStatus) -> tuple[int, int, int]:
    return status.epoch, status.samples, status.seq
