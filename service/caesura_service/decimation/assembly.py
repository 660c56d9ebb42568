"""Batches of a session to the columns that are drawn: time, samples in metres, and the speed.

As in the session itself, samples whose time does not advance are left out, and a batch whose content was
refused counts as lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import COLUMNS_OF_SIGNAL, Gap, Open, SampleBatch
from caesura_service.journal import StoredBatch
from caesura_service.session.content import samples_of
from caesura_service.session.limits import Limits

Array = NDArray[np.float64]

SPEED = "speed"
SPEED_WINDOW_S = 0.04  # a mean over which positions are taken for the speed; two of them follow each other
HOLE_S = 0.25  # between samples; a longer one is a gap of the session as well
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
LIMITS = Limits()


class SampleRun(NamedTuple):
    """Samples that follow each other. after: the hole before them; None where they go on."""

    t: Array  # (n,) [s] ascending
    values: Array  # (n, c) columns of `columns_of`, without the speed
    after: Gap | None


class Assembly:
    """Batches in the order of their numbers to stretches: a fold that remembers the last sample."""

    def __init__(self, opening: Open) -> None:
        self._opening = opening
        self._scale = np.array(
            [
                METRES[opening.length_unit] if name in COLUMNS_OF_SIGNAL["pos"] else 1.0
                for name in opening.columns
            ]
        )
        self.latest = -np.inf  # [s] the newest sample
        self._next_seq: int | None = None

    def push(self, batches: Sequence[StoredBatch]) -> list[SampleRun]:
        """The samples of further batches."""
        if not batches:
            return []
        matrix, seqs = self._matrix(batches)
        highest = np.maximum.accumulate(np.concatenate([[self.latest], matrix[:, 0]]))
        advances = matrix[:, 0] > highest[:-1]
        matrix, seqs = matrix[advances], seqs[advances]
        if not len(matrix):
            return []
        t = matrix[:, 0]
        before = np.concatenate([[self.latest], t[:-1]])
        expected = np.concatenate([[seqs[0] if self._next_seq is None else self._next_seq], seqs[:-1] + 1])
        lost, pauses = seqs > expected, t - before > HOLE_S
        breaks = np.flatnonzero(lost | (pauses & np.isfinite(before)))
        stretches = []
        for first, last in zip([0, *breaks], [*breaks, len(t)], strict=True):
            if first == last:
                continue
            after = None
            if first in breaks and np.isfinite(before[first]):
                reason = "evicted" if lost[first] else "source"
                after = Gap(t0=float(before[first]), tn=float(t[first]), reason=reason)
            stretches.append(SampleRun(t[first:last], matrix[first:last, 1:], after))
        self.latest, self._next_seq = float(t[-1]), int(seqs[-1]) + 1
        return stretches

    def _matrix(self, batches: Sequence[StoredBatch]) -> tuple[Array, NDArray[np.int64]]:
        """(n, columns) in metres, and the number of the batch of each row."""
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

    def _checked(self, batches: Sequence[StoredBatch]) -> tuple[Array, NDArray[np.int64]]:
        """As the session has checked them, one by one."""
        parts, seqs = [np.zeros((0, len(self._opening.columns)))], [np.zeros(0, np.int64)]
        for one in batches:
            batch = SampleBatch.model_construct(
                session=self._opening.session,
                epoch=0,
                **{k: v for k, v in one._asdict().items() if k != "place"},
            )
            try:
                parts.append(samples_of(batch, self._opening.columns, LIMITS) * self._scale)
            except ProtocolError:  # it was refused when it came
                continue
            seqs.append(np.full(len(parts[-1]), one.seq))
        return np.concatenate(parts), np.concatenate(seqs)


def columns_of(opening: Open) -> tuple[str, ...]:
    """What can be asked for: the session's columns but time, and the speed where something has a place."""
    return (*opening.columns[1:], *((SPEED,) if _places(opening) else ()))


def _places(opening: Open) -> list[int]:
    """Which columns the speed is of, counted without time: positions, else joints."""
    columns = opening.columns[1:]
    for signal in ("pos", "q"):
        if set(COLUMNS_OF_SIGNAL[signal]) <= set(columns):
            return [columns.index(name) for name in COLUMNS_OF_SIGNAL[signal]]
    return []


class Speed:
    """The speed at every sample of a session: a fold that remembers the last two windows."""

    def __init__(self, opening: Open) -> None:
        self._places = _places(opening)
        self._t, self._where = np.zeros(0), np.zeros((0, len(self._places)))

    def beside(self, stretch: SampleRun) -> Array:
        """The values (n, c) of a stretch with the speed as a further column, where there is one.

        NaN within two windows after the beginning and after a hole.
        """
        if not self._places:
            return stretch.values
        if stretch.after is not None:
            self._t, self._where = self._t[:0], self._where[:0]
        known = self._t.size
        t = np.concatenate([self._t, stretch.t])
        where = np.concatenate([self._where, stretch.values[:, self._places]])
        speed = _speed(t, where)[known:]
        kept = np.searchsorted(t, t[-1] - 2.5 * SPEED_WINDOW_S)
        kept = min(kept, max(t.size - 3, 0))
        self._t, self._where = t[kept:], where[kept:]
        return np.column_stack([stretch.values, speed])


def _speed(t: Array, where: Array) -> Array:
    """Between the means of two windows that follow each other, of each at least one sample."""
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
