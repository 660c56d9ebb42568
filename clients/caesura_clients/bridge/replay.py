"""Answers the service's requests for batches in a thread of its own, because a close may wait for them."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from types import TracebackType
from typing import Self

from caesura_clients.bridge.ring import ReplayRing
from caesura_protocol.codec import encode_error
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.keys import parse_replay_parameters, station_key
from caesura_protocol.transport.inbox import Inbox, IncomingQuery, ReceivedSample, TokenChange
from caesura_protocol.transport.network import Transport

QUESTIONS = 64  # that may wait; more are refused as overloaded
TICK_S = 0.1


class ReplayServer:
    """The `replay` key of a station: every batch of the range is one reply, in order."""

    def __init__(self, transport: Transport, station: str, session: str, ring: ReplayRing) -> None:
        self.answered = 0  # batches sent again
        self._session = session
        self._transport = transport
        self._key = station_key(station, "replay")
        self._ring = ring
        self._inbox = Inbox(QUESTIONS)
        self._stopped = threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            thread = threading.Thread(target=self._serve, name=self._key, daemon=True)
            thread.start()
            stack.callback(thread.join)
            stack.callback(self._stopped.set)
            stack.enter_context(self._transport.declare_queryable(self._key, self._inbox))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def _serve(self) -> None:
        while not self._stopped.is_set():
            item = self._inbox.get(TICK_S)
            if item is None or isinstance(item, ReceivedSample | TokenChange):
                continue
            try:
                with item:
                    self._answer(item)
            except CaesuraError:
                continue  # the asker or the network has gone; it will ask again

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
            question.reply(self._key, entry.content)
        self.answered += len(entries)
