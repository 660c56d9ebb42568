"""Answers queries for stored sessions, in a separate thread, one page of the journal at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import StoredPage, session_key
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.journal import JournalError, Key
from caesura_service.ownership.stored_sessions import StoredSessions
from caesura_service.server.answering_thread import AnsweringThread
from caesura_service.server.inbound_events import UNKNOWN, session_of_query
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
        """Reply with a page; yield after each session, and while others are passed over."""
        with answering(query):
            try:
                names = None if lane == UNKNOWN else lane, session_of_query(query.key)
                replies = 0
                for snapshot in self._stored.page(_filter_of(query, *names), wanted, *names):
                    if snapshot is not None:
                        key = session_key(snapshot.status.station, snapshot.status.session, "snapshot")
                        replies += reply_message(query, key, snapshot)
                    yield
                reply_nothing(query, self._instance, replies)
            except JournalError as error:
                reply_error(query, ProtocolError("internal", str(error)))


def _filter_of(query: IncomingQuery, station: str | None, session: str | None) -> Callable[[Key], bool]:
    """Return which of the sessions with these names a query requests: most queries request all of them."""
    if query.key == session_key(station or "*", session or "*", "snapshot"):
        return lambda _key: True
    return lambda key: query.matches(session_key(*key, "snapshot"))
