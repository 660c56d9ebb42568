"""The source `xarm`: an arm of UFACTORY through its SDK. Needs the extra `xarm`.

What is read, by xArm-Python-SDK 1.18.4 (`XArmAPI(…, report_type="real")`), at 100 Hz:
  the report callback's `joints` [rad] and `cartesian`, x y z [mm] and roll, pitch, yaw [rad] of the TCP in
  the base frame; `ft_ext_force` [N, Nm] of UFACTORY's six-axis sensor, less load and offset. It is 10 ms
  older than the rest. UFACTORY states neither its axes nor its sign. Those of the TCP are assumed, which must
  be parallel to the flange's, and the wire's sign (public code finds a contact below by a negative z of a
  tool that points down); not verified on an arm.
  `mode`, which every report brings: 2 is its joint teaching mode, in which the arm is guided by hand;
  `state`: 4 is STOP, to which the arm switches "when any error occurs" (user manual of UFACTORY Studio,
  10.2). Such a report has no error code (ufactory_docs, "Data Description of TCP port", 30003), so the
  source asks the controller for it.
A report has no timestamp: a row has the time at which the report arrived. Its joints and pose are the
controller's targets.

Without that sensor no wrench is reported (`--wrench-source none`): motor torques are not read. The TCP's
offset is stated (`--tcp-offset`): fast reports do not have it. In teach mode (`--teach-mode`) the arm is in
its joint teaching mode from the beginning to the end, and the sensor is zeroed before. That mode is entered
from the position mode only (user manual, 10.1). Without teach mode the bridge commands nothing. The operator
then turns the joint teaching mode on and off, for example in UFACTORY's software, which has the effect of a
hand-guiding button. A button on the arm itself is not reported.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from caesura_clients.bridge.sources.live_arm import ArmState, LiveArm, connect_arm
from caesura_protocol.errors import SourceError
from caesura_protocol.flange_pose import (
    Transform,
    flange_of,
    pose_of_roll_pitch_yaw,
    pose_of_rotation_vector,
)
from caesura_protocol.messages import ESTIMATE, HandOnRobot, WrenchSource
from caesura_protocol.package_version_and_extras import import_extra
from caesura_protocol.robots import RobotDescription

SILENT_S = 1.0  # without a report: the arm is lost
WAITING_REPORTS = 1000  # at most; ten seconds
POSITION, JOINT_TEACHING = 0, 2  # modes
READY, STOP = 0, 4  # states: the first starts a mode
M_PER_MM = 0.001


def open_xarm(
    host: str,
    robot: RobotDescription,
    *,
    wrench_source: WrenchSource | None,
    hand_on_robot: HandOnRobot,
    tcp_offset: tuple[float, ...] | None,
    teach_mode: bool = False,
) -> LiveArm:
    """Connect to an arm of UFACTORY, and return its source.

    tcp_offset: (6,) x y z [m], rotation vector [rad]. Raises SourceError if the extra is missing, the arm
    does not answer, or a needed option is not stated.
    """
    if tcp_offset is None:
        raise SourceError(
            f"{robot.name} at {host}: where is its TCP? State --tcp-offset x,y,z,rx,ry,rz [m, rad], "
            "0,0,0,0,0,0 without a tool"
        )
    if wrench_source in {None, ESTIMATE}:
        raise SourceError(
            f"wrench_source is {wrench_source!r}, expected flange_sensor or flange_sensor_with_hand with "
            "UFACTORY's sensor, or none without it"
        )
    with import_extra("xarm", "the source xarm"):
        wrapper = import_module("xarm.wrapper")
    who = f"{robot.name} at {host}"
    arm = connect_arm(who, lambda: wrapper.XArmAPI(host, is_radian=True, report_type="real"))
    has_sensor = wrench_source != "none"
    if has_sensor:
        _do(who, "its sensor", lambda: arm.set_ft_sensor_enable(1))
    if teach_mode:
        if has_sensor and robot.wrench_is_relative:
            _do(who, "zeroing its sensor", arm.set_ft_sensor_zero)
        _do(who, "its motors", arm.motion_enable)
        for mode in POSITION, JOINT_TEACHING:
            _do(who, "teach mode", partial(arm.set_mode, mode))
            _do(who, "teach mode", partial(arm.set_state, READY))
    return LiveArm(
        who,
        _reader(arm, len(robot.joints), pose_of_rotation_vector(tcp_offset), has_sensor=has_sensor),
        len(robot.joints),
        wrench_source=wrench_source or "none",
        hand_on_robot=hand_on_robot,
        force_frame="flange" if has_sensor else "base",
        button=not teach_mode,
        over=_end(arm, teach_mode=teach_mode),
    )


def _do(who: str, what: str, command: Callable[[], int]) -> None:
    """Execute a command. Raises SourceError for any return code but 0."""
    if code := connect_arm(f"{who}, {what}", command):
        raise SourceError(f"{who}: {what}: the SDK's code is {code}, expected 0")


def _end(arm: Any, *, teach_mode: bool) -> Callable[[], None]:
    def end() -> None:
        if teach_mode:
            arm.set_mode(POSITION)
            arm.set_state(READY)
        arm.disconnect()

    return end


def _reader(arm: Any, joints: int, tcp_on_flange: Transform, *, has_sensor: bool) -> Callable[[], ArmState]:
    """Return a function that waits for the next report of an arm and returns it as a state.

    The function raises RuntimeError with the reason if the arm is lost.
    """
    reports: queue.Queue[tuple[float, dict[str, Any], list[float], bool]] = queue.Queue(WAITING_REPORTS)

    def take(report: dict[str, Any]) -> None:
        wrench = list(arm.ft_ext_force) if has_sensor else []
        reports.put((time.monotonic(), report, wrench, arm.mode == JOINT_TEACHING))

    connect_arm("its reports", lambda: arm.register_report_callback(take))

    def read() -> ArmState:
        try:
            t, report, wrench, is_guided = reports.get(timeout=SILENT_S)
        except queue.Empty:
            reason = f"no report for {SILENT_S:g} s" if arm.connected else "the connection was closed"
            raise RuntimeError(reason) from None
        if report["state"] == STOP and (error := _error_of(arm)):
            raise RuntimeError(error)
        x, y, z, *turn = report["cartesian"]
        effector = pose_of_roll_pitch_yaw((x * M_PER_MM, y * M_PER_MM, z * M_PER_MM), turn)
        flange = flange_of(effector, tcp_on_flange)
        return ArmState(t, report["joints"][:joints], flange, wrench, button_pressed=is_guided)

    return read


def _error_of(arm: Any) -> str | None:
    """Ask a stopped controller for its error, in words; None where it was stopped without one."""
    code, found = arm.get_err_warn_code()
    if code:
        return f"the arm is stopped, and its error could not be read: the SDK's code is {code}"
    return f"the controller's error is {found[0]}" if found[0] else None
