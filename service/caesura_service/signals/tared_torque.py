"""The torque of a wrench less its bias, in base axes.

A sensor's own bias is constant in the flange's axes. So is the moment of a tool's weight while the tool turns
about the vertical. So the tare of the torque is kept in the flange's axes where the orientation is known, and
in the axes of the samples where it is not. The moment of a tool whose tilt changes is not compensated: no
session states a tool's mass and centre.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals.flange_pose_and_force import FlangeColumns

Array = NDArray[np.float64]
Vector = tuple[float, float, float]


def in_flange(row: Array, columns: FlangeColumns) -> list[float]:
    """Torque [Nm] of a filtered flange row in the flange's axes; without an orientation as it is measured."""
    assert columns.torque is not None, "asked of rows with a torque only"
    x, y, z = row[columns.torque].tolist()
    if columns.orientation is None or columns.turned:
        return [x, y, z]
    a, b, c, w = row[columns.orientation].tolist()
    return [*_rotated((-a, -b, -c, w), (x, y, z))]


def tared_torque(row: Array, columns: FlangeColumns, bias: Vector) -> Array:
    """Torque (3,) [Nm] of a filtered flange row about the flange, less its bias, in base axes."""
    x, y, z = (value - off for value, off in zip(in_flange(row, columns), bias, strict=True))
    if columns.orientation is not None:
        a, b, c, w = row[columns.orientation].tolist()
        x, y, z = _rotated((a, b, c, w), (x, y, z))
    torque = np.array([x, y, z])
    torque.setflags(write=False)
    return torque


def about(point: Array, positions: Array, forces: Array, torques: Array) -> Array:
    """Return torques (n, 3) [Nm] about a point (3,) [m] of wrenches that are given about other points.

    positions: (n, 3) [m] those points; forces: (n, 3) [N]; torques: (n, 3) [Nm] about them. The moment of the
    lever from the point is subtracted: M_c = M_p + (p − c) × F.
    """
    return np.asarray(torques + np.cross(positions - point, forces))


def _rotated(quaternion: tuple[float, float, float, float], vector: Vector) -> Vector:
    """Rotate a vector by a quaternion x y z w of any length: v + 2w (u × v) + 2u × (u × v), over its
    square.
    """
    x, y, z, w = quaternion
    u, v, s = vector
    scale = 2.0 / (x * x + y * y + z * z + w * w)
    a, b, c = scale * (y * s - z * v), scale * (z * u - x * s), scale * (x * v - y * u)
    return u + w * a + (y * c - z * b), v + w * b + (z * a - x * c), s + w * c + (x * b - y * a)
