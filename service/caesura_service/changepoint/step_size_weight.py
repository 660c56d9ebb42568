"""Bounds on the rate of change of a channel, without a model of its course."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import (
    AXES,
    Channel,
    ModelInput,
    Rows,
    append,
    log_absence,
    log_presence,
    signal,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StepSizeWeight:
    """A weight on every step of a channel; the evidence has no density of the channel's values.

    least [unit] weighs a step by 1 − exp(−step²/2 least²), and most [unit] by exp(−step²/2 most²); 0 disables
    the weight. Both are at most 1, and the first observation of a recording has no step. This model is used
    for the rotation: with a density, a movement without a rotation would count as a rest, and a rest as a
    turn.
    """

    channel: Channel
    least: float = 0.0
    most: float = 0.0

    def empty(self) -> Rows:
        """Return empty rows: the last value, Σ log weight."""
        return np.zeros((0, AXES)), np.zeros(0)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        z, joins = signal(observed, self.channel), len(rows[0]) > 0
        step2 = float(((z - rows[0][-1]) ** 2).sum()) if joins else 0.0
        weight = log_presence(step2, self.least) + log_absence(step2, self.most) if joins else 0.0
        return np.tile(z, (len(rows[0]) + 1, 1)), append(rows[1], 0.0) + weight

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        return np.asarray(rows[1], np.float64)
