"""Quaternions (x y z w) row by row, elementwise in a fixed order: a row's bits never depend on its neighbours
in memory, so results do not depend on how the rows were cut into batches.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def normalised(quaternions: Array) -> Array:
    """Quaternions (n, 4) at unit length."""
    return quaternions / np.sqrt(_dot(quaternions, quaternions))[:, None]


def sign_continuous(quaternions: Array, previous: Array | None) -> Array:
    """Put each row (n, 4) on the side of the row before it; q and -q are the same rotation.

    previous: (4,) the row before the first, as it came out of here; None where there is none.
    """
    if len(quaternions) == 0:
        return quaternions
    before = np.concatenate([quaternions[:1] if previous is None else previous[None], quaternions[:-1]])
    signs = np.where(_dot(quaternions, before) < 0.0, -1.0, 1.0)
    return quaternions * np.cumprod(signs)[:, None]


def rotated(quaternions: Array, vectors: Array) -> Array:
    """Vectors (n, 3) turned by unit quaternions (n, 4): v + 2w (u × v) + 2u × (u × v)."""
    axis, w = quaternions[:, :3], quaternions[:, 3:]
    turned = 2.0 * _cross(axis, vectors)
    return vectors + w * turned + _cross(axis, turned)


def _dot(a: Array, b: Array) -> Array:
    products = a * b
    total: Array = products[:, 0] + products[:, 1] + products[:, 2] + products[:, 3]
    return total


def _cross(a: Array, b: Array) -> Array:
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
