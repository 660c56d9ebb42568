"""A clock that stands still until a test moves it."""

from __future__ import annotations


class Clock:
    """A clock whose time [s] is `now`; to sleep moves it."""

    def __init__(self, now: float = 0.0) -> None:
        self.now = now

    def __call__(self) -> float:
        """Return the time [s]."""
        return self.now

    def sleep(self, duration_s: float) -> None:
        """Move the clock by a positive duration [s]."""
        assert duration_s > 0.0
        self.now += duration_s
