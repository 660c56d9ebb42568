"""Medians of forces are those of NumPy, to the bit."""

from __future__ import annotations

import numpy as np

from caesura_service.program.program_segment import medians


def test_medians_are_those_of_numpy_to_the_bit():
    rng = np.random.default_rng(0)
    for count in range(1, 60):
        for digits in (0, 16):  # with equal forces, among them zeros of either sign
            forces = np.round(rng.standard_normal((count, 3)), digits)
            assert medians(forces).tobytes() == np.median(forces, axis=0).tobytes()
            assert medians(-forces).tobytes() == np.median(-forces, axis=0).tobytes()
