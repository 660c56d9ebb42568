"""Turns of the tool by a hand: an angle about one axis over time, and the torque of the hand for it.

A scenario that turns names places of the tool's tip. The flange swings round the tip as the tool turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from caesura_lab.teacher.motion_profiles import Array, Vector
from caesura_lab.teacher.noise import band_noise
from caesura_lab.teacher.person import Person

DOWN = np.array([0.0, 0.0, -1.0])  # where the fingers point before any turn
FELT_INERTIA_KG_M2, FELT_DAMPING_NMS = 0.25, 1.5  # what a person expects of the arm that is turned
FELT_FRICTION_NM = np.array([0.8, 0.8, 0.3])  # a tilt moves more joints than a spin about the fingers
CREEP_RAD_PER_S = 0.05
FEED_FORWARD_LIMIT_NM = 3.0
UNREST_HZ = (1.5, 6.0)
UNREST_M = 0.06  # unrest of a torque per unrest of a force
FULL_UNREST_RAD_PER_S, MOST_UNREST = 1.0, 2.0


@dataclass(frozen=True)
class Turns:
    """The intended orientation of the tool, tick by tick.

    rotation: (n, 3, 3) from the orientation at the start, base axes; rate: (n, 3) [rad/s], base axes.
    """

    rotation: Array
    rate: Array

    def along_tool(self, vectors: Array) -> Array:
        """Turn vectors (n, 3) that are given for the start's orientation along with the tool."""
        return np.asarray(np.matvec(self.rotation, vectors))

    def swing(self, length_m: float) -> Array:
        """Return the displacement (n, 3) [m] of the flange while the tip of a tool of this length stays."""
        return np.asarray(length_m * (DOWN - self.along_tool(np.tile(DOWN, (len(self.rate), 1)))))


def turns_about(axis: Vector, angle: Array, dt: float) -> Turns:
    """Turns by angles (n,) [rad] about an axis of the base, at ticks of dt [s]."""
    unit = np.array(axis) / np.linalg.norm(axis)
    rotation = Rotation.from_rotvec(np.outer(angle, unit)).as_matrix()
    return Turns(rotation, np.outer(np.gradient(angle, dt), unit))


def turning_torque(turns: Turns, person: Person, dt: float, rng: np.random.Generator) -> Array:
    """Torque (n, 3) [Nm] that a hand adds while it turns: what the arm asks for, and unrest.

    Unrest grows with the rate.
    """
    rate = turns.rate
    size = np.linalg.norm(rate, axis=1, keepdims=True)
    meant = FELT_INERTIA_KG_M2 * np.gradient(rate, dt, axis=0)
    meant += person.guiding_damping * FELT_DAMPING_NMS * rate
    meant += person.joint_friction * FELT_FRICTION_NM * rate / (size + CREEP_RAD_PER_S)
    unrest = band_noise(len(rate), 3, UNREST_HZ, 1.0 / dt, rng)
    unrest *= UNREST_M * person.unrest_n * np.minimum(MOST_UNREST, size / FULL_UNREST_RAD_PER_S)
    return np.asarray(np.clip(meant, -FEED_FORWARD_LIMIT_NM, FEED_FORWARD_LIMIT_NM) + unrest)
