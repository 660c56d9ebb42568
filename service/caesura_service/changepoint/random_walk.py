"""A channel that stays constant except for steps: a hand at rest, and any force in contact."""

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
from caesura_service.changepoint.evidence import student_log_density

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StudentRandomWalk:
    """A random walk whose steps have a Student-t distribution in three dimensions.

    scale [unit]: of most steps; nu: degrees of freedom; with 1 (Cauchy) one step in a hundred is a hundred
    times larger. A hand at rest drifts (Collins & De Luca 1993), and a contact is constant except when it
    begins, changes or ends: neither requires a new segment. The scale is fixed, so that smaller steps are no
    evidence. The model is invariant to rotations of the base frame.

    `still` [unit] weighs every step by exp(−step²/2 still²): a moving hand does not rest. `presence` [unit]
    weighs every sample by 1 − exp(−z²/2 presence²): a contact always has a force. Both are at most 1.
    """

    channel: Channel
    scale: float
    nu: float = 1.0
    still: float = 0.0
    presence: float = 0.0

    def empty(self) -> Rows:
        """Return empty rows: the last value, log evidence."""
        return np.zeros((0, AXES)), np.zeros(0)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation. The first observation of a recording has no step."""
        z = signal(observed, self.channel)
        before = append(rows[0], rows[0][-1] if len(rows[0]) else z)
        step2 = ((z - before) ** 2).sum(axis=1)
        weight = log_absence(step2, self.still) + log_presence(z @ z, self.presence)
        evidence = append(rows[1], 0.0) + student_log_density(step2, AXES, self.nu, self.scale) + weight
        return np.tile(z, (len(before), 1)), evidence

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        return np.asarray(rows[1], np.float64)
