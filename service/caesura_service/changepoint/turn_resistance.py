"""Turns with and without a resistance: a driven screw, and a returning ratchet."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import (
    AXES,
    UNTURNED,
    ModelInput,
    Rows,
    append,
    log_absence,
    log_presence,
)

Array = NDArray[np.float64]

LEAST_FORCE_N = 5.0  # below which the direction of a force is that of its bias


def torsion_of(force: Array, torque: Array | None) -> Array:
    """Return the component (3,) [Nm] of a torque along the force; zeros for a force below LEAST_FORCE_N.

    force: (3,) [N]; torque: (3,) [Nm] about any point, because r × F is orthogonal to F; None gives zeros. It
    is the moment of the wrench about its central axis (Poinsot).
    """
    size2 = 0.0 if torque is None else float(force @ force)
    if torque is None or size2 < LEAST_FORCE_N**2:
        return UNTURNED
    along: Array = float(torque @ force) / size2 * force
    return along


@dataclass(frozen=True)
class TurnResistance:
    """A weight on every step of a turn, by the torsion that acts against it; no density of the torsion.

    least [Nm] weighs a step by 1 − exp(−resisting²/2 least²), with the torsion against the step, if any; most
    [Nm] by exp(−|torsion|²/2 most²); 0 disables the weight. Both are at most 1, and the first observation of
    a recording has no step. A step that is not faster than `pace` [rad] has no clear direction. A step about
    an axis that is further from the force than arccos(`aligned`) is no screwing and is not weighed.
    """

    least: float = 0.0
    most: float = 0.0
    pace: float = 0.005
    aligned: float = 0.9

    def empty(self) -> Rows:
        """Return empty rows: last rotation, Σ log weight."""
        return np.zeros((0, AXES)), np.zeros(0)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        joins, torsion, weight = len(rows[0]) > 0, observed.torsion, 0.0
        if joins and self._is_screwing(step := observed.rotation - rows[0][-1], observed.force):
            against = -float(torsion @ step) / math.sqrt(float(step @ step) + self.pace**2)
            weight += float(log_presence(max(against, 0.0) ** 2, self.least))
            weight += float(log_absence(float(torsion @ torsion), self.most))
        return np.tile(observed.rotation, (len(rows[0]) + 1, 1)), append(rows[1], 0.0) + weight

    def _is_screwing(self, step: Array, force: Array) -> bool:
        """Return whether a step may turn about the force; True without a force."""
        step2, force2 = float(step @ step), float(force @ force)
        return force2 < LEAST_FORCE_N**2 or float(step @ force) ** 2 >= self.aligned**2 * step2 * force2

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        return np.asarray(rows[1], np.float64)
