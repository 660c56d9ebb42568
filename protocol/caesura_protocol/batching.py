"""Collects samples into batches of 20 per message, which quarters the cost in the service.

A batch ends early before a pause longer than a batch may last. If most steps are such pauses, the times are
not in seconds: then batches are not cut at them, and the service reports the error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import SourceError
from caesura_protocol.messages import MAX_BATCH_SAMPLES, MAX_BATCH_SPAN_S

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
        """Append a chunk; return the full batches. Raises SourceError and then appends nothing."""
        self._check(chunk)
        if not len(chunk):
            return []
        self.seen += len(chunk)
        self._pending.append(np.array(chunk))
        self._count += len(chunk)
        span_s = chunk[-1, 0] - self._pending[0][0, 0]
        if self._count < self.batch_samples and not span_s > MAX_BATCH_SPAN_S:
            return []
        full, rest = self._cut(np.concatenate(self._pending))
        self._pending = [rest] if len(rest) else []
        self._count = len(rest)
        return full

    def flush(self) -> list[Matrix]:
        """Return the pending samples as a batch of their own."""
        pending, self._pending, self._count = self._pending, [], 0
        return [np.concatenate(pending)] if pending else []

    def _cut(self, samples: Matrix) -> tuple[list[Matrix], Matrix]:
        """Return the full batches, and the samples that are not yet a batch."""
        full: list[Matrix] = []
        while len(samples):
            batch = samples[: self.batch_samples]
            if count := _before_pause(batch[:, 0]):
                batch = batch[:count]
            elif len(batch) < self.batch_samples:
                break
            full.append(batch)
            samples = samples[len(batch) :]
        return full, samples

    def _check(self, chunk: Matrix) -> None:
        if not isinstance(chunk, np.ndarray) or chunk.dtype.kind not in "fiu":
            what = f"of {chunk.dtype}" if isinstance(chunk, np.ndarray) else f"a {type(chunk).__name__}"
            raise SourceError(f"chunk is {what}, expected an array of numbers (k, {len(self.columns)})")
        if chunk.ndim != 2 or chunk.shape[1] != len(self.columns):
            raise SourceError(
                f"chunk has shape {chunk.shape}, expected (k, {len(self.columns)}): {self.columns}"
            )
        if not np.isfinite(chunk).all():
            row, column = np.argwhere(~np.isfinite(chunk))[0]
            value = chunk[row, column]
            raise SourceError(
                f"sample {self.seen + row}: {self.columns[column]} is {value}, expected a finite number"
            )


def _before_pause(times: Matrix) -> int:
    """Return the number of samples before the first pause longer than a batch.

    It is 0 if there is none, or if at least every second step is such a pause.
    """
    if not times[-1] - times[0] > MAX_BATCH_SPAN_S:
        return 0
    pauses = np.flatnonzero(np.diff(times) > MAX_BATCH_SPAN_S)
    return int(pauses[0]) + 1 if 0 < 2 * len(pauses) < len(times) else 0
