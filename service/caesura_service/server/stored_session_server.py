"""Answers queries for stored sessions, in a separate thread, one page of the journal at a time."""

from __future__ import annotations

import logging
import time

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import StoredPage, session_key
from caesura_protocol.token_bucket import LOG_RATE, RateLimit
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.journal import JournalError
from caesura_service.ownership.stored_sessions import StoredSessions
from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.inbound import UNKNOWN
from caesura_service.server.outbound import answering, reply_error, reply_message, reply_nothing
from caesura_service.server.work_queue import QueueSettings, WorkQueue

logger = logging.getLogger(__name__)

QUERIES = 64  # that may wait; a quarter of them in one lane
TICK_S = 0.1


class StoredSessionServer(BackgroundThread):
    """Answers queries for stored sessions while the context lasts."""

    def __init__(self, stored: StoredSessions, instance: str) -> None:
        self._instance = instance
        self._stored, self._log_rate = stored, RateLimit(LOG_RATE)
        self._queue: WorkQueue[tuple[IncomingQuery, str, StoredPage]] = WorkQueue(
            QueueSettings(capacity=QUERIES)
        )
        super().__init__("caesura-stored", self._queue.wake)

    def take(self, query: IncomingQuery, lane: str, wanted: StoredPage) -> bool:
        """Enqueue a query; return False if too many of the lane are queued."""
        return self._queue.offer((query, lane, wanted), lane)

    def _run(self) -> None:
        while not self._stopped.is_set():
            if (found := self._queue.get(TICK_S)) is None:
                continue
            began = time.perf_counter()
            try:
                self._answer(*found)
            except Exception:
                if self._log_rate.allows("any"):
                    logger.exception("a query for stored sessions was not answered")
            self._queue.charge(time.perf_counter() - began)

    def _answer(self, query: IncomingQuery, lane: str, wanted: StoredPage) -> None:
        with answering(query):
            try:
                station = None if lane == UNKNOWN else lane
                found = self._stored.page(
                    lambda key: query.matches(session_key(*key, "snapshot")), wanted, station
                )
                replies = 0
                for snapshot in found:
                    key = session_key(snapshot.status.station, snapshot.status.session, "snapshot")
                    replies += reply_message(query, key, snapshot)
                reply_nothing(query, self._instance, replies)
            except JournalError as error:
                reply_error(query, ProtocolError("internal", str(error)))
