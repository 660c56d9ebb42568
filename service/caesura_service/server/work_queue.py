"""The queue between the network's threads and a working thread, with a lane for each station.

Scheduling: start-time fair queueing (Goyal, Vin & Cheng 1996). Every lane has a virtual time, to which the
measured time of the work on its items is added; the lane with the least is next. An empty lane restarts at
the virtual time of the lane in service, so idle time earns no credit. So a station that causes more work than
its share waits, and the others do not wait for it. Lanes whose virtual times differ by less than `BURST_S`
are served in order of arrival. Otherwise a station after one long item would wait until no other has work.
Within a lane items keep their order.

Work that was put back to stand aside waits until no lane is due, or until another item arrives in its lane.

Capacity and drops: samples are dropped, newest first, when the queue is full in items or in bytes, or when
one source has used its share of either, so that no source blocks the others. The session detects the gap by
its number and requests the batches again. Commands are never dropped: the same capacity again is reserved for
them, `commands` per station, and the caller must refuse further ones.

Overload is detected before messages are dropped: from `overloaded_at` of the capacity, or of a source's
share, the queue or that source is overloaded, until its load has fallen to `relieved_at`. With an announcer
nothing is dropped until the overload is published; meanwhile the capacity is doubled.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from typing import Generic, TypeVar

T = TypeVar("T")

BURST_S = 0.1  # [s] of work that a lane may have had more than others: some long looks
WHOLE = ""  # among the overloaded sources: the queue itself
SOURCES = 1024  # whose drops are counted one by one; those of further ones count in the total alone


@dataclass(frozen=True)
class QueueSettings:
    """The limits of the work queue. Raises ValueError if its marks are not shares in rising order."""

    capacity: int = 4096  # items; commands have as much again
    capacity_bytes: int = 1 << 28
    shares: int = 4  # one source may take one part in so many
    commands: int = 64  # of one station
    overloaded_at: float = 0.625  # more than the answers to all questions under way, which are no overload
    relieved_at: float = 0.25

    def __post_init__(self) -> None:
        if not 0.0 <= self.relieved_at < self.overloaded_at <= 1.0:
            marks = f"relieved_at {self.relieved_at:g}, overloaded_at {self.overloaded_at:g}"
            raise ValueError(f"{marks}: expected 0 ≤ relieved_at < overloaded_at ≤ 1")


class _Load:
    """The queued items of one source, or of all, and their limits."""

    __slots__ = ("items", "mark", "mark_bytes", "most", "most_bytes", "size", "source")

    def __init__(self, source: str, settings: QueueSettings, parts: int = 1) -> None:
        """parts: the number of parts into which the capacity is divided."""
        self.source = source
        self.most, self.most_bytes = settings.capacity / parts, settings.capacity_bytes / parts
        self.mark, self.mark_bytes = (settings.overloaded_at * of for of in (self.most, self.most_bytes))
        self.items = self.size = 0  # size [bytes]

    def has_room(self, items: int, size: int, room: float) -> bool:
        """Return whether `items` more items of `size` bytes in all fit. room: a factor on the limits."""
        return self.items + items - 1 < room * self.most and self.size + size <= room * self.most_bytes

    def is_overloaded(self) -> bool:
        """Whether the load is at its mark or above."""
        return self.items >= self.mark or self.size >= self.mark_bytes

    def fill_ratio(self) -> float:
        """Return the filled share; 1 and more is full."""
        share, share_bytes = self.items / self.most, self.size / self.most_bytes
        return share if share > share_bytes else share_bytes


class _Lane(Generic[T]):
    """The queued items of one station, in order."""

    __slots__ = ("commands", "due", "items", "stands_aside")

    def __init__(self) -> None:
        # Each with what it counts for, if for anything, its size [bytes], and whether it is a command.
        # Where one stands for several, how many.
        self.items: deque[tuple[T, _Load | None, int, bool, int]] = deque()
        self.commands = 0
        self.due = 0.0  # [s] virtual time; its turn comes BURST_S earlier
        self.stands_aside = False  # its first item does


class WorkQueue(Generic[T]):
    """A bounded queue; only `get` blocks."""

    def __init__(self, settings: QueueSettings, *, announced: bool = False) -> None:
        """announced: whether an announcer waits for `overload_changed` and calls `confirm_announced`."""
        self.capacity = settings.capacity
        self.overloaded_at = settings.overloaded_at
        self.dropped = 0
        self.overloaded_sources: frozenset[str] = (
            frozenset()
        )  # with WHOLE for the queue; replaced, never mutated
        self.overload_changed = threading.Event()  # overloaded_sources has changed
        self.revision = 0  # counts changes of overloaded_sources, and drops
        self.settings = settings
        self._lanes: dict[str, _Lane[T]] = {}
        # A heap of the lanes that wait, but for the one in service.
        self._turns: list[tuple[float, int, _Lane[T]]] = []
        self._aside: dict[_Lane[T], None] = {}  # lanes that stand aside, in order
        self._served: _Lane[T] | None = None
        self._virtual_s, self._count = 0.0, count()
        self._waiting, self._woken = 0, False
        self._total = _Load(WHOLE, settings)
        self._of_source: dict[str, _Load] = {}
        self._drops: dict[str, int] = {}
        self._announced = announced
        self._is_announced = not announced
        self._lock = threading.Lock()
        self._arrived = threading.Condition(self._lock)

    def offer(self, item: T, source: str, size: int = 0, lane: str | None = None, *, count: int = 1) -> bool:
        """Enqueue an item; return False if it was dropped, which is counted.

        lane: by default the source's own. count: the number of messages in the item.
        """
        with self._lock:
            room = 1.0 if self._is_announced else 2.0
            load = self._of_source.get(source) or self._add_source(source)
            self._total.items = self._waiting
            if not (self._total.has_room(count, size, room) and load.has_room(count, size, room)):
                self._drop(source, count)
                return False
            load.items += count
            self._total.items += count
            self._account(load, size)
            self._enqueue(source if lane is None else lane, item, load, size, count=count)
        return True

    def count_drop(self, source: str, count: int = 1) -> None:
        """Count items that were dropped before they reached the queue."""
        with self._lock:
            self._drop(source, count)

    def put(self, item: T, lane: str = "") -> bool:
        """Enqueue an item with twice the capacity; return False if that is used up too."""
        with self._lock:
            if self._waiting >= 2 * self.capacity:
                return False
            self._enqueue(lane, item)
        return True

    def put_command(self, item: T, lane: str) -> bool:
        """Enqueue a command; return False if too many of the lane are queued."""
        with self._lock:
            known = self._lanes.get(lane)
            if self._waiting >= 2 * self.capacity or (known and known.commands >= self.settings.commands):
                return False
            self._enqueue(lane, item, command=True)
        return True

    def put_unbounded(self, item: T, lane: str = "") -> None:
        """Enqueue an item of which there is a bounded number, like the end of a replay."""
        with self._lock:
            self._enqueue(lane, item)

    def put_back(self, item: T, *, stands_aside: bool = False) -> None:
        """Put an item in front of the lane that `get` served last; it may stand aside for other lanes."""
        with self._lock:
            assert self._served is not None
            self._served.stands_aside = stands_aside
            self._served.items.appendleft((item, None, 0, False, 1))
            self._waiting += 1

    def get(self, timeout_s: float) -> T | None:
        """Return the next item; None after the timeout [s] or a call of `wake`."""
        with self._lock:
            self._end_turn()
            if not self._turns and not self._aside and not self._woken:
                self._arrived.wait(timeout_s)
            if self._turns:
                self._virtual_s, _, lane = heappop(self._turns)
            elif self._aside:
                lane = next(iter(self._aside))
                del self._aside[lane]
            else:
                self._woken = False
                return None
            self._served, lane.stands_aside = lane, False
            item, load, size, command, count = lane.items.popleft()
            lane.commands -= command
            self._waiting -= count
            self._total.items = self._waiting  # commands too
            if load is not None:
                load.items -= count
                self._account(load, -size)
            elif self.overloaded_sources:  # by what may lie behind the last sample
                self._update_overload(self._total)
        return item

    def charge(self, seconds: float) -> None:
        """Add the time [s] of the work on the last item to the virtual time of its lane."""
        if self._served is not None:  # no other thread reads its time before the next `get`
            self._served.due += seconds

    def wake(self) -> None:
        """Make a waiting `get` return once the queue is empty."""
        with self._arrived:
            self._woken = True
            self._arrived.notify()

    def __len__(self) -> int:
        return self._waiting

    # --- overload ---------------------------------------------------------------------------------------

    def is_overloaded(self, *sources: str) -> bool:
        """Whether one of the sources, or the queue as a whole, is overloaded."""
        return not self.overloaded_sources.isdisjoint((WHOLE, *sources))

    def confirm_announced(self) -> None:
        """Confirm that the overload is published: from now on, excess items are dropped."""
        self._is_announced = True

    def fill_ratio(self) -> float:
        """Return the filled share of the queue or of its fullest source; 1 and more is full."""
        with self._lock:
            self._total.items = self._waiting
            return max(load.fill_ratio() for load in (self._total, *self._of_source.values()))

    def pop_drops(self) -> Mapping[str, int]:
        """Return the number of drops of each source since the last call."""
        with self._lock:
            drops, self._drops = self._drops, {}
        return drops

    # --- under the lock ---------------------------------------------------------------------------------

    def _enqueue(
        self,
        name: str,
        item: T,
        load: _Load | None = None,
        size: int = 0,
        *,
        command: bool = False,
        count: int = 1,
    ) -> None:
        lane = self._lanes.get(name) or self._new_lane(name)
        lane.items.append((item, load, size, command, count))
        lane.commands += command
        self._waiting += count
        if lane is not self._served and (len(lane.items) == 1 or lane in self._aside):
            self._aside.pop(lane, None)
            self._queue(lane)
            self._arrived.notify()

    def _queue(self, lane: _Lane[T]) -> None:
        """Schedule a lane at the current virtual time at the earliest: idle time earns no credit."""
        lane.due = max(lane.due, self._virtual_s)
        heappush(self._turns, (max(lane.due - BURST_S, self._virtual_s), next(self._count), lane))

    def _end_turn(self) -> None:
        lane, self._served = self._served, None
        if lane is None or not lane.items:
            return
        if lane.stands_aside and len(lane.items) == 1:
            self._aside[lane] = None
        else:
            self._queue(lane)

    def _new_lane(self, name: str) -> _Lane[T]:
        """Make a lane; beyond SOURCES empty ones are evicted."""
        if len(self._lanes) >= SOURCES:
            kept = {key: one for key, one in self._lanes.items() if one.items or one is self._served}
            self._lanes = kept
        lane = self._lanes[name] = _Lane()
        return lane

    def _add_source(self, source: str) -> _Load:
        """Return the load of a source without queued messages; there are at most SOURCES of them."""
        if len(self._of_source) >= SOURCES:
            self._of_source = {name: load for name, load in self._of_source.items() if load.items}
        load = self._of_source[source] = _Load(source, self.settings, self.settings.shares)
        return load

    def _drop(self, source: str, count: int = 1) -> None:
        self.dropped += count
        self.revision += 1
        if source in self._drops or len(self._drops) < SOURCES:
            self._drops[source] = self._drops.get(source, 0) + count

    def _account(self, load: _Load, size: int) -> None:
        """Add to the queued bytes and update the overload."""
        load.size += size
        self._total.size += size
        if self.overloaded_sources or self._total.is_overloaded() or load.is_overloaded():
            self._update_overload(self._total)
            self._update_overload(load)

    def _update_overload(self, load: _Load) -> None:
        """Mark a source as overloaded at its mark, and as relieved below `relieved_at`."""
        source = load.source
        is_pressed = source in self.overloaded_sources
        if is_pressed and load.fill_ratio() > self.settings.relieved_at:
            return
        if not is_pressed and not load.is_overloaded():
            return
        if not self.overloaded_sources:
            self._is_announced = not self._announced
        self.overloaded_sources ^= {source}
        self.revision += 1
        self.overload_changed.set()
