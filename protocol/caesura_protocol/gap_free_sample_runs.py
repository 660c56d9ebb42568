"""Divides a session's samples into runs without a gap, and computes their speed.

As in the session, samples whose time does not increase are left out.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.columns import signal_columns
from caesura_protocol.messages import COLUMNS_OF_SIGNAL, Gap, LengthUnit
from caesura_protocol.plausibility import METRES
from caesura_protocol.sample_limits import HOLE_S

Array = NDArray[np.float64]

SPEED = "speed"
SPEED_WINDOW_S = 0.04  # over which positions are averaged for the speed; two windows follow each other


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


def drawn_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a session that are drawn: all except time, and `speed` if it can be computed.

    columns: of the session, time first.
    """
    return (*columns[1:], *((SPEED,) if _places(columns) else ()))


def chosen_columns(asked: Collection[str], known: tuple[str, ...]) -> tuple[str, ...]:
    """Return those of the requested columns that exist, in their order; all columns if none is requested."""
    return tuple(name for name in known if name in asked) if asked else known


def in_metres(columns: Sequence[str], unit: LengthUnit) -> Array:
    """Return the factor (c,) of each column that converts positions to metres."""
    return np.array([METRES[unit] if name in COLUMNS_OF_SIGNAL["pos"] else 1.0 for name in columns])


def _places(columns: Sequence[str]) -> list[int]:
    """Return the columns from which the speed is computed, counted without time: positions, else joints.

    Empty without both.
    """
    known, there = list(columns[1:]), signal_columns(columns)
    for signal in ("pos", "q"):
        if signal in there:
            return [known.index(name) for name in there[signal]]
    return []


class Speed:
    """The speed at every sample of a session: a fold that stores the last two windows.

    columns: of the session, time first.
    """

    def __init__(self, columns: Sequence[str]) -> None:
        self._places = _places(columns)
        self._t, self._where = np.zeros(0), np.zeros((0, len(self._places)))

    def beside(self, run: SampleRun) -> Array:
        """Return the values (n, c) of a run with the speed as a further column, if it can be computed.

        It is NaN within two windows after the beginning and after a gap.
        """
        if not self._places:
            return run.values
        if run.after is not None:
            self._t, self._where = self._t[:0], self._where[:0]
        known = self._t.size
        t = np.concatenate([self._t, run.t])
        where = np.concatenate([self._where, run.values[:, self._places]])
        speed = _speed(t, where)[known:]
        kept = np.searchsorted(t, t[-1] - 2.5 * SPEED_WINDOW_S)
        kept = min(kept, max(t.size - 3, 0))
        self._t, self._where = t[kept:], where[kept:]
        return np.column_stack([run.values, speed])


def _speed(t: Array, where: Array) -> Array:
    """Return the speed (n,) between the means of the two newest windows; nan within two of the beginning."""
    sums = np.concatenate(
        [np.zeros((1, where.shape[1] + 1)), np.cumsum(np.column_stack([t - t[0], where - where[0]]), 0)]
    )
    here = np.arange(t.size)
    middle = np.minimum(np.searchsorted(t, t - SPEED_WINDOW_S, side="right"), here)
    first = np.minimum(np.searchsorted(t, t - 2 * SPEED_WINDOW_S, side="right"), middle - 1)
    valid = (middle >= 1) & (t - 2 * SPEED_WINDOW_S >= t[0])
    middle, first = np.maximum(middle, 1), np.maximum(first, 0)
    newer = (sums[here + 1] - sums[middle]) / np.maximum(here + 1 - middle, 1)[:, None]
    older = (sums[middle] - sums[first]) / np.maximum(middle - first, 1)[:, None]
    moved = newer - older
    with np.errstate(invalid="ignore", divide="ignore"):
        speed: Array = np.linalg.norm(moved[:, 1:], axis=1) / moved[:, 0]
    speed[~valid] = np.nan
    return speed
