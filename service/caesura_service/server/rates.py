"""How often a sender may send: token buckets, which the network's threads ask before they enqueue anything.

Sizes and queues bound what a sender may hold; rates bound the work that it may cause. The numbers lie well
above what honest clients do, so a sender that meets them is broken or hostile. Samples: a robot of 1 kHz that
sends each sample by itself sends 1000 messages a second; with every column there is they are 0.5 MB; a bridge
as fast as flow control lets it sends a window of 64 every 20 ms, 3200 (measured: 1500). Replays, which the
service asks for, do not count. Work: a robot of 1 kHz takes a fiftieth of the worker's time, an hour of a
recording that is sent as fast as it goes twenty seconds of it, an edit of an hour a second or two; here
replays and edits count. Commands: a bridge that is held up asks 50 times a second. Questions: 1000 readers
who ask for everything twice a second.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

SENDERS = 1024  # with own buckets; another is admitted once the one quiet for longest has full buckets


class Rate(NamedTuple):
    """So many a second, and so many at once."""

    per_s: float
    burst: float


SAMPLES = Rate(5000.0, 10_000.0)  # messages of a station
VOLUME = Rate(16e6, 32e6)  # bytes of them
COMMANDS = Rate(500.0, 1000.0)  # of a station
QUESTIONS = Rate(2000.0, 4000.0)  # to the instance
WORK = Rate(0.5, 60.0)  # [s] of the worker's time, for a station
COMPLAINTS = Rate(0.1, 1.0)  # log lines about a station, or about what it caused


@dataclass(frozen=True)
class RateSettings:
    """The rate of each kind of message, and of work."""

    samples: Rate = SAMPLES
    volume: Rate = VOLUME
    commands: Rate = COMMANDS
    questions: Rate = QUESTIONS
    work: Rate = WORK


class _Bucket(NamedTuple):
    """What one sender had left of each rate when it last sent."""

    tokens: Sequence[float]
    at: float  # [s]


class RateLimit:
    """A token bucket for each sender, of one rate or several at once; any thread may ask."""

    def __init__(
        self, *rates: Rate, senders: int = SENDERS, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.rates = rates
        self._senders = senders
        self._clock = clock
        self._buckets: dict[str, _Bucket] = {}  # the sender that sent last stands last
        self._full = _Bucket([rate.burst for rate in rates], -inf)
        self._lock = threading.Lock()

    def allows(self, sender: str, cost: float = 1.0, *further: float) -> bool:
        """Take so many tokens of each rate, if the sender has them all."""
        return self.lacking(sender, cost, *further) is None

    def lacking(self, sender: str, cost: float = 1.0, *further: float) -> int | None:
        """Likewise; returns the first rate of which there are too few, by its index, or None."""
        with self._lock:
            now = self._clock()
            bucket = self._buckets.pop(sender, None)
            if bucket is None:
                if not self._has_room(now):
                    return 0
                bucket = self._full
            filled = self._filled(bucket, now)
            left = [tokens - each for tokens, each in zip(filled, (cost, *further), strict=True)]
            lacks = next((index for index, tokens in enumerate(left) if tokens < 0.0), None)
            self._buckets[sender] = bucket if lacks is not None else _Bucket(left, now)
        return lacks

    def used(self, sender: str) -> list[float]:
        """Tokens of each rate that are missing to a full bucket."""
        filled = self._filled(self._buckets.get(sender, self._full), self._clock())
        return [rate.burst - tokens for rate, tokens in zip(self.rates, filled, strict=True)]

    def senders(self) -> list[str]:
        """Return those that have buckets of their own now."""
        with self._lock:
            return list(self._buckets)

    def _filled(self, bucket: _Bucket, now: float) -> list[float]:
        """Tokens of each rate by now, never more than its burst."""
        passed_s = now - bucket.at
        return [
            by_now if (by_now := tokens + passed_s * per_s) < burst else burst
            for (per_s, burst), tokens in zip(self.rates, bucket.tokens, strict=True)
        ]

    def _has_room(self, now: float) -> bool:
        """Room for one more sender; one whose buckets are full again need not be remembered."""
        if len(self._buckets) < self._senders:
            return True
        oldest = next(iter(self._buckets))
        if self._filled(self._buckets[oldest], now) != self._full.tokens:
            return False
        del self._buckets[oldest]
        return True


class WorkBudget:
    """The worker's time [s] that each station may still use; the worker spends, any thread asks.

    What work costs is known afterwards: a station may owe, and waits until it owes nothing.
    """

    def __init__(
        self, rate: Rate, *, stations: int = SENDERS, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.rate = rate
        self._stations = stations
        self._clock = clock
        self._left: dict[str, _Bucket] = {}  # the station that spent last stands last
        self._lock = threading.Lock()

    def spend(self, station: str, seconds: float) -> None:
        """So much has been used."""
        with self._lock:
            now = self._clock()
            left_s = self._left_s(self._left.pop(station, None), now)
            self._left[station] = _Bucket((left_s - seconds,), now)
            if len(self._left) > self._stations:
                del self._left[next(iter(self._left))]

    def used(self, station: str) -> float:
        """[s] what is missing to the burst; from the burst on the station has to wait."""
        return self.rate.burst - self._left_s(self._left.get(station), self._clock())

    def is_spent(self, station: str) -> bool:
        """Has it used what it may, so that it has to wait?"""
        bucket = self._left.get(station)
        return bucket is not None and self._left_s(bucket, self._clock()) <= 0.0

    def stations(self) -> list[str]:
        """Return those that have buckets of their own now."""
        with self._lock:
            return list(self._left)

    def _left_s(self, bucket: _Bucket | None, now: float) -> float:
        """[s] never more than the burst."""
        per_s, at_once_s = self.rate
        return at_once_s if bucket is None else min(at_once_s, bucket.tokens[0] + (now - bucket.at) * per_s)
