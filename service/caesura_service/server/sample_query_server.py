"""Answers queries for the samples of sessions, in a separate thread.

The first read of a long session takes seconds. Neither the worker nor other queries wait for it: stations are
served in turn, in slices. The queue is bounded; beyond it a query is refused as `overloaded`. An instance
answers for the sessions in its memory, as for snapshots, and for stored ones of the stations that it owns.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import parse_samples_parameters, parse_session_key
from caesura_protocol.messages import RecordedSamples
from caesura_protocol.token_bucket import LOG_RATE, RateLimit
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.decimation import SampleReader
from caesura_service.decimation.reader import SLICE_S, Owned
from caesura_service.journal import JournalError, Key
from caesura_service.ownership.session_index import SessionIndex
from caesura_service.ownership.station_ownership import StationOwnership
from caesura_service.publishing.events import Owner
from caesura_service.publishing.session_state import SessionState
from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.outbound import (
    FAILED,
    reply_error,
    reply_in_takeover,
    reply_message,
    reply_nothing,
)
from caesura_service.server.query_server import too_many_waiting
from caesura_service.server.work_queue import QueueSettings, WorkQueue

logger = logging.getLogger(__name__)

QUERIES = 64  # that may wait; a quarter of them of one station
TICK_S = 0.1
LOOK_S = 1.0  # between two looks for sessions that have ended


class SampleServer(BackgroundThread):
    """Answers queries for samples while the context lasts."""

    def __init__(
        self,
        reader: SampleReader,
        index: Callable[[], SessionIndex],
        owner: Owner,
        ownership: StationOwnership,
    ) -> None:
        """index: the sessions of this instance; ownership: its stations."""
        self._owner, self._ownership = owner, ownership
        self._reader, self._index, self._clock = reader, index, time.monotonic
        self._open: set[Key] = set()  # at the last look
        self._ended: set[Key] = set()  # since they were open; their overviews are not made yet
        self._looks_at = 0.0  # [s]
        self._log_rate = RateLimit(LOG_RATE)
        self._queue: WorkQueue[tuple[IncomingQuery, str, str]] = WorkQueue(QueueSettings(capacity=QUERIES))
        super().__init__("caesura-samples", self._queue.wake)

    def enqueue(self, query: IncomingQuery, lane: str) -> ProtocolError | None:
        """Enqueue a query; return the refusal if too many of the lane are queued.

        Called by the network's threads.
        """
        try:
            station, session, _ = parse_session_key(query.key)
        except ProtocolError as error:  # a wildcard: of all sessions it would be too much
            with query:
                reply_error(query, error)
            return None
        return None if self._queue.offer((query, station, session), lane) else too_many_waiting(lane)

    def _run(self) -> None:
        while not self._stopped.is_set():
            if (found := self._queue.get(TICK_S)) is None:
                self._prepare()
                continue
            began = self._clock()
            try:
                self._step(*found)
            except Exception:
                if self._log_rate.allows(found[1]):
                    logger.exception("a query for samples of %s/%s was not answered", *found[1:])
            self._queue.charge(self._clock() - began)

    def _prepare(self) -> None:
        """Make the overview of a closed session in advance, so that no reader waits for it."""
        if not self._ended and self._clock() < self._looks_at:
            return
        self._looks_at = self._clock() + LOOK_S
        states = {(one.station, one.session): one for one in self._index().all_states()}
        self._ended |= {key for key in self._open & states.keys() if not states[key].is_open}
        self._ended &= states.keys()
        self._open = {key for key, one in states.items() if one.is_open}
        for key in sorted(self._ended)[:1]:
            try:
                is_made = self._reader.advance(_owned(states[key]))
            except (ProtocolError, JournalError) as error:
                is_made = True
                if self._log_rate.allows(key[0]):
                    logger.warning("no overview of %s: %s", "/".join(key), error)
            except Exception:  # the first query for it makes it
                is_made = True
                if self._log_rate.allows(key[0]):
                    logger.exception("no overview of %s", "/".join(key))
            if is_made:
                self._ended.discard(key)

    def _step(self, query: IncomingQuery, station: str, session: str) -> None:
        """Answer a query, or read a part of its session, and then let other stations continue."""
        try:
            owned = self._owned(station, session)
            reply = None if owned is None else self._reply(owned, query.parameters)
        except JournalError as error:
            with query:
                reply_error(query, ProtocolError("internal", str(error)))
            return
        except Exception:
            with query:
                reply_error(query, FAILED)
            raise
        if owned is None:
            with query:
                if self._ownership.in_takeover(station):
                    reply_in_takeover(query, station, self._owner.instance)
                else:
                    reply_nothing(query, self._owner.instance)  # another instance may have it
            return
        if reply is None and self._queue.put((query, station, session), station):
            return
        with query:
            if isinstance(reply, RecordedSamples):
                reply_message(query, query.key, reply)
            else:
                reply_error(query, reply or ProtocolError("overloaded", "too many queries for samples"))

    def _reply(self, owned: Owned, parameters: str) -> RecordedSamples | ProtocolError | None:
        """Return the answer or the refusal; None if more of the session must be read first.

        Raises JournalError.
        """
        try:
            wanted = parse_samples_parameters(parameters)
            return self._reader.read(owned, wanted, SLICE_S)
        except ProtocolError as error:
            return error

    def _owned(self, station: str, session: str) -> Owned | None:
        """Return the session, in memory or stored, if this instance owns its station; None otherwise.

        Raises JournalError.
        """
        for held in self._index().sessions.get(station, ()):
            if held.state.session == session:
                return _owned(held.state)
        if self._ownership.serves(station) and self._reader.has(station, session):
            return Owned(station, session, self._owner.instance, self._owner.epoch, is_open=False)
        return None


def _owned(state: SessionState) -> Owned:
    owner = state.owner
    return Owned(state.station, state.session, owner.instance, owner.epoch, state.is_open)
