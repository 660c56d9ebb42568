"""The reorder buffer of batches, and the schedule of requests for missing ones.

Two rules. A batch leaves `take` exactly once and in sequence. While one is missing, at most one question
is out, and it is repeated at a named interval, never in a loop: an answer that brought something is
followed by the next question at once, one that brought nothing by a pause.
"""

from __future__ import annotations

from typing import Generic, NamedTuple, TypeVar

from caesura_service.sessions.limits import Limits

T = TypeVar("T")


class _Held(NamedTuple, Generic[T]):
    item: T
    size: int  # [bytes]


class ReorderBuffer(Generic[T]):
    """Hands out items by sequence number; holds a bounded number that came before their turn."""

    def __init__(self, capacity: int, capacity_bytes: int) -> None:
        self.next_seq = 0  # the batch that is waited for
        self.newest = -1  # the highest that is known to exist
        self._capacity, self._capacity_bytes = capacity, capacity_bytes
        self._held: dict[int, _Held[T]] = {}
        self._bytes = 0

    def is_duplicate(self, seq: int) -> bool:
        """Has the batch come before?"""
        return seq < self.next_seq or seq in self._held

    def has_room(self, seq: int, size: int) -> bool:
        """Can it be kept? The expected one always can. size: [bytes]."""
        full = len(self._held) >= self._capacity or self._bytes + size > self._capacity_bytes
        return seq == self.next_seq or not full

    def is_in_turn(self, seq: int) -> bool:
        """Is it the next one, with nothing held and nothing missing?"""
        return seq == self.next_seq and not self._held and self.newest < seq

    def pass_by(self) -> None:
        """The next one, in turn, has not been held at all."""
        self.newest = self.next_seq
        self.next_seq += 1

    def hold(self, seq: int, item: T, size: int) -> None:
        """Keep an item that is no duplicate, and for which there is room, until its turn."""
        self._held[seq] = _Held(item, size)
        self._bytes += size
        self.expect(seq)

    def expect(self, seq: int) -> None:
        """Learn that batches up to this one exist."""
        self.newest = max(self.newest, seq)

    def ready(self) -> bool:
        """Is the next item there?"""
        return self.next_seq in self._held

    def take(self) -> T:
        """The next item, which must be ready."""
        item, size = self._held.pop(self.next_seq)
        self._bytes -= size
        self.next_seq += 1
        return item

    def hole(self) -> tuple[int, int] | None:
        """First and last batch of the stretch that is missing next; None while nothing is."""
        if self.newest < self.next_seq:
            return None
        last = min(self._held) - 1 if self._held else self.newest
        return (self.next_seq, last) if self.next_seq <= last else None

    def nearest(self, oldest: int | None) -> int:
        """Where to go on if nothing before `oldest` will come: the first batch that is or will be there."""
        ahead = [seq for seq in (oldest, min(self._held, default=None)) if seq is not None]
        return min((seq for seq in ahead if seq > self.next_seq), default=self.newest + 1)

    def skip_to(self, seq: int) -> None:
        """Give up everything before a batch that is ahead, and whatever is held of that."""
        for passed in [held for held in self._held if held < seq]:
            self._bytes -= self._held.pop(passed).size
        self.next_seq = seq
        self.newest = max(self.newest, seq - 1)


class ReplayBackoff:
    """When to ask for a hole, and when to give a batch up."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._not_before = float("-inf")  # [s] the next question
        self._misses = 0

    def question(self, hole: tuple[int, int] | None, now: float) -> tuple[int, int] | None:
        """The range to ask for now, if any."""
        if hole is None or now < self._not_before:
            return None
        self._not_before = now + self._limits.replay_patience_s
        first, last = hole
        return first, min(last, first + self._limits.replay_batches - 1)

    def ended(self, *, progress: bool, answered: bool, now: float) -> bool:
        """Take note of an answer's end. True where the batch that was asked for counts as lost."""
        self._not_before = now if progress else now + self._limits.replay_retry_s
        self._misses = 0 if progress else self._misses + answered
        if self._misses < self._limits.replay_misses:
            return False
        self._misses = 0
        return True

    def forgive(self) -> None:
        """A hole was given up: what comes next may be asked for at once."""
        self._not_before, self._misses = float("-inf"), 0
