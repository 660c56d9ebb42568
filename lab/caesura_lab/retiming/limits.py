"""Compares the demands of a movement on the robot with its limits, at every millisecond.

A reproduced path is a polynomial between two via points, and its jerk jumps at each of them. So its joints
are a polynomial of each part between them, too: a spline across via points would smooth the jumps.

A load limits the acceleration: its inertia may exert at most `LOAD_N` on the fingers. So the flange
accelerates by at most `LOAD_N` divided by the load. A larger force would appear as a contact (4 N), or as a
load of another weight (3.5 N).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from caesura_lab.execution.joint_speeds import JOINT_SHARE
from caesura_protocol.programs.safety import PLANNED_SHARE, Safety
from caesura_protocol.reproduced_path import Curve
from caesura_service.robot import Robot

Array = NDArray[np.float64]

LOAD_N = 2.0
SHARE = 0.88  # of an acceleration or a jerk that is planned with: the arm does not follow exactly
SPEED_SHARE = 0.97  # of the speeds from which on the executor slows a movement down
TICK_S = 1e-3  # between two looks
PART_S, SOLVED = 0.04, 7  # a part of a path at most; inverse kinematics in a part, at both of its ends, too
PLACES = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, SOLVED))  # of these: Chebyshev's points
TO_POWERS = np.linalg.inv(np.vander(PLACES, increasing=True))


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


def slowdown(curve: Curve, still: Array, robot: Robot, q: Array, limits: MotionLimits) -> Array:
    """Return the factor of time (n,) that a movement needs at each millisecond; above 1 it is too fast there.

    still: (4,) quaternion where the curve has none; q: (n,) joints at its start. Raises ReachError, and
    ValueError where a joint passes the limits of its position.
    """
    begins, t = _parts(curve.t)
    poses = poses_at(curve, t, still)
    joints = robot.joints_along(poses, q)
    if (joints < limits.lower).any() or (joints > limits.upper).any():
        raise ValueError("a joint exceeds its position limits on the path")
    rates = _every_tick(begins, np.column_stack([joints, poses[:, :3]]))
    flange = (limits.speed, limits.acceleration, limits.jerk)
    most = np.full(len(rates), curve.peaks()[1] / limits.turn)
    for order in (1, 2, 3):
        rates = np.diff(rates, axis=0) / TICK_S
        share = (np.abs(rates[:, : robot.joints]) / limits.joints[order - 1]).max(axis=1)
        share = np.maximum(share, np.linalg.norm(rates[:, robot.joints :], axis=1) / flange[order - 1])
        most[: len(share)] = np.maximum(most[: len(share)], share ** (1.0 / order))
    return most


def _parts(knots: Array) -> tuple[Array, Array]:
    """Return the times (k + 1,) [s] at which parts begin and the last ends, and those of all `PLACES`."""
    legs = np.diff(knots)
    counts = np.ceil(legs / PART_S).astype(int)
    seconds = np.repeat(legs / counts, counts)
    begins = np.append(knots[0], knots[0] + np.cumsum(seconds))
    places = begins[:-1, None] + seconds[:, None] * PLACES[:-1]
    return begins, np.append(places.ravel(), begins[-1])


def _every_tick(begins: Array, values: Array) -> Array:
    """Return values (n, c) at every millisecond, from those at the times of `_parts`."""
    ticks = np.arange(begins[0], begins[-1] + 0.5 * TICK_S, TICK_S)
    part = np.searchsorted(begins[1:-1], ticks, side="right")
    shares = (ticks - begins[part]) / np.diff(begins)[part]
    places = sliding_window_view(values, SOLVED, axis=0)[:: SOLVED - 1]
    coefficients = places @ TO_POWERS.T
    return np.asarray(np.einsum("np,ncp->nc", shares[:, None] ** np.arange(SOLVED), coefficients[part]))


def poses_at(curve: Curve, t: Array, still: Array) -> Array:
    """Return poses (n, 7) of a curve at times (n,) [s]; still: (4,) the quaternion of a curve without one."""
    leg = np.clip(np.searchsorted(curve.t, t, side="right") - 1, 0, len(curve.t) - 2)
    share = (np.minimum(t, curve.t[-1]) - curve.t[leg]) / np.diff(curve.t)[leg]
    values = np.einsum("np,npc->nc", share[:, None] ** np.arange(6), curve.coefficients[leg])
    if values.shape[1] == 3:
        return np.column_stack([values, np.tile(still, (len(t), 1))])
    values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    return np.asarray(values)
