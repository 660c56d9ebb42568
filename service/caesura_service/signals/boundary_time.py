"""The time of a boundary between observations, determined from the speed on the 100 Hz grid.

The filter decides with which observation a segment starts; these are 0.1 s apart. Annotators place a boundary
by the speed: a movement starts where the speed rises above that of rest, stops where it falls to it, and ends
at a corner where it is slowest (docs/annotation.md). So a boundary is sought less than one observation's step
to either side of the middle between two observations. If the force changes by more than a bias, a contact
caused the boundary, which stays in the middle.

The place is a function of the signals alone. It is known with the next observation, and never changes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.constants import CREEP_M_PER_S, REST_M_PER_S, TARED_BIAS_N
from caesura_service.signals.backend import Backend
from caesura_service.signals.observation import FilteredRow

Array = NDArray[np.float64]

CONTACT_N = 2.0 * TARED_BIAS_N  # a change of the force that no bias explains
STEPS = 3  # observations whose speeds are looked at, the middle one starts the segment


class RecentRows(NamedTuple):
    """The last observations: times [s], speeds (n,) [m/s] at the grid rows up to each, forces (3,) [N]."""

    times: tuple[float, ...] = ()
    speeds: tuple[Array, ...] = ()
    forces: tuple[Array, ...] = ()

    def with_row(self, filtered: FilteredRow, force: Array) -> RecentRows:
        """Add an observation, with its tared force; after a gap it is the first."""
        kept = RecentRows() if filtered.after_gap else self
        return RecentRows(
            (*kept.times[1 - STEPS :], filtered.t),
            (*kept.speeds[1 - STEPS :], filtered.speeds),
            (*kept.forces[-STEPS:], force),
        )

    def boundary(self, every: int, grid_hz: float, arithmetic: Backend, *, contact: bool) -> float | None:
        """Return the start [s] of a segment whose first observation is the last but one.

        None without its rows, or if the force changes as at a contact. every: grid rows from one observation
        to the next. contact: whether the force shows contact.
        """
        if len(self.times) < STEPS or min(map(len, self.speeds)) < every:
            return None
        if contact and math.dist(self.forces[0].tolist(), self.forces[-1].tolist()) > CONTACT_N:
            return None
        own = 2 * every - 1  # the row of the observation that starts the segment
        first, last = own - every // 2 - (every - 1), own - every // 2 + (every - 1)
        row = arithmetic.boundary_row(np.concatenate(self.speeds), first, last, CREEP_M_PER_S, REST_M_PER_S)
        return self.times[1] + (row - own) / grid_hz
