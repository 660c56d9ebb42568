"""What arrives, and the one queue it arrives in.

Rule 1: whoever receives from the network only enqueues; work happens in the thread that calls `get`. A slow
callback inside the network library delays every other subscriber of the process.
Rule 2: an inbox holds `capacity` items. When it is full the oldest is dropped and counted: readers of results
find the hole by its sequence number, and a question that is dropped is refused as `overloaded`.
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


class Delivery(NamedTuple):
    """A payload that was put on a key, or that answered a query."""

    key: str
    payload: bytes
    encoding: str


class Presence(NamedTuple):
    """A liveliness token appeared or went."""

    key: str
    alive: bool


class Question(Protocol):
    """A query that waits for its answer. Leaving it as a context manager ends it for the asker."""

    @property
    def key(self) -> str:
        """The key that was asked, which may hold wildcards."""

    @property
    def parameters(self) -> str:
        """What followed the `?`."""

    @property
    def content(self) -> Encoded | None:
        """The payload of the question."""

    def reply(self, key: str, answer: Encoded) -> None:
        """Send one answer; there may be several."""

    def refuse(self, error: Encoded) -> None:
        """Send a refusal."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


Item = Delivery | Presence | Question


class Inbox:
    """A bounded queue between the network and one consumer; safe between threads."""

    def __init__(self, capacity: int = DEFAULT_CAPACITY) -> None:
        self.capacity = capacity
        self.dropped = 0
        self._items: deque[Item] = deque()
        self._changed = threading.Condition()

    def offer(self, item: Item) -> None:
        """Enqueue an item; drops the oldest where the inbox is full. Never blocks."""
        with self._changed:
            oldest = self._items.popleft() if len(self._items) >= self.capacity else None
            self._items.append(item)
            self.dropped += oldest is not None
            self._changed.notify()
        if oldest is not None and not isinstance(oldest, Delivery | Presence):
            self._refuse(oldest)

    def get(self, timeout_s: float) -> Item | None:
        """The oldest item, or None where none came in time."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while not self._items:
                remaining = deadline - time.monotonic()
                if remaining <= 0.0:
                    return None
                self._changed.wait(remaining)
            return self._items.popleft()

    def __len__(self) -> int:
        return len(self._items)

    def _refuse(self, question: Question) -> None:
        full = ProtocolError("overloaded", "too many questions at once", limit=self.capacity)
        with question:
            question.refuse(encode_error(full))
