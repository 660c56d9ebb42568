"""Libraries of unit responses: how a movement or a force goes from 0 to 1.

A library is a table over time: row j holds the value of every profile j samples after the start. The table,
with the sums of squares that models need, grows with the length of segments, by doubling, until every profile
is at rest. From there on each row equals the last one, and the sums grow linearly. So a segment of an hour
needs no more memory than one of minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

Array = NDArray[np.float64]


Profile = Callable[[Array], Array]


def overdamped(stiffness: float, damping: float, mass: float = 1.0) -> Profile:
    """Return the step response of a damped second-order system with two real roots, as a function of time
    [s].

    1 − e(t) with e(0) = 1 and ė(0) = 0. Thesis (3.25), (3.26), where the two coefficients are exchanged.
    Raises ValueError where the roots are not real and distinct.
    """
    discriminant = damping**2 - 4.0 * mass * stiffness
    if discriminant <= 0:
        raise ValueError(
            f"not overdamped: D²−4ΛK is {discriminant}, expected > 0 (K={stiffness}, D={damping})"
        )
    fast, slow = ((-damping + s * np.sqrt(discriminant)) / (2.0 * mass) for s in (-1.0, 1.0))
    return partial(_overdamped, fast, slow)


def _overdamped(fast: float, slow: float, t: Array) -> Array:
    decay: Array = (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (fast - slow)
    return 1.0 - decay


def minimum_jerk(duration_s: float) -> Profile:
    """Return the position of the smoothest movement of duration_s [s]; 1 afterwards. Flash & Hogan 1985."""
    return partial(_minimum_jerk, duration_s)


def _minimum_jerk(duration_s: float, t: Array) -> Array:
    u = np.clip(t / duration_s, 0.0, 1.0)
    course: Array = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    return course


def lognormal(duration_s: float, width: float = 0.5) -> Profile:
    """Return the position of a movement with lognormal speed: an early peak and a long tail. Plamondon 1995.

    duration_s [s]: time at which 99 % of the distance is covered; width: standard deviation of the log of
    time.
    """
    return partial(_lognormal, duration_s * float(np.exp(-ndtri(0.99) * width)), width)


def _lognormal(median_s: float, width: float, t: Array) -> Array:
    course: Array = ndtr(np.log(np.maximum(t, np.finfo(float).tiny) / median_s) / width)
    return course


def first_order(rate: float) -> Profile:
    """Return the profile 1 − e^(−rate t), rate [1/s]. Thesis (3.38)."""
    return partial(_first_order, rate)


def _first_order(rate: float, t: Array) -> Array:
    rise: Array = -np.expm1(-rate * t)
    return rise


FIRST_ROWS = 64  # of a table; within them every profile is at its fastest


def whiten(now: Array, before: Array, correlation: float) -> Array:
    """Return the whitened innovation of a value, given the one before and the correlation of neighbours.

    Turns a first-order autoregression of any scale into white noise of the same scale.
    """
    fresh: Array = (now - correlation * before) / np.sqrt(1.0 - correlation**2)
    return fresh


@dataclass
class ProfileLibrary:
    """Some profiles, sampled every step_s [s] and whitened for residuals with the given correlation.

    rest_scale_ratio: scale of residuals where a profile rests, relative to where it is fastest; between,
    their variance grows with the square of its speed (signal-dependent noise, Harris & Wolpert 1998).
    1: constant.
    """

    profiles: Sequence[Profile]
    step_s: float
    correlation: float = 0.0
    rest_scale_ratio: float = 1.0
    _values: Array = field(init=False, repr=False, compare=False)
    _precisions: Array = field(init=False, repr=False, compare=False)
    _squares: Array = field(init=False, repr=False, compare=False)
    _log_scales: Array = field(init=False, repr=False, compare=False)
    _at_rest: bool = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.rest_scale_ratio <= 1.0:
            raise ValueError(f"rest_scale_ratio is {self.rest_scale_ratio}, expected above 0 and at most 1")
        self._tabulate(FIRST_ROWS)

    def __len__(self) -> int:
        return len(self.profiles)

    def _tabulate(self, rows: int) -> None:
        t: Array = self.step_s * np.arange(rows, dtype=np.float64)
        plain: Array = np.column_stack([profile(t) for profile in self.profiles])
        before = np.zeros_like(plain)
        before[1:] = plain[:-1]
        variances = self._variances(np.abs(plain - before))
        self._values = whiten(plain, before, self.correlation)
        self._precisions = 1.0 / variances
        self._squares = np.cumsum(self._values**2 * self._precisions, axis=0)
        self._log_scales = np.cumsum(0.5 * np.log(variances), axis=0)
        self._at_rest = bool(plain[-1].all()) and np.array_equal(plain[-2], plain[-1])

    def _variances(self, steps: Array) -> Array:
        """Return relative variances of residuals, (rows, profiles), from absolute steps (row 0 is cleared).

        A variance is 1 where a profile is fastest, and at the start, which has no step.
        """
        steps[0] = 0.0
        variances: Array = (
            self.rest_scale_ratio**2
            + (1.0 - self.rest_scale_ratio**2) * (steps / steps[:FIRST_ROWS].max(axis=0)) ** 2
        )
        variances[0] = 1.0
        return variances

    def values(self, index: NDArray[np.int64]) -> Array:
        """Return (h, profiles) the value of every profile at each sample index (h,) from the start."""
        row = self._reach(index)
        return self._values[row]

    def precisions(self, index: NDArray[np.int64]) -> Array:
        """Return (h, profiles) the weight of a squared residual at each sample index (h,)."""
        row = self._reach(index)
        return self._precisions[row]

    def sums_of_squares(self, index: NDArray[np.int64]) -> Array:
        """Return (h, profiles) Σφ², weighted by the precisions, over samples 0..index, for each index
        (h,).
        """
        row = self._reach(index)
        return _continued(self._squares[row], index - row, self._values[-1] ** 2 * self._precisions[-1])

    def log_scales(self, index: NDArray[np.int64]) -> Array:
        """Return (h, profiles) Σ log of the residuals' scale over samples 1..index, for each index (h,)."""
        row = self._reach(index)
        return _continued(self._log_scales[row], index - row, -0.5 * np.log(self._precisions[-1]))

    def last_row(self, index: int) -> int:
        """Return the table row of a sample index: itself, or the last row if all profiles rest before it."""
        return int(self._reach(np.array([index]))[0])

    def _reach(self, index: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the table row of each index, as `last_row`; grow the table where profiles still move."""
        longest = int(np.max(index, initial=0))
        while longest >= len(self._values) and not self._at_rest:
            self._tabulate(2 * len(self._values))
        return np.minimum(index, len(self._values) - 1)


def _continued(sums: Array, beyond: NDArray[np.int64], each: Array) -> Array:
    """Return sums (h, profiles) at a table's end, plus `beyond` (h,) rows that add `each` (profiles,)."""
    return sums + beyond[:, None] * each if beyond.any() else sums
