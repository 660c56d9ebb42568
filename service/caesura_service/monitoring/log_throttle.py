"""A throttle for log lines: one in an interval, with the number of suppressed ones."""

from __future__ import annotations

from collections.abc import Hashable

MAX_KEYS = 4096


class LogThrottle:
    """Decides for each key whether a line is due. Holds at most MAX_KEYS; past that, no key is new."""

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._said: dict[Hashable, tuple[float, int]] = {}  # when, and how often it was kept back since

    def kept_back(self, key: Hashable, now: float, times: int = 1) -> int | None:
        """None: say nothing now. Else say it, and that so many more were not said before. now: [s]"""
        if key not in self._said and len(self._said) >= MAX_KEYS and not self._forget(now):
            return None
        at, held = self._said.get(key, (float("-inf"), 0))
        if now - at < self._interval_s:
            self._said[key] = at, held + times
            return None
        self._said[key] = now, 0
        return held + times - 1

    def _forget(self, now: float) -> bool:
        """Let go of what could be said at once; True where that made room."""
        self._said = {key: one for key, one in self._said.items() if now - one[0] < self._interval_s}
        return len(self._said) < MAX_KEYS
