"""Numbers the batches of one session, stores them in the ring and publishes them.

The two sides share only the ring. The robot's side (`push`, `flush`) numbers a batch and appends it. It holds
its lock for microseconds and never during a network call, so the robot's loop does not wait for the network.
The network's side (`put_waiting`, `heartbeat`, `resend`) encodes and publishes, in any other thread. If the
network is slower than the robot for longer than the span of the ring, the ring evicts batches that were never
published. The service finds the gap by the numbers, and its replay request is answered with `evicted`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from caesura_clients.bridge.replay_ring import ReplayRing, StoredBatch
from caesura_protocol.batching import Batcher, Matrix
from caesura_protocol.codec import Encoded, encode, pack_samples
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Heartbeat, Open
from caesura_protocol.transport.transport_interface import Transport

_AT_ONCE = 64  # batches taken from the ring in one go


class BatchSender:
    """Publisher of the `samples` key of a station for one session."""

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
        self.last_seq = -1  # of what has a number
        self.last_t: float | None = None  # [s] of the newest sample
        self._transport = transport
        self._key = station_key(station, "samples")
        self._open = opening
        self._batcher = Batcher(opening.columns, batch_samples)
        self._clock = clock
        self._numbering = threading.Lock()
        self._work = threading.Event()
        self._putting = threading.Lock()
        self._next_put = 0
        self._has_ended = False
        self._last_put = self._pending_since = clock()

    # --- the robot's side -------------------------------------------------------------------------------

    def push(self, chunk: Matrix) -> None:
        """Append samples (k, columns) and number the batches that they fill. Raises SourceError.

        After `end` the samples are dropped.
        """
        with self._numbering:
            if self._has_ended:
                return
            if not len(self._batcher):
                self._pending_since = self._clock()
            full = self._batcher.push(chunk)
            self.last_t = float(chunk[-1][0]) if len(chunk) else self.last_t
            for batch in full:
                self._number(batch)
            if full:
                self._pending_since = self._clock()
        if full:
            self._work.set()

    def flush(self, *, older_than_s: float = 0.0) -> None:
        """Number the pending samples as a batch of their own, if the first has waited for `older_than_s`.

        Before that it takes no lock, for which the robot's thread could wait.
        """
        if self._pending_since + older_than_s > self._clock():
            return
        with self._numbering:
            if self._clock() - self._pending_since >= older_than_s:
                for batch in self._batcher.flush():
                    self._number(batch)

    def end(self) -> None:
        """Number the pending samples; drop samples pushed from now on."""
        with self._numbering:
            for batch in self._batcher.flush():
                self._number(batch)
            self._has_ended = True

    def continue_from(self, seq: int) -> None:
        """Continue the numbers of a predecessor: the next batch is `seq`.

        Raises ValueError after the first batch.
        """
        with self._numbering:
            if len(self.ring):
                raise ValueError(f"batches up to {self.last_seq} were sent before the session was open")
            self.last_seq, self._next_put = seq - 1, seq

    # --- the network's side -----------------------------------------------------------------------------

    def wait(self, timeout_s: float) -> None:
        """Wait until a batch has been numbered since the last wait, at most `timeout_s`."""
        self._work.wait(timeout_s)
        self._work.clear()

    def put_waiting(self) -> None:
        """Publish every batch that has not been published yet."""
        with self._putting:
            while entries := self.ring.entries_from(self._next_put, _AT_ONCE):
                for entry in entries:
                    self._transport.put(self._key, entry.content)
                self._next_put = entries[-1].seq + 1
                self._last_put = self._clock()

    def heartbeat(self, *, idle_s: float = 0.0) -> None:
        """Publish the last number again, if nothing was published for `idle_s`."""
        with self._putting:
            if self._clock() - self._last_put >= idle_s:
                seq = self._next_put - 1
                opening = self._open
                beat = Heartbeat(session=opening.session, epoch=opening.epoch, seq=seq, bridge=opening.bridge)
                self._transport.put(self._key, encode(beat))
                self._last_put = self._clock()

    def resend(self, first: int, count: int) -> None:
        """Publish stored batches again, from number `first` on, at most `count`."""
        for entry in self.ring.entries_from(first, count):
            self._transport.put(self._key, entry.content)

    def _number(self, batch: Matrix) -> None:
        seq = self.last_seq + 1
        self.ring.append(StoredBatch(seq, float(batch[-1, 0]), len(batch), lambda: self._encoded(batch, seq)))
        self.last_seq = seq

    def _encoded(self, batch: Matrix, seq: int) -> Encoded:
        opening = self._open
        batch_message = pack_samples(
            batch,
            opening.columns,
            session=opening.session,
            epoch=opening.epoch,
            seq=seq,
            bridge=opening.bridge,
        )
        return encode(batch_message)
