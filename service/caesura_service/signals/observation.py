"""An observation: conditioned position and force on the segmentation grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals.backend import Backend
from caesura_service.signals.flange_pose_and_force import FlangeColumns
from caesura_service.signals.rotation import rotation_between
from caesura_service.signals.tare import Tare
from caesura_service.signals.tared_torque import tared_torque

Array = NDArray[np.float64]

UNBIASED = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Observation:
    """One row of the segmentation grid. Arrays are read-only."""

    index: int  # counts observations from 0, across gaps
    t: float  # [s] session time that it describes
    position_base: Array  # (3,) [m] flange
    force_base: Array  # (3,) [N] of the environment on the robot, less its bias; zeros without a wrench
    orientation: Array | None  # (4,) x y z w, flange to base
    joints: Array | None  # (n,) [rad]
    gripper_width: float | None  # [m]; None without a gripper, from a flag, or before either is clear
    gripper_closed: bool | None  # settled on something or nothing, as known at t
    velocity_base: Array  # (3,) [m/s] of the flange
    speed: float  # [m/s] its length
    after_gap: bool  # samples are missing between the observation before and this one
    bias_n: float | None = None  # [N] scale of what free space reads, where it is tracked
    rotation: Array | None = None  # (3,) [rad] sum of the rotations so far, each a vector in the base frame
    torque_base: Array | None = None  # (3,) [Nm] of the environment about the flange, where it is tared
    boundary_before: float | None = None  # [s] of a segment that starts with the observation before
    measured_n: float | None = None  # [N] length of the force as it came, with its bias and unfiltered
    turning: Array | None = None  # (4,) [1/s] how fast the quaternion changes
    between: Array | None = None  # (n, 3 or 7) unfiltered poses since the one before, evenly spread


class FilteredRow(NamedTuple):
    """A filtered row of the segmentation grid, which becomes an observation once the tare is known."""

    number: int  # becomes the observation's index
    t: float  # [s] session time
    row: Array  # (c,) a flange row: its columns are those of `FlangeColumns`
    velocity: Array  # (3,) [m/s] of the flange, base frame
    speed: float  # [m/s] its length
    speeds: Array  # (n,) [m/s] at the grid rows since the observation before, the last one its own
    after_gap: bool
    measured_n: float | None  # [N] as in Observation
    turning: Array | None  # (4,) [1/s] as in Observation
    between: Array | None  # as in Observation


class Turned(NamedTuple):
    """The orientation (4,) of an observation, None before the first one, and the sum of rotations [rad]."""

    orientation: Array | None = None
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)


def turned_to(before: Turned, orientation: Array) -> Turned:
    """Add the rotation to the orientation (4,) of the next observation."""
    if before.orientation is None:
        return Turned(orientation, before.rotation)
    (x, y, z), (dx, dy, dz) = before.rotation, rotation_between(before.orientation, orientation).tolist()
    return Turned(orientation, (x + dx, y + dy, z + dz))


def tared_row(filtered: Array, columns: FlangeColumns, tare: Tare, arithmetic: Backend) -> Array:
    """Return a filtered flange row (c,) less its tare, read-only."""
    row = filtered.copy()
    arithmetic.subtract_bias_and_normalise(*(tare.bias or UNBIASED), columns.orientation is not None, row)
    row.setflags(write=False)
    return row


def observation_of(
    filtered: FilteredRow,
    row: Array,
    columns: FlangeColumns,
    tare: Tare,
    turned: Turned,
    force: Array,
    bias_n: float | None,
    boundary_before: float | None,
) -> Observation:
    """Make an observation of a tared flange row (c,).

    force: (3,) [N] less its tracked bias, of scale bias_n [N]; None where none is tracked. boundary_before
    [s]: see `boundary_time`.
    """
    filtered.velocity.setflags(write=False)
    if filtered.between is not None:
        filtered.between.setflags(write=False)
    width, closed = row[columns.width :].tolist()
    taken = tare.torque_bias if columns.torque else None
    rotation = None
    if columns.orientation is not None:
        rotation = np.array(turned.rotation)
        rotation.setflags(write=False)
    return Observation(
        index=filtered.number,
        t=filtered.t,
        position_base=row[columns.position],
        force_base=force,
        orientation=turned.orientation,
        joints=row[columns.joints] if columns.joints else None,
        gripper_width=None if math.isnan(width) else width,
        gripper_closed=None if math.isnan(closed) else closed > 0.0,
        velocity_base=filtered.velocity,
        speed=filtered.speed,
        after_gap=filtered.after_gap,
        bias_n=bias_n,
        rotation=rotation,
        torque_base=None if taken is None else tared_torque(row, columns, taken),
        boundary_before=boundary_before,
        measured_n=filtered.measured_n,
        turning=filtered.turning,
        between=filtered.between,
    )
