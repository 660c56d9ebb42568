"""Answers the service's replay requests in a separate thread, because a close may wait for them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

from caesura_clients.bridge.query_responder import QueryThread
from caesura_clients.bridge.replay_ring import ReplayRing
from caesura_protocol.codec import encode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import parse_replay_parameters, station_key
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_protocol.transport.transport_interface import Transport

FORGOTTEN_S = 3.0  # a service that misses a batch asks for it several times in that


class _Missing(NamedTuple):
    """The batch that the service requested last, and the times of its first and last request [s]."""

    seq: int
    since: float
    asked: float


class ReplayServer(QueryThread):
    """Queryable on a station's `replay` key: it replies with every batch of the range, in order."""

    def __init__(
        self,
        transport: Transport,
        station: str,
        session: str,
        ring: ReplayRing,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.answered = 0  # batches sent again
        self._clock = clock
        self._missing = _Missing(-1, 0.0, -FORGOTTEN_S)
        self._session = session
        self._ring = ring
        super().__init__(transport, station_key(station, "replay"), self._answer)

    @property
    def stuck_s(self) -> float:
        """The time [s] for which the service has requested the same batch; 0 if it no longer does."""
        _, since, asked = self._missing
        return asked - since if self._clock() - asked < FORGOTTEN_S else 0.0

    def _asked(self, seq: int) -> None:
        now, (before, since, asked) = self._clock(), self._missing
        goes_on = seq == before and now - asked < FORGOTTEN_S
        self._missing = _Missing(seq, since if goes_on else now, now)

    def _answer(self, question: IncomingQuery) -> None:
        try:
            requested = parse_replay_parameters(question.parameters)
            if requested.session not in {"", self._session}:
                why = "the bridge has another session"
                raise ProtocolError("unknown_session", why, value=requested.session, expected=self._session)
            self._asked(requested.first)
            entries = self._ring.sent_range(requested)
        except ProtocolError as error:
            question.refuse(encode_error(error))
            return
        for entry in entries:
            question.reply(self.key, entry.content)
        self.answered += len(entries)
