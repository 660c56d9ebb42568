"""From grid rows to the flange: where it is, how it is turned, and the force on it, all in the base frame.

The robot's functions are called here and nowhere else: on grid rows, so at grid_hz and not at the rate of
the samples, many rows at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals.layout import Layout
from caesura_service.signals.rotation import make_sign_continuous, normalised, rotated

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

    @property
    def total(self) -> int:
        """How many columns there are."""
        return self.width + 2


def columns_of(layout: Layout) -> FlangeColumns:
    """Lay out a session's flange rows; the last two columns are the gripper's width and closed flag."""
    orientation = slice(6, 10) if layout.has_orientation else None
    end = 10 if orientation else 6
    joints = slice(end, end + 7) if layout.has("q") else None
    end += 7 if joints else 0
    return FlangeColumns(slice(0, 3), slice(3, 6), orientation, joints, width=end, moving=end)


def flange_rows(layout: Layout, columns: FlangeColumns, rows: Array, before: Array | None = None) -> Array:
    """Flange rows (m, columns) that came before, and after them those of n >= 1 grid rows: (m + n, columns).

    rows: (n, c) as `Layout.slices` says. What the gripper does is left open.
    """
    known = 0 if before is None else len(before)
    flange = np.empty((known + len(rows), columns.total))
    if before is not None:
        flange[:known] = before
    fresh = flange[known:]
    joints = rows[:, layout.slices["q"]] if columns.joints else None
    fresh[:, columns.position], orientation = _pose(layout, rows, joints)
    if columns.orientation and orientation is not None:
        fresh[:, columns.orientation] = normalised(orientation)
        make_sign_continuous(flange[max(0, known - 1) :, columns.orientation])
        orientation = fresh[:, columns.orientation]
    fresh[:, columns.force] = _force(layout, rows, joints, orientation)
    if columns.joints:
        fresh[:, columns.joints] = joints
    fresh[:, columns.width :] = np.nan
    return flange


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


def _force(layout: Layout, rows: Array, joints: Array | None, orientation: Array | None) -> Array | float:
    at = layout.slices
    if "force" in at:
        force = rows[:, at["force"]]
        in_flange = layout.force_frame == "flange" and orientation is not None
        return rotated(orientation, force) if in_flange and orientation is not None else force
    if "tau" in at and joints is not None and layout.wrench_of_joint_torques is not None:
        return layout.wrench_of_joint_torques(joints, rows[:, at["tau"]])[:, :3]
    return 0.0
