"""Received items, and the bounded queue that holds them.

Rule 1: a callback that receives from the network only enqueues; work happens in the thread that calls `get`.
A slow callback inside the network library delays every other subscriber of the process.

Rule 2: an inbox holds `capacity` items and `capacity_bytes` of payloads. When it is full the oldest are
dropped and counted: readers of results detect the gap by sequence numbers, and a dropped query is refused as
`overloaded`.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from types import TracebackType
from typing import NamedTuple, Protocol, Self

from caesura_protocol.codec import Encoded, encode_error
from caesura_protocol.errors import ProtocolError

DEFAULT_CAPACITY = 4096
CAPACITY_BYTES = 1 << 26  # of payloads; one item may always stay


class ReceivedSample(NamedTuple):
    """A payload that was published on a key, or that answered a query."""

    key: str
    payload: bytes
    encoding: str


class TokenChange(NamedTuple):
    """A liveliness token appeared or disappeared."""

    key: str
    alive: bool


class IncomingQuery(Protocol):
    """A query that waits for its replies. Leaving its context ends the query for the client."""

    @property
    def key(self) -> str:
        """The key of the query, which may contain wildcards."""

    @property
    def parameters(self) -> str:
        """The parameters of the query, after its `?`."""

    @property
    def content(self) -> Encoded | None:
        """The payload of the query."""

    def reply(self, key: str, answer: Encoded) -> None:
        """Send one reply; there may be several."""

    def refuse(self, error: Encoded) -> None:
        """Send a refusal."""

    def matches(self, key: str) -> bool:
        """Return whether the key of the query intersects another."""

    def drop(self) -> None:
        """End the query for the client."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


Item = ReceivedSample | TokenChange | IncomingQuery


class Inbox:
    """A bounded queue between the network and one consumer. Thread-safe."""

    def __init__(self, capacity: int = DEFAULT_CAPACITY, capacity_bytes: int = CAPACITY_BYTES) -> None:
        self.capacity = capacity
        self.capacity_bytes = capacity_bytes
        self.dropped = 0
        self._items: deque[Item] = deque()
        self._bytes = 0
        self._changed = threading.Condition()

    def offer(self, item: Item) -> None:
        """Enqueue an item; drop the oldest if the inbox is full. Never blocks."""
        dropped: list[Item] = []
        with self._changed:
            while self._items and self._is_full(item):
                dropped.append(self._pop())
            self._items.append(item)
            self._bytes += _size(item)
            self.dropped += len(dropped)
            self._changed.notify()
        for oldest in dropped:
            if not isinstance(oldest, ReceivedSample | TokenChange):
                self._refuse(oldest)

    def get(self, timeout_s: float) -> Item | None:
        """Return the oldest item, or None if none arrived within the timeout."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while not self._items:
                remaining = deadline - time.monotonic()
                if remaining <= 0.0:
                    return None
                self._changed.wait(remaining)
            return self._pop()

    def __len__(self) -> int:
        return len(self._items)

    def _is_full(self, item: Item) -> bool:
        return len(self._items) >= self.capacity or self._bytes + _size(item) > self.capacity_bytes

    def _pop(self) -> Item:
        item = self._items.popleft()
        self._bytes -= _size(item)
        return item

    def _refuse(self, question: IncomingQuery) -> None:
        full = ProtocolError("overloaded", "too many questions at once", limit=self.capacity)
        with question:
            question.refuse(encode_error(full))


def _size(item: Item) -> int:
    """Return the size [bytes] of those parts of an item whose length its sender chose."""
    if isinstance(item, ReceivedSample):
        return len(item.payload) + len(item.key)
    if isinstance(item, TokenChange):
        return len(item.key)
    return len(item.parameters) + (len(item.content.payload) if item.content else 0)
