"""Answers to those who ask what is: snapshots, programs, the service's status.

They come from immutable standings in a thread of its own, so that asking never delays the work and a busy
worker never delays an answer. One reply for each session or station that the query's key matches; none
where there is nothing. Questions wait in a bounded queue; past it they are refused as `overloaded`.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self

import zenoh

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import service_key, session_key, station_key
from caesura_protocol.messages import ServiceStatus
from caesura_service.edge.inbox import Inbox, QueueSettings
from caesura_service.edge.outgoing import answer, refuse
from caesura_service.session.registry import Registry
from caesura_service.session.standing import snapshot_of

logger = logging.getLogger(__name__)

QUESTIONS = 256  # that may wait
TICK_S = 0.1
JOIN_S = 2.0


class Answers:
    """Answers queries in a thread of its own while the context lasts."""

    def __init__(self, registry: Registry, status: Callable[[], ServiceStatus]) -> None:
        self._registry = registry
        self._status = status
        self._inbox: Inbox[tuple[Callable[[zenoh.Query], None], zenoh.Query]] = Inbox(
            QueueSettings(capacity=QUESTIONS, shares=1)
        )
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="caesura-answers", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self._inbox.wake()
        self._thread.join(JOIN_S)

    def snapshot(self, query: zenoh.Query) -> None:
        """Enqueue a question for sessions."""
        self._enqueue(self._answer_snapshot, query)

    def program(self, query: zenoh.Query) -> None:
        """Enqueue a question for stations' programs."""
        self._enqueue(self._answer_program, query)

    def status(self, query: zenoh.Query) -> None:
        """Enqueue a question for the service's status."""
        self._enqueue(self._answer_status, query)

    def _enqueue(self, how: Callable[[zenoh.Query], None], query: zenoh.Query) -> None:
        if not self._inbox.offer((how, query), "queries"):
            with query:
                limit = self._inbox.capacity
                refuse(query, ProtocolError("overloaded", "too many questions are waiting", limit=limit))

    def _run(self) -> None:
        while not self._stopped.is_set():
            if (question := self._inbox.get(TICK_S)) is None:
                continue
            how, query = question
            try:
                with query:
                    how(query)
            except Exception:
                logger.exception("a question was not answered")

    def _answer_snapshot(self, query: zenoh.Query) -> None:
        asked = query.key_expr
        for standing in self._registry.board.standings():
            key = session_key(standing.station, standing.session, "snapshot")
            if asked.intersects(key):
                answer(query, key, snapshot_of(standing))

    def _answer_program(self, query: zenoh.Query) -> None:
        asked = query.key_expr
        for standing in self._registry.board.current():
            key = station_key(standing.station, "program")
            if asked.intersects(key):
                answer(query, key, standing.program)

    def _answer_status(self, query: zenoh.Query) -> None:
        status = self._status()
        answer(query, service_key(status.instance, "status"), status)
