"""The speeds of an arm's joints on a path: the fastest joint, with its limit."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from caesura_lab.teacher.motion_profiles import Array
from caesura_protocol.reproduced_path import Curve
from caesura_protocol.rotations import turning_of
from caesura_service.robot import HandDynamics, Robot

JOINT_SHARE = 0.85  # of a joint's speed limit that a path may ask for
POSE = 6  # numbers of a pose
LOOK_S, LEAST_SINGULAR = 0.02, 0.02  # between two looks; of the largest singular value


class JointSpeed(NamedTuple):
    """The speed of a joint; number: counted from 1."""

    number: int
    rad_per_s: float
    limit_rad_per_s: float

    @property
    def share(self) -> float:
        """The speed as a share of the joint's limit."""
        return self.rad_per_s / self.limit_rad_per_s

    @property
    def slower(self) -> float:
        """The factor of time, 1 or more, with which the joint keeps `JOINT_SHARE` of its limit."""
        return max(1.0, self.share / JOINT_SHARE)


def _least_motion(arm: HandDynamics) -> Array:
    return np.asarray(np.linalg.pinv(arm.jacobian, rcond=LEAST_SINGULAR), dtype=np.float64)


def _least_energy(arm: HandDynamics) -> Array:
    across = np.linalg.solve(arm.mass_matrix, arm.jacobian.T)
    inverse: Array = across @ np.linalg.pinv(arm.jacobian @ across, rcond=LEAST_SINGULAR**2, hermitian=True)
    return inverse


def fastest_joint(robot: Robot, path: Curve, q: Array) -> JointSpeed:
    """Return the joint with the largest share of its speed limit on a path from q (n,) [rad].

    An arm with more than six joints may move its elbow on the way. It is computed twice, with the least
    motion of the joints, q̇ = J⁺ twist, and with the least kinetic energy, q̇ = M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹ twist
    (Khatib 1987). A controller that holds the elbow by a spring lies between the two.
    """
    inverses = (_least_motion, _least_energy) if robot.joints > POSE else (_least_motion,)
    peaks = np.max([_peaks(robot, path, q, inverse) for inverse in inverses], axis=0)
    number = int(np.argmax(peaks / robot.velocity_limits))
    return JointSpeed(number + 1, float(peaks[number]), float(robot.velocity_limits[number]))


def _peaks(robot: Robot, path: Curve, q: Array, inverse_of: Callable[[HandDynamics], Array]) -> Array:
    """Return the largest speed (n,) [rad/s] of each joint."""
    peaks = np.zeros(robot.joints)
    for t in np.arange(0.0, float(path.t[-1]), LOOK_S):
        v = inverse_of(robot.hand_dynamics(q)) @ _twist(path, float(t))
        peaks = np.maximum(peaks, np.abs(v))
        q = q + LOOK_S * v
    return peaks


def _twist(path: Curve, t: float) -> Array:
    """Return the twist (6,) [m/s], [rad/s] of the flange on a path; without orientation it does not turn."""
    value, velocity, _ = path.at(t)
    turning = turning_of(value[3:], velocity[3:], np.zeros(4))[0] if len(value) == 7 else np.zeros(3)
    return np.concatenate([velocity[:3], turning])
