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
5. A pose that repeats the one before, bit for bit, is an old reading that a faster clock has held. Poses
   that are held for at most the hold limit are interpolated between new ones. So rows after a new pose wait
   for the next one, as long as the limit. A pose that is held for longer is a rest.
6. Rows may be returned in groups of `every`, as soon as the last row of a group is complete. Until then a
   push whose samples are in order is only stored: all rows of a group are computed at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals.backend import REFERENCE, Backend

Array = NDArray[np.float64]

MAX_WAITING_SAMPLES = 1000  # in one unfinished cell: 100 kHz on a 100 Hz grid
LEAP_LIMIT_S = 3600.0  # a longer silence is a clock that was set, or a time in another unit


class Block(NamedTuple):
    """Consecutive grid rows of one stretch without a gap: row i has the grid index first + i."""

    first: int
    rows: Array  # (n, c), n may be 0
    restarts: bool  # a gap lies before it: filters forget what came before


class Resampled(NamedTuple):
    """The grid rows that one push completes, with its gaps and repeats."""

    blocks: tuple[Block, ...]
    gaps: tuple[tuple[float, float], ...]  # [s] last sample before, first sample after
    repeats: int  # samples dropped because their time did not advance


NOTHING = Resampled((), (), 0)


class GridState(NamedTuple):
    """The state of the grid, and the pushed samples that the rows to come still need."""

    anchor: float  # [s] time of the first sample
    next_row: int
    due: float  # [s] the first sample from then on completes rows that are handed out
    latest: float  # [s] time of the last sample
    waiting: tuple[Array, ...]  # (m, 1 + c) each, time first
    known: int  # samples in all of these
    posed: float  # [s] time of the last sample known to have a new pose


@dataclass(frozen=True)
class Resampler:
    """Immutable parameters of the grid; `advance` maps a state and samples to the next state and rows.

    held: how many of the last columns are held. quaternion: columns to make sign-continuous beforehand.
    pose: how many of the first columns are the pose; beside: how many columns follow (joints) whose held
    readings are interpolated with it; hold_limit_s [s]: see rule 5.
    every, phase: rows are returned up to row phase, phase + every, … (itself not included), or to a gap.
    """

    grid_hz: float
    gap_limit_s: float
    held: int = 0
    quaternion: slice | None = None
    pose: int = 0
    beside: int = 0
    hold_limit_s: float = 0.0
    every: int = 1
    phase: int = 0
    arithmetic: Backend = REFERENCE

    def time_of(self, anchor: float, row: int) -> float:
        """Session time of a grid row [s]."""
        return anchor + row / self.grid_hz

    def advance(
        self, state: GridState | None, samples: Array, *, broken: bool = False
    ) -> tuple[GridState | None, Resampled]:
        """Process samples (n, 1 + c), time first [s]. The state is None before the first one.

        Keeps the matrix: the caller must not write to it. broken: whether samples before these are lost.
        Raises ValueError over MAX_WAITING_SAMPLES, and for a clock that goes back by more than a gap or jumps
        ahead by more than LEAP_LIMIT_S.
        """
        steady = self.arithmetic.is_steady
        if state is not None and not broken and steady(samples, state.latest, self.gap_limit_s):
            anchor, next_row, due, _, waiting, known, posed = state
            latest, waiting, known = float(samples[-1, 0]), (*waiting, samples), known + len(samples)
            if latest < due and known <= MAX_WAITING_SAMPLES:
                return GridState(anchor, next_row, due, latest, waiting, known, posed), NOTHING
            state, block = self._extended(anchor, next_row, self._joined(waiting), posed, restarts=False)
            return state, Resampled((block,), (), 0)
        return self._sorted_out(state, samples, broken=broken)

    def flush(self, state: GridState) -> tuple[GridState, Block]:
        """Return the rows that are complete and held for others."""
        samples = self._joined(state.waiting)
        posed = self._interpolated_holds(samples, state.posed)
        next_row = max(state.next_row, self._row_open_at(state.anchor, state.latest))
        rows = self._rows(state.anchor, state.next_row, next_row, samples)
        state_after = self._state(state.anchor, next_row, samples, posed)
        return state_after, Block(state.next_row, rows, restarts=False)

    def _sorted_out(
        self, state: GridState | None, samples: Array, *, broken: bool
    ) -> tuple[GridState | None, Resampled]:
        """Process samples of which some may be repeated, or follow a gap."""
        latest = -math.inf if state is None else state.latest
        self._check_clock(samples[:, 0], None if state is None else latest)
        fresh = samples[_advancing(samples[:, 0], latest)]
        repeats = len(samples) - len(fresh)
        if len(fresh) == 0:
            return state, Resampled((), (), repeats)
        known, waiting = (0, ()) if state is None else (state.known, state.waiting)
        samples = self._joined((*waiting, fresh))
        times = samples[:, 0]
        holes = np.concatenate([[False], times[1:] - times[:-1] > self.gap_limit_s])
        holes[known] |= broken and state is not None
        anchor = float(times[0]) if state is None else state.anchor
        first = self._row_from(anchor, anchor) if state is None else state.next_row
        posed = float(times[0]) if state is None else state.posed
        blocks: list[Block] = []
        for start, stop in pairwise([0, *np.flatnonzero(holes).tolist(), len(samples)]):
            if start and state is not None:
                state, rest = self.flush(state)
                blocks += [rest] if len(rest.rows) else []
                posed = float(times[start])
                first = self._row_from(anchor, posed)
            state, block = self._extended(anchor, first, samples[start:stop], posed, restarts=start > 0)
            blocks += [block] if start or len(block.rows) else []
        gaps = tuple((float(times[i - 1]), float(times[i])) for i in np.flatnonzero(holes))
        return state, Resampled(tuple(blocks), gaps, repeats)

    def _check_clock(self, times: Array, latest: float | None) -> None:
        """Raise ValueError for a clock that was set: times before and after that cannot be ordered."""
        known = times[:1] if latest is None else np.array([latest])
        highest = np.maximum.accumulate(np.concatenate([known, times]))[:-1]
        for steps, limit, verb in (
            (highest - times, self.gap_limit_s, "goes back"),
            (times - highest, LEAP_LIMIT_S, "leaps"),
        ):
            if (steps > limit).any():
                i = int(np.argmax(steps > limit))
                raise ValueError(
                    f"sample {i}: time {verb} by {steps[i]:.7g} s, from {highest[i]:.13g} s to "
                    f"{times[i]:.13g} s, expected within {limit:g} s: the robot's clock was set; end this "
                    "session and begin another"
                )

    def _joined(self, waiting: Sequence[Array]) -> Array:
        """Return all samples in one matrix, each quaternion with the sign nearer to the one before it."""
        samples = np.concatenate(waiting)
        if self.quaternion is not None:
            self.arithmetic.make_sign_continuous(samples, 1 + self.quaternion.start)
        return samples

    def _extended(
        self, anchor: float, first: int, samples: Array, posed: float, *, restarts: bool
    ) -> tuple[GridState, Block]:
        """Make rows of the cells from `first` on that samples without a gap complete."""
        latest = float(samples[-1, 0])
        self._check_waiting(samples, anchor, max(first, self._row_open_at(anchor, latest)))
        posed = self._interpolated_holds(samples, posed)
        unfinished = self._row_open_at(anchor, posed if self._waits_for_pose(posed, latest) else latest)
        next_row = max(first, unfinished - (unfinished - self.phase) % self.every)
        rows = self._rows(anchor, first, next_row, samples)
        return self._state(anchor, next_row, samples, posed), Block(first, rows, restarts)

    def _interpolated_holds(self, samples: Array, posed: float) -> float:
        """Interpolate the poses after the last new one; return the time [s] of the newest new pose."""
        if not self.pose:
            return float(samples[-1, 0])
        return self.arithmetic.interpolate_holds(samples, self.pose, self.beside, posed, self.hold_limit_s)

    def _waits_for_pose(self, posed: float, latest: float) -> bool:
        """Whether the poses since the last new one may still be interpolated."""
        return latest - posed <= self.hold_limit_s

    def _state(self, anchor: float, next_row: int, samples: Array, posed: float) -> GridState:
        """Return the state with those of the samples that the rows from next_row on need."""
        last = next_row + 1 + (self.phase - next_row - 1) % self.every
        due, latest = self._edge(anchor, last), float(samples[-1, 0])
        wanted = self._edge(anchor, next_row)
        if self._waits_for_pose(posed, latest):
            wanted = min(wanted, posed)
        kept = samples[_wanted_from(samples[:, 0], wanted) :].copy()
        return GridState(anchor, next_row, due, latest, (kept,), len(kept), posed)

    def _rows(self, anchor: float, first: int, next_row: int, samples: Array) -> Array:
        rows = np.empty((next_row - first + 1, samples.shape[1] - 1))
        if next_row > first:
            self.arithmetic.resample(samples, anchor, self.grid_hz, first, self.held, rows)
        return rows[:-1]

    def _check_waiting(self, samples: Array, anchor: float, row: int) -> None:
        """Raise ValueError for more than MAX_WAITING_SAMPLES samples within the cells from this row on."""
        if len(samples) <= MAX_WAITING_SAMPLES:
            return
        waiting = len(samples) - _wanted_from(samples[:, 0], self._edge(anchor, row))
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
        """Return the row whose cell contains t and is not complete."""
        row = self._row_from(anchor, t)
        return row if self._edge(anchor, row) == t else row - 1


def _advancing(times: Array, latest: float) -> NDArray[np.bool_]:
    """Return (n,) whether each sample is later than all samples before it, and than `latest` [s]."""
    highest = np.maximum.accumulate(np.concatenate([[latest], times]))
    advancing: NDArray[np.bool_] = times > highest[:-1]
    return advancing


def _wanted_from(times: Array, edge: float) -> int:
    """Return the index of the first sample that a cell from this edge on needs: the last before the edge."""
    return max(0, int(times.searchsorted(edge)) - 1)
