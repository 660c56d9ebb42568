"""Estimates the rate at which a pose is read, if a faster clock repeats it.

A file at 100 Hz from a robot that reports 15 poses a second contains most poses several times. The service
interpolates poses that repeat for at most `HOLD_S`; longer repeats count as a rest. If many poses of a
movement repeat for longer, the movement is divided at them. Pure functions.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.columns import signal_columns
from caesura_protocol.sample_limits import HOLD_S

Array = NDArray[np.float64]

NEEDED_HZ = 25.0  # two poses and a half for each step of 0.1 s; slower ones are named
LEAST_HELD = 20  # poses that repeat; a hand that stops now and then has fewer
LATEST = 400  # readings of a live pose that are judged
LEAST_REPEATED = 0.25  # of the samples between poses that are read
SELDOM_S = 0.5  # between two readings of a moving robot at most
LEAST_TOO_SELDOM = 0.25  # of the poses that are read: those that are held for longer than the limit
HELD = (
    "The pose is read about {read:.2g} times a second and repeated in between: it is interpolated, and "
    "boundaries are known to about {apart:.2g} s."
)
TOO_SELDOM = (
    "The pose is read about {read:.2g} times a second and repeated in between, often for longer than "
    "{limit:g} s: each such time is taken as a rest, and movements are cut at it. Read the pose at least "
    "{needed:g} times a second."
)
ENOUGH_HZ = 10.0  # readings at a clock of 100 Hz are then at most 0.11 s apart


def slow_pose(t: Array, signals: Mapping[str, Array]) -> str | None:
    """Return a sentence on the rate of a pose if it is slow and a faster clock repeats it; else None.

    t: (n,) [s]; signals: name → (n, width), as in a Recording.

    >>> t = np.arange(400) / 100.0
    >>> slow_pose(t, {"pos": np.column_stack([np.floor(t * 10.0 + 1e-9)] * 3)}).partition(" and ")[0]
    'The pose is read about 10 times a second'
    """
    names = _pose_signals(signals)
    if not names:
        return None
    pose = np.hstack([signals[name] for name in names])
    new = np.flatnonzero((pose[1:] != pose[:-1]).any(axis=1)) + 1
    return _slow(np.diff(t[new]), np.diff(new))


class PoseReadings:
    """Rate at which a live pose is read: a fold over samples that keeps the newest `LATEST` readings.

    columns: of the samples, `t` first. A finding in `slow` is kept.
    """

    def __init__(self, columns: Sequence[str]) -> None:
        known = signal_columns(columns)
        names = [name for signal in _pose_signals(known) for name in known[signal]]
        self.slow: str | None = None  # as of `slow_pose`
        self._places = [list(columns).index(name) for name in names]
        self._last: Array | None = None  # the newest pose
        self._count = 0  # of samples
        self._held = 0  # readings that were repeated, since they were judged
        self._read: deque[tuple[float, int]] = deque(maxlen=LATEST)  # time [s] and number of its sample

    def push(self, rows: NDArray[np.floating]) -> None:
        """Process further samples (k, columns)."""
        if self.slow is not None or not self._places or not len(rows):
            return
        pose = np.asarray(rows, np.float64)[:, self._places]
        before = np.concatenate([pose[:1] if self._last is None else self._last[None], pose[:-1]])
        for i in np.flatnonzero((pose != before).any(axis=1)).tolist():
            number = self._count + i
            self._held += bool(self._read) and number - self._read[-1][1] > 1
            self._read.append((float(rows[i, 0]), number))
        self._last, self._count = pose[-1].copy(), self._count + len(rows)
        if self._held >= LEAST_HELD:
            self._held = 0
            t, numbers = (np.array(column) for column in zip(*self._read, strict=True))
            self.slow = _slow(np.diff(t), np.diff(numbers))


def _pose_signals(there: Mapping[str, object]) -> list[str]:
    """Return the names of the signals that are the pose."""
    return [name for name in (("pos", "quat") if "pos" in there else ("q",)) if name in there]


def _slow(apart: Array, samples: NDArray[np.int64]) -> str | None:
    return _held_too_long(apart, samples) or _held(apart, samples)


def _held_too_long(apart: Array, samples: NDArray[np.int64]) -> str | None:
    """Return a sentence on readings that are too far apart.

    apart: [s] between readings; samples: numbers of samples between them.
    """
    read = (apart > 0.0) & (apart <= SELDOM_S)
    repeated = read & (samples > 1)
    long = repeated & (apart > HOLD_S)
    if np.count_nonzero(long) < max(LEAST_HELD, LEAST_TOO_SELDOM * np.count_nonzero(read)):
        return None
    return TOO_SELDOM.format(read=1.0 / float(np.median(apart[repeated])), limit=HOLD_S, needed=ENOUGH_HZ)


def _held(apart: Array, samples: NDArray[np.int64]) -> str | None:
    """Return a sentence on slow readings that are interpolated.

    apart: [s] between readings; samples: numbers of samples between them.
    """
    short = (apart > 0.0) & (apart <= HOLD_S)
    repeated = int((samples[short] - 1).sum())
    if np.count_nonzero(samples[short] > 1) < LEAST_HELD or repeated < LEAST_REPEATED * samples[short].sum():
        return None
    seconds = float(apart[short].mean())
    return HELD.format(read=1.0 / seconds, apart=seconds) if seconds > 1.0 / NEEDED_HZ else None
