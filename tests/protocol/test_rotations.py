"""Rotations: what is computed without numpy's wrappers has the bits of numpy."""

from __future__ import annotations

import numpy as np

from caesura_protocol.rotations import cross


def test_the_cross_product_has_the_bits_of_numpy() -> None:
    pairs = (
        np.random.default_rng(0).standard_normal((200, 2, 3)) * 10.0 ** np.arange(-100, 100)[:, None, None]
    )
    pairs[0, 0] = 0.0
    for one, other in pairs:
        assert cross(one, other).tobytes() == np.cross(one, other).tobytes()
