"""Reads the state of a Franka arm through any wrapper of libfranka, at up to 1 kHz. It sends no command.

What is read, in libfranka's words (franka::RobotState, robot_state.h):
  q [rad]; O_T_EE and F_T_EE, 4×4 in column-major order, from which the flange's pose is taken;
  O_F_ext_hat_K [N, Nm] in the base frame, at the stiffness frame K: "forces applied by the robot to the
  environment are positive", so it is negated; zeros near a singularity. Its moment is moved from K, which
  EE_T_K places on the end effector, to the flange;
  tau_ext_hat_filtered [Nm], of the same sign;  time, in milliseconds since the robot was started;
  robot_mode, kGuiding of the enumeration RobotMode while the arm is guided with the buttons at its wrist. The
  robot's own state machine sets it (frankarobotics/libfranka issue 166), and no other button of the wrist is
  in the state (frankarobotics/franka_ros issue 266). In Desk's mode Programming some arms send no state at
  all (frankarobotics/libfranka issue 181). None of this was verified on an arm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from caesura_clients.bridge.sources.live_arm import MS, ArmState, LiveArm
from caesura_protocol.flange_pose import Transform, flange_of, moved_wrench, point_in_base, pose_of
from caesura_protocol.messages import ESTIMATE, JOINTS, HandOnRobot


class FrankaState(NamedTuple):
    """The values of one robot state that the source uses, as libfranka reports them."""

    time_ms: int
    q: Sequence[float]
    effector: Transform  # O_T_EE
    effector_on_flange: Transform  # F_T_EE
    stiffness_on_effector: Transform  # EE_T_K
    wrench: Sequence[float]  # O_F_ext_hat_K
    tau: Sequence[float]  # tau_ext_hat_filtered
    is_guided: bool = False  # robot_mode is kGuiding


def state_of(state: Any, pose: Callable[[Any], Transform] = pose_of, *, guiding: Any) -> FrankaState:
    """Return the values of a wrapper's franka::RobotState.

    pose: converts a matrix of the wrapper; guiding: the wrapper's kGuiding.
    """
    return FrankaState(
        time_ms=int(state.time.to_msec()),
        q=state.q,
        effector=pose(state.O_T_EE),
        effector_on_flange=pose(state.F_T_EE),
        stiffness_on_effector=pose(state.EE_T_K),
        wrench=state.O_F_ext_hat_K,
        tau=state.tau_ext_hat_filtered,
        is_guided=state.robot_mode == guiding,
    )


class FrankaSource(LiveArm):
    """A Franka arm as a Source.

    read: waits for the next state; width: returns the gripper's opening [m], and may block; None without a
    gripper; hand_on_robot: whether a person guides this arm by hand.
    """

    def __init__(
        self,
        name: str,
        read: Callable[[], FrankaState],
        width: Callable[[], float] | None = None,
        hand_on_robot: HandOnRobot = "yes",
    ) -> None:
        super().__init__(
            name,
            lambda: _wire_state(read()),
            JOINTS,
            wrench_source=ESTIMATE,
            hand_on_robot=hand_on_robot,
            torques=True,
            button=True,
            width=width,
        )


def _wire_state(state: FrankaState) -> ArmState:
    flange = flange_of(state.effector, state.effector_on_flange)
    stiffness = point_in_base(state.effector, state.stiffness_on_effector.position)
    return ArmState(
        t=state.time_ms / MS,
        q=state.q,
        flange=flange,
        wrench=[-value for value in moved_wrench(state.wrench, stiffness, flange.position)],
        tau=[-float(value) for value in state.tau],
        button_pressed=state.is_guided,
    )
