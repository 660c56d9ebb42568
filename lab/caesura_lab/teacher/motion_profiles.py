"""The intended movements of a hand: strokes with a unit response, added up.

A stroke goes from 0 to 1 within its duration and stays there. Strokes that overlap in time blend into one
movement that passes their common point without stopping (Flash & Henis 1991), so a whole demonstration is one
sum of strokes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import erf, log, sqrt
from types import MappingProxyType
from typing import Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Profile = Literal["minimum_jerk", "overdamped", "lognormal"]
PROFILES: tuple[Profile, ...] = get_args(Profile)

# Overdamped: roots of s² + D s + K with K = 60, D = 20 in units of the duration; 99 % settled at its end.
ROOTS = (-16.32, -3.68)
# Lognormal speed: its median and width in units of the duration, peak at about a third (Plamondon 1995).
MEDIAN, WIDTH = 0.44, 0.42

_erf = np.vectorize(erf, otypes=[np.float64])


def minimum_jerk(tau: Array) -> Array:
    """Movement with the least jerk, its speed a bell (Flash & Hogan 1985). tau: (n,) in 0..1."""
    return tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)


def overdamped(tau: Array) -> Array:
    """Response of an overdamped second order system to a step, thesis (3.25) with e(0) = 1, ė(0) = 0.

    tau: (n,) in 0..1, at which it is scaled to arrive.
    """

    def rise(x: Array) -> Array:
        slow, fast = ROOTS[1], ROOTS[0]
        error: Array = (fast * np.exp(slow * x) - slow * np.exp(fast * x)) / (fast - slow)
        return 1.0 - error

    return rise(tau) / rise(np.ones(1))


def lognormal(tau: Array) -> Array:
    """Position of a movement with lognormal speed: an early peak and a long tail. tau: (n,) in 0..1."""

    def share(x: Array) -> Array:
        z = (np.log(np.maximum(x, 1e-9)) - log(MEDIAN)) / (WIDTH * sqrt(2.0))
        below: Array = 0.5 * (1.0 + _erf(z))
        return below

    return share(tau) / share(np.ones(1))


UNIT_RESPONSES: Mapping[Profile, Callable[[Array], Array]] = MappingProxyType(
    {"minimum_jerk": minimum_jerk, "overdamped": overdamped, "lognormal": lognormal}
)


class Movement(Protocol):
    """An intended movement that begins at a time, and keeps its displacement after its end."""

    @property
    def start_s(self) -> float:
        """The time [s] at which the movement begins."""

    def positions(self, t: Array) -> Array:
        """Return the displacement at times t (n,) [s], (n, 3) [m]."""


@dataclass(frozen=True)
class Stroke:
    """One intended movement.

    displacement: (3,) [m]; deviation: (k, 3) [m], amplitudes of the half waves by which the path leaves the
    profile on its way; it is back on it at both ends.
    """

    start_s: float
    duration_s: float
    displacement: Array
    profile: Profile = "minimum_jerk"
    deviation: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def end_s(self) -> float:
        """The time [s] at which the stroke arrives."""
        return self.start_s + self.duration_s

    def positions(self, t: Array) -> Array:
        """Return the displacement at times t (n,) [s], (n, 3) [m]."""
        tau = np.clip((t - self.start_s) / self.duration_s, 0.0, 1.0)
        moved: Array = UNIT_RESPONSES[self.profile](tau)[:, None] * self.displacement
        for k, amplitude in enumerate(self.deviation, start=1):
            moved += (np.sin(np.pi * tau) ** 2 * np.sin(k * np.pi * tau))[:, None] * amplitude
        return moved


def path(start: Vector | Array, strokes: Sequence[Movement], t: Array) -> Array:
    """Return the intended position (n, 3) [m] at times t (n,) [s]: the start plus all strokes."""
    positions = np.tile(np.asarray(start, dtype=np.float64), (t.size, 1))
    for stroke in strokes:
        first = int(np.searchsorted(t, stroke.start_s))
        positions[first:] += stroke.positions(t[first:])
    return positions


def time_of_share(profile: Profile, share: float) -> float:
    """Return when a stroke has covered a share of its way, as a share of its duration; both in 0..1."""
    tau = np.linspace(0.0, 1.0, 2001)
    return float(np.interp(share, UNIT_RESPONSES[profile](tau), tau))
