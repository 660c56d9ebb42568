"""Numbers the batches of one session, keeps them in the ring and puts them.

Everything that decides an order (what is pending, the number, the put) is under one lock, because late
batches and heartbeats come from another thread than samples do. No network call in here waits.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from caesura_clients.bridge.batching import Batcher, Matrix
from caesura_clients.bridge.ring import Entry, ReplayRing
from caesura_clients.network import Transport
from caesura_protocol.codec import encode, pack_samples
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Heartbeat, Open


class Sender:
    """The `samples` key of a station for one session."""

    def __init__(
        self,
        transport: Transport,
        station: str,
        opening: Open,
        ring: ReplayRing,
        *,
        batch_samples: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.ring = ring
        self.last_seq = -1
        self._transport = transport
        self._key = station_key(station, "samples")
        self._open = opening
        self._batcher = Batcher(opening.columns, batch_samples)
        self._clock = clock
        self._lock = threading.RLock()
        self._last_put = self._pending_since = clock()

    def push(self, chunk: Matrix) -> None:
        """Take samples (k, columns) and put the batches that they fill. Raises BadSource."""
        with self._lock:
            if not len(self._batcher):
                self._pending_since = self._clock()
            full = self._batcher.push(chunk)
            for batch in full:
                self._put(batch)
            if full:
                self._pending_since = self._clock()

    def flush(self, *, older_than_s: float = 0.0) -> None:
        """Put what is pending as a batch of its own, if its first sample has waited so long."""
        with self._lock:
            if self._clock() - self._pending_since >= older_than_s:
                for batch in self._batcher.flush():
                    self._put(batch)

    def heartbeat(self, *, idle_s: float = 0.0) -> None:
        """Repeat the last number, if nothing was put for so long."""
        with self._lock:
            if self._clock() - self._last_put >= idle_s:
                beat = Heartbeat(session=self._open.session, epoch=self._open.epoch, seq=self.last_seq)
                self._transport.put(self._key, encode(beat))
                self._last_put = self._clock()

    def resend(self, first: int, count: int) -> None:
        """Put batches again from `first` on, as far as the ring has them, at most `count`."""
        entries = [entry for entry in self.ring if entry.seq >= first][:count]
        with self._lock:
            for entry in entries:
                self._transport.put(self._key, entry.content)

    def continue_from(self, seq: int) -> None:
        """Number the next batch `seq`: a predecessor sent those before. Only while nothing was put."""
        with self._lock:
            if len(self.ring):
                raise ValueError(f"batches up to {self.last_seq} were put before the session was open")
            self.last_seq = seq - 1

    def _put(self, batch: Matrix) -> None:
        seq = self.last_seq + 1
        packed = pack_samples(
            batch, self._open.columns, session=self._open.session, epoch=self._open.epoch, seq=seq
        )
        content = encode(packed)
        self.ring.append(Entry(seq, float(batch[-1, 0]), len(batch), content))
        self.last_seq = seq
        self._transport.put(self._key, content)
        self._last_put = self._clock()
