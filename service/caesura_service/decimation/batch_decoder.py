"""Decodes the journal's batches into runs of samples; a batch with invalid content counts as lost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.gap_free_sample_runs import RunSplitter, SampleRun, in_metres
from caesura_protocol.messages import Open, SampleBatch
from caesura_service.journal import BatchRow
from caesura_service.sessions.batch_validation import validated_samples
from caesura_service.sessions.limits import Limits

Array = NDArray[np.float64]

LIMITS = Limits()


class BatchDecoder:
    """A fold from batches, in the order of their numbers, to runs of samples."""

    def __init__(self, opening: Open) -> None:
        self._opening = opening
        self._scale = in_metres(opening.columns, opening.length_unit)
        self._runs = RunSplitter()

    @property
    def latest(self) -> float:
        """The time [s] of the newest sample."""
        return self._runs.latest

    def push(self, batches: Sequence[BatchRow]) -> list[SampleRun]:
        """Return the runs of samples of further batches, lengths in metres."""
        return self._runs.push(*self._matrix(batches)) if batches else []

    def _matrix(self, batches: Sequence[BatchRow]) -> tuple[Array, NDArray[np.int64]]:
        """Return the samples (n, columns) in metres, and the number of the batch of each row."""
        sizes = {len(one.samples) // max(one.n, 1) for one in batches}
        plain = all(one.columns == self._opening.columns for one in batches) and len(sizes) == 1
        width = len(self._opening.columns)
        dtype = {4 * width: "<f4", 8 * width: "<f8"}.get(sizes.pop()) if plain else None
        if dtype is not None:
            matrix = np.frombuffer(b"".join(one.samples for one in batches), dtype).reshape(-1, width)
            matrix = matrix.astype(np.float64)
            counts = [one.n for one in batches]
            if len(matrix) == sum(counts):
                matrix[:, 0] += np.repeat([one.t0 for one in batches], counts)
                if np.isfinite(matrix).all() and self._is_plausible(matrix, counts):
                    return matrix * self._scale, np.repeat([one.seq for one in batches], counts)
        return self._checked(batches)

    def _is_plausible(self, matrix: Array, counts: Sequence[int]) -> bool:
        starts = np.cumsum([0, *counts[:-1]])
        t = matrix[:, 0]
        spans = np.maximum.reduceat(t, starts) - np.minimum.reduceat(t, starts)
        return bool(
            np.abs(matrix[:, 1:]).max() <= LIMITS.value
            and np.abs(t).max() <= LIMITS.time_s
            and spans.max() <= LIMITS.batch_span_s
        )

    def _checked(self, batches: Sequence[BatchRow]) -> tuple[Array, NDArray[np.int64]]:
        """Return the results of `_matrix` from batches that are validated one by one, as in the session.

        Rejected batches are left out.
        """
        parts, seqs = [np.zeros((0, len(self._opening.columns)))], [np.zeros(0, np.int64)]
        for one in batches:
            batch = SampleBatch.model_construct(
                session=self._opening.session,
                epoch=0,
                **{k: v for k, v in one._asdict().items() if k != "place"},
            )
            try:
                parts.append(validated_samples(batch, self._opening.columns, LIMITS) * self._scale)
            except ProtocolError:  # it was refused when it came
                continue
            seqs.append(np.full(len(parts[-1]), one.seq))
        return np.concatenate(parts), np.concatenate(seqs)
