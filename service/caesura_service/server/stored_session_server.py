"""Answers queries for stored sessions, in a separate thread, one page of the journal at a time.

The thread works for a fifth of the time, however many clients ask: within that, lanes take turns. A query
for which its lane has no room, or that has waited for PATIENCE_S, is refused with the time after which to ask
again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import StoredPage, session_key
from caesura_protocol.token_bucket import Rate
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.journal import JournalError, Key
from caesura_service.ownership.stored_sessions import StoredSessions
from caesura_service.server.answering_thread import AnsweringThread, Pace
from caesura_service.server.inbound_events import UNKNOWN, session_of_query
from caesura_service.server.outbound import answering, reply_error, reply_message, reply_nothing

QUERIES = 64  # that may wait; a quarter of them in one lane
# [s] of the thread's processor time; 0.1 s is a page of sessions of some minutes.
LISTING_RATE = Rate(0.2, 0.1)
# Behind the lane of a refused list: other queries of the lane are not dropped with it. Refused lists share
# one rate of reasons.
LISTING = "/stored"
PATIENCE_S = 5.0  # that a query waits


class StoredSessionServer(AnsweringThread):
    """Answers queries for stored sessions while the context lasts."""

    def __init__(
        self, stored: StoredSessions, instance: str, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._instance, self._stored, self._clock = instance, stored, clock
        self._waited_s = 0.0  # [s] of the query that was begun last
        super().__init__("caesura-stored", QUERIES, Pace(LISTING_RATE))

    def enqueue(self, query: IncomingQuery, lane: str, wanted: StoredPage) -> ProtocolError | None:
        """Enqueue a query; return the refusal if too many of the lane are queued."""
        if self._queue.offer((query, self._answer(query, lane, wanted, self._clock())), lane):
            return None
        return self._refusal()

    def _refusal(self) -> ProtocolError:
        again_s = math.ceil(max(1.0, self._waited_s))
        why = f"too many lists of stored sessions are asked for: ask again in {again_s} s"
        return ProtocolError("overloaded", why, value=round(self._waited_s, 1), limit=PATIENCE_S)

    def _answer(self, query: IncomingQuery, lane: str, wanted: StoredPage, asked: float) -> Iterator[None]:
        """Reply with a page; yield after each session, and while others are skipped. asked: time [s]."""
        with answering(query):
            self._waited_s = self._clock() - asked
            if self._waited_s > PATIENCE_S:
                reply_error(query, self._refusal())
                return
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


def is_listing(query: IncomingQuery) -> bool:
    """Whether a query asks for stored sessions."""
    return query.parameters.startswith("stored=")


def _filter_of(query: IncomingQuery, station: str | None, session: str | None) -> Callable[[Key], bool]:
    """Return which of the sessions with these names a query requests: most queries request all of them."""
    if query.key == session_key(station or "*", session or "*", "snapshot"):
        return lambda _key: True
    return lambda key: query.matches(session_key(*key, "snapshot"))
