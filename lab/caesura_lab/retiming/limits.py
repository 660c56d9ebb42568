"""Compares the demands of a movement on the robot with its limits, at every millisecond.

A load limits the acceleration: its inertia may exert at most `LOAD_N` on the fingers. So the flange
accelerates by at most `LOAD_N` divided by the load. A larger force would appear as a contact (4 N), or as a
load of another weight (3.5 N).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from caesura_lab.execution.joint_speeds import JOINT_SHARE
from caesura_protocol.programs.safety import PLANNED_SHARE, Safety
from caesura_protocol.reproduced_path import Curve
from caesura_service.robot import Robot

Array = NDArray[np.float64]

LOAD_N = 2.0
SHARE = 0.88  # of an acceleration or a jerk that is planned with: the arm does not follow exactly
SPEED_SHARE = 0.97  # of the speeds from which on the executor slows a movement down
LOOK_S, TICK_S = 4e-3, 1e-3  # between two inverse kinematics; between two looks
FEWEST = 24  # inverse kinematics of a movement
LEAST_RISE_S, MOST_RISE_S = 0.02, 0.04


@dataclass(frozen=True)
class MotionLimits:
    """Limits of the joints, (n,) each [rad/s, rad/s², rad/s³], and of the flange [m/s, rad/s, m/s², m/s³].

    lower, upper: positions of the joints [rad].
    """

    lower: Array
    upper: Array
    joints: tuple[Array, Array, Array]
    speed: float
    turn: float
    acceleration: float
    jerk: float

    @property
    def rise_s(self) -> float:
        """The time [s] over which an acceleration that jumps is averaged, twice (`time_law`).

        A jump from one limit of the acceleration to the other then takes half the jerk that a joint may have.
        """
        longest = float(np.max(4.0 * self.joints[1] / self.joints[2]))
        return min(max(longest, LEAST_RISE_S), MOST_RISE_S)


def limits_of(robot: Robot, safety: Safety, load_kg: float) -> MotionLimits:
    """Return the limits for planning a movement with a load."""
    arm = robot.description
    carried = arm.flange_acceleration_limit if load_kg <= 0.0 else LOAD_N / load_kg
    velocity = SPEED_SHARE * JOINT_SHARE * robot.velocity_limits
    return MotionLimits(
        robot.lower_limits,
        robot.upper_limits,
        (velocity, SHARE * robot.acceleration_limits, SHARE * robot.jerk_limits),
        SPEED_SHARE * PLANNED_SHARE * safety.speed_m_per_s,
        SPEED_SHARE * PLANNED_SHARE * safety.turn_rad_per_s,
        SHARE * min(arm.flange_acceleration_limit, carried),
        SHARE * arm.flange_jerk_limit,
    )


def hurry(curve: Curve, still: Array, robot: Robot, q: Array, limits: MotionLimits) -> float:
    """Return the least factor of time with which a movement keeps the limits; above 1 it is too fast.

    still: (4,) quaternion where the curve has none; q: (n,) joints at its start. Raises ReachError, and
    ValueError where a joint passes the limits of its position.
    """
    seconds = float(curve.t[-1])
    t = np.linspace(0.0, seconds, max(round(seconds / LOOK_S), FEWEST) + 1)
    poses = poses_at(curve, t, still)
    joints = robot.joints_along(poses, q)
    if (joints < limits.lower).any() or (joints > limits.upper).any():
        raise ValueError("a joint passes the limits of its position on the way")
    motion = make_interp_spline(t, np.column_stack([joints, poses[:, :3]]), k=5)
    ticks = np.arange(0.0, seconds, TICK_S)
    flange = (limits.speed, limits.acceleration, limits.jerk)
    most = curve.peaks()[1] / limits.turn
    for order in (1, 2, 3):
        rates = motion.derivative(order)(ticks)
        share = float((np.abs(rates[:, : robot.joints]) / limits.joints[order - 1]).max())
        share = max(share, float(np.linalg.norm(rates[:, robot.joints :], axis=1).max()) / flange[order - 1])
        most = max(most, share ** (1.0 / order))
    return most


def poses_at(curve: Curve, t: Array, still: Array) -> Array:
    """Return poses (n, 7) of a curve at times (n,) [s]; still: (4,) the quaternion of a curve without one."""
    leg = np.clip(np.searchsorted(curve.t, t, side="right") - 1, 0, len(curve.t) - 2)
    share = (np.minimum(t, curve.t[-1]) - curve.t[leg]) / np.diff(curve.t)[leg]
    values = np.einsum("np,npc->nc", share[:, None] ** np.arange(6), curve.coefficients[leg])
    if values.shape[1] == 3:
        return np.column_stack([values, np.tile(still, (len(t), 1))])
    values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    return np.asarray(values)
