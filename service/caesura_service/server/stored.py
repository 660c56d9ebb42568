"""Answers queries for stored sessions, in a thread of its own: a page is read from the journal."""

from __future__ import annotations

import logging

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import StoredPage, session_key
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.journal import JournalError
from caesura_service.ownership.stored_sessions import StoredSessions
from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.result_publisher import reply_error, reply_message
from caesura_service.server.work_queue import QueueSettings, WorkQueue
from caesura_service.token_bucket import LOG_RATE, RateLimit

logger = logging.getLogger(__name__)

QUERIES = 16  # that may wait
TICK_S = 0.1


class StoredServer(BackgroundThread):
    """Answers while the context lasts."""

    def __init__(self, stored: StoredSessions) -> None:
        self._stored, self._log_rate = stored, RateLimit(LOG_RATE)
        self._queue: WorkQueue[tuple[IncomingQuery, StoredPage]] = WorkQueue(
            QueueSettings(capacity=QUERIES, shares=1)
        )
        super().__init__("caesura-stored", self._queue.wake)

    def take(self, query: IncomingQuery, wanted: StoredPage) -> None:
        """Enqueue a query."""
        if not self._queue.offer((query, wanted), "queries"):
            with query:
                why = "too many queries for stored sessions are waiting"
                reply_error(query, ProtocolError("overloaded", why, limit=QUERIES))

    def _run(self) -> None:
        while not self._stopped.is_set():
            if (found := self._queue.get(TICK_S)) is not None:
                try:
                    self._answer(*found)
                except Exception:
                    if self._log_rate.allows("any"):
                        logger.exception("a query for stored sessions was not answered")

    def _answer(self, query: IncomingQuery, wanted: StoredPage) -> None:
        with query:
            try:
                found = self._stored.page(lambda key: query.matches(session_key(*key, "snapshot")), wanted)
                for snapshot in found:
                    status = snapshot.status
                    reply_message(query, session_key(status.station, status.session, "snapshot"), snapshot)
            except JournalError as error:
                reply_error(query, ProtocolError("internal", str(error)))
