"""Rotations: quaternions x y z w of any length, and matrices; as arrays of numpy.

q and −q are the same rotation. Functions of many rotations take rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.up_direction import UP

Array = NDArray[np.float64]
LOCKED = 1e-6  # cosine of a pitch at which x and z are one axis
SMALL = 1e-9  # sine of half an angle that is its own arc


def matrix_of(quaternion: Sequence[float] | Array) -> Array:
    """Return the rotation (3, 3) of a quaternion (4,)."""
    return np.array(_rows(*_unit(quaternion).tolist()))


def matrices_of(quaternions: Array) -> Array:
    """Return the rotations (n, 3, 3) of quaternions (n, 4)."""
    return np.moveaxis(np.array(_rows(*_unit(quaternions).T)), -1, 0)


def quaternion_of(rotation: Array) -> Array:
    """Return the quaternion x y z w of a rotation (3, 3) (Shepperd's method, by the largest component)."""
    m, trace = rotation, float(np.trace(rotation))
    squares = np.array([1 + 2 * m[0, 0] - trace, 1 + 2 * m[1, 1] - trace, 1 + 2 * m[2, 2] - trace, 1 + trace])
    products = np.array(
        [
            [squares[0], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
            [m[1, 0] + m[0, 1], squares[1], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
            [m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], squares[2], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], squares[3]],
        ]
    )
    return _unit(products[int(np.argmax(squares))])


def rotation_vector(quaternion: Sequence[float] | Array) -> tuple[float, float, float]:
    """Return the axis times the angle [rad], at most π, of a quaternion (4,)."""
    unit = _unit(quaternion)
    x, y, z, w = (unit if unit[3] >= 0.0 else -unit).tolist()
    size = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 if size < 1e-9 else 2.0 * math.atan2(size, w) / size
    return factor * x, factor * y, factor * z


def rotation_vectors(quaternions: Array, start: Sequence[float]) -> Array:
    """Return the rotation vectors (n, 3) [rad] from one quaternion (4,) to others (n, 4), in the base frame.

    Each is at most π long; NaN for a quaternion of length 0. A row has the same bits among any other rows.
    """
    x, y, z, w = np.ascontiguousarray(quaternions.T)
    a, b, c, d = _unit(start).tolist()
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        turned = np.stack(  # the quaternion times the conjugate of start
            [
                (x * d - w * a) + (z * b - y * c),
                (y * d - w * b) + (x * c - z * a),
                (z * d - w * c) + (y * a - x * b),
            ]
        )
        cosine = (x * a + y * b) + (z * c + w * d)
        sine = np.sqrt(turned[0] * turned[0] + turned[1] * turned[1] + turned[2] * turned[2])
        length = sine + np.abs(cosine)
        factor = np.where(sine > SMALL * length, np.arctan2(sine, np.abs(cosine)) / sine, 1.0 / length)
        vectors: Array = (turned * np.where(cosine < 0.0, -2.0, 2.0) * factor).T
    return vectors


def quaternions_of_vectors(vectors: Array) -> Array:
    """Return the quaternions (n, 4) of rotation vectors (n, 3) [rad], axis times angle; see `_joined`."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    share = 0.5 * np.sinc(size / (2.0 * np.pi))  # sin(size / 2) / size
    return _joined(np.hstack([share * vectors, np.cos(0.5 * size)]))


def quaternions_of_roll_pitch_yaw(turns: Array) -> Array:
    """Return the quaternions (n, 4) of turns (n, 3) [rad] about x, then y, then z of the base frame."""
    (a, b, c), (d, e, f) = np.sin(0.5 * turns).T, np.cos(0.5 * turns).T
    return _joined(
        np.column_stack(
            [
                a * e * f - d * b * c,
                d * b * f + a * e * c,
                d * e * c - a * b * f,
                d * e * f + a * b * c,
            ]
        )
    )


def roll_pitch_yaw(quaternion: Sequence[float] | Array) -> tuple[float, float, float]:
    """Return the turns [rad] about x, then y, then z of the base frame, of a quaternion (4,).

    At a pitch of a quarter turn x and z are one axis: then the turn about z is 0.

    >>> [round(math.degrees(turn)) for turn in roll_pitch_yaw((1.0, 0.0, 0.0, 0.0))]
    [180, 0, 0]
    """
    m = matrix_of(quaternion)
    pitch = math.asin(min(1.0, max(-1.0, -float(m[2, 0]))))
    if math.hypot(m[0, 0], m[1, 0]) < LOCKED:
        return math.atan2(-m[1, 2], m[1, 1]), pitch, 0.0
    return math.atan2(m[2, 1], m[2, 2]), pitch, math.atan2(m[1, 0], m[0, 0])


def _joined(quaternions: Array) -> Array:
    """Return the same rotations, each with the sign nearer to the row before: vectors jump at a half turn."""
    apart = np.einsum("ni,ni->n", quaternions[1:], quaternions[:-1]) < 0.0
    signs = np.cumprod(np.where(np.concatenate([[False], apart]), -1.0, 1.0))
    joined: Array = quaternions * signs[:, None]
    return joined


def angle_between(one: Sequence[float], other: Sequence[float]) -> float:
    """Return the angle [rad] between two quaternions (4,)."""
    return 2.0 * math.acos(min(abs(float(_unit(one) @ _unit(other))), 1.0))


def angles(quaternions: Array, other: Array) -> Array:
    """Return the angles (n,) [rad] between quaternions (n, 4) and another (4,), all of unit length."""
    cosine = np.minimum(np.abs(quaternions @ other), 1.0)
    return 2.0 * np.arccos(cosine)


def angle_of_matrices(one: Array, other: Array) -> float:
    """Return the angle [rad] between two rotations (3, 3)."""
    return math.acos(min(max(0.5 * (float(np.vdot(one, other)) - 1.0), -1.0), 1.0))


def turning_of(quaternion: Array, change: Array, bend: Array) -> tuple[Array, Array]:
    """Return angular velocity (3,) [rad/s] and acceleration (3,) [rad/s²] of a quaternion (4,), base frame.

    change, bend: (4,) its first and second derivatives; its length need not be 1.
    """
    size = float(quaternion.dot(quaternion))
    slower = 2.0 * float(quaternion.dot(change)) / size
    turning = [part / size for part in _imaginary(change, quaternion)]
    turned = [part / size for part in _imaginary(bend, quaternion)]
    return np.array(turning), np.array([b - a * slower for a, b in zip(turning, turned, strict=True)])


def angular_velocities(quaternions: Array, rates: Array) -> Array:
    """Return the angular velocities (n, 3) [rad/s], base frame, of quaternions (n, 4) with rates (n, 4)."""
    vectors, w = quaternions[:, :3], quaternions[:, 3:]
    turned = w * rates[:, :3] - rates[:, 3:] * vectors + np.cross(vectors, rates[:, :3])
    return np.asarray(2.0 * turned / np.vecdot(quaternions, quaternions)[:, None])


def quaternion_rates(quaternions: Array, turning: Array) -> Array:
    """Return the rates (n, 4) of quaternions (n, 4) that turn with (n, 3) [rad/s], base frame: q̇ = ½ ω q."""
    vectors, w = quaternions[:, :3], quaternions[:, 3:]
    along = w * turning + np.cross(turning, vectors)
    return 0.5 * np.column_stack([along, -np.vecdot(turning, vectors)])


def cross(one: Array, other: Array) -> Array:
    """Return the cross product (3,) of two vectors (3,): the bits of np.cross, in a twentieth of its time."""
    ax, ay, az = one.tolist()
    bx, by, bz = other.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _imaginary(change: Array, quaternion: Array) -> tuple[float, float, float]:
    """Return twice the vector part (3,) of a quaternion (4,) times the conjugate of another."""
    cx, cy, cz, cw = change.tolist()
    qx, qy, qz, qw = quaternion.tolist()
    return (
        2.0 * ((qw * cx - cw * qx) + (qy * cz - qz * cy)),
        2.0 * ((qw * cy - cw * qy) + (qz * cx - qx * cz)),
        2.0 * ((qw * cz - cw * qz) + (qx * cy - qy * cx)),
    )


def turned_along(quaternions: Array) -> Array:
    """Return the sum (n, 3) [rad] of rotation vectors between successive quaternions (n, 4), base frame."""
    along = _unit(quaternions)
    align_signs(along)
    before, after = along[:-1], along[1:]
    half_sines = (
        before[:, 3:] * after[:, :3] - after[:, 3:] * before[:, :3] + np.cross(before[:, :3], after[:, :3])
    )
    sizes = np.linalg.norm(half_sines, axis=1, keepdims=True)
    angles = 2.0 * np.arctan2(sizes, np.vecdot(before, after)[:, None])
    steps = half_sines * np.divide(angles, sizes, out=np.full_like(sizes, 2.0), where=sizes > 0.0)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def upright_rotation(up: tuple[float, float, float] | None) -> Array | None:
    """Return the least rotation (3, 3) that turns a direction of unit length to +z; None if it is +z.

    up: None is +z. −z is turned about x: about any axis across z the turn would be as small.
    """
    if up is None or up == UP:
        return None
    x, y, z = up
    sine2 = x * x + y * y
    if sine2 < 1e-24:
        return None if z > 0.0 else np.diag([1.0, -1.0, -1.0])
    turn = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])  # v ↦ (up × z) × v
    share = (1.0 - z) / sine2 if z < 0.0 else 1.0 / (1.0 + z)  # the same, without cancellation near −z
    rotation: Array = np.eye(3) + turn + share * (turn @ turn)
    return rotation


def align_signs(quaternions: Array) -> None:
    """Negate rows (n, 4) so that successive ones have dot products >= 0: q and −q are the same rotation."""
    turned = np.vecdot(quaternions[1:], quaternions[:-1]) < 0.0
    quaternions[1:] *= np.where(turned, -1.0, 1.0).cumprod()[:, None]


def _unit(quaternions: Sequence[float] | Array) -> Array:
    """Scale a quaternion (4,), or each of (n, 4), to unit length."""
    given = np.asarray(quaternions, dtype=np.float64)
    if given.ndim == 1:
        return np.asarray(given / math.sqrt(given.dot(given)))
    return np.asarray(given / np.linalg.norm(given, axis=1, keepdims=True))


def _rows(x: Array, y: Array, z: Array, w: Array) -> list[list[Array]]:
    """Return the elements of a matrix from those of quaternions of unit length."""
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
