"""Answers queries for snapshots, programs and the service's status.

They are answered from immutable states in a separate thread, so that queries never delay the worker, and a
busy worker never delays an answer. There is one reply for each session or station that the query's key
matches. The status has a lane of its own. The last reply of an answer states the number of replies, because a
congested network loses some of them, or all but the last. A query without room in the queue is refused as
`overloaded`.

While a station, or the service, is overloaded, this server checks its commands: one that would open a new
session is refused at once; every other command is passed to the worker.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping

from caesura_protocol.codec import decode
from caesura_protocol.errors import ErrorCode, ProtocolError
from caesura_protocol.keys import (
    INFERRED_PROGRAM,
    StoredPage,
    is_name,
    parse_snapshot_parameters,
    parse_station_key,
    service_key,
    session_key,
    station_key,
)
from caesura_protocol.messages import Control, Message, Open, Program, ServiceStatus, Snapshot
from caesura_protocol.token_bucket import Rate, RateLimit
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.ownership.registry import Registry
from caesura_service.ownership.session_index import SessionIndex
from caesura_service.publishing.session_state import (
    SessionState,
    inferred_program_of,
    program_at_edit,
    program_of,
    snapshot_of,
)
from caesura_service.server.answering_thread import AnsweringThread
from caesura_service.server.budgets import Budgets
from caesura_service.server.inbound_events import (
    MAX_TEXT,
    UNKNOWN,
    Arrival,
    CommandReceived,
    RawPayload,
    content_of_query,
    source_of_key,
    sources_of,
)
from caesura_service.server.outbound import (
    answering,
    reply_error,
    reply_in_takeover,
    reply_message,
    reply_nothing,
    with_load,
)
from caesura_service.server.work_queue import WorkQueue

QUERIES = 1024  # that may wait; a quarter of them in one lane
QUERY_BYTES = 4096  # of its parameters and content; those of Caesura have a few hundred, and no content
# Of a station's commands and queries that are refused with a reason; others end without one.
REFUSAL_RATE = Rate(100.0, 200.0)


class QueryServer(AnsweringThread):
    """Answers queries in a separate thread while the context lasts."""

    def __init__(
        self,
        registry: Registry,
        work: WorkQueue[Arrival],
        status: Callable[[], ServiceStatus],
        budgets: Budgets,
        stored: Callable[[IncomingQuery, str, StoredPage], ProtocolError | None],
        instance: str,
    ) -> None:
        """work: the worker's queue; stored: enqueues a query for stored sessions, with its lane."""
        self._stored = stored
        self._instance = instance
        self._refusal_rate = RateLimit(REFUSAL_RATE)
        self.rejected_commands = 0  # commands that were refused because of an overload
        self._counting = threading.Lock()
        self._registry = registry
        self._work_queue, self._budgets = work, budgets
        self._status = status
        super().__init__("caesura-answers", QUERIES)

    def snapshot(self, query: IncomingQuery, lane: str) -> ProtocolError | None:
        """Enqueue a query for sessions: those in memory, or a page of stored ones.

        Returns the refusal if too many of the lane are queued, like `program` and `status`.
        """
        try:
            page, version = parse_snapshot_parameters(query.parameters)
        except ProtocolError as error:
            with query:
                reply_error(query, error)
            return None
        if page is not None:
            return self._stored(query, lane, page)
        return self._enqueue(query, self._answer_snapshot(query, lane, version), lane)

    def program(self, query: IncomingQuery, lane: str) -> ProtocolError | None:
        """Enqueue a query for stations' programs."""
        return self._enqueue(query, self._answer_program(query, lane), lane)

    def status(self, query: IncomingQuery, lane: str) -> ProtocolError | None:
        """Enqueue a query for the service's status."""
        return self._enqueue(query, self._answer_status(query), lane)

    def _enqueue(self, query: IncomingQuery, answer: Iterator[None], lane: str) -> ProtocolError | None:
        return None if self._queue.offer((query, answer), lane) else too_many_waiting(lane)

    def add_rejections(self, refused: Mapping[ErrorCode, int]) -> dict[ErrorCode, int]:
        """Return the refusals of the registry plus those of this server."""
        own: dict[ErrorCode, int] = {"overloaded": self.rejected_commands} if self.rejected_commands else {}
        return {code: refused.get(code, 0) + own.get(code, 0) for code in {**refused, **own}}

    def command(self, query: IncomingQuery) -> bool:
        """Enqueue a command for the worker; in an overload only if it opens no new session.

        Returns False, and leaves the query open, if the station has used up its budget and the refusals of
        REFUSAL_RATE.
        """
        station = source_of_key(query.key).station
        lane = station or UNKNOWN
        if (refusal := self._budgets.reject_command(lane)) is not None:
            self.count_rejected(1)
            return self.refuse(query, lane, refusal)
        if station is None or not self._work_queue.is_overloaded(*sources_of(station)):
            self._forward_command(CommandReceived(content_of_query(query), query))
        elif not self._queue.offer((query, self._admit_command(query)), lane):
            self._reject_command(query, too_many_waiting(lane))
        return True

    def refuse(self, query: IncomingQuery, lane: str, refusal: ProtocolError) -> bool:
        """End a query of a lane with the reason if REFUSAL_RATE allows it; return whether it has ended."""
        if not self._refusal_rate.allows(lane):
            return False
        with query:
            reply_error(query, refusal)
        return True

    def count_rejected(self, count: int) -> None:
        """Count commands that were refused."""
        with self._counting:
            self.rejected_commands += count

    def _admit_command(self, query: IncomingQuery) -> Iterator[None]:
        command = CommandReceived(content_of_query(query), query)
        if self._opens_new_session(command.content):
            why = "the service is overloaded, and accepts no new session until that is over: try again"
            fill, limit = round(self._work_queue.fill_ratio(), 2), self._work_queue.overloaded_at
            self._reject_command(query, ProtocolError("overloaded", why, value=fill, limit=limit))
        else:
            self._forward_command(command)
        yield from ()

    def _opens_new_session(self, content: RawPayload) -> bool:
        """Return whether a command opens a session that is not in memory; False if it is unreadable."""
        try:
            content.check_size()
            station = parse_station_key(content.key)[0]
            command = decode(content.payload, content.encoding, Control).command
        except ProtocolError:
            return False
        known = {session.name for session in self._registry.index.sessions.get(station, ())}
        return isinstance(command, Open) and command.session not in known

    def _forward_command(self, command: CommandReceived) -> None:
        station = source_of_key(command.content.key).station
        if not self._work_queue.put_command(command, station or UNKNOWN):
            most = self._work_queue.settings.commands
            why = f"{most} commands of station {station} are waiting: try again"
            refusal = ProtocolError("overloaded", why, value=most, limit=most)
            self._reject_command(command.query, refusal)

    def _reject_command(self, query: IncomingQuery, refusal: ProtocolError) -> None:
        self.count_rejected(1)
        with query:
            reply_error(query, refusal)

    def _answer_snapshot(self, query: IncomingQuery, lane: str, version: int | None) -> Iterator[None]:
        def snapshot(state: SessionState) -> Snapshot:
            if version is not None:
                return self._snapshot(state, program_at_edit(state, version))
            if query.parameters != INFERRED_PROGRAM:
                return self._snapshot(state, None)
            # A document lays the times of apps out anew for every edit that its program lists as applied.
            return self._snapshot(state, inferred_program_of(state).model_copy(update={"edits": ()}))

        states = self._index_of(lane).all_states()
        keyed = ((session_key(one.station, one.session, "snapshot"), one) for one in states)
        yield from self._replies(query, keyed, snapshot, lambda name: session_key(name, "*", "snapshot"))

    def _snapshot(self, state: SessionState, program: Program | None) -> Snapshot:
        snapshot = snapshot_of(state, program)
        return snapshot.model_copy(
            update={"status": with_load(snapshot.status, self._work_queue, self._budgets)}
        )

    def _answer_program(self, query: IncomingQuery, lane: str) -> Iterator[None]:
        states = self._index_of(lane).newest_states()
        keyed = ((station_key(one.station, "program"), one) for one in states)
        yield from self._replies(query, keyed, program_of, lambda name: station_key(name, "program"))

    def _answer_status(self, query: IncomingQuery) -> Iterator[None]:
        with answering(query):
            status = self._status()
            reply_message(query, service_key(status.instance, "status"), status)
        yield from ()

    def _replies(
        self,
        query: IncomingQuery,
        states: Iterable[tuple[str, SessionState]],
        message_of: Callable[[SessionState], Message],
        keys_of: Callable[[str], str],
    ) -> Iterator[None]:
        """Reply with a message of each state whose key matches; yield after each one but the last.

        keys_of: the keys of a station's replies.
        """
        with answering(query):
            found = [(key, state) for key, state in states if query.matches(key)]
            ownership = self._registry.ownership
            behind = ownership.may_be_behind({state.station for _, state in found})
            found = [(key, state) for key, state in found if state.station not in behind]
            there = {state.station for _, state in found}
            taking = [name for name in {*ownership.stations_in_takeover(), *behind} if name not in there]
            taking = [name for name in taking if query.matches(keys_of(name))]
            for name in taking:
                reply_in_takeover(query, name, self._instance)
            replies = 0
            for remaining, (key, state) in zip(reversed(range(len(found))), found, strict=True):
                replies += reply_message(query, key, message_of(state))
                if remaining:
                    yield
            if found or not taking:
                reply_nothing(query, self._instance, replies)

    def _index_of(self, lane: str) -> SessionIndex:
        index = self._registry.index
        return index if lane == UNKNOWN else index.of_station(lane)


def size_refusal(query: IncomingQuery) -> ProtocolError | None:
    """Return the refusal of a query that holds more than QUERY_BYTES while it waits, or None.

    The time to compare a key with those of the sessions grows with its length.
    """
    if len(query.key) > MAX_TEXT:
        return ProtocolError(
            "too_large", "the key of a query is too long", value=len(query.key), limit=MAX_TEXT
        )
    if query.size <= QUERY_BYTES:
        return None
    why = "the parameters and the content of a query are too long"
    return ProtocolError("too_large", why, value=query.size, limit=QUERY_BYTES)


def too_many_waiting(lane: str) -> ProtocolError:
    """Return the refusal of a query for which its lane has no room."""
    sender = lane if is_name(lane) else "what names no station"
    return ProtocolError("overloaded", f"too many queries of {sender} are waiting: try again")
