"""Where a movement is on its way at each time: as fast as limits of velocity and acceleration allow.

TOPP-RA (Pham & Pham 2018, "A New Approach to Time-Optimal Path Parameterization Based on Reachability
Analysis") gives a law whose acceleration jumps. It is averaged over `SMOOTHED_S` twice, so the acceleration
rises and falls within that time. The way stays the same, and the movement takes so much longer.
"""

from __future__ import annotations

import numpy as np
import toppra
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

Array = NDArray[np.float64]

TICK_S = 1e-3
SMOOTHED_S = 0.04


class TimeLawError(ValueError):
    """No time law keeps to the limits on this way."""


def fastest(way: Array, values: Array, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
    """Times (n,) [s] from 0 at every millisecond, and the way covered by then, from rest to rest.

    way: (k,) rising; values: (k, d) of the coordinates there; velocity, acceleration: (d,) their limits.
    Raises TimeLawError.
    """
    path = toppra.SplineInterpolator(way, values)
    constraints = [JointVelocityConstraint(velocity), JointAccelerationConstraint(acceleration)]
    _, speeds, *_ = TOPPRA(constraints, path, gridpoints=way).compute_parameterization(0.0, 0.0)
    if speeds is None or not np.isfinite(speeds).all() or (speeds[1:-1] <= 0.0).any():
        raise TimeLawError("no time law keeps to the limits of the robot")
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(way) / (speeds[:-1] + speeds[1:]))])
    ticks = np.arange(0.0, times[-1] + TICK_S, TICK_S)
    covered = CubicHermiteSpline(times, way, speeds)(np.minimum(ticks, times[-1]))
    box = np.full(round(SMOOTHED_S / TICK_S), TICK_S / SMOOTHED_S)
    kernel = np.convolve(box, box)
    around = len(kernel) - 1
    padded = np.concatenate([np.full(around, way[0]), covered, np.full(around, way[-1])])
    smooth = np.maximum.accumulate(np.clip(np.convolve(padded, kernel, "valid"), way[0], way[-1]))
    return TICK_S * np.arange(len(smooth), dtype=np.float64), np.asarray(smooth, dtype=np.float64)
