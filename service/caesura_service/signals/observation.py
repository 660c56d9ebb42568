"""What the segmentation sees: conditioned position and force on the segmentation grid."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals.flange import FlangeColumns
from caesura_service.signals.rotation import normalised
from caesura_service.signals.tare import Tare

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Observation:
    """One row of the segmentation grid. Arrays are read-only."""

    index: int  # counts observations from 0, across gaps
    t: float  # [s] session time that it describes
    position_base: Array  # (3,) [m] flange
    force_base: Array  # (3,) [N] of the environment on the robot, tared; zeros without a wrench
    orientation: Array | None  # (4,) x y z w, flange to base
    joints: Array | None  # (7,) [rad]
    gripper_width: float | None  # [m]; None without a gripper, from a flag, or before either is clear
    gripper_closed: bool | None  # settled on something or nothing, as known at t
    speed: float  # [m/s] of the flange
    after_gap: bool  # samples are missing between the observation before and this one


def observation_of(
    columns: FlangeColumns, row: Array, *, index: int, t: float, speed: float, after_gap: bool
) -> Observation:
    """Make an observation of a filtered flange row (c,), not yet tared."""
    orientation = None if columns.orientation is None else normalised(row[None, columns.orientation])[0]
    width, closed = float(row[columns.width]), float(row[columns.closed])
    return Observation(
        index=index,
        t=t,
        position_base=_frozen(row[columns.position]),
        force_base=_frozen(row[columns.force]),
        orientation=None if orientation is None else _frozen(orientation),
        joints=None if columns.joints is None else _frozen(row[columns.joints]),
        gripper_width=None if math.isnan(width) else width,
        gripper_closed=None if math.isnan(closed) else closed > 0.0,
        speed=speed,
        after_gap=after_gap,
    )


def tared(observation: Observation, tare: Tare) -> Observation:
    """Take the bias off an observation's force."""
    if tare.bias is None:
        return observation
    return replace(observation, force_base=_frozen(tare.off(observation.force_base)))


def _frozen(values: Array) -> Array:
    copy: Array = np.array(values)
    copy.flags.writeable = False
    return copy
