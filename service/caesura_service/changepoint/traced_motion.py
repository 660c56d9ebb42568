"""A second motion model of `default`: a slow movement that sticks and slips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import AXES, ModelInput, Rows, append, log_presence
from caesura_service.changepoint.evidence import log_mean_exp, student_log_density

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TracedMotion:
    """Steps vary about a velocity that changes slowly.

    A local level with a discount (West & Harrison 1997, chapter 2). With the steps u_t = z_t − z_{t−1},

        e_t = u_t − m_{t−1},  R_t = C_{t−1}/discount,  C_t = R_t/(R_t + 1),  m_t = m_{t−1} + C_t e_t

    m_0 = 0 and R_1 = (speed/floor)². Every e_t/(floor √(R_t + 1)) is an isotropic Student t of its own with
    nu degrees of freedom. The scale is constant in a segment: one of `scales`, all equally likely.

    `GuidedMotion` predicts each step from the last two. If a tool sticks and slips, the last two steps do not
    predict the next one. The mean of many steps does, so a traced line is neither a rest nor many movements.

    floor: scale of the noise [m per step]; speed: scale of the velocity [m per step]. away [m] weighs the
    displacement of the last `away_steps` steps as in `GuidedMotion`: a tracing hand is elsewhere by then.
    """

    floor: float
    speed: float
    discount: float
    nu: float = 4.0
    scales: tuple[float, ...] = (0.5, 1.0, 2.0)
    away: float = 0.0
    away_steps: int = 3

    def empty(self) -> Rows:
        """Return empty rows: n, last positions, m, C, Σ log density of e for each scale, Σ log weight."""
        past, densities = np.zeros((0, self.away_steps + 1, AXES)), np.zeros((0, len(self.scales)))
        return np.zeros(0, np.int64), past, np.zeros((0, AXES)), np.zeros(0), densities, np.zeros(0)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        z, joins = observed.position, len(rows[0]) > 0
        n, mean, densities, weights = (append(rows[i], np.zeros(rows[i].shape[1:])) for i in (0, 2, 4, 5))
        spread = append(rows[3], self.discount * (self.speed / self.floor) ** 2) / self.discount
        past = np.concatenate([rows[1][-1][1:], z[None]]) if joins else np.tile(z, (self.away_steps + 1, 1))
        error, gain = z - past[-2] - mean, spread / (spread + 1.0)
        scale2 = self.floor**2 * (spread + 1.0)
        squared = (error**2).sum(axis=1) / scale2
        density = np.stack([student_log_density(squared, AXES, self.nu, s) for s in self.scales], axis=1)
        left = log_presence(((z - past[0]) ** 2).sum(), self.away)
        return (
            n + 1,
            np.tile(past, (len(n), 1, 1)),
            mean + gain[:, None] * error,
            gain,
            densities + density,
            weights - 0.5 * AXES * np.log(scale2) + np.where(n >= self.away_steps, left, 0.0),
        )

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        densities, weights = rows[4:]
        result: Array = log_mean_exp(densities, axis=1) + weights
        return result
