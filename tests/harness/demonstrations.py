"""A guided demonstration that needs no robot model: reach, press, lift away, carry nothing home."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.recording import Recording

RATE_HZ = 200.0
Stroke = tuple[float, tuple[float, float, float], float]
# (seconds, target [m], force on the robot along z at its end [N])
STROKES: tuple[Stroke, ...] = (
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
    position, force = _strokes(STROKES)
    t = np.arange(len(position)) / RATE_HZ
    tremor = 3e-4 * rng.standard_normal(position.shape)
    noise = 0.2 * rng.standard_normal(force.shape)
    return Recording(
        t=t,
        signals={"pos": position + tremor, "force": force + noise},
        wrench_source="flange_sensor",
        name=f"guided-{seed}",
    )


def _strokes(strokes: Sequence[Stroke]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    positions, forces = [], []
    at, push = np.array(strokes[0][1]), 0.0
    for duration, target, level in strokes:
        s = np.arange(round(duration * RATE_HZ)) / (duration * RATE_HZ)
        bell = (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]
        positions.append(at + bell * (np.array(target) - at))
        forces.append(np.column_stack([0 * s, 0 * s, push + bell[:, 0] * (level - push)]))
        at, push = np.array(target), level
    return np.concatenate(positions), np.concatenate(forces)


def taught(seed: int, seconds: float) -> Recording:
    """As `guided`, for so long: rest, then strokes of random length to random places, some with a push."""
    rng = np.random.default_rng(seed)
    strokes, length = [(0.8, STROKES[0][1], 0.0)], 0.8
    while length < seconds:
        stroke_s = float(rng.uniform(0.6, 2.0))
        x, y, z = rng.uniform([0.3, -0.3, 0.1], [0.6, 0.3, 0.5]).tolist()
        target = strokes[-1][1] if rng.random() < 0.3 else (x, y, z)
        strokes.append((stroke_s, target, float(rng.choice([0.0, 0.0, 8.0, 14.0]))))
        length += stroke_s
    position, force = _strokes(strokes)
    count = round(seconds * RATE_HZ)
    tremor, noise = 3e-4 * rng.standard_normal((count, 3)), 0.2 * rng.standard_normal((count, 3))
    signals = {"pos": position[:count] + tremor, "force": force[:count] + noise}
    return Recording(
        t=np.arange(count) / RATE_HZ, signals=signals, wrench_source="flange_sensor", name=f"taught-{seed}"
    )
