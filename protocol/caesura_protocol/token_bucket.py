"""Token buckets, which limit how often a sender may act. Used by server, monitoring and dashboard."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from math import inf
from typing import NamedTuple

SENDERS = 1024  # with own buckets; another is admitted once the one quiet for longest has full buckets


class Rate(NamedTuple):
    """Tokens per second, and the greatest number at once."""

    per_s: float
    burst: float


LOG_RATE = Rate(0.1, 1.0)  # log lines about a station, or about what it caused


_Bucket = tuple[Sequence[float], float]  # tokens of each rate that a sender had left, and at what time [s]


class RateLimit:
    """A token bucket for each sender, of one rate or several at once; any thread may call it.

    `allows` removes available tokens before a message is accepted. `charge` removes the cost of work, which
    is measured afterwards: the number of tokens may become negative, and the sender waits until it is
    positive again.
    """

    def __init__(
        self, *rates: Rate, senders: int = SENDERS, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.rates = rates
        self._senders = senders
        self._clock = clock
        self._buckets: dict[str, _Bucket] = {}  # the sender that sent last stands last
        self._full: _Bucket = [rate.burst for rate in rates], -inf
        self._lock = threading.Lock()

    def allows(self, sender: str, cost: float = 1.0, *further: float) -> bool:
        """Remove `cost` tokens of each rate, if the sender has them all; return whether it had."""
        return self.lacking(sender, cost, *further) is None

    def lacking(self, sender: str, cost: float = 1.0, *further: float) -> int | None:
        """Remove tokens as `allows`; return the index of the first rate that lacks tokens, or None."""
        with self._lock:
            now = self._clock()
            bucket = self._buckets.pop(sender, None)
            if bucket is None:
                if not self._has_room(now):
                    return 0
                bucket = self._full
            filled = self._filled(bucket, now)
            left = [tokens - each for tokens, each in zip(filled, (cost, *further), strict=True)]
            lacks = None
            if min(left) < 0.0:
                lacks = next(index for index, tokens in enumerate(left) if tokens < 0.0)
            self._buckets[sender] = bucket if lacks is not None else (left, now)
        return lacks

    def charge(self, sender: str, cost: float) -> None:
        """Remove tokens of the only rate, also below 0; too many senders evict the oldest bucket."""
        with self._lock:
            now = self._clock()
            (tokens,), at = self._buckets.pop(sender, self._full)
            ((per_s, burst),) = self.rates
            self._buckets[sender] = [min(burst, tokens + (now - at) * per_s) - cost], now
            if len(self._buckets) > self._senders:
                del self._buckets[next(iter(self._buckets))]

    def is_spent(self, sender: str) -> bool:
        """Return whether a rate has no tokens left."""
        bucket = self._buckets.get(sender)
        if bucket is None or min(bucket[0]) > 0.0:  # more come back with time
            return False
        return min(self._filled(bucket, self._clock())) <= 0.0

    def used(self, sender: str) -> list[float]:
        """Return the tokens of each rate that are missing to a full bucket."""
        filled = self._filled(self._buckets.get(sender, self._full), self._clock())
        return [rate.burst - tokens for rate, tokens in zip(self.rates, filled, strict=True)]

    def senders(self) -> list[str]:
        """Return the senders that have a bucket."""
        with self._lock:
            return list(self._buckets)

    def _filled(self, bucket: _Bucket, now: float) -> list[float]:
        """Return the tokens of each rate at a time, at most its burst. now: [s]."""
        before, at = bucket
        passed_s = now - at
        return [
            by_now if (by_now := tokens + passed_s * per_s) < burst else burst
            for (per_s, burst), tokens in zip(self.rates, before, strict=True)
        ]

    def _has_room(self, now: float) -> bool:
        """Return whether a new sender fits; if necessary, evict the oldest one with full buckets."""
        if len(self._buckets) < self._senders:
            return True
        oldest = next(iter(self._buckets))
        if self._filled(self._buckets[oldest], now) != self._full[0]:
            return False
        del self._buckets[oldest]
        return True
