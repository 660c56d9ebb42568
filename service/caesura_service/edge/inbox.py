"""The one queue between the network's threads and a thread that works.

Capacity and what is dropped: samples are dropped, newest first, when the queue is full in items or in bytes,
or when one source has taken its share of either, so that no source shuts the others out; the session finds
the hole by its number and asks again. Commands are never dropped: there is room for as many again, and past
that the caller is told, so that it can refuse them.

Overload is known before anything is dropped: from `overloaded_at` of the capacity, or of a source's share,
the queue or that source is pressed, until it has fallen to `relieved_at`. Where somebody announces it,
nothing is dropped until that is done; meanwhile there is room for as much again.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

T = TypeVar("T")

WHOLE = ""  # among what is pressed: the queue itself
DROPPING_SOURCES = 1024  # told apart between two looks at what was dropped; further ones count in the total


@dataclass(frozen=True)
class QueueSettings:
    """How much may wait. Raises ValueError for marks that are no shares in order."""

    capacity: int = 4096  # items; commands have as much again
    capacity_bytes: int = 1 << 28
    shares: int = 4  # one source may take one part in so many
    overloaded_at: float = 0.625  # more than the answers to all questions under way, which are no overload
    relieved_at: float = 0.25

    def __post_init__(self) -> None:
        if not 0.0 <= self.relieved_at < self.overloaded_at <= 1.0:
            marks = f"relieved_at {self.relieved_at:g}, overloaded_at {self.overloaded_at:g}"
            raise ValueError(f"{marks}: expected 0 ≤ relieved_at < overloaded_at ≤ 1")


class _Load:
    """What waits of one source, or of all of them, and how much of that may."""

    __slots__ = ("items", "most", "most_bytes", "size", "source")

    def __init__(self, source: str, most: float, most_bytes: float) -> None:
        self.source, self.most, self.most_bytes = source, most, most_bytes
        self.items = self.size = 0  # size [bytes]

    def has_room(self, size: int, room: float) -> bool:
        """For one more of that size? room: 1, or 2 where twice as much may wait as otherwise."""
        return self.items < room * self.most and self.size + size <= room * self.most_bytes

    def filling(self) -> float:
        """1 and more is full."""
        share, share_bytes = self.items / self.most, self.size / self.most_bytes
        return share if share > share_bytes else share_bytes


class Inbox(Generic[T]):
    """Bounded, first in first out; nothing but `get` ever waits."""

    def __init__(self, settings: QueueSettings, *, announced: bool = False) -> None:
        """announced: does somebody watch `changed` and call `has_announced`?"""
        self.capacity = settings.capacity
        self.overloaded_at = settings.overloaded_at
        self.dropped = 0
        self.pressed: frozenset[str] = frozenset()  # sources, and WHOLE; replaced, never changed
        self.changed = threading.Event()  # what is pressed has changed
        self.news = 0  # counts changes of what is pressed, and drops
        self._settings = settings
        # With what it counts for, if for anything, and its size [bytes].
        self._queue: SimpleQueue[tuple[T, _Load | None, int] | None] = SimpleQueue()
        self._total = _Load(WHOLE, settings.capacity, settings.capacity_bytes)
        self._of_source: dict[str, _Load] = {}  # of whom something waits
        self._drops: dict[str, int] = {}
        self._announced = announced
        self._is_told = not announced
        self._lock = threading.Lock()

    def offer(self, item: T, source: str, size: int = 0) -> bool:
        """Enqueue an item that may be dropped. False where it was, which is counted."""
        with self._lock:
            room = 1.0 if self._is_told else 2.0
            mine = self._of_source.get(source) or self._share_of(source)
            self._total.items = self._queue.qsize()
            if not (self._total.has_room(size, room) and mine.has_room(size, room)):
                self._drop(source)
                return False
            self._of_source[source] = mine
            self._account(mine, 1, size)
            self._queue.put((item, mine, size))
        return True

    def turn_away(self, source: str) -> None:
        """Count an item that was dropped on its way here."""
        with self._lock:
            self._drop(source)

    def insist(self, item: T) -> bool:
        """Enqueue an item that is not dropped. False only where even its own room is used up."""
        if self._queue.qsize() >= 2 * self.capacity:
            return False
        self.deliver(item)
        return True

    def deliver(self, item: T) -> None:
        """Enqueue an item that its own cause bounds, like the end of one of a few questions."""
        self._queue.put((item, None, 0))

    def get(self, timeout_s: float) -> T | None:
        """The next item; None if there is none in time, or if somebody called `wake`."""
        try:
            entry = self._queue.get(timeout=timeout_s)
        except Empty:
            return None
        if entry is None:
            return None
        item, load, size = entry
        if load is not None:
            with self._lock:
                self._account(load, -1, -size)
        return item

    def wake(self) -> None:
        """Let a waiting `get` return, once what lies before this is taken."""
        self._queue.put(None)

    def __len__(self) -> int:
        return self._queue.qsize()

    # --- overload ---------------------------------------------------------------------------------------

    def is_pressed(self, *sources: str) -> bool:
        """Is one of the sources, or the queue as a whole, overloaded?"""
        return not self.pressed.isdisjoint((WHOLE, *sources))

    def has_announced(self) -> None:
        """Whoever listens has been told of the overload: from here on, what is too much is dropped."""
        self._is_told = True

    def fill(self) -> float:
        """How full the queue is, or the share that is fullest: 1 and more is full."""
        with self._lock:
            self._total.items = self._queue.qsize()
            return max(load.filling() for load in (self._total, *self._of_source.values()))

    def take_drops(self) -> Mapping[str, int]:
        """What was dropped of each source since the last call."""
        with self._lock:
            drops, self._drops = self._drops, {}
        return drops

    # --- under the lock ---------------------------------------------------------------------------------

    def _share_of(self, source: str) -> _Load:
        """Nothing so far."""
        shares = self._settings.shares
        return _Load(source, self.capacity / shares, self._settings.capacity_bytes / shares)

    def _drop(self, source: str) -> None:
        self.dropped += 1
        self.news += 1
        if source in self._drops or len(self._drops) < DROPPING_SOURCES:
            self._drops[source] = self._drops.get(source, 0) + 1

    def _account(self, mine: _Load, items: int, size: int) -> None:
        """One more waits, or one less."""
        mine.items += items
        mine.size += size
        self._total.size += size
        if not mine.items:
            del self._of_source[mine.source]
        self._total.items = self._queue.qsize() + max(items, 0)  # commands too, and what is about to be put
        self._press(self._total)
        self._press(mine)

    def _press(self, load: _Load) -> None:
        """Note where the mark is passed, and where what was pressed is relieved."""
        source, filling = load.source, load.filling()
        if source in self.pressed:
            changes = filling <= self._settings.relieved_at
        else:
            changes = filling >= self._settings.overloaded_at
        if not changes:
            return
        if not self.pressed:
            self._is_told = not self._announced
        self.pressed ^= {source}
        self.news += 1
        self.changed.set()
