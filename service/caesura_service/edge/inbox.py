"""The one queue between the network's threads and a thread that works.

Capacity and what is dropped: samples are dropped, newest first, when the queue is full in items or in bytes,
or when one source has taken its share of either, so that no source shuts the others out; the session finds
the hole by its number and asks again. Commands are never dropped: there is room for as many again, and past
that the caller is told, so that it can refuse them.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class QueueSettings:
    """How much may wait."""

    capacity: int = 4096  # items; commands have as much again
    capacity_bytes: int = 1 << 28
    shares: int = 4  # one source may take one part in so many


class _Load(NamedTuple):
    items: int
    size: int  # [bytes]


class _Entry(NamedTuple, Generic[T]):
    item: T
    source: str | None  # None: does not count
    size: int  # [bytes]


class Inbox(Generic[T]):
    """Bounded, first in first out; nothing but `get` ever waits."""

    def __init__(self, settings: QueueSettings) -> None:
        self.capacity = settings.capacity
        self.dropped = 0
        self._settings = settings
        self._queue: SimpleQueue[_Entry[T] | None] = SimpleQueue()
        self._total = _Load(0, 0)
        self._of_source: dict[str, _Load] = {}
        self._lock = threading.Lock()

    def offer(self, item: T, source: str, size: int = 0) -> bool:
        """Enqueue an item that may be dropped. False where it was, which is counted."""
        with self._lock:
            if not self._has_room(source, size):
                self.dropped += 1
                return False
            self._account(source, 1, size)
            self._queue.put(_Entry(item, source, size))
        return True

    def insist(self, item: T) -> bool:
        """Enqueue an item that is not dropped. False only where even its own room is used up."""
        if self._queue.qsize() >= 2 * self.capacity:
            return False
        self.deliver(item)
        return True

    def deliver(self, item: T) -> None:
        """Enqueue an item that its own cause bounds, like the end of one of a few questions."""
        self._queue.put(_Entry(item, None, 0))

    def get(self, timeout_s: float) -> T | None:
        """The next item; None if there is none in time, or if somebody called `wake`."""
        try:
            entry = self._queue.get(timeout=timeout_s)
        except Empty:
            return None
        if entry is None:
            return None
        if entry.source is not None:
            with self._lock:
                self._account(entry.source, -1, -entry.size)
        return entry.item

    def wake(self) -> None:
        """Let a waiting `get` return, once what lies before this is taken."""
        self._queue.put(None)

    def __len__(self) -> int:
        return self._queue.qsize()

    def _has_room(self, source: str, size: int) -> bool:
        limits, mine = self._settings, self._of_source.get(source, _Load(0, 0))
        return (
            self._queue.qsize() < limits.capacity
            and mine.items < limits.capacity / limits.shares
            and self._total.size + size <= limits.capacity_bytes
            and mine.size + size <= limits.capacity_bytes / limits.shares
        )

    def _account(self, source: str, items: int, size: int) -> None:
        mine = self._of_source.get(source, _Load(0, 0))
        self._total = _Load(self._total.items + items, self._total.size + size)
        self._of_source[source] = _Load(mine.items + items, mine.size + size)
        if not self._of_source[source].items:
            del self._of_source[source]
