"""The reproduced path: the curve on which a robot follows an app's path.

It leads through knots, in time order: the robot's pose, the via points, the target. Between two knots every
coordinate (position, and the four of the quaternion, which is normalised afterwards) is the polynomial of
degree five in time with the velocities and accelerations of both. Velocities and angular velocities at knots
are the taught ones. Unstated ones are estimated from three knots (`estimated_slopes`); an end without a
stated velocity is at rest. So with two knots it is the straight line of minimum jerk, and the turn about one
axis.

>>> curve = Curve.through([0.0, 1.0], [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
>>> curve.at(0.5)[0].round(3).tolist()
[0.05, 0.0, 0.0]
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from caesura_protocol.messages import App, Vector, ViaPoint
from caesura_protocol.number_words import fixed
from caesura_protocol.rotations import align_signs, angular_velocities, quaternion_rates, turned_along

Array = NDArray[np.float64]

TOLERANCE_M, TOLERANCE_RAD = 0.002, math.radians(1.0)  # of a path, where no other is asked for
NAMED_TURN_RAD = math.radians(5.0)  # from which on a turn is named
POWERS = 6  # of a share of a leg, from 0 on
_EXPONENTS = np.arange(float(POWERS))
# Exponents of the powers, of their first and of their second derivatives, (3, 6), and what multiplies them.
_LOWERED = np.maximum(np.arange(POWERS) - np.arange(3)[:, None], 0)
_FACTORS = np.array([np.ones(POWERS), _EXPONENTS, _EXPONENTS * (_EXPONENTS - 1.0)])
UNKNOWN = (math.nan,) * 3
STEEPEST = 1.5  # an estimate is at most so many times the mean slope on either side of a knot


@dataclass(frozen=True, eq=False)
class Curve:
    """Knots: times (k,) [s], values, velocities and accelerations (k, c); c is 3, or 7 with a quaternion."""

    t: Array
    values: Array
    velocities: Array
    accelerations: Array

    @classmethod
    def through(cls, t: ArrayLike, values: ArrayLike, *, passing: ArrayLike | None = None) -> Curve:
        """Return the curve through knots at rising times.

        passing: (k, 3) [m/s] at the knots, or (k, 6) with [rad/s]; nan is estimated, and is rest at the ends.
        Quaternions get the sign nearer to the one before.
        """
        times, knots = np.asarray(t, dtype=np.float64), np.array(values, dtype=np.float64)
        if knots.shape[1] == 7:
            align_signs(knots[:, 3:])
        velocities = estimated_slopes(times, knots)
        if passing is not None:
            stated = np.asarray(passing, dtype=np.float64)
            rates = stated[:, :3]
            if knots.shape[1] == 7 and stated.shape[1] == 6:
                rates = np.hstack([rates, quaternion_rates(knots[:, 3:], stated[:, 3:])])
            known = velocities[:, : rates.shape[1]]
            known[:] = np.where(np.isnan(rates), known, rates)
        return cls(times, knots, velocities, estimated_slopes(times, velocities))

    @cached_property
    def passing(self) -> Array:
        """Velocities (k, 3) [m/s] at the knots, or (k, 6) with [rad/s] if quaternions are known."""
        if self.values.shape[1] == 3:
            return self.velocities
        turning = angular_velocities(self.values[:, 3:], self.velocities[:, 3:])
        return np.hstack([self.velocities[:, :3], turning])

    @cached_property
    def _times(self) -> list[float]:
        times: list[float] = self.t.tolist()
        return times

    @cached_property
    def coefficients(self) -> Array:
        """Return (k − 1, 6, c) coefficients of the powers of a share of each leg, the lowest first."""
        seconds = (self.t[1:] - self.t[:-1])[:, None]
        squared = seconds**2
        first, way = self.values[:-1], self.values[1:] - self.values[:-1]
        left, arrived = seconds * self.velocities[:-1], seconds * self.velocities[1:]
        begun, ended = squared * self.accelerations[:-1], squared * self.accelerations[1:]
        found = np.empty((len(first), POWERS, first.shape[1]))
        found[:, 0], found[:, 1], found[:, 2] = first, left, 0.5 * begun
        found[:, 3] = 10.0 * way - 6.0 * left - 4.0 * arrived - 1.5 * begun + 0.5 * ended
        found[:, 4] = -15.0 * way + 8.0 * left + 7.0 * arrived + 1.5 * begun - ended
        found[:, 5] = 6.0 * way - 3.0 * left - 3.0 * arrived - 0.5 * begun + 0.5 * ended
        return found

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return value, velocity and acceleration (c,) at a time.

        After the end the curve continues as it arrived.
        """
        if t >= self._times[-1]:
            last = self.velocities[-1]
            return self.values[-1] + (t - self.t[-1]) * last, last, np.zeros_like(last)
        leg = max(bisect_right(self._times, t) - 1, 0)
        began = self._times[leg]
        seconds = self._times[leg + 1] - began
        s = max(t - began, 0.0) / seconds
        value, velocity, acceleration = _powers(np.array(s)).dot(self.coefficients[leg])
        return value, velocity / seconds, acceleration / seconds**2

    def sampled(self, parts: int) -> Array:
        """Return (parts · legs + 1, c) points, at even times in each leg; quaternions have unit length."""
        inner = (_powers_of_parts(parts) @ self.coefficients).reshape(-1, self.values.shape[1])
        return unit(np.concatenate([inner, self.values[-1:]]))

    def peaks(self, parts: int = 17) -> tuple[float, float]:
        """Return the largest speed [m/s] and rate of turn [rad/s]; the latter is 0 without orientation."""
        powers = _powers((np.arange(parts) + 0.5) / parts)
        velocities = (powers[:, 1] @ self.coefficients) / np.diff(self.t)[:, None, None]
        speed = float(np.linalg.norm(velocities[..., :3], axis=-1).max())
        if self.values.shape[1] == 3:
            return speed, 0.0
        quaternions = (powers[:, 0] @ self.coefficients)[..., 3:]
        sizes = np.linalg.norm(quaternions, axis=-1, keepdims=True)
        along, rate = quaternions / sizes, velocities[..., 3:] / sizes
        across = rate - along * np.vecdot(along, rate)[..., None]
        return speed, float(2.0 * np.linalg.norm(across, axis=-1).max())


def estimated_slopes(t: Array, values: Array) -> Array:
    """Return slopes (k, c) at knots: 0 at both ends, else the derivative of the parabola through three knots.

    The slope of the first three columns is at most `STEEPEST` times the mean slope on the less steep side,
    and so is that of the others, so that the curve does not overshoot at a stop.
    """
    slopes = np.zeros_like(values)
    if len(t) < 3:
        return slopes
    seconds = (t[1:] - t[:-1])[:, None]
    means = (values[1:] - values[:-1]) / seconds
    inner = (seconds[1:] * means[:-1] + seconds[:-1] * means[1:]) / (seconds[1:] + seconds[:-1])
    for part in (slice(0, 3), slice(3, None)):
        sizes = np.sqrt(np.vecdot(means[:, part], means[:, part]))
        most = STEEPEST * np.minimum(sizes[:-1], sizes[1:])
        size = np.sqrt(np.vecdot(inner[:, part], inner[:, part]))
        inner[:, part] *= np.minimum(1.0, most / np.maximum(size, 1e-12))[:, None]
    slopes[1:-1] = inner
    return slopes


def knots_of(app: App) -> tuple[Array, Array, Array]:
    """Return times (k,) [s], poses (k, 3 or 7) and velocities (k, 6) [m/s], [rad/s] of an app's path.

    The last knot is the target. An unstated velocity is nan. Raises ValueError for an app without path or
    target.
    """
    if app.path is None or app.target is None:
        raise ValueError(f"{app.kind} at {fixed(app.t0, 2)} s has no path, expected one with a target")
    path = app.path
    end = ViaPoint(
        t=path.tn,
        position=app.target,
        orientation=app.orientation,
        velocity=path.end_velocity,
        angular_velocity=path.end_angular_velocity,
    )
    points = (path.start, *path.via, end)
    turns = all(point.orientation is not None for point in points)
    poses = [(*point.position, *((point.orientation or ()) if turns else ())) for point in points]
    passing = [(*(point.velocity or UNKNOWN), *(point.angular_velocity or UNKNOWN)) for point in points]
    return np.array([point.t for point in points]), np.array(poses, dtype=np.float64), np.array(passing)


def curve_of(app: App) -> Curve:
    """Return the reproduced path of an app from its taught start. Raises as `knots_of`."""
    times, poses, passing = knots_of(app)
    return Curve.through(times, poses, passing=passing)


def turning_at_points(app: App) -> list[Vector]:
    """Return the rates of turn [rad/s] of an app's path at its start and via points.

    Empty without orientations. Raises as `knots_of`.
    """
    curve = curve_of(app)
    return [(x, y, z) for x, y, z in curve.passing[:-1, 3:].tolist()] if curve.values.shape[1] == 7 else []


def path_in_words(app: App, unit: str = " via") -> str:
    """Return a path's length, turn and number of via points as text; empty without a path.

    A path without via points is straight, and their number is left out. unit: text after that number.
    """
    if app.path is None:
        return ""
    length, via, turn = f"{fixed(1000 * app.path.length_m, 0)} mm", len(app.path.via), turn_of(app)
    turned = f", {math.degrees(turn):.0f}°" if turn >= NAMED_TURN_RAD else ""
    return f"{length}{turned}, {via}{unit}" if via else length + turned


def turn_of(app: App) -> float:
    """Return the turn [rad] of an app: that of its screw motion, else the largest along its path.

    0 without either. Along a path the rotation vectors from knot to knot are summed, so a turn may exceed
    180°, and turning back reduces it.
    """
    if app.path is None or app.target is None:
        return 0.0
    if app.screw is not None:
        return app.screw.angle
    quaternions = np.array(knots_of(app)[1][:, 3:])
    return float(np.linalg.norm(turned_along(quaternions), axis=1).max()) if quaternions.size else 0.0


def unit(values: Array) -> Array:
    """Scale the quaternions of values (n, c) to unit length in place; return the values."""
    if values.shape[1] == 7:
        values[:, 3:] /= np.sqrt(np.square(values[:, 3:]).sum(axis=1, keepdims=True))
    return values


@lru_cache
def _powers_of_parts(parts: int) -> Array:
    """Return (parts, POWERS) the powers of the shares at which a leg of `parts` parts is sampled."""
    return _powers(np.arange(parts) / parts)[:, 0]


def _powers(s: Array) -> Array:
    """Return (…, 3, 6) powers of shares s of a leg, and their first and second derivatives."""
    powers: Array = np.asarray(s)[..., None] ** _EXPONENTS
    return np.asarray(_FACTORS * powers[..., _LOWERED])
