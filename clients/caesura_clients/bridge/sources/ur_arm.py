"""The source `ur`: an arm of Universal Robots by RTDE, through ur_rtde. Needs the extra `ur`.

What is read, by ur_rtde 1.6.5 (`RTDEReceiveInterface`), up to 500 Hz:
  getTimestamp [s] since the controller was started; getActualQ [rad]; getActualTCPPose, x y z [m] and
  rotation vector [rad] in the controller's base frame; getActualTCPForce [N, Nm] in that frame, less the
  payload's weight. It is about the flange where an arm has a sensor ("all measured at the tool flange with
  the orientation of the robot base coordinate system", Script Directory of the e-Series, get_tcp_force), and
  about the TCP where it estimates (UR's ROS 2 driver, pull request 1287). Its sign is the wire's: a stated
  payload of 1 kg that is not there is +9.82 N along z (UR's forum, topic 2053). Not verified on an arm;
  getRobotStatus, whose bit 2 is "Is teach button pressed" (its docstring): the freedrive button.
Each value is a separate call: a state is valid if getTimestamp returns the same before and after the calls.
RTDE reports no gripper: a Robotiq gripper is read separately (robotiq_urcap.py).

The flange is the TCP's pose without the TCP's offset. A torque about the TCP is moved to the flange. RTDE, as
ur_rtde reads it, does not report the offset: it is stated (`--tcp-offset`), or read from the controller in
teach mode. In teach mode (`--teach-mode`) a script runs on the controller, which must be in remote control:
freedrive is on from the beginning to the end, and a wrench whose zero is relative (robot.json) is zeroed
before. Without it the bridge commands nothing: guide with the button of the pendant, and zero the sensor
there. Only without teach mode does the button show whether a person guides the arm.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from importlib import import_module
from typing import Any

from caesura_clients.bridge.sources.live_arm import ArmState, LiveArm, connect_arm
from caesura_clients.bridge.sources.robotiq_urcap import UrcapGripper
from caesura_protocol.errors import SourceError
from caesura_protocol.flange_pose import Transform, flange_of, moved_wrench, pose_of_rotation_vector
from caesura_protocol.messages import ESTIMATE, HandOnRobot, WrenchSource
from caesura_protocol.package_version_and_extras import import_extra
from caesura_protocol.robots import GripperDescription, RobotDescription

SILENT_S = 1.0  # without a new state: the arm is lost
VARIABLES = [
    "timestamp", "actual_q", "actual_TCP_pose", "actual_TCP_force", "safety_status_bits", "robot_status_bits",
]  # fmt: skip
TEACH_BUTTON = 1 << 2  # of the robot's status


def open_ur(
    host: str,
    robot: RobotDescription,
    *,
    wrench_source: WrenchSource,
    hand_on_robot: HandOnRobot,
    tcp_offset: tuple[float, ...] | None = None,
    teach_mode: bool = False,
    gripper: GripperDescription | None = None,
) -> LiveArm:
    """Connect to an arm of Universal Robots, and return its source.

    tcp_offset: (6,) x y z [m], rotation vector [rad]; None: asked of the controller. gripper: of Robotiq,
    read through its URCap; None: no gripper is read. Raises SourceError if the extra is missing, the arm or
    its gripper does not answer, or the TCP's offset is not known.
    """
    if tcp_offset is None and not teach_mode:
        raise SourceError(
            f"{robot.name} at {host}: where is its TCP? State --tcp-offset x,y,z,rx,ry,rz [m, rad] as on the "
            "pendant (0,0,0,0,0,0 without a tool), or --teach-mode, which asks the controller"
        )
    with import_extra("ur", "the source ur"):
        receiving, controlling = import_module("rtde_receive"), import_module("rtde_control")
    who = f"{robot.name} at {host}"
    with ExitStack() as opened:
        receive = connect_arm(who, lambda: receiving.RTDEReceiveInterface(host, -1.0, VARIABLES))
        over = receive.disconnect
        opened.callback(receive.disconnect)
        fingers = None if gripper is None else UrcapGripper(who, host, gripper)
        if fingers is not None:
            opened.callback(fingers.close)
        if teach_mode:
            control = connect_arm(f"{who}, teach mode", lambda: controlling.RTDEControlInterface(host))
            tcp_offset = tcp_offset or connect_arm(who, control.getTCPOffset)
            over = _end_of_teaching(control, receive)
            if robot.wrench_is_relative:
                _do(f"{who}, zeroing its sensor", control.zeroFtSensor)
            _do(f"{who}, teach mode", control.teachMode)
        opened.pop_all()
    return LiveArm(
        who,
        _reader(
            receive, pose_of_rotation_vector(tcp_offset or (0.0,) * 6), about_tcp=wrench_source == ESTIMATE
        ),
        len(robot.joints),
        wrench_source=wrench_source,
        hand_on_robot=hand_on_robot,
        button=not teach_mode,
        gripper=fingers,
        over=over,
    )


def _do(what: str, command: Callable[[], bool]) -> None:
    """Execute a command. Raises SourceError if the controller does not carry it out."""
    if not connect_arm(what, command):
        raise SourceError(f"{what}: the controller did not execute it; is it in remote control?")


def _end_of_teaching(control: Any, receive: Any) -> Callable[[], None]:
    def end() -> None:
        control.endTeachMode()
        control.stopScript()
        control.disconnect()
        receive.disconnect()

    return end


def _reader(receive: Any, tcp_on_flange: Transform, *, about_tcp: bool) -> Callable[[], ArmState]:
    """Return a function that waits for the next state of an arm and returns it.

    about_tcp: is the arm's torque about its TCP? Otherwise it is about the flange. The function raises
    RuntimeError with the reason if the arm is lost.
    """
    last = -1.0

    def read() -> ArmState:
        nonlocal last
        waited_s = 0.0
        while True:
            period = receive.initPeriod()
            t = receive.getTimestamp()
            q, pose, wrench = receive.getActualQ(), receive.getActualTCPPose(), receive.getActualTCPForce()
            status = receive.getRobotStatus()
            if t != last and t == receive.getTimestamp():
                last = t
                break
            if why := _lost(receive, waited_s):
                raise RuntimeError(why)
            receive.waitPeriod(period)
            waited_s += PERIOD_S
        effector = pose_of_rotation_vector(pose)
        flange = flange_of(effector, tcp_on_flange)
        if about_tcp:
            wrench = moved_wrench(wrench, effector.position, flange.position)
        return ArmState(t, q, flange, wrench, button_pressed=bool(status & TEACH_BUTTON))

    return read


PERIOD_S = 0.002  # of ur_rtde's at 500 Hz; a CB3 controller has 0.008


def _lost(receive: Any, waited_s: float) -> str | None:
    """Return why the arm will report no new state; None while it may."""
    if not receive.isConnected():
        return "the controller has closed the connection"
    if receive.isEmergencyStopped():
        return "emergency stop"
    if receive.isProtectiveStopped():
        return "protective stop"
    return f"no state for {SILENT_S:g} s" if waited_s >= SILENT_S else None
