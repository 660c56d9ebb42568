"""From grid rows to the flange: where it is, how it is turned, and the force on it, all in the base frame.

The robot's functions are called here and nowhere else: on grid rows, so at grid_hz and not at the rate of
the samples, many rows at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals.layout import Layout
from caesura_service.signals.rotation import normalised, rotated, sign_continuous

Array = NDArray[np.float64]


class FlangeColumns(NamedTuple):
    """Where things stand in a flange row: position (m), force (N), then what the session has."""

    position: slice
    force: slice
    orientation: slice | None  # x y z w
    joints: slice | None  # [rad]
    width: int
    moving: int  # columns before this one are filtered, the others only delayed

    @property
    def closed(self) -> int:
        """Gripper closed: 1, 0 or nan."""
        return self.width + 1

    def orientation_before(self, rows: Array | None) -> Array | None:
        """Orientation (4,) of the last of these flange rows, where there is one."""
        return None if rows is None or self.orientation is None else rows[-1, self.orientation]


def columns_of(layout: Layout) -> FlangeColumns:
    """Lay out a session's flange rows; the last two columns are the gripper's width and closed flag."""
    orientation = slice(6, 10) if layout.has_orientation else None
    end = 10 if orientation else 6
    joints = slice(end, end + 7) if layout.has("q") else None
    end += 7 if joints else 0
    return FlangeColumns(slice(0, 3), slice(3, 6), orientation, joints, width=end, moving=end)


def flange_rows(layout: Layout, rows: Array, previous_orientation: Array | None) -> list[Array]:
    """Position, force and what else `columns_of` names, as matrices of n >= 1 rows each.

    rows: (n, c) as `Layout.slices` says. previous_orientation: (4,) of the row before the first.
    """
    at = layout.slices
    joints = rows[:, at["q"]] if "q" in at else None
    position, orientation = _pose(layout, rows, joints)
    if orientation is not None:
        orientation = sign_continuous(normalised(orientation), previous_orientation)
    force = _force(layout, rows, joints, orientation)
    return [part for part in (position, force, orientation, joints) if part is not None]


def _pose(layout: Layout, rows: Array, joints: Array | None) -> tuple[Array, Array | None]:
    """Position as measured where it is, else from the joints; the same for the orientation."""
    at = layout.slices
    position = rows[:, at["pos"]] if "pos" in at else None
    orientation = rows[:, at["quat"]] if "quat" in at else None
    if layout.pose_of_joints is not None and joints is not None and (position is None or orientation is None):
        from_joints = layout.pose_of_joints(joints)
        position = from_joints[0] if position is None else position
        orientation = from_joints[1] if orientation is None else orientation
    assert position is not None, "Layout demands a position or joints with their pose"
    return position, orientation


def _force(layout: Layout, rows: Array, joints: Array | None, orientation: Array | None) -> Array:
    at = layout.slices
    if "force" in at:
        force = rows[:, at["force"]]
        in_flange = layout.force_frame == "flange" and orientation is not None
        return rotated(orientation, force) if in_flange and orientation is not None else force
    if "tau" in at and joints is not None and layout.wrench_of_joint_torques is not None:
        return layout.wrench_of_joint_torques(joints, rows[:, at["tau"]])[:, :3]
    return np.zeros((len(rows), 3))
