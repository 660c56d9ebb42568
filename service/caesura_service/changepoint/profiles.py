"""Libraries of unit responses: how a movement or a force goes from 0 to 1.

A library is a table over time: row j holds the value of every profile j samples after the start. The
table grows as segments do, by doubling, and the sums of squares that the models need grow with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def overdamped(stiffness: float, damping: float, mass: float = 1.0) -> Callable[[Array], Array]:
    """Step response of a damped second-order system with two real roots, as a function of time [s].

    1 − e(t) with e(0) = 1 and ė(0) = 0. Thesis (3.25), (3.26), where the two coefficients stand exchanged.
    Raises ValueError where the roots are not real and distinct.
    """
    discriminant = damping**2 - 4.0 * mass * stiffness
    if discriminant <= 0:
        raise ValueError(
            f"not overdamped: D²−4ΛK is {discriminant}, expected > 0 (K={stiffness}, D={damping})"
        )
    fast, slow = ((-damping + s * np.sqrt(discriminant)) / (2.0 * mass) for s in (-1.0, 1.0))

    def response(t: Array) -> Array:
        decay: Array = (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (fast - slow)
        return 1.0 - decay

    return response


def minimum_jerk(duration_s: float) -> Callable[[Array], Array]:
    """Position of the smoothest movement that takes duration_s [s]; 1 afterwards. Flash & Hogan 1985."""

    def response(t: Array) -> Array:
        u = np.clip(t / duration_s, 0.0, 1.0)
        course: Array = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        return course

    return response


def first_order(rate: float) -> Callable[[Array], Array]:
    """1 − e^(−rate t), rate [1/s]. Thesis (3.38)."""

    def response(t: Array) -> Array:
        rise: Array = -np.expm1(-rate * t)
        return rise

    return response


def whiten(now: Array, before: Array, correlation: float) -> Array:
    """What is new in a value, given the one before, when neighbours have this correlation.

    Turns a first-order autoregression of any scale into white noise of the same scale.
    """
    fresh: Array = (now - correlation * before) / np.sqrt(1.0 - correlation**2)
    return fresh


@dataclass
class ProfileLibrary:
    """Some profiles, sampled every step_s [s] and whitened for residuals with the given correlation."""

    profiles: Sequence[Callable[[Array], Array]]
    step_s: float
    correlation: float = 0.0
    _values: Array = field(init=False, repr=False, compare=False)
    _squares: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self._tabulate(64)

    def __len__(self) -> int:
        return len(self.profiles)

    def _tabulate(self, rows: int) -> None:
        t: Array = self.step_s * np.arange(rows, dtype=np.float64)
        plain: Array = np.column_stack([profile(t) for profile in self.profiles])
        before = np.zeros_like(plain)
        before[1:] = plain[:-1]
        self._values = whiten(plain, before, self.correlation)
        self._squares = np.cumsum(self._values**2, axis=0)

    def values(self, index: NDArray[np.int64]) -> Array:
        """Value of every profile at each sample index (h,) counted from the start: (h, profiles)."""
        self._reach(index)
        return self._values[index]

    def sums_of_squares(self, index: NDArray[np.int64]) -> Array:
        """Σφ² over samples 0..index, for each index (h,): (h, profiles)."""
        self._reach(index)
        return self._squares[index]

    def _reach(self, index: NDArray[np.int64]) -> None:
        longest = int(np.max(index, initial=0))
        if longest >= len(self._values):
            self._tabulate(2 ** (longest + 1).bit_length())
