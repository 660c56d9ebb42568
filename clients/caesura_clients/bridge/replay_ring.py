"""The ring of the last batches, kept for replay.

The ring keeps at least `span_s` of the demonstration, measured on the session's clock, and every batch that
no service has acknowledged, up to `max_samples`. So a service may be silent for longer than the span. A jump
of the clock evicts nothing: the time between two batches counts as at least 0 and at most `STEP_S`.

The ring is also the queue between the robot's thread and the network. A batch is appended when it is
numbered, and is encoded once, at its first use.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

from caesura_protocol.codec import Encoded
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import ReplayRange

STEP_S = 1.0
EVICTED = 8  # batches that may go for one that comes: the robot's thread does not wait for thousands


class StoredBatch:
    """A batch of the ring with its sequence number."""

    __slots__ = ("_content", "passed", "samples", "seq", "t")

    def __init__(self, seq: int, t: float, samples: int, content: Encoded | Callable[[], Encoded]) -> None:
        """Store a batch. t: time of its last sample [s], session clock.

        content: the batch as it is sent, or a function that encodes it.
        """
        self.seq = seq
        self.t = t
        self.passed = 0.0  # [s] since the first one, as the ring counts
        self.samples = samples
        self._content = content

    @property
    def content(self) -> Encoded:
        """The encoded batch, made at its first use; two concurrent first uses may both encode it."""
        content = self._content
        if callable(content):
            self._content = content = content()
        return content


class ReplayRing:
    """Consecutive batches, oldest first. Thread-safe."""

    def __init__(self, *, span_s: float = 120.0, max_samples: int = 600_000) -> None:
        self.span_s = span_s
        self.max_samples = max_samples
        self.acknowledged = 0  # batches that a service is known to have
        self._entries: deque[StoredBatch] = deque()
        self._samples = 0
        self._lock = threading.Lock()

    def append(self, entry: StoredBatch) -> None:
        """Store the next batch; evict stored ones beyond the span, and any beyond the number of samples.

        Raises ValueError if its number does not follow that of the last one.
        """
        with self._lock:
            if self._entries and entry.seq != self._entries[-1].seq + 1:
                raise ValueError(f"batch {entry.seq} after {self._entries[-1].seq}, expected the next")
            if self._entries:
                last = self._entries[-1]
                entry.passed = last.passed + min(max(entry.t - last.t, 0.0), STEP_S)
            self._entries.append(entry)
            self._samples += entry.samples
            evicted = 0
            while self._evictable(entry.passed, evicted):
                self._samples -= self._entries.popleft().samples
                evicted += 1

    def sent_range(self, requested: ReplayRange) -> list[StoredBatch]:
        """Return the stored batches of a range, oldest first, at most `requested.limit`.

        Some may not have been published yet. Raises ProtocolError `evicted`, which names the oldest batch, if
        the range begins before it.
        """
        with self._lock:
            if not self._entries:
                return []
            oldest = self._entries[0].seq
            if requested.first < oldest:
                raise ProtocolError(
                    "evicted", "the ring no longer has these samples", value=requested.first, limit=oldest
                )
            end = min(requested.last + 1, requested.first + requested.limit, self._entries[-1].seq + 1)
            return self._between(requested.first - oldest, end - oldest)

    def entries_from(self, first: int, count: int) -> list[StoredBatch]:
        """Return the stored batches from `first` on, oldest first, at most `count`."""
        with self._lock:
            skipped = max(0, first - self._entries[0].seq) if self._entries else 0
            return self._between(skipped, min(skipped + count, len(self._entries)))

    def __len__(self) -> int:
        return len(self._entries)

    def _between(self, begin: int, end: int) -> list[StoredBatch]:
        """Return the batches at these indices. An iterator over the deque would visit all older ones."""
        return [self._entries[place] for place in range(begin, end)]

    def _evictable(self, now: float, evicted: int) -> bool:
        """Return whether the oldest batch may be evicted, after `evicted` others.

        The bound on samples takes precedence over the span.
        """
        if len(self._entries) <= 1:
            return False
        if self._samples > self.max_samples:
            return True
        if evicted >= EVICTED:
            return False
        return self._entries[0].seq < self.acknowledged and now - self._entries[1].passed > self.span_s
