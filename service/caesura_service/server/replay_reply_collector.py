"""Joins the replies to a replay into blocks of consecutive batches, which cost less than single batches."""

from __future__ import annotations

import threading
from collections.abc import Callable

from caesura_service.server.inbound_events import RawPayload
from caesura_service.sessions.same_layout_batches import ENCODING, BatchBlock, BatchLayout

MOST = 16  # batches of a block


class ReplayBlocks:
    """The replies to one replay, in order. Any thread may call it."""

    def __init__(
        self, pass_on: Callable[[RawPayload], None], pass_on_block: Callable[[BatchBlock], None]
    ) -> None:
        """pass_on: processes a reply without a `BatchLayout`; pass_on_block: processes several batches."""
        self._pass_on, self._pass_on_block = pass_on, pass_on_block
        self._layout: BatchLayout | None = None
        self._first, self._payloads = 0, list[bytes]()
        self._lock = threading.Lock()

    def receive(self, reply: RawPayload) -> None:
        """Add a reply, to pass it on with those that follow."""
        with self._lock:
            if not self._follows(reply):
                self._pass_on_waiting()
                self._layout = layout = BatchLayout.of(reply.payload) if reply.encoding == ENCODING else None
                if layout is None:
                    self._pass_on(reply)
                    return
                self._first = layout.message.seq
            self._payloads.append(reply.payload)
            if len(self._payloads) >= MOST:
                self._pass_on_waiting()

    def end(self) -> None:
        """Pass on the replies that are left."""
        with self._lock:
            self._pass_on_waiting()

    def _follows(self, reply: RawPayload) -> bool:
        layout = self._layout
        if layout is None or reply.encoding != ENCODING:
            return False
        return layout.seq_of(reply.payload) == self._first + len(self._payloads)

    def _pass_on_waiting(self) -> None:
        payloads, self._payloads = self._payloads, []
        if payloads and self._layout is not None:
            self._pass_on_block(BatchBlock(self._layout, self._first, payloads))
            self._first += len(payloads)
