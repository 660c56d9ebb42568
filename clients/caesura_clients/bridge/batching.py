"""Samples come as the robot delivers them and go as batches: 20 in one message cost the service a quarter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_clients.errors import BadSource
from caesura_protocol.messages import MAX_BATCH_SAMPLES

Matrix = NDArray[np.floating]


class Batcher:
    """Cuts chunks (k, columns) into batches (batch_samples, columns)."""

    def __init__(self, columns: tuple[str, ...], batch_samples: int) -> None:
        if not 1 <= batch_samples <= MAX_BATCH_SAMPLES:
            raise ValueError(f"batch_samples is {batch_samples}, expected 1 to {MAX_BATCH_SAMPLES}")
        self.columns = columns
        self.batch_samples = batch_samples
        self.seen = 0  # samples taken so far
        self._pending: list[Matrix] = []
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def push(self, chunk: Matrix) -> list[Matrix]:
        """Take a chunk; returns the batches that are full. Raises BadSource and takes nothing."""
        self._check(chunk)
        self.seen += len(chunk)
        self._pending.append(np.array(chunk))
        self._count += len(chunk)
        if self._count < self.batch_samples:
            return []
        full = self._count - self._count % self.batch_samples
        samples = np.concatenate(self._pending)
        self._pending = [samples[full:]] if full < len(samples) else []
        self._count = len(samples) - full
        return [samples[i : i + self.batch_samples] for i in range(0, full, self.batch_samples)]

    def flush(self) -> list[Matrix]:
        """What is pending, as a batch of its own."""
        pending, self._pending, self._count = self._pending, [], 0
        return [np.concatenate(pending)] if pending else []

    def _check(self, chunk: Matrix) -> None:
        if chunk.ndim != 2 or chunk.shape[1] != len(self.columns):
            raise BadSource(
                f"chunk has shape {chunk.shape}, expected (k, {len(self.columns)}): {self.columns}"
            )
        if not np.isfinite(chunk).all():
            row, column = np.argwhere(~np.isfinite(chunk))[0]
            value = chunk[row, column]
            raise BadSource(
                f"sample {self.seen + row}: {self.columns[column]} is {value}, expected a finite number"
            )
