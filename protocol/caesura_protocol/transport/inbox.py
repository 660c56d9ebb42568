"""Received items, and the bounded queue that holds them, with a lane for each station.

Rule 1: a callback that receives from the network only enqueues; work happens in the thread that calls `get`.
A slow callback inside the network library delays every other subscriber of the process.

Rule 2: an inbox holds `capacity` items and `capacity_bytes` of payloads. When it is full, a station that
holds an equal share or more loses its oldest item, and other stations lose nothing to it. An item for
which there are too few bytes, and which has more than any other station holds, is dropped itself. Drops
are counted: readers of results detect the gap by sequence numbers, and a dropped query is refused as
`overloaded`.

Rule 3: stations take turns by time (start-time fair queueing, Goyal, Vin & Cheng 1996). The time from one
`get` to the next is added to the virtual time of the lane that was served, and the lane with the least is
next. An empty lane restarts at the virtual time of the lane in service, so idle time earns no credit. A
longer turn counts as MOST_TURN_S: a reader that is suspended is no station's work. Items of one station keep
their order. Keys of another system, such as those of ROS 2, have one lane together.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from heapq import heapify, heappop, heappush
from itertools import count
from types import TracebackType
from typing import NamedTuple, Protocol, Self

from caesura_protocol.codec import Encoded, encode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import ROOT

DEFAULT_CAPACITY = 4096
CAPACITY_BYTES = 1 << 26  # of payloads; one item may always stay
MOST_TURN_S = 1.0  # [s] that one item may add to the time of its lane
LANES = 1024  # at which the empty ones are evicted, or twice as many as have items


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
    def size(self) -> int:
        """The bytes that the query holds beside its key, without copying them."""

    @property
    def content(self) -> Encoded | None:
        """The payload of the query."""

    def reply(self, key: str, answer: Encoded) -> None:
        """Send one reply; there may be several."""

    def refuse(self, error: Encoded) -> None:
        """Send a refusal."""

    def matches(self, key: str) -> bool:
        """Return whether the key of the query includes a key, or with `*` any of the keys."""

    def drop(self) -> None:
        """End the query for the client."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


Item = ReceivedSample | TokenChange | IncomingQuery


class _StationItems:
    """The queued items of one station, in order."""

    __slots__ = ("due", "items", "share", "waits")

    def __init__(self) -> None:
        self.items: deque[Item] = deque()
        self.share = 0.0  # of the capacities that they take
        self.due = 0.0  # [s] virtual time
        self.waits = False  # it is in the heap of turns


class Inbox:
    """A bounded queue between the network and one consumer, fair among stations. Thread-safe."""

    def __init__(
        self,
        capacity: int = DEFAULT_CAPACITY,
        capacity_bytes: int = CAPACITY_BYTES,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """clock: monotonic [s], by which stations take turns."""
        self.capacity = capacity
        self.capacity_bytes = capacity_bytes
        self.dropped = 0
        self._clock = clock
        self._lanes: dict[str, _StationItems] = {}
        # A heap of the lanes with items, but the one in service.
        self._turns: list[tuple[float, int, _StationItems]] = []
        self._order = count()
        self._served: _StationItems | None = None
        self._served_s = self._virtual_s = 0.0
        self._count = self._bytes = 0
        self._holding = 0  # lanes with items
        self._evict_at = LANES  # lanes
        self._changed = threading.Condition()

    def offer(self, item: Item) -> None:
        """Enqueue an item; drop the oldest of its station, or of the fullest, if there is no room.

        Never blocks.
        """
        dropped: list[Item] = []
        size = _size(item)
        with self._changed:
            name = _lane_of(item.key)
            lane = self._lanes.get(name) or self._new_lane(name)
            self._holding += not lane.items
            lane.items.append(item)
            self._account(lane, 1, size)
            while self._count > 1 and (self._count > self.capacity or self._bytes > self.capacity_bytes):
                dropped.append(self._pop(self._fullest(lane)))
            self.dropped += len(dropped)
            self._queue(lane)
            self._changed.notify()
        for oldest in dropped:
            if not isinstance(oldest, ReceivedSample | TokenChange):
                self._refuse(oldest)

    def get(self, timeout_s: float) -> Item | None:
        """Return the next item, or None if none arrived within the timeout."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            self._end_turn(self._clock())
            while not self._count:
                remaining = deadline - time.monotonic()
                if remaining <= 0.0:
                    return None
                self._changed.wait(remaining)
            self._end_turn(self._clock())  # of another thread, meanwhile
            lane = self._next_lane()
            self._served, self._served_s = lane, self._clock()
            return self._pop(lane)

    def __len__(self) -> int:
        return self._count

    # --- under the lock ---------------------------------------------------------------------------------

    def _end_turn(self, now: float) -> None:
        """Add the time of the work on the last item to its lane, and queue the lane again."""
        lane, self._served = self._served, None
        if lane is not None:
            lane.due += min(now - self._served_s, MOST_TURN_S)
            self._queue(lane)

    def _queue(self, lane: _StationItems) -> None:
        """Queue a lane with items at the virtual time at the earliest, unless it waits or is in service."""
        if lane.items and not lane.waits and lane is not self._served:
            lane.waits, lane.due = True, max(lane.due, self._virtual_s)
            heappush(self._turns, (lane.due, next(self._order), lane))

    def _next_lane(self) -> _StationItems:
        """Return the lane that has had the least time; those of which everything was dropped are skipped."""
        while True:
            self._virtual_s, _, lane = heappop(self._turns)
            lane.waits = False
            if lane.items:
                return lane

    def _fullest(self, lane: _StationItems) -> _StationItems:
        """Return the lane itself if it holds an equal share or more, else the one that holds most.

        A single item of it is dropped only if its bytes have no room, and no lane holds more.
        """
        is_single = len(lane.items) == 1
        if not is_single and lane.share * self._holding >= self._share_of(self._count, self._bytes):
            return lane
        own = 0.0 if is_single and self._bytes <= self.capacity_bytes else lane.share
        return max(self._lanes.values(), key=lambda one: own if one is lane else one.share)

    def _pop(self, lane: _StationItems) -> Item:
        item = lane.items.popleft()
        self._account(lane, -1, -_size(item))
        if not lane.items:
            self._holding -= 1
            lane.share = 0.0  # without the errors of many sums
        return item

    def _account(self, lane: _StationItems, items: int, size: int) -> None:
        lane.share += self._share_of(items, size)
        self._count += items
        self._bytes += size

    def _share_of(self, items: int, size: int) -> float:
        return items / self.capacity + size / self.capacity_bytes

    def _new_lane(self, name: str) -> _StationItems:
        """Make a lane; evict the empty ones if there are too many, and their turns."""
        if len(self._lanes) >= self._evict_at:
            kept = {key: one for key, one in self._lanes.items() if one.items or one is self._served}
            self._lanes, self._evict_at = kept, max(LANES, 2 * len(kept))
            self._turns = [turn for turn in self._turns if turn[2].items]
            heapify(self._turns)
        lane = self._lanes[name] = _StationItems()
        return lane

    def _refuse(self, question: IncomingQuery) -> None:
        full = ProtocolError("overloaded", "too many questions at once", limit=self.capacity)
        with question:
            question.refuse(encode_error(full))


def _lane_of(key: str) -> str:
    """Return the name of the station or instance in a key; "" for a key of another system.

    >>> _lane_of("caesura/v1/session/cell-1/s1/status"), _lane_of("0/joint_states/Type/Hash")
    ('cell-1', '')
    """
    if not key.startswith(ROOT):
        return ""
    parts = key.split("/", 4)
    return parts[3] if len(parts) > 3 else ""


def _size(item: Item) -> int:
    """Return the size [bytes] of those parts of an item whose length its sender chose."""
    if isinstance(item, ReceivedSample):
        return len(item.payload) + len(item.key)
    if isinstance(item, TokenChange):
        return len(item.key)
    return len(item.parameters) + (len(item.content.payload) if item.content else 0)
