"""An observation in the form that coaching uses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.coaching.bias_drift_tracker import Vector

Array = NDArray[np.float64]


class ObservedPose(NamedTuple):
    """An observation in the form that coaching uses. Vectors are in the base frame."""

    t: float  # [s]
    position: Vector  # [m] of the flange
    velocity: Vector  # [m/s] likewise
    force: Vector  # [N] of the environment on the robot, tared
    holding: float  # 1 the fingers hold something, 0 they do not, nan unknown
    joints: Array | None = None  # (n,) [rad]
    after_gap: bool = False  # samples are missing before it
    measured_n: float | None = None  # [N] length of the force as it came; None without a wrench
    orientation: Sequence[float] | None = None  # (4,) quaternion of the flange
    turning: Sequence[float] | None = None  # (4,) [1/s] how fast it changes
    between: Array | None = None  # (n, 3 or 7) poses since the one before, evenly spread
