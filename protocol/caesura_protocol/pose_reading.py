"""How often a pose is read, where a faster clock repeats it.

A file at 100 Hz of a robot that reports 15 poses a second has most of them several times. The service
interpolates poses that repeat for at most `HOLD_S`, and takes longer ones as a rest. Where many of a movement
are held for longer, it is cut at them. Pure.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.sample_limits import HOLD_S

Array = NDArray[np.float64]

NEEDED_HZ = 25.0  # two poses and a half for each step of 0.1 s; slower ones are named
LEAST_HELD = 20  # poses that repeat; a hand that stops now and then has fewer
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
    """Say how often a pose is read, where a faster clock repeats it and it is slow; else None.

    t: (n,) [s]; signals: name → (n, width), as in a Recording.

    >>> t = np.arange(400) / 100.0
    >>> slow_pose(t, {"pos": np.column_stack([np.floor(t * 10.0 + 1e-9)] * 3)}).partition(" and ")[0]
    'The pose is read about 10 times a second'
    """
    names = ("pos", "quat") if "pos" in signals else ("q",)
    pose = np.hstack([signals[name] for name in names if name in signals])
    new = np.flatnonzero((pose[1:] != pose[:-1]).any(axis=1)) + 1
    apart, samples = np.diff(t[new]), np.diff(new)
    return _held_too_long(apart, samples) or _held(apart, samples)


def _held_too_long(apart: Array, samples: NDArray[np.int64]) -> str | None:
    """Name readings that are too seldom; apart [s], and how many samples apart."""
    read = (apart > 0.0) & (apart <= SELDOM_S)
    long = read & (apart > HOLD_S) & (samples > 1)
    if np.count_nonzero(long) < max(LEAST_HELD, LEAST_TOO_SELDOM * np.count_nonzero(read)):
        return None
    return TOO_SELDOM.format(read=1.0 / float(np.median(apart[read])), limit=HOLD_S, needed=ENOUGH_HZ)


def _held(apart: Array, samples: NDArray[np.int64]) -> str | None:
    """Name readings that are interpolated and slow; apart [s], and how many samples apart."""
    short = (apart > 0.0) & (apart <= HOLD_S)
    repeated = int((samples[short] - 1).sum())
    if np.count_nonzero(samples[short] > 1) < LEAST_HELD or repeated < LEAST_REPEATED * samples[short].sum():
        return None
    seconds = float(apart[short].mean())
    return HELD.format(read=1.0 / seconds, apart=seconds) if seconds > 1.0 / NEEDED_HZ else None
