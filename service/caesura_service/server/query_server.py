"""Answers to those who ask what is: snapshots, programs, the service's status.

They come from immutable standings in a thread of its own, so that asking never delays the work and a busy
worker never delays an answer. One reply for each session or station that the query's key matches; none
where there is nothing. Questions wait in a bounded queue; past it they are refused as `overloaded`.

While a station, or the service, is overloaded its commands pass through here: what would begin a new session
is refused at once, without waiting behind what is too much already; everything else goes its way.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping

import zenoh

from caesura_protocol.codec import decode
from caesura_protocol.errors import ErrorCode, ProtocolError
from caesura_protocol.keys import parse_station_key, service_key, session_key, station_key
from caesura_protocol.messages import Control, Open, ServiceStatus, Snapshot
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.session_state import SessionState, program_of, snapshot_of
from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.budgets import Budgets
from caesura_service.server.inbound import (
    UNKNOWN,
    Arrival,
    CommandReceived,
    RawPayload,
    content_of_query,
    sender_of,
    sources_of,
)
from caesura_service.server.rates import COMPLAINTS, Rate, RateLimit
from caesura_service.server.result_publisher import answer, refuse, with_load
from caesura_service.server.work_queue import QueueSettings, WorkQueue

logger = logging.getLogger(__name__)

QUESTIONS = 256  # that may wait
TICK_S = 0.1


class QueryServer(BackgroundThread):
    """Answers queries in a thread of its own while the context lasts."""

    def __init__(
        self,
        registry: Registry,
        work: WorkQueue[Arrival],
        status: Callable[[], ServiceStatus],
        budgets: Budgets,
        questions: Rate,
    ) -> None:
        """work: the worker's inbox; questions: how many are answered, of all readers together."""
        self._questions = RateLimit(questions)
        self._complaints = RateLimit(COMPLAINTS)
        self.turned_away = 0  # commands that were refused because of an overload
        self._counting = threading.Lock()
        self._registry = registry
        self._work, self._budgets = work, budgets
        self._status = status
        self._inbox: WorkQueue[tuple[Callable[[zenoh.Query], None], zenoh.Query]] = WorkQueue(
            QueueSettings(capacity=QUESTIONS, shares=1)
        )
        super().__init__("caesura-answers", self._inbox.wake)

    def snapshot(self, query: zenoh.Query) -> None:
        """Enqueue a question for sessions."""
        self._ask(self._answer_snapshot, query)

    def program(self, query: zenoh.Query) -> None:
        """Enqueue a question for stations' programs."""
        self._ask(self._answer_program, query)

    def status(self, query: zenoh.Query) -> None:
        """Enqueue a question for the service's status."""
        self._ask(self._answer_status, query)

    def with_refusals(self, refused: Mapping[ErrorCode, int]) -> dict[ErrorCode, int]:
        """Those of the registry and our own."""
        own: dict[ErrorCode, int] = {"overloaded": self.turned_away} if self.turned_away else {}
        return {code: refused.get(code, 0) + own.get(code, 0) for code in {**refused, **own}}

    def command(self, query: zenoh.Query) -> None:
        """Enqueue a command for the worker; under pressure look at it first."""
        station = sender_of(str(query.key_expr)).station
        if (refusal := self._budgets.refuse_command(station or UNKNOWN)) is not None:
            self._refuse_command(query, refusal)
        elif station is not None and self._work.is_pressed(*sources_of(station)):
            self._enqueue(self._admit, query)
        else:
            self._pass_on(CommandReceived(content_of_query(query), query))

    def _ask(self, how: Callable[[zenoh.Query], None], query: zenoh.Query) -> None:
        if self._questions.allows("every reader"):  # a query does not say who asks
            self._enqueue(how, query)
        else:
            _refuse_overload(query, "too many questions a second", self._questions.rates[0].per_s)

    def _enqueue(self, how: Callable[[zenoh.Query], None], query: zenoh.Query) -> None:
        if not self._inbox.offer((how, query), "queries"):
            _refuse_overload(query, "too many questions are waiting", self._inbox.capacity)

    def _run(self) -> None:
        while not self._stopped.is_set():
            if (question := self._inbox.get(TICK_S)) is None:
                continue
            how, query = question
            try:
                how(query)
            except Exception:
                if self._complaints.allows("any"):
                    logger.exception("a question was not answered")
                query.drop()  # type: ignore[no-untyped-call]

    def _admit(self, query: zenoh.Query) -> None:
        command = CommandReceived(content_of_query(query), query)
        if not self._begins(command.content):
            self._pass_on(command)
            return
        with self._counting:
            self.turned_away += 1
        why = "more arrives than can be done: no new sessions until that is over, try again"
        with query:
            fill = round(self._work.fill(), 2)
            refuse(query, ProtocolError("overloaded", why, value=fill, limit=self._work.overloaded_at))

    def _begins(self, content: RawPayload) -> bool:
        """Would the command open a session that is not known? One that cannot be read is the worker's."""
        try:
            content.check_size()
            station = parse_station_key(content.key)[0]
            command = decode(content.payload, content.encoding, Control).command
        except ProtocolError:
            return False
        known = {session.name for session in self._registry.index.sessions.get(station, ())}
        return isinstance(command, Open) and command.session not in known

    def _pass_on(self, command: CommandReceived) -> None:
        station = sender_of(command.content.key).station
        if not self._work.command(command, station or UNKNOWN):
            most = self._work.settings.commands
            why = f"{most} commands of station {station} are waiting: try again"
            refusal = ProtocolError("overloaded", why, value=most, limit=most)
            self._refuse_command(command.query, refusal)

    def _refuse_command(self, query: zenoh.Query, refusal: ProtocolError) -> None:
        with self._counting:
            self.turned_away += 1
        with query:
            refuse(query, refusal)

    def _answer_snapshot(self, query: zenoh.Query) -> None:
        with query:
            asked = query.key_expr
            for state in self._registry.index.all_states():
                key = session_key(state.station, state.session, "snapshot")
                if asked.intersects(key):
                    answer(query, key, self._snapshot(state))

    def _snapshot(self, state: SessionState) -> Snapshot:
        snapshot = snapshot_of(state)
        return snapshot.model_copy(update={"status": with_load(snapshot.status, self._work, self._budgets)})

    def _answer_program(self, query: zenoh.Query) -> None:
        with query:
            asked = query.key_expr
            for state in self._registry.index.newest_states():
                key = station_key(state.station, "program")
                if asked.intersects(key):
                    answer(query, key, program_of(state))

    def _answer_status(self, query: zenoh.Query) -> None:
        with query:
            status = self._status()
            answer(query, service_key(status.instance, "status"), status)


def _refuse_overload(query: zenoh.Query, why: str, limit: float) -> None:
    with query:
        refuse(query, ProtocolError("overloaded", why, limit=limit))
