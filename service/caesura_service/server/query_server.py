"""Answers queries for snapshots, programs and the service's status.

They are answered from immutable states in a thread of its own, so that queries never delay the work and a
busy worker never delays an answer. One reply for each session or station that the query's key matches.
Queries wait in a bounded queue; past it they are refused as `overloaded`.

While a station, or the service, is overloaded its commands pass through here: what would open a new session
is refused at once; every other command goes to the worker.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping

from caesura_protocol.codec import decode
from caesura_protocol.errors import ErrorCode, ProtocolError
from caesura_protocol.keys import (
    INFERRED_PROGRAM,
    StoredPage,
    parse_station_key,
    parse_stored_parameters,
    service_key,
    session_key,
    station_key,
)
from caesura_protocol.messages import Control, Open, Program, ServiceStatus, Snapshot
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.session_state import (
    SessionState,
    inferred_program_of,
    program_of,
    snapshot_of,
)
from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.budgets import Budgets
from caesura_service.server.inbound import (
    UNKNOWN,
    Arrival,
    CommandReceived,
    RawPayload,
    content_of_query,
    source_of_key,
    sources_of,
)
from caesura_service.server.result_publisher import reply_error, reply_message, with_load
from caesura_service.server.work_queue import QueueSettings, WorkQueue
from caesura_service.token_bucket import LOG_RATE, Rate, RateLimit

logger = logging.getLogger(__name__)

QUERIES = 256  # that may wait
TICK_S = 0.1
REFUSAL_RATE = Rate(
    100.0, 200.0
)  # of a station's commands that are refused with a reason; others end at once


class QueryServer(BackgroundThread):
    """Answers queries in a thread of its own while the context lasts."""

    def __init__(
        self,
        registry: Registry,
        work: WorkQueue[Arrival],
        status: Callable[[], ServiceStatus],
        budgets: Budgets,
        questions: Rate,
        stored: Callable[[IncomingQuery, StoredPage], None],
    ) -> None:
        """work: the worker's queue; questions: the rate of queries, of all readers together.

        stored: takes a query for stored sessions.
        """
        self._stored = stored
        self._query_rate = RateLimit(questions)
        self._log_rate = RateLimit(LOG_RATE)
        self._refusal_rate = RateLimit(REFUSAL_RATE)
        self.rejected_commands = 0  # commands that were refused because of an overload
        self._counting = threading.Lock()
        self._registry = registry
        self._work_queue, self._budgets = work, budgets
        self._status = status
        self._queue: WorkQueue[tuple[Callable[[IncomingQuery], None], IncomingQuery]] = WorkQueue(
            QueueSettings(capacity=QUERIES, shares=1)
        )
        super().__init__("caesura-answers", self._queue.wake)

    def snapshot(self, query: IncomingQuery) -> None:
        """Enqueue a query for sessions: those that are held, or a page of those that are stored."""
        try:
            page = parse_stored_parameters(query.parameters)
        except ProtocolError as error:
            with query:
                reply_error(query, error)
            return
        if page is None:
            self._enqueue_query(self._answer_snapshot, query)
        elif self._query_rate.allows("every reader"):
            self._stored(query, page)
        else:
            _reply_overloaded(query, "too many questions a second", self._query_rate.rates[0].per_s)

    def program(self, query: IncomingQuery) -> None:
        """Enqueue a query for stations' programs."""
        self._enqueue_query(self._answer_program, query)

    def status(self, query: IncomingQuery) -> None:
        """Enqueue a query for the service's status."""
        self._enqueue_query(self._answer_status, query)

    def add_rejections(self, refused: Mapping[ErrorCode, int]) -> dict[ErrorCode, int]:
        """Return the refusals of the registry plus those of this server."""
        own: dict[ErrorCode, int] = {"overloaded": self.rejected_commands} if self.rejected_commands else {}
        return {code: refused.get(code, 0) + own.get(code, 0) for code in {**refused, **own}}

    def command(self, query: IncomingQuery) -> bool:
        """Enqueue a command for the worker; in an overload only where it opens no new session.

        Returns False where the station has used up its budget and REFUSAL_RATE has no further answer for it.
        """
        station = source_of_key(query.key).station
        if (refusal := self._budgets.reject_command(station or UNKNOWN)) is not None:
            if not self._refusal_rate.allows(station or UNKNOWN):
                self.count_rejected(1)
                query.drop()
                return False
            self._reject_command(query, refusal)
        elif station is not None and self._work_queue.is_overloaded(*sources_of(station)):
            self._enqueue(self._admit_command, query)
        else:
            self._forward_command(CommandReceived(content_of_query(query), query))
        return True

    def count_rejected(self, count: int) -> None:
        """Count commands that were refused."""
        with self._counting:
            self.rejected_commands += count

    def _enqueue_query(self, handle: Callable[[IncomingQuery], None], query: IncomingQuery) -> None:
        if self._query_rate.allows("every reader"):  # a query does not name its client
            self._enqueue(handle, query)
        else:
            _reply_overloaded(query, "too many questions a second", self._query_rate.rates[0].per_s)

    def _enqueue(self, handle: Callable[[IncomingQuery], None], query: IncomingQuery) -> None:
        if not self._queue.offer((handle, query), "queries"):
            _reply_overloaded(query, "too many questions are waiting", self._queue.capacity)

    def _run(self) -> None:
        while not self._stopped.is_set():
            if (queued := self._queue.get(TICK_S)) is None:
                continue
            handle, query = queued
            try:
                handle(query)
            except Exception:
                if self._log_rate.allows("any"):
                    logger.exception("a question was not answered")
                query.drop()

    def _admit_command(self, query: IncomingQuery) -> None:
        command = CommandReceived(content_of_query(query), query)
        if not self._opens_new_session(command.content):
            self._forward_command(command)
            return
        self.count_rejected(1)
        why = "more arrives than can be done: no new sessions until that is over, try again"
        with query:
            fill = round(self._work_queue.fill_ratio(), 2)
            reply_error(
                query, ProtocolError("overloaded", why, value=fill, limit=self._work_queue.overloaded_at)
            )

    def _opens_new_session(self, content: RawPayload) -> bool:
        """Whether the command opens a session that is not in memory; False where it cannot be read."""
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

    def _answer_snapshot(self, query: IncomingQuery) -> None:
        with query:
            for state in self._registry.index.all_states():
                key = session_key(state.station, state.session, "snapshot")
                if query.matches(key):
                    program = inferred_program_of(state) if query.parameters == INFERRED_PROGRAM else None
                    reply_message(query, key, self._snapshot(state, program))

    def _snapshot(self, state: SessionState, program: Program | None) -> Snapshot:
        snapshot = snapshot_of(state, program)
        return snapshot.model_copy(
            update={"status": with_load(snapshot.status, self._work_queue, self._budgets)}
        )

    def _answer_program(self, query: IncomingQuery) -> None:
        with query:
            for state in self._registry.index.newest_states():
                key = station_key(state.station, "program")
                if query.matches(key):
                    reply_message(query, key, program_of(state))

    def _answer_status(self, query: IncomingQuery) -> None:
        with query:
            status = self._status()
            reply_message(query, service_key(status.instance, "status"), status)


def _reply_overloaded(query: IncomingQuery, why: str, limit: float) -> None:
    with query:
        reply_error(query, ProtocolError("overloaded", why, limit=limit))
