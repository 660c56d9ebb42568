"""Answers the queries of one key in a separate thread, one after the other."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Self

from caesura_protocol.errors import CaesuraError
from caesura_protocol.transport.inbox import Inbox, IncomingQuery, ReceivedSample, TokenChange
from caesura_protocol.transport.transport_interface import Transport

QUERIES = 64  # that may wait; more are refused as overloaded
TICK_S = 0.1


class QueryThread:
    """Calls `answer` with every query on `key` while the context lasts."""

    def __init__(self, transport: Transport, key: str, answer: Callable[[IncomingQuery], None]) -> None:
        self.key = key
        self._transport = transport
        self._answer_query = answer
        self._inbox = Inbox(QUERIES)
        self._stopped = threading.Event()
        self.thread = threading.Thread(target=self._serve, name=key, daemon=True)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self.thread.start()
            stack.callback(self.thread.join)
            stack.callback(self._stopped.set)
            stack.enter_context(self._transport.declare_queryable(self.key, self._inbox))
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
                    self._answer_query(item)
            except CaesuraError:
                continue  # the asker or the network has gone; the asker repeats its query
