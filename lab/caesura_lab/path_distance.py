"""The distance between two paths, independent of the time at which each position is passed."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from caesura_protocol.rotations import align_signs

Array = NDArray[np.float64]


def furthest(
    pairs: Iterable[tuple[Array, Array]], tolerance_m: float, tolerance_rad: float
) -> tuple[float, float]:
    """Return the largest distance [m] and angle [rad] from poses to the nearest ones of a line.

    pairs: of poses (n, 3 or 7) and line (m, …). The nearest pose has the least √(distance² + angle²), each
    divided by its tolerance. The angle is 0 without quaternions.
    """
    off_m, off_rad = zip(*(_off(*pair, tolerance_m, tolerance_rad) for pair in pairs), strict=True)
    return max(off_m), max(off_rad)


def _off(seen: Array, line: Array, tolerance_m: float, tolerance_rad: float) -> tuple[float, float]:
    poses = np.concatenate([line, seen])
    align_signs(poses[:, 3:])
    there, here = np.split(poses, [len(line)])
    scale = np.array([1.0 / tolerance_m] * 3 + [2.0 / tolerance_rad] * (poses.shape[1] - 3))
    off = here - there[cKDTree(there * scale).query(here * scale)[1]]
    half_chord = 0.5 * float(np.linalg.norm(off[:, 3:], axis=1).max())
    return float(np.linalg.norm(off[:, :3], axis=1).max()), 4.0 * math.asin(min(half_chord, 1.0))
