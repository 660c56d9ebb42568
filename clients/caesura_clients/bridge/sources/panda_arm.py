"""The source `panda`: a Franka arm through panda-python. Needs the extra `panda`.

Checked against panda-python 1.1.1 (its `libfranka.pyi`): `panda_py.libfranka.Robot(franka_address,
realtime_config)`, `Robot.read_once()`, which waits for the next state; in it `O_T_EE` and `F_T_EE` are lists
of 16 in column-major order, the others lists, `time.to_msec()`, `robot_mode` of `libfranka.RobotMode`
(`kGuiding`); `Gripper(franka_address).read_once().width`.
Its exceptions are RuntimeErrors with libfranka's text. `panda_py.Panda` is not used: it sets up controllers.
"""

from __future__ import annotations

from importlib import import_module

from caesura_clients.bridge.sources.libfranka_state import FrankaSource, state_of
from caesura_clients.bridge.sources.live_arm import NO_GRIPPER, connect_arm
from caesura_protocol.messages import HandOnRobot
from caesura_protocol.package_version_and_extras import import_extra


def open_panda(host: str, *, gripper: bool = True, hand_on_robot: HandOnRobot = "yes") -> FrankaSource:
    """Connect to a Franka arm by panda-py, and return its source.

    Raises SourceError if the extra is missing or the robot does not answer.
    """
    with import_extra("panda", "the source panda"):
        libfranka = import_module("panda_py.libfranka")
    who = f"panda at {host}"
    robot = connect_arm(who, lambda: libfranka.Robot(host, libfranka.RealtimeConfig.kIgnore))
    width = None
    if gripper:
        hand = connect_arm(f"{who}, its gripper", lambda: libfranka.Gripper(host), NO_GRIPPER)
        width = lambda: float(hand.read_once().width)  # noqa: E731 - it closes over the hand
    guiding = libfranka.RobotMode.kGuiding
    return FrankaSource(who, lambda: state_of(robot.read_once(), guiding=guiding), width, hand_on_robot)
