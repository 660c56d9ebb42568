"""How a setpoint moves: quintic in time, which is the minimum-jerk movement where both ends are at rest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from caesura_clients.bridge.teacher.intentions import Array

PEAK = 1.875  # speed of a minimum-jerk movement at its middle, over its mean


@dataclass(frozen=True)
class Glide:
    """A movement from `start` to `end` (3,) [m] in some seconds, with velocities (3,) [m/s] at both ends."""

    start: Array
    end: Array
    seconds: float
    arriving: Array
    leaving: Array = field(default_factory=lambda: np.zeros(3))

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration (3,) at a time [s] after its start; past its end it goes on."""
        seconds = self.seconds
        if t >= seconds:
            return self.end + (t - seconds) * self.arriving, self.arriving, np.zeros(3)
        s, way = t / seconds, self.end - self.start
        first, last = seconds * self.leaving, seconds * self.arriving
        a = 10.0 * way - 4.0 * last - 6.0 * first
        b = -15.0 * way + 7.0 * last + 8.0 * first
        c = 6.0 * way - 3.0 * last - 3.0 * first
        position = self.start + s * first + s**3 * (a + s * (b + s * c))
        velocity = (first + s**2 * (3.0 * a + s * (4.0 * b + s * 5.0 * c))) / seconds
        acceleration = s * (6.0 * a + s * (12.0 * b + s * 20.0 * c)) / seconds**2
        return position, velocity, acceleration


@dataclass(frozen=True)
class Turn:
    """A rotation about one axis from one orientation to another, (3, 3), at rest at both ends."""

    start: Array
    end: Array
    seconds: float

    def at(self, t: float) -> Array:
        """Rotation (3, 3) at a time [s]."""
        s = min(max(t / self.seconds, 0.0), 1.0)
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        turn: Array = _exp(share * rotation_vector(self.end @ self.start.T)) @ self.start
        return turn


def rotation_vector(rotation: Array) -> Array:
    """Axis times angle (3,) [rad] of a rotation (3, 3), for angles below a half turn."""
    axis = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(axis)), 0.5 * (float(np.trace(rotation)) - 1.0)
    vector: Array = axis * (np.arctan2(sine, cosine) / sine) if sine > 1e-9 else axis
    return vector


def rotation_of(quaternion: tuple[float, float, float, float]) -> Array:
    """Rotation (3, 3) of a quaternion x y z w, which need not have length 1."""
    x, y, z, w = np.asarray(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _exp(vector: Array) -> Array:
    """Rotation (3, 3) of an axis times an angle (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Array = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return rotation
