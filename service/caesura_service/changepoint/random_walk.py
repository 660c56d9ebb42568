"""A channel that stays where it is, but for steps: a hand at rest, and whatever a person does in contact."""

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
    """From one sample to the next the value stays, give or take a step: Student-t in three dimensions.

    scale [unit]: of most steps; nu: degrees of freedom, 1 (Cauchy) lets one of a hundred be a hundred times
    larger. A hand drifts rather than returns (Collins & De Luca 1993), and a contact is quiet but for the
    moments in which it is made, pressed harder or let go: neither is a reason for a new segment. The scale
    is known, so that being calmer than a hand is no evidence of anything. It turns with the base frame.

    `still` [unit] weighs every step by exp(−step²/2 still²): who moves does not rest. `presence` [unit]
    weighs every sample by 1 − exp(−z²/2 presence²): a contact is a force all the time. Both are at most 1.
    """

    channel: Channel
    scale: float
    nu: float = 1.0
    still: float = 0.0
    presence: float = 0.0

    def empty(self) -> Rows:
        """Rows: the last value, log evidence."""
        return np.zeros((0, AXES)), np.zeros(0)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Take one observation. The first of all is no step."""
        z = signal(observed, self.channel)
        before = append(rows[0], rows[0][-1] if len(rows[0]) else z)
        step2 = ((z - before) ** 2).sum(axis=1)
        weight = log_absence(step2, self.still) + log_presence(z @ z, self.presence)
        evidence = append(rows[1], 0.0) + student_log_density(step2, AXES, self.nu, self.scale) + weight
        return np.tile(z, (len(before), 1)), evidence

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        return np.asarray(rows[1], np.float64)
