"""Computes the fastest time law along a path within limits of velocity and acceleration.

TOPP-RA (Pham & Pham 2018, "A New Approach to Time-Optimal Path Parameterization Based on Reachability
Analysis") gives a law with discontinuous acceleration. It is averaged over two times, one after the other, so
that the acceleration is continuous. The path stays the same, and the movement takes longer by both times.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import toppra
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraintVarying

Array = NDArray[np.float64]

TICK_S = 1e-3
UNLIMITED = 1e3  # [m/s, m/s²]
# Places added near both ends, in steps of the way: a law that turns back just before its end crept to it.
NEAR_ENDS = np.array([0.1, 0.25, 0.5, 1.5])


class TimeLawError(ValueError):
    """No time law keeps the limits on this path."""


class Planned(NamedTuple):
    """A path with its limits: way (k,) [m] rising, values (k, d) of the coordinates there.

    velocity, acceleration: (d,) limits of the coordinates; rises_s: [s] over which a law is averaged.
    """

    way: Array
    values: Array
    velocity: Array
    acceleration: Array
    rises_s: tuple[float, float]


class Ceiling(NamedTuple):
    """The highest speeds (g,) [m/s] at places (g,) [m] along a path, rising; ends_at: [m/s] at its end."""

    places: Array
    speeds: Array
    ends_at: float = 0.0


def fastest(planned: Planned, ceiling: Ceiling) -> tuple[Array, Array]:
    """Return times (n,) [s] from 0 at every millisecond, and the length [m] covered by then, from rest.

    Raises TimeLawError.
    """
    ends_at = ceiling.ends_at
    near = NEAR_ENDS * (planned.way[1] - planned.way[0])
    way = np.unique(np.concatenate([ceiling.places, planned.way[0] + near, planned.way[-1] - near]))
    path = toppra.SplineInterpolator(planned.way, np.column_stack([planned.values, planned.way]))

    def limits(place: float) -> Array:
        highest = np.append(planned.velocity, np.interp(place, ceiling.places, ceiling.speeds))
        return np.column_stack([-highest, highest])

    constraints = [
        JointVelocityConstraintVarying(limits),
        JointAccelerationConstraint(np.append(planned.acceleration, UNLIMITED)),
    ]
    _, speeds, *_ = TOPPRA(constraints, path, gridpoints=way).compute_parameterization(0.0, ends_at)
    if speeds is None or not np.isfinite(speeds).all() or (speeds[1:-1] <= 0.0).any():
        raise TimeLawError("no time law keeps to the limits of the robot")
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(way) / (speeds[:-1] + speeds[1:]))])
    ticks = np.arange(0.0, times[-1] + TICK_S, TICK_S)
    covered = CubicHermiteSpline(times, way, speeds)(np.minimum(ticks, times[-1]))
    covered += ends_at * np.maximum(ticks - times[-1], 0.0)
    first, second = (np.ones(round(seconds / TICK_S)) for seconds in planned.rises_s)
    kernel = np.convolve(first, second) / (len(first) * len(second))
    around = len(kernel) - 1
    beyond = covered[-1] + ends_at * TICK_S * np.arange(1, around + 1)
    padded = np.concatenate([np.full(around, way[0]), covered, beyond])
    smooth = np.maximum.accumulate(np.clip(np.convolve(padded, kernel, "valid"), way[0], way[-1]))
    if ends_at:
        smooth = smooth[: int(np.searchsorted(smooth, way[-1])) + 1]
    return TICK_S * np.arange(len(smooth), dtype=np.float64), np.asarray(smooth, dtype=np.float64)
