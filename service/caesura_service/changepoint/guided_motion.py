"""The motion model of `default`: a movement guided by a hand, without a library of strokes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import AXES, ModelInput, Rows, append, log_presence
from caesura_service.changepoint.evidence import log_mean_exp, student_log_density

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GuidedMotion:
    """Velocity is a critically damped Gauss–Markov process that begins at rest.

    With the steps u_t = z_t − z_{t−1}, and u = 0 before the segment's start,

        u_t = 2ρ u_{t−1} − ρ² u_{t−2} + w_t ε_t
        w_t² = floor² + share² |u_{t−1}|² + burst² [age < burst_steps]

    Every innovation ε is an isotropic Student t of its own with nu degrees of freedom (Lange, Little & Taylor
    1989), so a large one does not require a new segment. The scale is constant in a segment: one of `scales`,
    all equally likely. A path may curve and its speed may have several peaks. Noise grows with speed (Harris
    & Wolpert 1998), and the first steps have additional noise. A segment's evidence is the mean over scales
    of the product of the densities of ε, divided by Π w³.

    correlation: ρ = exp(−step/τ) for a velocity with time constant τ. floor, burst [m]. pace [m] weighs every
    step by 1 − exp(−step²/2 pace²), which is at most 1: a moving hand does not rest. The first observation of
    a recording has no step, and is not weighed. away [m] weighs the displacement of the last `away_steps`
    steps in the same way, once a segment has more observations than that: a moving hand is elsewhere by then.
    """

    correlation: float
    floor: float
    share: float
    burst: float
    burst_steps: int = 3
    nu: float = 4.0
    scales: tuple[float, ...] = (0.5, 1.0, 2.0)
    pace: float = 0.0
    away: float = 0.0
    away_steps: int = 3

    def empty(self) -> Rows:
        """Return empty rows: n, last positions, last two steps, Σ log density of ε by scale, Σ log (pace /
        w³).
        """
        vectors, past = np.zeros((0, AXES)), np.zeros((0, self.away_steps + 1, AXES))
        densities = np.zeros((0, len(self.scales)))
        return np.zeros(0, np.int64), past, vectors, vectors, densities, np.zeros(0)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        z, joins = observed.position, len(rows[0]) > 0
        n, step_1, step_2, densities, weights = (
            append(rows[i], np.zeros(rows[i].shape[1:])) for i in (0, 2, 3, 4, 5)
        )
        past = np.concatenate([rows[1][-1][1:], z[None]]) if joins else np.tile(z, (self.away_steps + 1, 1))
        step = np.tile(z - past[-2], (len(n), 1))
        error = step - 2.0 * self.correlation * step_1 + self.correlation**2 * step_2
        scale2 = self._scale2(n, step_1)
        pace = log_presence((step**2).sum(axis=1), self.pace) if joins else 0.0
        left = log_presence(((z - past[0]) ** 2).sum(), self.away)
        return (
            n + 1,
            np.tile(past, (len(n), 1, 1)),
            step,
            step_1,
            densities + self._log_densities((error**2).sum(axis=1) / scale2),
            weights - 0.5 * AXES * np.log(scale2) + pace + np.where(n >= self.away_steps, left, 0.0),
        )

    def _log_densities(self, squared: Array) -> Array:
        """Return (h, scales) log densities of innovations; squared: (h,) their squared lengths."""
        return np.stack([student_log_density(squared, AXES, self.nu, scale) for scale in self.scales], axis=1)

    def _scale2(self, n: NDArray[np.int64], step: Array) -> Array:
        """Return (h,) w² [m²] of the observation that follows n (h,) others and the step (h, 3) [m]."""
        burst2 = np.where(n < self.burst_steps, self.burst**2, 0.0)
        scale2: Array = self.floor**2 + self.share**2 * (step**2).sum(axis=1) + burst2
        return scale2

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        densities, weights = rows[4:]
        result: Array = log_mean_exp(densities, axis=1) + weights
        return result
