"""Operations on rows of vectors and quaternions (x y z w).

A row's result does not depend, to the last bit, on its neighbours in memory. So results do not depend on the
division of rows into batches.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def normalised(quaternions: Array) -> Array:
    """Return quaternions (n, 4) scaled to unit length."""
    return quaternions / lengths(quaternions)[:, None]


def length(vector: Array) -> float:
    """Return the length of a vector (c,)."""
    return math.sqrt(vector @ vector)


def lengths(vectors: Array) -> Array:
    """Return the length (n,) of each row (n, c)."""
    norms: Array = np.sqrt(np.vecdot(vectors, vectors))
    return norms


def make_sign_continuous(quaternions: Array) -> None:
    """Negate rows (n, 4) after the first, so that successive ones have dot products >= 0.

    q and -q are the same rotation.
    """
    turned = np.vecdot(quaternions[1:], quaternions[:-1]) < 0.0
    if np.count_nonzero(turned):
        quaternions[1:] *= np.where(turned, -1.0, 1.0).cumprod()[:, None]


def rotated(quaternions: Array, vectors: Array) -> Array:
    """Return vectors (n, 3) rotated by unit quaternions (n, 4): v + 2w (u × v) + 2u × (u × v)."""
    axis, w = quaternions[:, :3], quaternions[:, 3:]
    turned = 2.0 * _cross(axis, vectors)
    return vectors + w * turned + _cross(axis, turned)


def rotation_between(before: Array, after: Array) -> Array:
    """Return the rotation vector (3,) [rad] from one orientation to another, base frame, at most a half turn.

    Unit quaternions (4,) x y z w, frame to base. The logarithm of after · before⁻¹ (Solà 2017, section 2.4);
    it does not depend on the frame's orientation in the tool.
    """
    ax, ay, az, aw = after.tolist()
    bx, by, bz, bw = before.tolist()
    x = aw * -bx + ax * bw + ay * -bz - az * -by
    y = aw * -by - ax * -bz + ay * bw + az * -bx
    z = aw * -bz + ax * -by - ay * -bx + az * bw
    w = aw * bw + ax * bx + ay * by + az * bz
    sine = math.sqrt(x * x + y * y + z * z)
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 0.0 else 2.0
    return np.array([scale * x, scale * y, scale * z])


def _cross(a: Array, b: Array) -> Array:
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
