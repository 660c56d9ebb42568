"""A guided demonstration that needs no robot model: reach, press, lift away, carry nothing home."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_clients.recording import Recording

RATE_HZ = 200.0
# (seconds, target [m], force on the robot along z at its end [N])
STROKES = (
    (0.8, (0.30, 0.00, 0.40), 0.0),
    (1.2, (0.45, 0.10, 0.25), 0.0),
    (0.8, (0.45, 0.10, 0.25), 12.0),
    (0.6, (0.45, 0.10, 0.25), 0.0),
    (1.2, (0.35, -0.10, 0.40), 0.0),
    (0.8, (0.35, -0.10, 0.40), 0.0),
)


def guided(seed: int = 0) -> Recording:
    """Minimum-jerk strokes with a push in between, a hand's tremor and a sensor's noise."""
    rng = np.random.default_rng(seed)
    position, force = _strokes()
    t = np.arange(len(position)) / RATE_HZ
    tremor = 3e-4 * rng.standard_normal(position.shape)
    noise = 0.2 * rng.standard_normal(force.shape)
    return Recording(t=t, signals={"pos": position + tremor, "force": force + noise}, name=f"guided-{seed}")


def _strokes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    positions, forces = [], []
    at, push = np.array(STROKES[0][1]), 0.0
    for duration, target, level in STROKES:
        s = np.arange(round(duration * RATE_HZ)) / (duration * RATE_HZ)
        bell = (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]
        positions.append(at + bell * (np.array(target) - at))
        forces.append(np.column_stack([0 * s, 0 * s, push + bell[:, 0] * (level - push)]))
        at, push = np.array(target), level
    return np.concatenate(positions), np.concatenate(forces)
