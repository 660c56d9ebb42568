"""Random demonstrations: pieces of anything that a stream may bring, joined anyhow."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from caesura_service.changepoint.channel_model import ModelInput


def pieces(rng: np.random.Generator, n: int) -> Iterator[tuple[ModelInput, bool]]:
    """n observations, each with whether it follows a gap: rests, moves, pushes, loads, jumps and noise."""
    position, force, holding = rng.normal(0, 0.3, 3), np.zeros(3), rng.choice([0.0, 1.0, np.nan])
    left, velocity, change, noise = 0, np.zeros(3), np.zeros(3), (1e-4, 0.1)
    rotation, rate, torsion = np.zeros(3), np.zeros(3), 0.0
    twisting = np.random.default_rng(n)
    for _ in range(n):
        if left == 0:
            left = int(rng.integers(1, 25))
            velocity = rng.choice([0.0, 0.002, 0.03]) * rng.normal(size=3)
            rate = rng.choice([0.0, 0.02, 0.3]) * rng.normal(size=3)
            change = rng.choice([0.0, 0.0, 0.3]) * rng.normal(size=3)
            noise = rng.choice([1e-5, 1e-3, 1e-2]), rng.choice([0.05, 0.5])
            force = force + rng.choice([0.0, 0.0, 5.0]) * rng.normal(size=3)
            holding = rng.choice([holding, 0.0, 1.0, np.nan])
            torsion = 0.1 * twisting.choice([0.0, 1.0]) * twisting.normal()
            rate = 0.2 * force / max(np.linalg.norm(force), 1.0) if twisting.random() < 0.2 else rate
        left -= 1
        position, force, rotation = position + velocity, force + change, rotation + rate
        seen = position + rng.normal(0, noise[0], 3), force + rng.normal(0, noise[1], 3)
        yield (
            ModelInput(*seen, float(holding), rotation + rng.normal(0, noise[0], 3), torsion * seen[1]),
            bool(rng.random() < 0.02),
        )
