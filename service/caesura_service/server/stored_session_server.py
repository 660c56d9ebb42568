"""Answers queries for stored sessions, in a separate thread, one page of the journal at a time."""

from __future__ import annotations

from collections.abc import Iterator

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import StoredPage, session_key
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.journal import JournalError
from caesura_service.ownership.stored_sessions import StoredSessions
from caesura_service.server.answering_thread import AnsweringThread
from caesura_service.server.inbound import UNKNOWN
from caesura_service.server.outbound import answering, reply_error, reply_message, reply_nothing

QUERIES = 64  # that may wait; a quarter of them in one lane


class StoredSessionServer(AnsweringThread):
    """Answers queries for stored sessions while the context lasts."""

    def __init__(self, stored: StoredSessions, instance: str) -> None:
        self._instance, self._stored = instance, stored
        super().__init__("caesura-stored", QUERIES)

    def take(self, query: IncomingQuery, lane: str, wanted: StoredPage) -> bool:
        """Enqueue a query; return False if too many of the lane are queued."""
        return self._queue.offer((query, self._answer(query, lane, wanted)), lane)

    def _answer(self, query: IncomingQuery, lane: str, wanted: StoredPage) -> Iterator[None]:
        """Reply with a page; yield after each session."""
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
                    yield
                reply_nothing(query, self._instance, replies)
            except JournalError as error:
                reply_error(query, ProtocolError("internal", str(error)))
