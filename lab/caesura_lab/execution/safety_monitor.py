"""Looks at every tick whether the robot is within its limits, and stops it with the reason if it is not.

It stops before a limit: a little before those of speed and force, and where place or joints would pass their
limits in the time that it takes to brake.
"""

from __future__ import annotations

import numpy as np

from caesura_lab.execution.simulated_arm import ArmMeasurement, SimulatedArm
from caesura_lab.teacher.motion_profiles import Array
from caesura_protocol.programs.safety import STOP_SHARE, Safety

EDGE_M = 0.002  # before the edge of the workspace
JOINT_MARGIN_RAD = 0.02
BRAKING_S = 0.08


class RobotStopped(Exception):  # noqa: N818  (a stop is no error of the program that is running)
    """The safety monitor stopped the robot; the message has the reason, the value and the limit."""


class SafetyMonitor:
    """Compares every measurement of a run with the limits of speed, force, place and joints."""

    def __init__(self, arm: SimulatedArm, safety: Safety) -> None:
        self._safety = safety
        self._low = np.array(safety.workspace_low) + EDGE_M
        self._high = np.array(safety.workspace_high) - EDGE_M
        self._lower, self._upper = arm.lower + JOINT_MARGIN_RAD, arm.upper - JOINT_MARGIN_RAD
        self._joint_speeds = STOP_SHARE * arm.joint_speeds

    def check_measurement(self, measured: ArmMeasurement) -> None:
        """Check one measurement. Raises RobotStopped where a limit is reached."""
        self._check_norm(
            "speed", float(np.linalg.norm(measured.twist[:3])), self._safety.speed_m_per_s, "m/s"
        )
        self._check_norm(
            "turn", float(np.linalg.norm(measured.twist[3:])), self._safety.turn_rad_per_s, "rad/s"
        )
        self._check_norm("force", float(np.linalg.norm(measured.force)), self._safety.felt_force_n, "N")
        ahead = measured.position + BRAKING_S * measured.twist[:3]
        self._check_interval("position", ahead, self._low, self._high, "m")
        self._check_interval("joint", measured.q + BRAKING_S * measured.v, self._lower, self._upper, "rad")
        self._check_interval("joint speed", measured.v, -self._joint_speeds, self._joint_speeds, "rad/s")

    def _check_norm(self, what: str, value: float, limit: float, unit: str) -> None:
        if value > STOP_SHARE * limit:
            raise RobotStopped(f"{what} {value:.3g} {unit} reaches the limit of {limit:g} {unit}")

    def _check_interval(self, what: str, values: Array, low: Array, high: Array, unit: str) -> None:
        out = (values < low) | (values > high)
        if out.any():
            i = int(np.argmax(out))
            span = f"{low[i]:.3f} to {high[i]:.3f} {unit}"
            raise RobotStopped(f"{what} {i + 1}: {values[i]:.3f} {unit} reaches its limits, {span}")
