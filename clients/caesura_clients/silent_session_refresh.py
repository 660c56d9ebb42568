"""Schedules queries of keys without messages: first after a pause, then at increasing intervals.

A received message restarts the schedule of its key; a query without an answer is repeated after the first
interval.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, NamedTuple, TypeVar

K = TypeVar("K")

LONGEST_S = 60.0  # between two questions about the same
SHARE = 0.125  # of a thread's time, at most, that queries of one key take
LONGEST_PAUSE_S = 0.5  # after a query: one that no service answered in time is no fault of its key


class _Waiting(NamedTuple):
    due: float  # [s] when to ask
    wait_s: float  # since it was received, or queried


class RefreshBackoff(Generic[K]):
    """Query intervals of many keys."""

    def __init__(self, silence_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        """silence_s: how long nothing may be received before a query."""
        self._silence_s = silence_s
        self._clock = clock
        self._waiting: dict[K, _Waiting] = {}
        self._next_check_s = clock()

    def reset(self, key: K) -> None:
        """Restart the interval of a key that was received."""
        self._waiting[key] = _Waiting(self._clock() + self._silence_s, self._silence_s)

    def retry_after_silence(self, key: K) -> None:
        """Repeat the query of a key after the first interval: no answer came."""
        self.reset(key)

    def back_off(self, key: K) -> None:
        """Double the interval of a key that was queried, up to LONGEST_S."""
        known = self._waiting.get(key)
        wait_s = min(2.0 * known.wait_s, LONGEST_S) if known else self._silence_s
        self._waiting[key] = _Waiting(self._clock() + wait_s, wait_s)

    def hasten(self, key: K) -> None:
        """Make the query of a key due now."""
        self._waiting[key] = _Waiting(self._clock(), self._silence_s)

    def remove(self, key: K) -> None:
        """Stop querying a key."""
        self._waiting.pop(key, None)

    def due(self) -> list[K]:
        """Return the keys to query now; calls within the check interval return none."""
        now = self._clock()
        if now < self._next_check_s:
            return []
        self._next_check_s = now + self._silence_s / 4.0
        return [key for key, waiting in self._waiting.items() if waiting.due <= now]


class TimeShares(Generic[K]):
    """Limits the queries of each key to a share of the thread's time."""

    def __init__(self, share: float = SHARE, clock: Callable[[], float] = time.monotonic) -> None:
        self._share, self._clock = share, clock
        self._free: dict[K, float] = {}  # from when on [s] a key may be queried

    def allows(self, key: K) -> bool:
        """Return whether the share of a key is not yet used up."""
        return self._free.get(key, 0.0) <= self._clock()

    @contextmanager
    def charged(self, key: K) -> Iterator[None]:
        """Charge the duration of the context to the share of a key."""
        began = self._clock()
        try:
            yield
        finally:
            now = self._clock()
            self._free = {one: free for one, free in self._free.items() if free > now}
            self._free[key] = now + min((now - began) * (1.0 / self._share - 1.0), LONGEST_PAUSE_S)
