"""Queries to the service. `NotFound` is raised only if the service states that it has no such content.

A query without any reply is repeated: a congested network can lose all of a long answer except its end. If
there is still no reply, liveliness and the service's status show why: no service is alive (`Unreachable`),
the budget of the station is used up (`overloaded`), or access rules forbid it (`AccessDenied`). No reply
within the time of the query is `overloaded` too, with that time as its limit.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeVar

from caesura_clients.damaged_session_words import damage_words, damaged_in
from caesura_protocol.codec import Encoded, decode, is_other_version
from caesura_protocol.errors import AccessDenied, CaesuraError, NotFound, ProtocolError, Unreachable
from caesura_protocol.fragments import Reassembler
from caesura_protocol.keys import (
    INFERRED_PROGRAM,
    SampleRange,
    StoredPage,
    edits_parameters,
    parse_service_key,
    parse_station_key,
    samples_parameters,
    service_key,
    session_key,
    station_key,
    stored_parameters,
    with_nothing_said,
)
from caesura_protocol.messages import (
    MAX_WHOLE_BYTES,
    Message,
    Program,
    RecordedSamples,
    ServiceStatus,
    Snapshot,
)
from caesura_protocol.transport.transport_interface import (
    NOTHING,
    QUERY_TIMEOUT_S,
    IncompleteAnswerError,
    QueryReplies,
    Transport,
)

M = TypeVar("M", bound=Message)
Found = TypeVar("Found")

QUERY_ATTEMPTS = 3  # times at most
PIECES_ATTEMPTS = 6  # where pieces of an answer came: the service is well, and a busy network loses some
RETRY_S = 0.1  # after a query that ended without a word, times the number of the attempt
CONFIRM_S = 0.2  # until the next instance has noticed that one with a station has gone
HELD_ATTEMPTS = 5  # of a query that may have been held back
HELD_WAIT_S = 0.3  # between them; the service renews its list of budgets more often
SAMPLES_TIMEOUT_S = 20.0  # of a query for samples: the first one reads the whole session


@dataclass(frozen=True)
class SessionInfo:
    """The entry of a session in a list."""

    station: str
    session: str
    state: Literal["open", "closed", "damaged"]  # damaged: its results cannot be read
    t: float  # [s] its last observation
    segments: int
    instance: str
    task: str | None = None
    success: bool | None = None  # None: not stated
    opened: float | None = None  # [s] time of day (UTC)
    deleted: bool = False
    damage: str | None = None  # of a damaged one, with how to get its samples


def snapshots(
    transport: Transport,
    station: str = "*",
    session: str = "*",
    *,
    complete: bool = False,
    inferred: bool = False,
) -> list[Snapshot]:
    """Query the snapshot with the highest epoch of every matching session; no match is no error.

    complete: raise also if only some of the live instances have answered; inferred: programs without
    operators' edits. Raises ProtocolError or AccessDenied if a service is alive and does not answer.
    """
    newest: dict[tuple[str, str], Snapshot] = {}
    asked, parameters = session_key(station, session, "snapshot"), INFERRED_PROGRAM if inferred else ""

    def ask() -> list[Snapshot]:
        return _query_all(transport, asked, Snapshot, complete=complete, parameters=parameters)

    for snapshot in _of_stations(transport, station, ask):
        key = (snapshot.status.station, snapshot.status.session)
        if key not in newest or _rank(snapshot) > _rank(newest[key]):
            newest[key] = snapshot
    return [newest[key] for key in sorted(newest)]


def stored_snapshots(
    transport: Transport, station: str = "*", session: str = "*", *, skip: int = 0
) -> list[Snapshot]:
    """Return a page of the closed sessions that are in the journal and no longer in memory, the newest first.

    skip: number of sessions on earlier pages, by instance. A page has at most MAX_STORED of each instance. It
    is empty after the last one.
    """
    page = stored_parameters(StoredPage(skip=skip))
    key = session_key(station, session, "snapshot")

    def ask() -> list[Snapshot]:
        return _query_all(transport, key, Snapshot, parameters=page, timeout_s=SAMPLES_TIMEOUT_S)

    found = _of_stations(transport, station, ask)
    return sorted(found, key=lambda one: one.status.opened or 0.0, reverse=True)


def snapshot(
    transport: Transport, station: str, session: str | None = None, *, inferred: bool = False
) -> Snapshot:
    """Return the snapshot of one session, held or stored; by default the newest, the one of `program`.

    inferred: its program without operators' edits. Raises NotFound, which lists the existing names,
    Unreachable, or ProtocolError where no answer came.
    """
    name = session or _current_session(transport, station)

    def ask() -> list[Snapshot]:
        held = snapshots(transport, station, name or "*", inferred=inferred)
        if held or session is None:
            return held
        stored = _stored(transport, station, session, edits=0 if inferred else None)
        return [_as_inferred(one) for one in stored] if inferred else stored

    found = _confirmed(transport, station, ask)
    if not found:
        raise _not_found(transport, f"station {station!r} has no session {name or ''}".rstrip(), station)
    # Without a program the newest session is an open one, or else the last by name.
    return max(found, key=lambda one: (one.status.state == "open", one.status.session))


def _stored(transport: Transport, station: str, session: str, edits: int | None) -> list[Snapshot]:
    """Return the snapshot of a session that only the journal has. edits: the version of its program."""
    key, page = session_key(station, session, "snapshot"), stored_parameters(StoredPage(1, edits=edits))
    return _query_all(transport, key, Snapshot, parameters=page, timeout_s=SAMPLES_TIMEOUT_S)


def _as_inferred(snapshot: Snapshot) -> Snapshot:
    """Return a snapshot whose program lists no edits, as the answer to `INFERRED_PROGRAM`."""
    program = snapshot.program.model_copy(update={"edits": ()})
    return snapshot.model_copy(update={"program": program})


def program_at_edit(transport: Transport, station: str, session: str, number: int) -> Program:
    """Return the program of a session, in memory or stored, with the effective edits up to a number; 0: none.

    Raises NotFound, Unreachable, CaesuraError where the service is too old, or ProtocolError.
    """
    key, parameters = session_key(station, session, "snapshot"), edits_parameters(number)

    def ask() -> list[Snapshot]:
        held = _query_all(transport, key, Snapshot, parameters=parameters)
        return held or _stored(transport, station, session, edits=number)

    found = _confirmed(transport, station, ask)
    if not found:
        raise _not_found(transport, f"station {station!r} has no session {session}", station)
    version = max(found, key=_rank).program
    if version.edit_revision != number:
        raise CaesuraError(f"the service of {station} has no versions of a program: update the service")
    return version


def program(transport: Transport, station: str) -> Program:
    """Query the current task program of a station.

    Raises NotFound, which lists the existing names, Unreachable, or ProtocolError if no answer was received.
    """
    found = _confirmed(transport, station, lambda: _program(transport, station))
    if found is None:
        raise _not_found(transport, f"station {station!r} has no program")
    return found


def samples(
    transport: Transport,
    station: str,
    session: str,
    wanted: SampleRange,
    *,
    timeout_s: float = SAMPLES_TIMEOUT_S,
) -> RecordedSamples:
    """Return the samples of a session in a range: the extremes of every column in each bin.

    `unpack_points` of `caesura_protocol.minmax_decimation` converts the answer to arrays. Raises NotFound,
    which lists the existing names, Unreachable, or ProtocolError.
    """
    key, parameters = session_key(station, session, "samples"), samples_parameters(wanted)

    def ask() -> list[RecordedSamples]:
        return _query_all(transport, key, RecordedSamples, parameters=parameters, timeout_s=timeout_s)

    if found := _confirmed(transport, station, ask):
        return max(found, key=lambda one: one.epoch)
    raise _not_found(transport, f"no samples of session {station}/{session}", station)


def current_sessions(transport: Transport, station: str = "*") -> dict[str, str]:
    """Return each station's current session, the one that was opened last, by station."""
    key = station_key(station, "program")
    programs = _of_stations(transport, station, lambda: _query_all(transport, key, Program))
    ranked = sorted(programs, key=lambda one: (one.epoch, one.version))
    return {one.station: one.session for one in ranked}


def sessions(transport: Transport, station: str = "*", *, complete: bool = False) -> list[SessionInfo]:
    """Return all sessions in the service's memory, sorted by station and name.

    complete: raise also if only some of the live instances have answered. Raises Unreachable, AccessDenied,
    or ProtocolError where no answer came.
    """
    found = snapshots(transport, station, complete=complete)
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
            task=one.status.description.task,
            success=one.status.description.success,
            opened=one.status.opened,
            deleted=one.status.description.deleted,
        )
        for one in found
    ]


def damaged_sessions(transport: Transport, station: str = "*") -> list[SessionInfo]:
    """Return the sessions in the journals whose results cannot be read, the newest first.

    None where these credentials may not query the service's status. Raises Unreachable, or ProtocolError.
    """
    try:
        services = service_status(transport)
    except AccessDenied:
        return []
    return [
        SessionInfo(
            station=one.station,
            session=one.session,
            state="damaged",
            t=0.0,
            segments=0,
            instance=instance,
            opened=one.opened,
            damage=damage_words(one),
        )
        for instance, one in damaged_in(services)
        if station in {"*", one.station}
    ]


def stations(transport: Transport) -> list[str]:
    """Return the stations whose bridge is connected now."""
    return _names_of_tokens(transport.list_tokens(station_key("*", "alive")), parse_station_key)


def services(transport: Transport) -> list[str]:
    """Return the instances of the service that are alive now."""
    return _names_of_tokens(transport.list_tokens(service_key("*", "alive")), parse_service_key)


def service_status(transport: Transport) -> list[ServiceStatus]:
    """Query the status of every instance.

    Raises Unreachable where there is none, AccessDenied, or ProtocolError where no answer came.
    """
    found = _query_all(transport, service_key("*", "status"), ServiceStatus)
    if not found:
        _require_service(transport)
    return sorted(found, key=lambda one: one.instance)


def _names_of_tokens(keys: Iterable[str], parse: Callable[[str], tuple[str, object]]) -> list[str]:
    """Return the first name in each liveliness key; a key that does not parse is left out.

    The key's form alone is checked: another program may have declared it.
    """
    names = []
    for key in keys:
        with suppress(ProtocolError):
            names.append(parse(key)[0])
    return names


def find_program(transport: Transport, station: str) -> Program | None:
    """Query the current task program of a station; None if it has none, or if access is denied."""
    with suppress(AccessDenied):
        return _newest_program(transport, station)
    return None


def _program(transport: Transport, station: str) -> Program | None:
    """Return the program of a station; None if every instance answers that it has no session."""
    try:
        return _newest_program(transport, station)
    except (AccessDenied, IncompleteAnswerError) as error:
        # Instances that share the stations do not listen to questions for one without bridge and session.
        was_late = isinstance(error, IncompleteAnswerError) and error.limit is not None
        if was_late or snapshots(transport, station, complete=True):
            raise
    return None


def _newest_program(transport: Transport, station: str) -> Program | None:
    found = _query_all(transport, station_key(station, "program"), Program)
    return max(found, key=lambda one: (one.epoch, one.version), default=None)


def _current_session(transport: Transport, station: str) -> str | None:
    """Return the current session of the station according to the service."""
    program = _unless_held_back(transport, station, lambda: find_program(transport, station))
    return None if program is None else program.session


def _rank(snapshot: Snapshot) -> tuple[int, str]:
    return snapshot.status.epoch, snapshot.status.instance


def _query_all(
    transport: Transport,
    key: str,
    model: type[M],
    *,
    complete: bool = False,
    parameters: str = "",
    timeout_s: float = QUERY_TIMEOUT_S,
) -> list[M]:
    """Return the answers to a query.

    Empty if no service is alive, or every live one states that it has nothing. Makes QUERY_ATTEMPTS attempts
    if replies of a long answer were lost or the query timed out, and PIECES_ATTEMPTS if fragments of it were
    received. A query that the service refuses as `overloaded` is not repeated: that would add to its load.
    Raises ProtocolError, or AccessDenied if a service is alive and does not reply.
    """
    # Most answers take 0.1 s: one that was lost is not waited for as long as one that takes its time.
    limits = (min(timeout_s, QUERY_TIMEOUT_S), *[timeout_s] * (PIECES_ATTEMPTS - 1))
    for attempt, within_s in enumerate(limits, start=1):
        before = services(transport) if complete else []  # one that goes meanwhile has not answered
        answers = transport.query(key, parameters=with_nothing_said(parameters), timeout_s=within_s)
        try:
            joined = _joined(answers)
            found = _decoded(joined, answers.refusals, model, complete=complete)
        except IncompleteAnswerError as lost:
            said = f"asked {attempt} times: {lost.message}"
            error: Exception = IncompleteAnswerError("overloaded", said, limit=lost.limit)
            if attempt >= QUERY_ATTEMPTS and lost.limit is not None:  # no pieces came
                break
            continue
        if joined.lost is not None:  # of an answer that need not be complete
            error = joined.lost
            if attempt >= QUERY_ATTEMPTS:
                return found
            time.sleep(attempt * RETRY_S)
            continue
        if found and not complete:
            return found
        if attempt == 1 and _has_no_end(answers, found):
            continue
        if not (missing := _missing([*before, *services(transport)], answers, found)):
            return found
        error = _unanswered(key, missing, answers)
        if attempt >= QUERY_ATTEMPTS:
            break
        time.sleep(attempt * RETRY_S)
    raise error


class _Joined(NamedTuple):
    """The received messages, whether fragments of further ones were received, and the counted number."""

    whole: list[Encoded]
    has_pieces: bool
    counted: int  # by the instances at the end of their answers; an older one counts none

    @property
    def lost(self) -> IncompleteAnswerError | None:
        """The error of an answer of which counted replies did not come; None if all came."""
        if self.counted <= len(self.whole):
            return None
        why = f"{len(self.whole)} of {self.counted} replies came, the network is busy: ask again"
        return IncompleteAnswerError("overloaded", why)


def _joined(answers: QueryReplies) -> _Joined:
    joining = Reassembler()
    replies = [joining.add(key, Encoded(payload, encoding)) for key, payload, encoding in answers.replies]
    said = (refusal.limit for refusal in answers.refusals if refusal.code == NOTHING)
    return _Joined(
        [reply for reply in replies if reply is not None],
        bool(joining.unfinished),
        sum(limit for limit in said if isinstance(limit, int)),
    )


def lost_replies(answers: QueryReplies) -> IncompleteAnswerError | None:
    """Return the error of an answer of which counted replies did not come; None where all came."""
    return _joined(answers).lost


def _has_no_end(answers: QueryReplies, found: Iterable[Message]) -> bool:
    """Return whether an instance sent no count of its replies: it is older, or the count is lost."""
    said = {refusal.value for refusal in answers.refusals if refusal.code == NOTHING}
    return any(one.status.instance not in said for one in found if isinstance(one, Snapshot))


def _missing(alive: Iterable[str], answers: QueryReplies, found: Iterable[Message]) -> list[str]:
    """Return the live instances that answered neither with content nor that they have nothing."""
    answered = {refusal.value for refusal in answers.refusals if refusal.code == NOTHING}
    answered |= {one.status.instance for one in found if isinstance(one, Snapshot)}
    return sorted(set(alive) - answered)


def _unanswered(key: str, missing: list[str], answers: QueryReplies) -> ProtocolError | AccessDenied:
    """Return the error for instances that did not answer a query; others may have answered."""
    who = f"{', '.join(missing)} {'are' if len(missing) > 1 else 'is'} alive"
    if answers.replies or answers.refusals:
        why = f"{who} and did not answer, asked {QUERY_ATTEMPTS} times: busy, or has just gone; ask again"
        return IncompleteAnswerError("overloaded", why)
    return AccessDenied(
        f"{who}, and a query for {key} ends without an answer, asked {QUERY_ATTEMPTS} times: it is forbidden "
        "for these credentials (use those of a dashboard or an operator), or its answers are lost"
    )


def decoded(answers: QueryReplies, model: type[M], *, complete: bool = False) -> list[M]:
    """Decode the answers. An invalid one is raised only without a valid one, a newer protocol always.

    The statement that an instance has nothing is not a refusal. complete: raise a refusal, or lost fragments,
    also if there are valid answers.
    """
    return _decoded(_joined(answers), answers.refusals, model, complete=complete)


def _decoded(
    joined: _Joined, said: Iterable[ProtocolError], model: type[M], *, complete: bool = False
) -> list[M]:
    """Decode messages from joined fragments, as `decoded`. said: refusals received with them."""
    whole = joined.whole
    refusals = [refusal for refusal in said if refusal.code != NOTHING]
    others = [refusal for refusal in refusals if not isinstance(refusal, IncompleteAnswerError)]
    if joined.has_pieces and not others and (complete or not whole):
        raise IncompleteAnswerError("overloaded", "fragments of the answer were lost on the way: ask again")
    if joined.lost is not None and not others and (complete or not whole):
        raise joined.lost
    if refusals and (complete or not whole):
        raise refusals[0]
    found, spoilt = [], None
    for reply in whole:
        try:
            found.append(decode(*reply, model, limit=MAX_WHOLE_BYTES))
        except ProtocolError as error:
            if is_other_version(error):
                raise
            spoilt = error
    if spoilt is not None and not found:
        raise spoilt
    return found


def _confirmed(transport: Transport, station: str, ask: Callable[[], Found]) -> Found:
    """Return the result of `ask`; an empty result is confirmed by a second query.

    Raises as `_unless_held_back`. Just after an instance has left, the others hold nothing of its stations
    and have not begun to take them over.
    """
    if found := _unless_held_back(transport, station, ask):
        return found
    time.sleep(CONFIRM_S)
    return _unless_held_back(transport, station, ask)


def _unless_held_back(transport: Transport, station: str, ask: Callable[[], Found]) -> Found:
    """Return the result of `ask`; repeat an empty one while the station's budget of queries is used up.

    Beyond a station's budget the service explains some refusals, and drops other queries without an answer.
    Raises ProtocolError `overloaded` if the budget stays used up, or as `ask` does.
    """
    before = held = 0
    for _ in range(HELD_ATTEMPTS):
        unanswered = None
        try:
            if found := ask():
                return found
        except AccessDenied as error:
            unanswered = error
        before, held = held, _held_back(transport, station)
        if held == before:
            if unanswered is not None:
                raise unanswered
            return found
        time.sleep(HELD_WAIT_S)
    raise ProtocolError(
        "overloaded",
        f"the service has refused {held} queries for station {station} because of their rate, and answers "
        "none now: stop the script that queries in a loop, and try again",
        value=held,
    )


def _of_stations(transport: Transport, station: str, ask: Callable[[], list[M]]) -> list[M]:
    """Return the result of `ask` for a station, or for all with `*`; queries with `*` have a separate budget.

    Raises ProtocolError `overloaded` where it is not answered because that budget is used up.
    """
    if station != "*":
        return ask()
    try:
        return ask()
    except AccessDenied:
        before = _held_back(transport, station)
        try:
            return ask()
        except AccessDenied:
            if (held := _held_back(transport, station)) == before:
                raise
    raise ProtocolError(
        "overloaded",
        f"the service has refused {held} queries that name no station because of their rate: stop the "
        "script that queries in a loop, and try again",
        value=held,
    )


def _held_back(transport: Transport, station: str) -> int:
    """Return how many queries of a station were refused by its budget; 0 if no service states it.

    For `*`: the number of refused queries without a station.
    """
    with suppress(AccessDenied):
        stated = _query_all(transport, service_key("*", "status"), ServiceStatus)
        if station == "*":
            return sum(status.queries.refused for status in stated if status.queries is not None)
        budgets = (one.queries for status in stated for one in status.budgets if one.station == station)
        return sum(budget.refused for budget in budgets if budget is not None)
    return 0


def _require_service(transport: Transport) -> None:
    if not services(transport):
        raise no_service(transport)


def no_service(transport: Transport) -> Unreachable:
    """Return the error to raise where no instance is alive, or the router cannot be reached."""
    if not transport.has_router:
        return Unreachable(
            f"no service can be reached: the router at {transport.endpoint} has ended, hangs, or the network "
            "is cut; the link is restored once it answers"
        )
    return Unreachable(
        f"no service is alive at {transport.endpoint}: it is not started, or has no link to the router"
    )


def _not_found(transport: Transport, what: str, station: str | None = None) -> NotFound:
    """Return the error, with the sessions of the station, or the stations if it is None or has no session."""
    _require_service(transport)
    try:
        held = [one.status for one in snapshots(transport)]
    except (AccessDenied, ProtocolError):
        known = "not known"  # a bridge may ask for its own station alone
    else:
        if sessions := {one.session for one in held if one.station == station}:
            return NotFound(f"{what}; its newest sessions: {_listed(sessions)}")
        known = _listed({one.station for one in held})
    return NotFound(f"{what}; stations with sessions: {known}; with a bridge: {_listed(stations(transport))}")


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "none"
