"""Simulates the robot's report of a trace: pose, joints and wrench, with realistic errors.

A wrench carries what its source can see (protocol: `WrenchSource`). Beside white noise it has a constant
bias, a wander with the pose (a tool's weight is never compensated quite right) and slowly by itself, coloured
noise while the arm moves, and the inertia of the hand below the sensor. All chance is drawn before the first
tick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from caesura_lab.teacher.guided_arm import SimulationTrace
from caesura_lab.teacher.hand_motion_plan import DT, FULL_SPEED_NOISE, TICKS_PER_S, Plan
from caesura_lab.teacher.motion_profiles import Array
from caesura_lab.teacher.noise import band_noise
from caesura_protocol.messages import WrenchSource
from caesura_service.robot import Robot

# Smallest steps reported: about 1 µm, 1 µrad, 1 mN, 0.1 mNm. Powers of two, exact in any float.
POSITION_STEP, ANGLE_STEP, FORCE_STEP, TORQUE_STEP = 2.0**-20, 2.0**-20, 2.0**-10, 2.0**-13

TORQUE_NOISE_M = 0.03  # noise of a moment per noise of a force
REACH_M = 0.8  # joint noise per position noise
MOTION_NOISE_HZ = (0.0, 15.0)
FULL_MOTION_M_PER_S = 0.1  # speed from which motion noise is at its full size
WANDER_REACH_M = 0.15  # change of position over which the bias wanders by its nominal size
WANDER_TIME_S = 10.0
TARE_S = 0.15  # at the start, over which the bias is averaged and taken off
WANDER_OF_SOURCE = {"flange_sensor": 1.0, "flange_sensor_with_hand": 2.0, "joint_torque_estimate": 3.0}
JOINT_FRICTION_ERROR_NM = 0.5  # of the joint torque model, in motion
JOINT_NOISE_NM = 0.4
JOINT_SLIP_RAD_PER_S = 0.02


@dataclass(frozen=True)
class _SensorNoise:
    """Random sensor errors of one demonstration, one row a tick."""

    joints: Array  # (n, joints) [rad]
    white: Array  # (n, 6) [N, Nm]
    coloured: Array  # (n, 6) unit variance
    joint_coloured: Array  # (n, joints) unit variance
    drift: Array  # (n, 3) [N]
    bias: Array  # (3,) [N]
    gradient: Array  # (3, 3) [N/m]
    joint_friction: Array  # (joints,) [Nm]


class Sensors:
    """The sensors during one demonstration: `read` turns traces, in order, into signals."""

    def __init__(
        self, robot: Robot, plan: Plan, source: WrenchSource, rng: np.random.Generator, *, tared: bool = True
    ) -> None:
        self._robot, self._source = robot, source
        self._chance = _draw(plan, source, robot.joints, rng)
        self._tare = self._chance.bias + self._chance.white[: round(TARE_S / DT), :3].mean(axis=0)
        self._tare = self._tare if tared else np.zeros(3)
        self._start = np.array(plan.scenario.start)
        self._most_noise = FULL_SPEED_NOISE if plan.person.habits.speed_noise else 1.0
        self._period_m = plan.person.bias_period_m
        self._hand_kg = plan.person.hand_kg
        self._last_velocity = np.zeros(3)
        self._last_quaternion = np.zeros(4)

    def read(self, trace: SimulationTrace) -> dict[str, Array]:
        """Return the signals of the next ticks, name → (n, width), as in a recording."""
        first = round(trace.t[0] / DT)
        ticks = slice(first, first + trace.t.size)
        q = _stepped(trace.q + self._chance.joints[ticks], ANGLE_STEP)
        positions, quaternions = self._robot.flange_poses(q)
        signals = {
            "pos": _stepped(positions, POSITION_STEP),
            "quat": _stepped(self._align_signs(quaternions), ANGLE_STEP),
            "q": q,
        }
        if self._source != "none":
            wrench, tau = self._wrench(trace, positions, ticks)
            signals["force"] = _stepped(wrench[:, :3], FORCE_STEP)
            signals["torque"] = _stepped(wrench[:, 3:], TORQUE_STEP)
            if tau is not None:
                signals["tau"] = _stepped(tau, TORQUE_STEP)
        signals["gripper"] = _stepped(trace.width[:, None], POSITION_STEP)
        return signals

    def _wrench(self, trace: SimulationTrace, positions: Array, ticks: slice) -> tuple[Array, Array | None]:
        """Measured wrench (n, 6), and the joint torques (n, joints) that it was estimated from."""
        chance, tau = self._chance, None
        speed = np.linalg.norm(trace.twist[:, :3], axis=1)
        moving = np.minimum(self._most_noise, speed / FULL_MOTION_M_PER_S)[:, None]
        if self._source == "joint_torque_estimate":
            tau = self._joint_torques(trace, moving, ticks)
            wrench = self._robot.wrenches_of_joint_torques(trace.q, tau)
        else:
            wrench = trace.environment + (trace.hand if self._source == "flange_sensor_with_hand" else 0.0)
            wrench[:, :3] -= self._hand_kg * self._acceleration(trace)
        wrench += chance.white[ticks] + chance.coloured[ticks] * moving
        wrench[:, :3] += chance.bias - self._tare + chance.drift[ticks]
        wrench[:, :3] += self._pose_bias(positions)
        return wrench, tau

    def _pose_bias(self, positions: Array) -> Array:
        """Bias (n, 3) [N] at positions (n, 3) beside the one at the start."""
        way = positions - self._start
        if self._period_m:
            way = self._period_m / (2.0 * np.pi) * np.sin(2.0 * np.pi * way / self._period_m)
        bias: Array = way @ self._chance.gradient
        return bias

    def _joint_torques(self, trace: SimulationTrace, moving: Array, ticks: slice) -> Array:
        """External joint torques as the robot estimates them: true ones plus the error of its model."""
        pairs = zip(trace.q, trace.environment + trace.hand, strict=True)
        true = np.array([self._robot.joint_torques_of_wrench(q, wrench) for q, wrench in pairs])
        slip = trace.v / (np.abs(trace.v) + JOINT_SLIP_RAD_PER_S)
        error: Array = self._chance.joint_friction * slip
        return true + error + JOINT_NOISE_NM * self._chance.joint_coloured[ticks] * moving

    def _acceleration(self, trace: SimulationTrace) -> Array:
        velocity = np.vstack([self._last_velocity, trace.twist[:, :3]])
        self._last_velocity = velocity[-1]
        return np.diff(velocity, axis=0) / DT

    def _align_signs(self, quaternions: Array) -> Array:
        if quaternions[0] @ self._last_quaternion < 0.0:
            quaternions = -quaternions
        self._last_quaternion = quaternions[-1]
        return quaternions


def _draw(plan: Plan, source: WrenchSource, joints: int, rng: np.random.Generator) -> _SensorNoise:
    n, person = plan.ticks, plan.person
    scale = np.array([1.0] * 3 + [TORQUE_NOISE_M] * 3)
    wander = person.bias_wander_n * (1.0 if person.bias_period_m else WANDER_OF_SOURCE.get(source, 0.0))
    direction = rng.normal(size=3)
    return _SensorNoise(
        joints=person.position_noise_m / REACH_M * rng.normal(size=(n, joints)),
        white=person.force_noise_n * scale * rng.normal(size=(n, 6)),
        coloured=person.motion_noise_n * scale * band_noise(n, 6, MOTION_NOISE_HZ, TICKS_PER_S, rng),
        joint_coloured=person.joint_noise * band_noise(n, joints, MOTION_NOISE_HZ, TICKS_PER_S, rng),
        drift=0.5 * wander * np.sqrt(DT / WANDER_TIME_S) * np.cumsum(rng.normal(size=(n, 3)), axis=0),
        bias=person.bias_n * direction / np.linalg.norm(direction),
        gradient=wander / WANDER_REACH_M * rng.normal(size=(3, 3)) / np.sqrt(3.0),
        joint_friction=person.joint_noise * JOINT_FRICTION_ERROR_NM * rng.normal(size=joints),
    )


def _stepped(values: Array, step: float) -> Array:
    rounded: Array = step * np.round(values / step)
    return rounded
