"""The pairs of rows and columns with the greatest total gain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.intp]


def best_pairs(gain: NDArray[np.float64]) -> tuple[Places, Places]:
    """Return row and column of each of min(n, m) pairs with the greatest sum of gain (n, m).

    scipy.optimize takes a quarter of a second to load, which would delay every command.
    """
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415

    return linear_sum_assignment(gain, maximize=True)
