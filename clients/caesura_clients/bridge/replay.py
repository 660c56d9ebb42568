"""Answers the service's requests for batches in a thread of its own, because a close may wait for them."""

from __future__ import annotations

from caesura_clients.bridge.query_thread import QueryThread
from caesura_clients.bridge.ring import ReplayRing
from caesura_protocol.codec import encode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import parse_replay_parameters, station_key
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_protocol.transport.network import Transport


class ReplayServer(QueryThread):
    """The `replay` key of a station: every batch of the range is one reply, in order."""

    def __init__(self, transport: Transport, station: str, session: str, ring: ReplayRing) -> None:
        self.answered = 0  # batches sent again
        self._session = session
        self._ring = ring
        super().__init__(transport, station_key(station, "replay"), self._answer)

    def _answer(self, question: IncomingQuery) -> None:
        try:
            requested = parse_replay_parameters(question.parameters)
            if requested.session not in {"", self._session}:
                why = "the bridge has another session"
                raise ProtocolError("unknown_session", why, value=requested.session, expected=self._session)
            entries = self._ring.sent_range(requested)
        except ProtocolError as error:
            question.refuse(encode_error(error))
            return
        for entry in entries:
            question.reply(self.key, entry.content)
        self.answered += len(entries)
