"""A throttle for log lines: one in an interval, with the number of suppressed ones."""

from __future__ import annotations

from collections.abc import Hashable

MAX_KEYS = 4096


class LogThrottle:
    """Decides for each key whether a line is due. Holds at most MAX_KEYS; past that, no key is new."""

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._said: dict[Hashable, tuple[float, int]] = {}  # last logged [s], and suppressed since

    def kept_back(self, key: Hashable, now: float, times: int = 1) -> int | None:
        """Return None to suppress a line; else log it with the number suppressed before. now: [s]."""
        if key not in self._said and len(self._said) >= MAX_KEYS and not self._forget(now):
            return None
        at, held = self._said.get(key, (float("-inf"), 0))
        if now - at < self._interval_s:
            self._said[key] = at, held + times
            return None
        self._said[key] = now, 0
        return held + times - 1

    def _forget(self, now: float) -> bool:
        """Evict the keys whose interval is over; return whether there is room then."""
        self._said = {key: one for key, one in self._said.items() if now - one[0] < self._interval_s}
        return len(self._said) < MAX_KEYS
