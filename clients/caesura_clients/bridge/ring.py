"""The last batches that were sent, kept so that they can be asked for again.

The ring keeps at least `span_s` of the demonstration, measured on the session's own clock, as long as that is
no more than `max_samples`; and always the last `min_batches`, which is what may be under way to the service.
Batches are kept as bytes: answering a replay copies nothing and encodes nothing.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from caesura_protocol.codec import Encoded
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import ReplayRange


@dataclass(frozen=True)
class Entry:
    """A batch as it was sent."""

    seq: int
    t: float  # [s] its last sample, session clock
    samples: int
    content: Encoded


class ReplayRing:
    """Consecutive batches, oldest first; safe between threads."""

    def __init__(self, *, span_s: float = 30.0, max_samples: int = 200_000, min_batches: int = 64) -> None:
        self.span_s = span_s
        self.max_samples = max_samples
        self.min_batches = min_batches
        self._entries: deque[Entry] = deque()
        self._samples = 0
        self._lock = threading.Lock()

    def append(self, entry: Entry) -> None:
        """Keep a batch, whose number follows the last one's; evicts what is too old or too much."""
        with self._lock:
            if self._entries and entry.seq != self._entries[-1].seq + 1:
                raise ValueError(f"batch {entry.seq} after {self._entries[-1].seq}, expected the next")
            self._entries.append(entry)
            self._samples += entry.samples
            while self._evictable(entry.t):
                self._samples -= self._entries.popleft().samples

    def since(self, wanted: ReplayRange) -> list[Entry]:
        """The batches of a range that have been sent, oldest first, at most `wanted.limit`.

        Raises ProtocolError `evicted`, which names the oldest, where the range begins before it.
        """
        with self._lock:
            if not self._entries:
                return []
            oldest = self._entries[0].seq
            if wanted.first < oldest:
                raise ProtocolError(
                    "evicted", "the ring no longer has these samples", value=wanted.first, limit=oldest
                )
            end = min(wanted.last + 1, wanted.first + wanted.limit, self._entries[-1].seq + 1)
            return [self._entries[seq - oldest] for seq in range(wanted.first, end)]

    def __iter__(self) -> Iterator[Entry]:
        with self._lock:
            return iter(tuple(self._entries))

    def __len__(self) -> int:
        return len(self._entries)

    def _evictable(self, now: float) -> bool:
        """Is the oldest one of no more use? The bound on samples wins over the one on time."""
        if len(self._entries) <= 1:
            return False
        if self._samples > self.max_samples:
            return True
        return len(self._entries) > self.min_batches and now - self._entries[1].t > self.span_s
