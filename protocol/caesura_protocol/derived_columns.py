"""Columns that are computed from a session's samples, to be drawn beside those that were sent.

`speed` is that between the means of two windows of time. `rotation_x`, `rotation_y` and `rotation_z` are the
rotation vector [rad] from the session's first orientation, in the base frame. It depends on nothing but that
orientation and the sample, so any part of a session has the values of the whole. So it has no history in
which turns are counted: it is at most a half turn long, and jumps to the opposite vector there.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.columns import signal_columns
from caesura_protocol.gap_free_sample_runs import SampleRun
from caesura_protocol.messages import Quaternion
from caesura_protocol.rotations import rotation_vectors
from caesura_protocol.sample_limits import NORM_TOLERANCE

Array = NDArray[np.float64]

SPEED = "speed"
ROTATION = ("rotation_x", "rotation_y", "rotation_z")
DERIVED = (SPEED, *ROTATION)
SPEED_WINDOW_S = 0.04  # over which positions are averaged for the speed; two windows follow each other


def drawn_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a session that are drawn: all except time, and the derived ones that it can have.

    columns: of the session, time first. What was measured is not derived as well.
    """
    speed = (SPEED,) if _moving(columns) else ()
    return (*columns[1:], *speed, *(ROTATION if _turning(columns) else ()))


def chosen_columns(asked: Collection[str], known: tuple[str, ...]) -> tuple[str, ...]:
    """Return those of the requested columns that exist, in their order; all columns if none is requested."""
    return tuple(name for name in known if name in asked) if asked else known


def _moving(columns: Sequence[str]) -> list[int]:
    """Return the columns from which the speed is derived, counted without time; empty without it."""
    return [] if SPEED in columns else _places(columns, "pos", "q")


def _turning(columns: Sequence[str]) -> list[int]:
    """Return the columns from which the rotation is derived, counted without time; empty without it."""
    return [] if set(ROTATION) & set(columns) else _places(columns, "quat")


def _places(columns: Sequence[str], *signals: str) -> list[int]:
    """Return the columns of the first of these signals that is complete, counted without time.

    Empty without any.
    """
    known, there = list(columns[1:]), signal_columns(columns)
    for signal in signals:
        if signal in there:
            return [known.index(name) for name in there[signal]]
    return []


class DerivedColumns:
    """The derived columns of a session: a fold over its runs of samples.

    columns: of the session, time first. first_orientation: of the session, x y z w; if None, the first run
    that has one states it. has_beginning: does the first run begin with the session's first sample?
    """

    def __init__(
        self,
        columns: Sequence[str],
        first_orientation: Quaternion | None = None,
        *,
        has_beginning: bool = True,
    ) -> None:
        self.first_orientation = first_orientation
        self._has_beginning = has_beginning
        self._speed = Speed(_moving(columns))
        self._quaternion = _turning(columns)

    def beside(self, run: SampleRun) -> Array:
        """Return the values (n, c) of a run with the derived columns beside them, as `drawn_columns`.

        The speed is NaN within two windows after the beginning and after a gap. A rotation is NaN for a
        quaternion of zeros, and while the first orientation is unknown.
        """
        parts = [run.values]
        if self._speed.places:
            parts.append(self._speed.of(run)[:, None])
        if self._quaternion:
            parts.append(self._rotations(run.values[:, self._quaternion]))
        return np.hstack(parts) if len(parts) > 1 else run.values

    def _rotations(self, quaternions: Array) -> Array:
        if self.first_orientation is None and self._has_beginning:
            lengths = np.linalg.norm(quaternions, axis=1)
            for x, y, z, w in quaternions[np.isfinite(lengths) & (lengths > NORM_TOLERANCE)][:1].tolist():
                self.first_orientation = x, y, z, w
        if self.first_orientation is None:
            return np.full((len(quaternions), 3), np.nan)
        return rotation_vectors(quaternions, self.first_orientation)


class Speed:
    """The speed at every sample of a session: a fold that stores the last two windows.

    places: columns of the values from which it is computed.
    """

    def __init__(self, places: list[int]) -> None:
        self.places = places
        self._t, self._where = np.zeros(0), np.zeros((0, len(places)))

    def of(self, run: SampleRun) -> Array:
        """Return the speed (n,) at the samples of a run."""
        if run.after is not None:
            self._t, self._where = self._t[:0], self._where[:0]
        known = self._t.size
        t = np.concatenate([self._t, run.t])
        where = np.concatenate([self._where, run.values[:, self.places]])
        speed = _speed(t, where)[known:]
        kept = np.searchsorted(t, t[-1] - 2.5 * SPEED_WINDOW_S)
        kept = min(kept, max(t.size - 3, 0))
        self._t, self._where = t[kept:], where[kept:]
        return speed


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
    up_to_middle = sums[middle]
    newer = (sums[1:] - up_to_middle) / np.maximum(here + 1 - middle, 1)[:, None]
    older = (up_to_middle - sums[first]) / np.maximum(middle - first, 1)[:, None]
    moved = newer - older
    with np.errstate(invalid="ignore", divide="ignore"):
        speed: Array = np.linalg.norm(moved[:, 1:], axis=1) / moved[:, 0]
    speed[~valid] = np.nan
    return speed
