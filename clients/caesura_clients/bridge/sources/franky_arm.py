"""The source `franky`: a Franka arm through franky-control. Needs the extra `franky`.

Checked against franky-control 2.0.0 (its `_franky.pyi`): `Robot(fci_hostname, …, realtime_config=)`, property
`Robot.state`, which waits for the next state while no program moves the robot; in it `O_T_EE` and `F_T_EE`
are `Affine`s (`.matrix`, 4×4), the others arrays, `time.to_msec()`, `robot_mode` of `franky.RobotMode`
(`Guiding`); `Gripper(fci_hostname).state.width`. All of its exceptions derive from `franky.Exception`.

Connecting changes one setting: the constructor of franky sets the robot's collision thresholds (20 Nm, 30 N
by default). It commands nothing else. Some versions read twice for one state, and so return states at 500 Hz.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from caesura_clients.bridge.sources.libfranka_state import FrankaSource, state_of
from caesura_clients.bridge.sources.live_arm import NO_GRIPPER, connect_arm
from caesura_protocol.flange_pose import Transform, pose_of
from caesura_protocol.messages import HandOnRobot
from caesura_protocol.package_version_and_extras import import_extra


def open_franky(host: str, *, gripper: bool = True, hand_on_robot: HandOnRobot = "yes") -> FrankaSource:
    """Connect to a Franka arm by franky, and return its source.

    Raises SourceError if the extra is missing or the robot does not answer.
    """
    with import_extra("franky", "the source franky"):
        franky = import_module("franky")
    who = f"franky at {host}"
    robot = connect_arm(who, lambda: franky.Robot(host, realtime_config=franky.RealtimeConfig.Ignore))
    width = None
    if gripper:
        hand = connect_arm(f"{who}, its gripper", lambda: franky.Gripper(host), NO_GRIPPER)
        width = lambda: float(hand.state.width)  # noqa: E731 - it closes over the hand
    guiding = franky.RobotMode.Guiding
    return FrankaSource(who, lambda: state_of(robot.state, _pose, guiding=guiding), width, hand_on_robot)


def _pose(affine: Any) -> Transform:
    return pose_of(affine.matrix.flatten(order="F"))
