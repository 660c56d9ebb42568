"""A weight on the force of a contact during a movement: it does no work on the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import (
    AXES,
    ModelInput,
    Rows,
    append,
    log_absence,
    log_presence,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DissipativeContactWeight:
    """A surface that is slid along, or an object that is pushed, takes up energy: it never drives the robot.

    With f∥ along the step and o = max(f∥, 0), every sample is weighed by exp(−o²/2 least²), because the force
    does no work on the robot. It is also weighed by 1 − exp(−(f² − o²)/2 least²), because there always is a
    force across the movement or against it. So a spring that pushes the robot back does not slide, nor does a
    free movement with a bias along it. The weight is at most 1.

    least [N]: least force that differs from a bias; 0 disables the weight. pace [m]: a step much shorter than
    this has no direction.
    """

    least: float
    pace: float

    def empty(self) -> Rows:
        """Return empty rows: the last position, Σ log weight."""
        return np.zeros((0, AXES)), np.zeros(0)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation. The first observation of a recording has no step."""
        step = observed.position - rows[0][-1] if len(rows[0]) else np.zeros(AXES)
        evidence = append(rows[1], 0.0) + self.log_weight(observed.force, step)
        return np.tile(observed.position, (len(evidence), 1)), evidence

    def log_weight(self, force: Array, step: Array) -> float:
        """Return the log weight of a force (3,) [N] at the end of a step (3,) [m]."""
        along = float(force @ step) / float(np.sqrt(step @ step + self.pace**2))
        driving2 = max(along, 0.0) ** 2
        resisting = log_presence(float(force @ force) - driving2, self.least)
        return float(resisting + log_absence(driving2, self.least))

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        return np.asarray(rows[1], np.float64)
