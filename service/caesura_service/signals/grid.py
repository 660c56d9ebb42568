"""Resampling: jittered, gapped, repeated samples at any rate to a fixed grid.

Rules
1. The grid is anchored at the first sample's time and never moves; row k describes anchor + k / grid_hz.
2. A row is the mean of the piecewise-linear interpolant over its cell, one grid period wide and centred on
   the row's time. For fast input that is an anti-aliasing filter, for slow input interpolation.
   Columns that are held (the last ones) take the last value at or before the row's time instead.
3. Only cells that samples span completely become rows: nothing is extrapolated, nothing invented in a hole
   longer than the gap limit. Such a hole ends a stretch, is reported, and the next stretch starts afresh.
4. A row is the same, bit for bit, however the samples were cut into pushes: an unfinished cell keeps its
   samples, never a partial sum.
5. Rows may be handed out `every` so many together, as soon as the last of them is complete: where only some
   rows lead to anything, looking at each as it comes costs as much again for every push.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals.cells import cell_means, held_values
from caesura_service.signals.rotation import sign_continuous

Array = NDArray[np.float64]

MAX_WAITING_SAMPLES = 1000  # in one unfinished cell: 100 kHz on a 100 Hz grid
LEAP_LIMIT_S = 3600.0  # a longer silence is a clock that was set, or a time in another unit


class Block(NamedTuple):
    """Consecutive grid rows of one stretch: row i has the grid index first + i."""

    first: int
    rows: Array  # (n, c), n may be 0
    restarts: bool  # a gap lies before it: filters forget what came before


class Resampled(NamedTuple):
    """What one push came to."""

    blocks: tuple[Block, ...]
    gaps: tuple[tuple[float, float], ...]  # [s] last sample before, first sample after
    repeats: int  # samples dropped because their time did not advance


@dataclass(frozen=True, eq=False)
class GridState:
    """Where the grid stands, and the samples that the rows to come still want."""

    anchor: float  # [s] time of the first sample
    next_row: int
    times: Array  # (m,) [s]
    values: Array  # (m, c)

    @property
    def latest(self) -> float:
        """Time of the last sample [s]."""
        return float(self.times[-1])


@dataclass(frozen=True)
class Resampler:
    """Immutable parameters of the grid; `advance` maps a state and samples to the next state and rows.

    held: how many of the last columns are held. quaternion: columns to make sign-continuous beforehand.
    every, phase: rows are handed out up to row phase, phase + every, … (itself not included), or to a gap.
    """

    grid_hz: float
    gap_limit_s: float
    held: int = 0
    quaternion: slice | None = None
    every: int = 1
    phase: int = 0

    def time_of(self, anchor: float, row: int) -> float:
        """Session time of a grid row [s]."""
        return anchor + row / self.grid_hz

    def advance(
        self, state: GridState | None, times: Array, values: Array, *, broken: bool = False
    ) -> tuple[GridState | None, Resampled]:
        """Take samples: times (n,) [s], values (n, c). The state is None before the first sample.

        broken: samples before these were lost for good. Raises ValueError over MAX_WAITING_SAMPLES, and for a
        clock that goes back by more than a gap or leaps by more than LEAP_LIMIT_S.
        """
        if state is not None and not broken and self._is_steady(times, state.latest):
            state, block = self._extend(state, times, self._with_continuous_signs(state, values), False)
            return state, Resampled((block,), (), 0)
        self._check_clock(times, None if state is None else state.latest)
        fresh = _advancing(times, -math.inf if state is None else state.latest)
        repeats = len(times) - int(np.count_nonzero(fresh))
        times, values = times[fresh], values[fresh]
        if len(times) == 0:
            return state, Resampled((), (), repeats)
        values = self._with_continuous_signs(state, values)
        before = np.concatenate([times[:1] if state is None else state.times[-1:], times[:-1]])
        holes = times - before > self.gap_limit_s
        holes[0] |= broken and state is not None
        blocks: list[Block] = []
        for start, stop in _stretches(holes):
            restarts = bool(holes[start])
            if restarts and state is not None:
                state, rest = self.flush(state)
                blocks += [rest] if len(rest.rows) else []
            state, block = self._extend(state, times[start:stop], values[start:stop], restarts)
            blocks.append(block)
        gaps = tuple((float(before[i]), float(times[i])) for i in np.flatnonzero(holes))
        return state, Resampled(tuple(blocks), gaps, repeats)

    def flush(self, state: GridState) -> tuple[GridState, Block]:
        """Hand out the rows that are complete but wait for others."""
        next_row = max(state.next_row, self._row_open_at(state.anchor, state.latest))
        rows = self._rows(state.anchor, state.next_row, next_row, state.times, state.values)
        return replace(state, next_row=next_row), Block(state.next_row, rows, restarts=False)

    def _is_steady(self, times: Array, latest: float) -> bool:
        """Whether every sample is later than the one before, and none by more than a gap."""
        if not times.size or not 0.0 < times[0] - latest <= self.gap_limit_s:
            return False
        steps = times[1:] - times[:-1]
        return not steps.size or bool(steps.min() > 0.0 and steps.max() <= self.gap_limit_s)

    def _check_clock(self, times: Array, latest: float | None) -> None:
        """Refuse a clock that was set: what it says of before and after cannot be put in order."""
        known = times[:1] if latest is None else np.array([latest])
        highest = np.maximum.accumulate(np.concatenate([known, times]))[:-1]
        for steps, limit, verb in (
            (highest - times, self.gap_limit_s, "goes back"),
            (times - highest, LEAP_LIMIT_S, "leaps"),
        ):
            if (steps > limit).any():
                i = int(np.argmax(steps > limit))
                raise ValueError(
                    f"sample {i}: time {verb} from {highest[i]:.6g} s to {times[i]:.6g} s, "
                    f"expected within {limit:g} s"
                )

    def _with_continuous_signs(self, state: GridState | None, values: Array) -> Array:
        if self.quaternion is None:
            return values
        previous = None if state is None else state.values[-1, self.quaternion]
        values = values.copy()
        values[:, self.quaternion] = sign_continuous(values[:, self.quaternion], previous)
        return values

    def _extend(
        self, state: GridState | None, times: Array, values: Array, restarts: bool
    ) -> tuple[GridState, Block]:
        """Add samples without a hole, and turn the cells that they complete into rows."""
        anchor = float(times[0]) if state is None else state.anchor
        if state is None or restarts:
            first = self._row_from(anchor, float(times[0]))
        else:
            first = state.next_row
            times, values = np.concatenate([state.times, times]), np.concatenate([state.values, values])
        unfinished = self._row_open_at(anchor, float(times[-1]))
        next_row = max(first, unfinished - (unfinished - self.phase) % self.every)
        self._check_waiting(times, self._edge(anchor, max(first, unfinished)))
        rows = self._rows(anchor, first, next_row, times, values)
        wanted = _wanted_from(times, self._edge(anchor, next_row))
        state = GridState(anchor, next_row, times[wanted:].copy(), values[wanted:].copy())
        return state, Block(first, rows, restarts)

    def _rows(self, anchor: float, first: int, next_row: int, times: Array, values: Array) -> Array:
        if next_row == first:
            return np.empty((0, values.shape[1]))
        rows = np.arange(first, next_row + 1, dtype=np.float64)
        edges = anchor + (rows - 0.5) / self.grid_hz
        means = cell_means(edges, times, values)
        if self.held:
            centres = anchor + rows[:-1] / self.grid_hz
            means[:, -self.held :] = held_values(centres, times, values[:, -self.held :])
        return means

    def _check_waiting(self, times: Array, edge: float) -> None:
        waiting = len(times) - _wanted_from(times, edge)
        if waiting > MAX_WAITING_SAMPLES:
            raise ValueError(
                f"{waiting} samples within {1 / self.grid_hz:g} s, expected at most {MAX_WAITING_SAMPLES}"
            )

    def _edge(self, anchor: float, row: int) -> float:
        """Left edge of a row's cell [s]."""
        return anchor + (row - 0.5) / self.grid_hz

    def _row_from(self, anchor: float, t: float) -> int:
        """First row whose cell begins at t or later. Settled by comparing edges, not by rounding."""
        row = math.ceil((t - anchor) * self.grid_hz + 0.5)
        while self._edge(anchor, row - 1) >= t:
            row -= 1
        while self._edge(anchor, row) < t:
            row += 1
        return row

    def _row_open_at(self, anchor: float, t: float) -> int:
        """Find the row whose cell t lies in and has not completed."""
        row = self._row_from(anchor, t)
        return row if self._edge(anchor, row) == t else row - 1


def _advancing(times: Array, latest: float) -> NDArray[np.bool_]:
    """Which samples are later than all before them."""
    highest = np.maximum.accumulate(np.concatenate([[latest], times]))
    advancing: NDArray[np.bool_] = times > highest[:-1]
    return advancing


def _stretches(holes: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Ranges of samples without a hole inside; a hole before the first sample divides nothing."""
    starts = [0, *(np.flatnonzero(holes[1:]) + 1).tolist()]
    return list(zip(starts, [*starts[1:], len(holes)], strict=True))


def _wanted_from(times: Array, edge: float) -> int:
    """First sample that the cell beginning at this edge needs: the last one before the edge."""
    return max(0, int(np.searchsorted(times, edge)) - 1)
