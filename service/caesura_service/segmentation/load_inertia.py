"""The inertia of what the fingers hold: by Newton's second law it is known, once the weight is seen.

What hangs from the flange pulls with m (g − a). Accelerated by 1.5 m/s², a load of 2 kg pulls 3 N aside: as
much as a sensor's bias. Without its inertia, a load has the same force in movement and at rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.preset import STEP_S
from caesura_service.constants import GRAVITY, LOAD_KG

Array = NDArray[np.float64]

_Z = 2
RESTING = np.zeros(3)  # [m/s²] the acceleration of a flange at rest
RESTING.setflags(write=False)


class Acceleration:
    """The acceleration of the flange from its velocities, without a delay, to the second order."""

    def __init__(self) -> None:
        self._before: tuple[Array, ...] = ()  # the last velocities [m/s], the newest first; at most two

    def next(self, velocity: Array, *, after_gap: bool) -> Array:
        """Return the acceleration (3,) [m/s²] at the next observation; 0 at the first one after a gap."""
        before = () if after_gap else self._before
        self._before = (velocity, *before[:1])
        if len(before) < 2:
            return (velocity - before[0]) / STEP_S if before else RESTING
        found: Array = (3.0 * velocity - 4.0 * before[0] + before[1]) / (2.0 * STEP_S)
        return found


def without_load_inertia(force: Array, acceleration: Array) -> Array:
    """Return the force (3,) [N] that the held load would have at rest, its own weight included.

    force: of the environment on the robot, z upwards; acceleration (3,) [m/s²]. The mass is the one whose
    weight pulls down in this observation, up to `LOAD_KG`: a force upwards has none, and in free fall nothing
    weighs.
    """
    apparent = GRAVITY + acceleration[_Z]  # [m/s²] of what hangs on the flange
    kg = min(max(-force[_Z] / apparent, 0.0), LOAD_KG) if apparent > 0.0 else 0.0
    still: Array = force + kg * acceleration
    return still
