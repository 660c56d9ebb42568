"""Checks at every tick that the robot is within its limits, and otherwise stops it with the reason.

It stops before a limit: slightly below those of speed and force, and if position or joints would pass their
limits within the braking time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from caesura_lab.execution.simulated_arm import ArmMeasurement, SimulatedArm
from caesura_protocol.programs.safety import STOP_SHARE, Safety

EDGE_M = 0.002  # before the edge of the workspace
JOINT_MARGIN_RAD = 0.02
BRAKING_S = 0.08


class RobotStopped(Exception):  # noqa: N818  (a stop is no error of the program that is running)
    """The safety monitor stopped the robot; the message has the reason, the value and the limit."""


class SafetyMonitor:
    """Compares every measurement of a run with the limits of speed, force, position and joints."""

    def __init__(self, arm: SimulatedArm, safety: Safety) -> None:
        self._safety = safety
        self._low = [low + EDGE_M for low in safety.workspace_low]
        self._high = [high - EDGE_M for high in safety.workspace_high]
        self._lower = (arm.lower + JOINT_MARGIN_RAD).tolist()
        self._upper = (arm.upper - JOINT_MARGIN_RAD).tolist()
        self._fastest = (STOP_SHARE * arm.joint_speeds).tolist()
        self._slowest = [-speed for speed in self._fastest]

    def check_measurement(self, measured: ArmMeasurement) -> None:
        """Check one measurement. Raises RobotStopped where a limit is reached."""
        twist, v = measured.twist.tolist(), measured.v.tolist()
        self._check_norm("speed", twist[:3], self._safety.speed_m_per_s, "m/s")
        self._check_norm("turn", twist[3:], self._safety.turn_rad_per_s, "rad/s")
        self._check_norm("force", measured.force.tolist(), self._safety.felt_force_n, "N")
        place, q = measured.position.tolist(), measured.q.tolist()
        self._check_interval("position", _ahead(place, twist[:3]), self._low, self._high, "m after braking")
        self._check_interval("joint", _ahead(q, v), self._lower, self._upper, "rad after braking")
        self._check_interval("joint speed", v, self._slowest, self._fastest, "rad/s")

    def _check_norm(self, what: str, vector: Sequence[float], limit: float, unit: str) -> None:
        value = math.hypot(*vector)
        if value > STOP_SHARE * limit:
            raise RobotStopped(
                f"{what} {value:.3g} {unit} is above {STOP_SHARE:.0%} of the limit of {limit:g} {unit}"
            )

    def _check_interval(
        self, what: str, values: Sequence[float], low: Sequence[float], high: Sequence[float], unit: str
    ) -> None:
        for i, (value, least, most) in enumerate(zip(values, low, high, strict=True)):
            if not least <= value <= most:
                expected = f"expected {least:.3f} to {most:.3f}"
                raise RobotStopped(f"{what} {i + 1}: {value:.3f} {unit}, {expected}")


def _ahead(values: Sequence[float], rates: Sequence[float]) -> list[float]:
    """Return the values after the braking time."""
    return [value + BRAKING_S * rate for value, rate in zip(values, rates, strict=True)]
