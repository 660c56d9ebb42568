"""Queries to the service. No answer means absent or forbidden; liveliness then shows which."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, TypeVar

from caesura_protocol.codec import Encoded, decode
from caesura_protocol.errors import NotFound, ProtocolError, Unreachable
from caesura_protocol.fragments import Reassembler
from caesura_protocol.keys import parse_service_key, parse_station_key, service_key, session_key, station_key
from caesura_protocol.messages import MAX_WHOLE_BYTES, Message, Program, ServiceStatus, Snapshot
from caesura_protocol.transport.network import IncompleteAnswerError, QueryReplies, Transport

M = TypeVar("M", bound=Message)

ASKED = 3  # times at most


@dataclass(frozen=True)
class SessionInfo:
    """A session, as a list shows it."""

    station: str
    session: str
    state: Literal["open", "closed"]
    t: float  # [s] its last observation
    segments: int
    instance: str


def snapshots(
    transport: Transport, station: str = "*", session: str = "*", *, complete: bool = False
) -> list[Snapshot]:
    """Everything about every session that matches, one of the highest epoch each; none is no error.

    complete: also raise where only some of the live instances have answered.
    """
    newest: dict[tuple[str, str], Snapshot] = {}
    for snapshot in _asked(transport, session_key(station, session, "snapshot"), Snapshot, complete=complete):
        key = (snapshot.status.station, snapshot.status.session)
        if key not in newest or _rank(snapshot) > _rank(newest[key]):
            newest[key] = snapshot
    return [newest[key] for key in sorted(newest)]


def snapshot(transport: Transport, station: str, session: str | None = None) -> Snapshot:
    """Everything about one session; without a name the one that `program` speaks of, the newest.

    Raises NotFound, which names what there is, or Unreachable.
    """
    name = session or _current_session(transport, station)
    found = snapshots(transport, station, name or "*")
    if not found:
        raise _nothing(transport, f"station {station!r} has no session {name or ''}".rstrip())
    # Without a program the newest session is an open one, or else the last by name.
    return max(found, key=lambda one: (one.status.state == "open", one.status.session))


def program(transport: Transport, station: str) -> Program:
    """The current task program of a station. Raises NotFound, which names what there is, or Unreachable."""
    found = _current_program(transport, station)
    if found is None:
        raise _nothing(transport, f"station {station!r} has no program")
    return found


def current_sessions(transport: Transport) -> dict[str, str]:
    """The session that each station's program speaks of: the one that was opened last."""
    programs = _asked(transport, station_key("*", "program"), Program)
    ranked = sorted(programs, key=lambda one: (one.epoch, one.version))
    return {one.station: one.session for one in ranked}


def sessions(transport: Transport, station: str = "*") -> list[SessionInfo]:
    """Return all sessions that the service holds, by station and name. Raises Unreachable."""
    found = snapshots(transport, station)
    if not found:
        _require_service(transport)
    return [
        SessionInfo(
            station=one.status.station,
            session=one.status.session,
            state=one.status.state,
            t=one.status.t,
            segments=len(one.segments.segments),
            instance=one.status.instance,
        )
        for one in found
    ]


def stations(transport: Transport) -> list[str]:
    """Stations whose bridge is connected now."""
    return _named(transport.alive(station_key("*", "alive")), parse_station_key)


def services(transport: Transport) -> list[str]:
    """Instances of the service that are alive now."""
    return _named(transport.alive(service_key("*", "alive")), parse_service_key)


def service_status(transport: Transport) -> list[ServiceStatus]:
    """How every instance is doing. Raises Unreachable where there is none."""
    found = _asked(transport, service_key("*", "status"), ServiceStatus)
    if not found:
        _require_service(transport)
    return sorted(found, key=lambda one: one.instance)


def _named(keys: Iterable[str], parse: Callable[[str], tuple[str, object]]) -> list[str]:
    """Whose tokens these are, without a stranger's on a key of that form, but for its name."""
    names = []
    for key in keys:
        with suppress(ProtocolError):
            names.append(parse(key)[0])
    return names


def _current_program(transport: Transport, station: str) -> Program | None:
    found = _asked(transport, station_key(station, "program"), Program)
    return max(found, key=lambda one: (one.epoch, one.version), default=None)


def _current_session(transport: Transport, station: str) -> str | None:
    """The session that the service takes for the station's current one."""
    program = _current_program(transport, station)
    return None if program is None else program.session


def _rank(snapshot: Snapshot) -> tuple[int, str]:
    return snapshot.status.epoch, snapshot.status.instance


def _asked(transport: Transport, key: str, model: type[M], *, complete: bool = False) -> list[M]:
    """The answers to a query. Asks again, ASKED times in all, where pieces of a long answer were lost, or it
    took longer than the query lasts. What the service itself refuses as `overloaded` is not asked again: that
    would add to its load.
    """
    for _ in range(ASKED - 1):
        with suppress(IncompleteAnswerError):
            return decoded(transport.query(key), model, complete=complete)
    return decoded(transport.query(key), model, complete=complete)


def decoded(answers: QueryReplies, model: type[M], *, complete: bool = False) -> list[M]:
    """The answers. What is wrong with one is raised only where there is no other; a newer protocol always.

    complete: a refusal, or that pieces were lost, is raised wherever it is.
    """
    joining = Reassembler()
    replies = [joining.add(key, Encoded(payload, encoding)) for key, payload, encoding in answers.replies]
    whole = [reply for reply in replies if reply is not None]
    if answers.refusals and (complete or not whole):
        raise answers.refusals[0]
    if joining.unfinished and (complete or not whole):
        raise IncompleteAnswerError("overloaded", "pieces of the answer were lost on the way: ask again")
    found, spoilt = [], None
    for reply in whole:
        try:
            found.append(decode(*reply, model, limit=MAX_WHOLE_BYTES))
        except ProtocolError as error:
            if error.code == "unsupported_version":
                raise
            spoilt = error
    if spoilt is not None and not found:
        raise spoilt
    return found


def _require_service(transport: Transport) -> None:
    if not services(transport):
        raise Unreachable(f"no service is alive at {transport.endpoint}")


def _nothing(transport: Transport, what: str) -> NotFound:
    _require_service(transport)
    known = {one.status.station for one in snapshots(transport)}
    return NotFound(
        f"{what}, or it is forbidden; stations with sessions: {_listed(known)}; "
        f"with a bridge: {_listed(stations(transport))}"
    )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "none"
