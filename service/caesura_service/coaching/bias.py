"""The bias of a tared force, tracked while it drifts.

A bias drifts slowly; a contact comes and goes fast. So the bias is a random walk, and each force is the bias
plus noise, or a contact of any size:

    p(F) = π N(m, (v + R) I) + (1 − π) N(m, c² I)

A Kalman filter takes each force by its probability r of being free (Bar-Shalom & Tse 1975, probabilistic data
association): m ← m + r K (F − m), K = v / (v + R). While a contact lasts, v grows, so that a drift in the
meantime is caught up with afterwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

Vector = tuple[float, float, float]

AXES = 3
MOST_LOG_ODDS = 50.0  # beyond which a force is a contact for certain


class DriftState(NamedTuple):
    """Mean [N] and variance [N²] of the bias."""

    mean: Vector = (0.0, 0.0, 0.0)
    variance: float = 0.0


@dataclass(frozen=True)
class DriftTracker:
    """Parameters of the filter; `advance` maps a state and a force to the next state.

    walk_n2_per_s: variance that the bias gains in a second; most_n2: its variance at most [N²]; noise_n [N]
    R½ of a force; contact_n [N] scale of a contact; free_share π.
    """

    walk_n2_per_s: float
    most_n2: float = math.inf
    noise_n: float = 0.5  # of a force in movement, as in the models of segments
    contact_n: float = 10.0
    free_share: float = 0.9  # of what moves faster than 50 mm/s

    def wait(self, state: DriftState, dt: float) -> DriftState:
        """Let a time [s] pass of which no force is known to be free."""
        return DriftState(state.mean, min(state.variance + self.walk_n2_per_s * dt, self.most_n2))

    def advance(self, state: DriftState, force: Vector, dt: float) -> DriftState:
        """Take a force [N], dt [s] after the one before."""
        variance = self.wait(state, dt).variance
        spread = variance + self.noise_n * self.noise_n
        contact2 = max(self.contact_n * self.contact_n, spread)
        x, y, z = (f - m for f, m in zip(force, state.mean, strict=True))
        off2 = x * x + y * y + z * z
        log_odds = 0.5 * off2 * (1.0 / spread - 1.0 / contact2) - 0.5 * AXES * math.log(contact2 / spread)
        log_odds += math.log((1.0 - self.free_share) / self.free_share)
        if log_odds > MOST_LOG_ODDS:
            return DriftState(state.mean, variance)
        gain = variance / spread / (1.0 + math.exp(log_odds))
        mx, my, mz = state.mean
        return DriftState((mx + gain * x, my + gain * y, mz + gain * z), variance * (1.0 - gain))
