"""The layout of a session's samples and their robot, from its opening."""

from __future__ import annotations

from caesura_protocol.columns import signal_columns
from caesura_protocol.messages import Open
from caesura_protocol.plausibility import UNITS
from caesura_protocol.robots import RobotError
from caesura_protocol.up_direction import UP
from caesura_service.coaching import ArmLimits
from caesura_service.constants import JOINTS
from caesura_service.robot import Robot, load_robot
from caesura_service.signals import SampleLayout


def layout_of(opening: Open) -> SampleLayout:
    """Return the layout by which the samples of a session are read.

    Seven joints without a stated robot are those of a Panda. Raises ValueError for an unknown robot, and for
    columns that cannot be segmented.
    """
    return sample_layout(opening, robot_of(opening))


def _joints_of(opening: Open) -> int:
    return len(signal_columns(opening.columns).get("q", ()))


def robot_of(opening: Open) -> Robot | None:
    """Return the arm that an opening states, or a Panda for seven joints; None where neither holds.

    Raises ValueError as `layout_of`.
    """
    joints = _joints_of(opening)
    name = opening.robot or ("panda" if joints == JOINTS else None)
    robot = None if name is None else load_robot(name)
    if robot is not None and joints not in {0, robot.joints}:
        stated = f"robot is {name!r}, which has {robot.joints} joints"
        raise RobotError(f"{stated}; the columns have {joints}: q1 to q{joints}")
    return robot


def arm_of(opening: Open, robot: Robot | None) -> ArmLimits | None:
    """Return the limits of the arm for hints on its joints.

    None if the arm is assumed, or no joints are reported.
    """
    if robot is None or opening.robot is None or not _joints_of(opening):
        return None
    return ArmLimits(robot.lower_limits, robot.upper_limits, robot.flange_jacobian)


def sample_layout(opening: Open, robot: Robot | None) -> SampleLayout:
    """Return the layout by which samples are read. Raises ValueError for columns it cannot read.

    robot: as of `robot_of`.
    """
    return SampleLayout(
        columns=opening.columns,
        wrench_source=opening.wrench_source,
        hand_on_robot=opening.hand_on_robot,
        force_frame=opening.force_frame,
        metres_per_unit=UNITS["length"][opening.length_unit],
        pose_of_joints=None if robot is None else robot.flange_poses,
        wrench_of_joint_torques=None if robot is None else robot.wrenches_of_joint_torques,
        joints=_joints_of(opening) or JOINTS,
        up=opening.up or UP,
    )
