"""The pairs of rows and columns with the greatest total gain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.intp]


def best_pairs(gain: NDArray[np.float64]) -> tuple[Places, Places]:
    """Row and column of each pair, so that gain (n, m) adds up to most; min(n, m) pairs.

    scipy.optimize takes a quarter of a second to load, which every command would wait for.
    """
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415

    return linear_sum_assignment(gain, maximize=True)
