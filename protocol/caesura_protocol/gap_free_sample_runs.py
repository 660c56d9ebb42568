"""Divides a session's samples into runs without a gap.

As in the session, samples whose time does not increase are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import COLUMNS_OF_SIGNAL, Gap, LengthUnit
from caesura_protocol.plausibility import METRES
from caesura_protocol.sample_limits import HOLE_S

Array = NDArray[np.float64]


class SampleRun(NamedTuple):
    """Successive samples without a gap. after: the gap before them; None if there is none."""

    t: Array  # (n,) [s] ascending
    values: Array  # (n, c) columns of the session but time
    after: Gap | None


class RunSplitter:
    """A fold from batches, in the order of their numbers, to runs; it stores the last sample."""

    def __init__(self) -> None:
        self.latest = -np.inf  # [s] the newest sample
        self._next_seq: int | None = None

    def push(self, matrix: Array, seqs: NDArray[np.int64]) -> list[SampleRun]:
        """Return the runs of further samples (n, columns), time [s] first.

        seqs: (n,) batch number of each sample.
        """
        highest = np.maximum.accumulate(np.concatenate([[self.latest], matrix[:, 0]]))
        advances = matrix[:, 0] > highest[:-1]
        matrix, seqs = matrix[advances], seqs[advances]
        if not len(matrix):
            return []
        t = matrix[:, 0]
        before = np.concatenate([[self.latest], t[:-1]])
        expected = np.concatenate([[seqs[0] if self._next_seq is None else self._next_seq], seqs[:-1] + 1])
        lost, pauses = seqs > expected, t - before > HOLE_S
        starts = np.flatnonzero((lost | pauses) & np.isfinite(before)).tolist()
        self.latest, self._next_seq = float(t[-1]), int(seqs[-1]) + 1
        runs = []
        for first, last in zip([0, *starts], [*starts, len(t)], strict=True):
            after = None
            if first in starts:
                reason = "evicted" if lost[first] else "source"
                after = Gap(t0=float(before[first]), tn=float(t[first]), reason=reason)
            if first < last:
                runs.append(SampleRun(t[first:last], matrix[first:last, 1:], after))
        return runs


def in_metres(columns: Sequence[str], unit: LengthUnit) -> Array:
    """Return the factor (c,) of each column that converts positions to metres."""
    return np.array([METRES[unit] if name in COLUMNS_OF_SIGNAL["pos"] else 1.0 for name in columns])
