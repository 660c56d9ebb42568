"""The one queue between the network's threads and a thread that works.

Capacity and what is dropped: samples are dropped, newest first, when the queue is full or when one source
has taken its share of it, so that no source shuts the others out; the session finds the hole by its number
and asks again. Commands are never dropped: there is room for as many again, and past that the caller is
told, so that it can refuse them.
"""

from __future__ import annotations

import threading
from collections import Counter
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

T = TypeVar("T")


class Inbox(Generic[T]):
    """Bounded, first in first out; `offer` and `insist` never wait."""

    def __init__(self, capacity: int, share: int | None = None) -> None:
        """capacity: items; share: of them, how many one source may have waiting."""
        self.capacity = capacity
        self.dropped = 0
        self._share = share or capacity
        self._queue: SimpleQueue[tuple[str | None, T] | None] = SimpleQueue()
        self._waiting: Counter[str] = Counter()
        self._lock = threading.Lock()

    def offer(self, item: T, source: str) -> bool:
        """Enqueue an item that may be dropped. False where it was, which is counted."""
        with self._lock:
            if self._queue.qsize() >= self.capacity or self._waiting[source] >= self._share:
                self.dropped += 1
                return False
            self._waiting[source] += 1
            self._queue.put((source, item))
        return True

    def insist(self, item: T) -> bool:
        """Enqueue an item that is not dropped. False only where even its own room is used up."""
        if self._queue.qsize() >= 2 * self.capacity:
            return False
        self._queue.put((None, item))
        return True

    def get(self, timeout_s: float) -> T | None:
        """The next item; None if there is none in time, or if somebody called `wake`."""
        try:
            entry = self._queue.get(timeout=timeout_s)
        except Empty:
            return None
        if entry is None:
            return None
        source, item = entry
        if source is not None:
            with self._lock:
                self._waiting[source] -= 1
                if not self._waiting[source]:
                    del self._waiting[source]
        return item

    def wake(self) -> None:
        """Let a waiting `get` return, once what lies before this is taken."""
        self._queue.put(None)

    def __len__(self) -> int:
        return self._queue.qsize()
