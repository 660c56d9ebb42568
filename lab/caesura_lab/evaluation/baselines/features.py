"""Features for general changepoint detectors: one row of numbers per observation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_lab.evaluation.baselines.conditioned_signals import Signals

Array = NDArray[np.float64]


def log_features(signals: Signals, floor_m_per_s: float, floor_n: float) -> Array:
    """Return log speed and, where force shows contact, the log of the force's magnitude, (n, 1 or 2).

    Values below the floors [m/s], [N] are not distinguished.
    """
    speed = np.log(signals.speed + floor_m_per_s)[:, None]
    if not signals.force_shows_contact:
        return speed
    force_n = np.linalg.norm(signals.force_base, axis=1)
    return np.column_stack([speed, np.log(force_n + floor_n)])


def vector_features(signals: Signals, unit_m_per_s: float, unit_n: float) -> Array:
    """Return velocity and, where it shows contact, force, in their units, (n, 3 or 6)."""
    velocity = signals.velocity_base / unit_m_per_s
    return np.hstack([velocity, signals.force_base / unit_n]) if signals.force_shows_contact else velocity
