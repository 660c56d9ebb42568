"""Computes the flange's pose from the reported pose of the end effector and its transform on the flange.

Quaternions are x y z w. An end effector frame that was never set (all zeros) equals the flange's.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin, sqrt
from typing import NamedTuple

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Transform(NamedTuple):
    """The pose of one frame in another."""

    position: Vector  # [m]
    orientation: Quaternion


SMALL_RAD = 1e-4  # below it a sine is its series
HERE = Transform((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def flange_of(effector: Transform, effector_on_flange: Transform) -> Transform:
    """Return the flange O_T_F = O_T_EE · (F_T_EE)⁻¹.

    effector: in the base frame; effector_on_flange: in the flange's frame, all zeros if it was never set.
    """
    if effector_on_flange == HERE or not any(effector_on_flange.orientation):
        return effector
    (x, y, z), (ox, oy, oz, ow) = effector_on_flange
    turned = multiply(effector.orientation, (-ox, -oy, -oz, ow))
    offset = rotate(turned, (x, y, z))
    a, b = effector.position, offset
    return Transform((a[0] - b[0], a[1] - b[1], a[2] - b[2]), turned)


def point_in_base(frame: Transform, point: Vector) -> Vector:
    """Return a point [m] of a frame in the frame to which `frame` refers."""
    (x, y, z), (a, b, c) = frame.position, rotate(frame.orientation, point)
    return x + a, y + b, z + c


def multiply(one: Quaternion, other: Quaternion) -> Quaternion:
    """Return the product of two rotations, of which the second is applied first."""
    x, y, z, w = one
    a, b, c, d = other
    return (
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    )


def rotate(by: Quaternion, vector: Vector) -> Vector:
    """Return a vector, rotated."""
    x, y, z, w = by
    turned = multiply(multiply(by, (*vector, 0.0)), (-x, -y, -z, w))
    return turned[:3]


def pose_of(matrix: Sequence[float]) -> Transform:
    """Return the pose of a 4×4 matrix in column-major order, as in libfranka.

    matrix: (16,); rotation [[m0, m4, m8], [m1, m5, m9], [m2, m6, m10]], position m12, m13, m14 [m].
    """
    position = (float(matrix[12]), float(matrix[13]), float(matrix[14]))
    return Transform(position, _quaternion_of(matrix))


def _quaternion_of(m: Sequence[float]) -> Quaternion:
    """Return the quaternion by Shepperd's method: the largest component first, to avoid small divisors."""
    xx, yy, zz = float(m[0]), float(m[5]), float(m[10])
    squares = (1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz, 1.0 + xx + yy + zz)  # 4 x², …
    largest = max(range(4), key=squares.__getitem__)
    twice = sqrt(max(squares[largest], 0.0))
    if twice == 0.0:
        return HERE.orientation  # all zeros: there is no rotation
    x_y, x_z, y_z = m[1] + m[4], m[2] + m[8], m[6] + m[9]  # 4 x y, …
    x_w, y_w, z_w = m[6] - m[9], m[8] - m[2], m[1] - m[4]
    four: tuple[Quaternion, ...] = (
        (squares[0], x_y, x_z, x_w),
        (x_y, squares[1], y_z, y_w),
        (x_z, y_z, squares[2], z_w),
        (x_w, y_w, z_w, squares[3]),
    )
    a, b, c, d = (float(value) / (2.0 * twice) for value in four[largest])
    return a, b, c, d


def pose_of_rotation_vector(values: Sequence[float]) -> Transform:
    """Return the pose of (6,): position, then rotation vector (axis times angle [rad]), as in UR robots."""
    x, y, z, *turn = map(float, values)
    a, b, c = turn
    angle = sqrt(a * a + b * b + c * c)
    share = 0.5 - angle * angle / 48.0 if angle < SMALL_RAD else sin(0.5 * angle) / angle
    return Transform((x, y, z), (share * a, share * b, share * c, cos(0.5 * angle)))


def pose_of_roll_pitch_yaw(position: Vector, turn: Sequence[float]) -> Transform:
    """Return the pose of turns [rad] about x, then y, then z of the base frame, as in UFACTORY robots."""
    roll, pitch, yaw = (0.5 * float(angle) for angle in turn)
    about_x = (sin(roll), 0.0, 0.0, cos(roll))
    about_y = (0.0, sin(pitch), 0.0, cos(pitch))
    about_z = (0.0, 0.0, sin(yaw), cos(yaw))
    return Transform(position, multiply(about_z, multiply(about_y, about_x)))


def moved_wrench(wrench: Sequence[float], about: Vector, place: Vector) -> list[float]:
    """Return a wrench (6,) about one point as a wrench about another; all in one frame."""
    fx, fy, fz, mx, my, mz = map(float, wrench)
    x, y, z = about[0] - place[0], about[1] - place[1], about[2] - place[2]
    return [fx, fy, fz, mx + y * fz - z * fy, my + z * fx - x * fz, mz + x * fy - y * fx]


def nearest(orientation: Quaternion, last: Quaternion) -> Quaternion:
    """Return the same rotation with the sign nearer to the last one."""
    x, y, z, w = orientation
    along = x * last[0] + y * last[1] + z * last[2] + w * last[3]
    return orientation if along >= 0.0 else (-x, -y, -z, -w)
