"""A hand that controls its force where it touches: the thesis' human, a switching proportional controller.

In free space the hand controls a position, in contact a force (3.6) and no position: "the desired position as
already reached x_d = x" (3.2.2). The force is one first order response from the touch on (3.37), at any time,
and so is its release.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray

from caesura_lab.teacher.motion_profiles import Array, Vector

SWITCH_S = 0.03  # in which a hand goes over from place to force and back, as fast as its muscles


@dataclass(frozen=True)
class ForceSetpoint:
    """Force that a hand aims at from a time on.

    aside: (2,) lateral share of the force; yields: whether position control ends at a touch; waits: whether
    it presses only after a touch.
    """

    start_s: float
    force_n: float = 0.0
    aside: tuple[float, float] = (0.0, 0.0)
    yields: bool = False
    waits: bool = False


@dataclass(frozen=True)
class ForceProfile:
    """Force setpoints tick by tick: force (n,) [N], aside (n, 2), waits and yields (n,)."""

    force: Array
    aside: Array
    waits: NDArray[np.bool_]
    yields: NDArray[np.bool_]


def force_profile(setpoints: Sequence[ForceSetpoint], t: Array) -> ForceProfile:
    """Sample the setpoints at times t (n,) [s]; force 0 before the first."""
    all_setpoints = (ForceSetpoint(0.0), *setpoints)
    at = np.searchsorted([setpoint.start_s for setpoint in setpoints], t, side="right")
    return ForceProfile(
        np.array([setpoint.force_n for setpoint in all_setpoints])[at],
        np.array([setpoint.aside for setpoint in all_setpoints])[at],
        np.array([setpoint.waits for setpoint in all_setpoints])[at],
        np.array([setpoint.yields for setpoint in all_setpoints])[at],
    )


def force_goal(force_n: float, before_n: float, duration_s: float, rate_per_s: float) -> float:
    """Return the target force [N] for which a first order response reaches a force in a time.

    It is never a pull. The forces of the thesis' tables are those at the end of a segment (3.2.2).
    """
    left = exp(-rate_per_s * duration_s)
    return max(0.0, (force_n - before_n * left) / (1.0 - left))


class HandForceController:
    """Force and position control of a hand, tick by tick.

    force_n: current pressing force [N]; position_share: weight of the position control, 1 in the air.
    """

    def __init__(self, setpoints: ForceProfile, rate_per_s: float, dt: float) -> None:
        self._profile = setpoints
        self._force_step = dt * rate_per_s
        self._position_step = dt / SWITCH_S
        self._met = False
        self.force_n = 0.0
        self.position_share = 1.0

    def force_at(self, tick: int) -> Vector:
        """Return the force [N] of the hand on the flange at a tick."""
        x, y = self._profile.aside[tick].tolist()
        return self.force_n * x, self.force_n * y, -self.force_n

    def update(self, tick: int, normal_n: float) -> None:
        """Advance by a tick in which a surface pushed back with a normal force [N]."""
        waits, yields = bool(self._profile.waits[tick]), bool(self._profile.yields[tick])
        self._met = normal_n > 0.0 or (yields and (self._met or not waits))
        position_share = float(not (yields and self._met))
        goal = float(self._profile.force[tick]) if self._met else 0.0
        self.position_share += self._position_step * (position_share - self.position_share)
        self.force_n += self._force_step * (goal - self.force_n)
