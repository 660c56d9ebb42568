"""Computes the fastest time law along a path within limits of velocity and acceleration.

TOPP-RA (Pham & Pham 2018, "A New Approach to Time-Optimal Path Parameterization Based on Reachability
Analysis") gives a law with discontinuous acceleration. It is averaged twice over a time, so that the
acceleration is continuous. The path stays the same, and the movement takes longer by twice that time.

A movement that ends in a contact arrives with a given speed, for which it brakes in time.
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


class TimeLawError(ValueError):
    """No time law keeps the limits on this path."""


class Arrival(NamedTuple):
    """The end of a path: a constant speed in its last part, and braking before that; by default at rest."""

    speed: float = 0.0  # [m/s]
    slow_m: float = 0.0
    brake: float = np.inf  # [m/s²]

    def ceiling(self, left: float) -> float:
        """Return the highest speed [m/s] with `left` [m] of the path left."""
        braked = left - self.slow_m
        return float(np.sqrt(self.speed**2 + 2.0 * self.brake * braked)) if braked > 0.0 else self.speed


AT_REST = Arrival()


def fastest(
    way: Array,
    values: Array,
    velocity: Array,
    acceleration: Array,
    rise_s: float,
    arrival: Arrival = AT_REST,
) -> tuple[Array, Array]:
    """Return times (n,) [s] from 0 at every millisecond, and the length covered by then, starting at rest.

    way: (k,) [m] rising; values: (k, d) of the coordinates there; velocity, acceleration: (d,) their limits;
    rise_s [s]: over which the law is averaged, twice. Raises TimeLawError.
    """
    path = toppra.SplineInterpolator(way, np.column_stack([values, way]))

    def limits(place: float) -> Array:
        highest = np.append(velocity, min(arrival.ceiling(way[-1] - place), UNLIMITED))
        return np.column_stack([-highest, highest])

    constraints = [
        JointVelocityConstraintVarying(limits),
        JointAccelerationConstraint(np.append(acceleration, UNLIMITED)),
    ]
    if arrival.slow_m:
        way = np.union1d(way, way[-1] - arrival.slow_m)
    _, speeds, *_ = TOPPRA(constraints, path, gridpoints=way).compute_parameterization(0.0, arrival.speed)
    if speeds is None or not np.isfinite(speeds).all() or (speeds[1:-1] <= 0.0).any():
        raise TimeLawError("no time law keeps to the limits of the robot")
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(way) / (speeds[:-1] + speeds[1:]))])
    ticks = np.arange(0.0, times[-1] + TICK_S, TICK_S)
    covered = CubicHermiteSpline(times, way, speeds)(np.minimum(ticks, times[-1]))
    covered += arrival.speed * np.maximum(ticks - times[-1], 0.0)
    ticks_of_rise = round(rise_s / TICK_S)
    box = np.full(ticks_of_rise, 1.0 / ticks_of_rise)
    kernel = np.convolve(box, box)
    around = len(kernel) - 1
    beyond = covered[-1] + arrival.speed * TICK_S * np.arange(1, around + 1)
    padded = np.concatenate([np.full(around, way[0]), covered, beyond])
    smooth = np.maximum.accumulate(np.clip(np.convolve(padded, kernel, "valid"), way[0], way[-1]))
    if arrival.speed:
        smooth = smooth[: int(np.searchsorted(smooth, way[-1])) + 1]
    return TICK_S * np.arange(len(smooth), dtype=np.float64), np.asarray(smooth, dtype=np.float64)
