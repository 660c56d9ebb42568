"""The friction of a surface on a sliding tool: a weight on the force, given the direction of the movement."""

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
class FrictionConeWeight:
    """A surface exerts a normal force across the movement and friction against it; it never drives it.

    Coulomb: the force lies in a cone about the surface's normal, with a friction coefficient of at most 1.
    With f∥ along the step and f⊥ across it, every sample is weighed by 1 − exp(−f⊥²/2 least²), because there
    always is a normal force. It is also weighed by exp(−e²/2 least²) with e = max(f∥, −f∥ − f⊥, 0), by which
    the force exceeds the cone. A tool that pushes a yielding object in, or is pushed back by it, does not
    slide; nor does a free movement with a bias along it. The weight is at most 1.

    least [N]: least normal force that differs from a bias; 0 disables the weight. pace [m]: a step much
    shorter than this has no direction.
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
        across2 = max(float(force @ force) - along**2, 0.0)
        outside = max(along, -along - np.sqrt(across2), 0.0)
        return float(log_presence(across2, self.least) + log_absence(outside**2, self.least))

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        return np.asarray(rows[1], np.float64)
