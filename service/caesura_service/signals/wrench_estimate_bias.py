"""The bias of an estimated wrench, tracked from the past only.

An estimate from joint torques has the error of the robot's model, which drifts. A robot without a hand on it
is in contact or not, so every force is drawn from a mixture of two densities:

    p(F) = π N(m, b² I) + (1 − π) N(0, c² I)

free space with mean m and scale b, or contact with a broad scale c. r is the probability of free space for
a force, with m and b as they were before it:

    m  = (n m0 + w Σ r F) / (n + w Σ r)
    b² = (ν b0² + w Σ r |F − m|²) / (ν + 3 w Σ r)

with the tare as m0, and the sums over the whole session; each |F − m|² has the m of its time. w < 1, because
errors are correlated over a second, so ten observations a second are not ten independent ones. b is bounded
below by the model's error in motion, which a long rest does not show, and above by half the scale of contact.
m is subtracted from the force, and b is the scale of free space. See ARCHITECTURE.md, "Where `default`
differs from the thesis' models".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AXES = 3
TRACKED_BIAS_N = 1.5  # scale of free space under the tracked mean, before any observation
LEAST_SCALE_N = 1.0  # by which an estimate errs in motion, however quiet a rest was
MOST_LOG_ODDS = 500.0  # against free space, beyond which a force says nothing of it
ORIGIN = (0.0, 0.0, 0.0)


class BiasState(NamedTuple):
    """Sums over the observations so far: r, r F (3,) [N], r |F − m|² [N²]."""

    weight: float = 0.0
    total: tuple[float, float, float] = ORIGIN
    squares: float = 0.0


@dataclass(frozen=True)
class BiasTracker:
    """Two-component mixture of a force: free space, with estimated mean and scale, and contact.

    scale_n [N] b0; contact_n [N] c; free_share π; prior_mean n and prior_scale ν: weights of the prior, in
    observations; weight w.
    """

    scale_n: float
    contact_n: float = 10.0
    free_share: float = 0.5
    prior_mean: float = 1.0
    prior_scale: float = 10.0
    weight: float = 0.1

    def estimate(self, state: BiasState) -> tuple[Array, float]:
        """Mean (3,) and scale [N] of free space, from the observations so far."""
        mean = self.weight * np.array(state.total) / (self.prior_mean + self.weight * state.weight)
        squares = self.prior_scale * self.scale_n**2 + self.weight * state.squares
        scale = math.sqrt(squares / (self.prior_scale + AXES * self.weight * state.weight))
        return mean, min(max(scale, LEAST_SCALE_N), 0.5 * self.contact_n)

    def advance(self, state: BiasState, force: Array) -> BiasState:
        """Return the state after a force (3,) [N], tared."""
        mean, scale = self.estimate(state)
        off2 = float((force - mean) @ (force - mean))
        free = math.log(self.free_share) - AXES * math.log(scale) - 0.5 * off2 / scale**2
        touched = math.log1p(-self.free_share) - AXES * math.log(self.contact_n)
        touched -= 0.5 * float(force @ force) / self.contact_n**2
        if not touched - free < MOST_LOG_ODDS:
            return state
        share = 1.0 / (1.0 + math.exp(touched - free))
        x, y, z = (np.array(state.total) + share * force).tolist()
        return BiasState(state.weight + share, (x, y, z), state.squares + share * off2)
