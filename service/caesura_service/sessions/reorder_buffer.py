"""The reorder buffer of batches, and the schedule of requests for missing ones.

Rules: `pop_next` returns each batch exactly once and in sequence. At most one request for missing batches is
in progress. After an answer with progress the next request follows at once; after one without progress it
follows after a pause.
"""

from __future__ import annotations

from typing import Generic, NamedTuple, TypeVar

from caesura_service.sessions.limits import Limits

T = TypeVar("T")


class _Held(NamedTuple, Generic[T]):
    item: T
    size: int  # [bytes]


class ReorderBuffer(Generic[T]):
    """A buffer that returns items by sequence number, and holds a bounded number of early ones."""

    def __init__(self, capacity: int, capacity_bytes: int) -> None:
        self.next_seq = 0  # the next expected batch
        self.newest_seq = -1  # the highest number that was announced
        self._capacity, self._capacity_bytes = capacity, capacity_bytes
        self._held: dict[int, _Held[T]] = {}
        self._bytes = 0

    def is_duplicate(self, seq: int) -> bool:
        """Whether the batch was received before."""
        return seq < self.next_seq or seq in self._held

    def has_room(self, seq: int, size: int) -> bool:
        """Whether the batch can be held; the expected one always can. size: [bytes]."""
        return seq == self.next_seq or self.room_for(size) > 0

    def room_for(self, size: int) -> int:
        """Return how many further items of a size [bytes] can be held."""
        by_size = (self._capacity_bytes - self._bytes) // max(size, 1)
        return max(0, min(self._capacity - len(self._held), by_size))

    def free_run(self, seq: int) -> int | None:
        """Return how many items from this one on are not held; None if no later one is held."""
        return min((held - seq for held in self._held if held >= seq), default=None)

    def is_in_turn(self, seq: int) -> bool:
        """Whether it is the expected batch, and no batch is held or missing."""
        return seq == self.next_seq and not self._held and self.newest_seq < seq

    def advance(self, count: int = 1) -> None:
        """Skip the expected batches, which are processed without being held."""
        self.next_seq += count
        self.announce(self.next_seq - 1)

    def hold(self, seq: int, item: T, size: int) -> None:
        """Hold an item that is no duplicate and for which there is room. size: [bytes]."""
        self._held[seq] = _Held(item, size)
        self._bytes += size
        self.announce(seq)

    def announce(self, seq: int) -> None:
        """Record that batches up to this one exist."""
        self.newest_seq = max(self.newest_seq, seq)

    def has_next(self) -> bool:
        """Whether the expected item is held."""
        return self.next_seq in self._held

    def peek_next(self) -> T | None:
        """Return the expected item; None where it is not held."""
        held = self._held.get(self.next_seq)
        return None if held is None else held.item

    def pop_next(self) -> T:
        """Remove and return the expected item. Raises KeyError where it is not held."""
        item, size = self._held.pop(self.next_seq)
        self._bytes -= size
        self.next_seq += 1
        return item

    def missing_range(self) -> tuple[int, int] | None:
        """Return the first and last number of the next missing range; None where nothing is missing."""
        if self.newest_seq < self.next_seq:
            return None
        last = min(self._held) - 1 if self._held else self.newest_seq
        return (self.next_seq, last) if self.next_seq <= last else None

    def next_available(self, oldest: int | None) -> int:
        """Return the first batch that is held or can be replayed, if those before `oldest` are gone.

        Without one, the number after all known batches.
        """
        ahead = [seq for seq in (oldest, min(self._held, default=None)) if seq is not None]
        return min((seq for seq in ahead if seq > self.next_seq), default=self.newest_seq + 1)

    def skip_to(self, seq: int) -> None:
        """Continue at a later batch; drop the held ones before it."""
        for passed in [held for held in self._held if held < seq]:
            self._bytes -= self._held.pop(passed).size
        self.next_seq = seq
        self.newest_seq = max(self.newest_seq, seq - 1)


class ReplayBackoff:
    """Decides when missing batches are requested, and when one counts as lost."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._not_before = float("-inf")  # [s] the next request
        self._misses = 0

    def next_request(self, missing: tuple[int, int] | None, now: float) -> tuple[int, int] | None:
        """Return the range to request now; None for none. now: [s]."""
        if missing is None or now < self._not_before:
            return None
        self._not_before = now + self._limits.replay_timeout_s
        first, last = missing
        return first, min(last, first + self._limits.replay_batches - 1)

    def record_result(self, *, progress: bool, answered: bool, now: float) -> bool:
        """Record the end of an answer; return whether the requested batch counts as lost. now: [s]."""
        self._not_before = now if progress else now + self._limits.replay_retry_s
        self._misses = 0 if progress else self._misses + answered
        if self._misses < self._limits.replay_misses:
            return False
        self._misses = 0
        return True

    def reset(self) -> None:
        """Allow the next request at once."""
        self._not_before, self._misses = float("-inf"), 0
