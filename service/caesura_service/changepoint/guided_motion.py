"""The motion model of `default`: a movement that a hand guides, without a library of strokes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import AXES, ModelInput, Rows, append, log_presence
from caesura_service.changepoint.evidence import known_mean_log_evidence, log_mean_exp

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GuidedMotion:
    """Velocity is a critically damped Gauss–Markov process that begins at rest.

    With the steps u_t = z_t − z_{t−1}, and u = 0 before the segment's start,

        u_t = 2ρ u_{t−1} − ρ² u_{t−2} + w_t ε_t
        w_t² = floor² + share² |u_{t−1}|² + burst² [age < burst_steps]

    The innovations ε are isotropic normal. Their variance has a scaled inverse chi-squared prior with nu0
    degrees of freedom; its scale is one of `scales`, all equally likely. So a path may curve and its speed
    may have several peaks. Noise grows with speed (Harris & Wolpert 1998), and a start is a burst.
    A segment's evidence is the mean over scales of a Student-t density of Σ|ε|² with 3n values (Murphy 2007,
    section 5), divided by Π w³.

    correlation: ρ = exp(−step/τ) for a velocity with time constant τ. floor, burst [m]. pace [m] weighs every
    step by 1 − exp(−step²/2 pace²), which is at most 1: a moving hand does not rest. The first observation of
    all has no step, and is not weighed. away [m] weighs the way of the last `away_steps` steps likewise, once
    a segment has more observations than that: a hand that moves is elsewhere by then.
    """

    correlation: float
    floor: float
    share: float
    burst: float
    burst_steps: int = 3
    nu0: float = 10.0
    scales: tuple[float, ...] = (0.5, 1.0, 2.0)
    pace: float = 0.0
    away: float = 0.0
    away_steps: int = 3

    def empty(self) -> Rows:
        """Rows: n, last positions, last two steps, Σ|ε|², Σ log w, Σ log pace."""
        vectors, scalars, past = np.zeros((0, AXES)), np.zeros(0), np.zeros((0, self.away_steps + 1, AXES))
        return np.zeros(0, np.int64), past, vectors, vectors, scalars, scalars, scalars

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Take one observation."""
        z, joins = observed.position, len(rows[0]) > 0
        n, step_1, step_2, squares, log_scales, paced = (
            append(rows[i], np.zeros(rows[i].shape[1:])) for i in (0, 2, 3, 4, 5, 6)
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
            squares + (error**2).sum(axis=1) / scale2,
            log_scales + 0.5 * np.log(scale2),
            paced + pace + np.where(n >= self.away_steps, left, 0.0),
        )

    def _scale2(self, n: NDArray[np.int64], step: Array) -> Array:
        """(h,) [m²] w² of the observation that follows n others and the step (h, 3)."""
        burst2 = np.where(n < self.burst_steps, self.burst**2, 0.0)
        scale2: Array = self.floor**2 + self.share**2 * (step**2).sum(axis=1) + burst2
        return scale2

    def log_evidence(self, rows: Rows) -> Array:
        """(h,)."""
        n, squares, log_scales, paced = rows[0], *rows[4:]
        each = [known_mean_log_evidence(AXES * n, squares, self.nu0, scale**2) for scale in self.scales]
        result: Array = log_mean_exp(np.stack(each), axis=0) - AXES * log_scales + paced
        return result
