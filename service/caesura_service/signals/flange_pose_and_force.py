"""Flange pose and force in the base frame, from grid rows.

Only this module calls the robot's kinematics: on grid rows, so at grid_hz and not at the rate of the samples,
for many rows at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals.backend import REFERENCE, Backend
from caesura_service.signals.numpy_operations import FILLED, FORCE, LEFT_OPEN, TURN
from caesura_service.signals.sample_layout import SampleLayout

Array = NDArray[np.float64]

POSITION, FORCES, ORIENTATION = slice(0, FORCE), slice(FORCE, TURN), slice(TURN, TURN + 4)


class FlangeColumns(NamedTuple):
    """The columns of a flange row: position (m), force (N), then the other signals of the session."""

    position: slice
    force: slice
    orientation: slice | None  # x y z w
    joints: slice | None  # [rad]
    torque: slice | None  # [Nm] about the flange, in the axes of the sensor
    width: int
    moving: int  # columns before this one are filtered, the others only delayed
    sources: NDArray[np.int64]  # columns of the grid row, see `numpy_operations.flange_rows`
    turned: bool  # the force is measured in the flange's frame

    @property
    def closed(self) -> int:
        """The column of the gripper's closed flag: 1, 0 or nan."""
        return self.width + 1

    @property
    def total(self) -> int:
        """The number of columns."""
        return self.width + 2


def columns_of(layout: SampleLayout) -> FlangeColumns:
    """Lay out a session's flange rows; the last two columns are the gripper's width and closed flag."""
    orientation = ORIENTATION if layout.has_orientation else None
    end = TURN + 4 if orientation else TURN
    joints = slice(end, end + layout.joints) if layout.has("q") else None
    end += layout.joints if joints else 0
    torque = slice(end, end + 3) if layout.has_torque else None
    end += 3 if torque else 0
    sources = np.full(end + 2, LEFT_OPEN)
    places = {"pos": POSITION, "force": FORCES, "quat": orientation, "q": joints, "torque": torque}
    for signal, place in places.items():
        if place:
            at = layout.slices.get(signal)
            sources[place] = np.arange(at.start, at.stop) if at else FILLED
    turned = layout.force_frame == "flange" and "force" in layout.slices
    return FlangeColumns(POSITION, FORCES, orientation, joints, torque, end, end, sources, turned)


def flange_rows(
    layout: SampleLayout,
    columns: FlangeColumns,
    rows: Array,
    before: Array | None = None,
    arithmetic: Backend = REFERENCE,
) -> Array:
    """Return earlier flange rows (m, columns), followed by those of n >= 1 grid rows: (m + n, columns).

    rows: (n, c) in the order of `SampleLayout.slices`. The columns of the gripper are left nan.
    """
    before = np.empty((0, columns.total)) if before is None else before
    flange = np.empty((len(before) + len(rows), columns.total))
    _fill(layout, rows, flange[len(before) :])
    oriented = columns.orientation is not None
    arithmetic.flange_rows(rows, before, columns.sources, oriented, columns.turned, flange)
    return flange


def _fill(layout: SampleLayout, rows: Array, fresh: Array) -> None:
    """Fill in the values that no column of the grid rows has: those computed from the joints, and 0 for no
    force.
    """
    at = layout.slices
    if layout.pose_of_joints is not None and "q" in at and not ("pos" in at and "quat" in at):
        position, orientation = layout.pose_of_joints(rows[:, at["q"]])
        fresh[:, POSITION], fresh[:, ORIENTATION] = position, orientation
    if "tau" in at and layout.wrench_of_joint_torques is not None:
        fresh[:, FORCES] = layout.wrench_of_joint_torques(rows[:, at["q"]], rows[:, at["tau"]])[:, :3]
    elif "force" not in at:
        fresh[:, FORCES] = 0.0
