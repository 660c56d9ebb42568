"""Savitzky–Golay filter with a delay: a polynomial fitted to the last rows, evaluated at their centre.

Evaluation at the centre keeps the phase linear and causes a delay of half a window, which is stated. Each
filtered row has the time that it describes, so boundaries are late but not shifted. Taps are summed in a
fixed order, so a filtered row has the same bits in every batch. Savitzky & Golay 1964; the taps are those of
`scipy.signal.savgol_coeffs`, which takes a second to load.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SavitzkyGolay:
    """A filter of `window` rows (odd) at rate_hz, exact for polynomials up to `order`.

    Raises ValueError for an invalid window or order.
    """

    window: int
    order: int
    rate_hz: float

    def __post_init__(self) -> None:
        if self.window < 3 or self.window % 2 == 0:
            raise ValueError(f"Savitzky-Golay window is {self.window}, expected an odd number from 3 on")
        if not 1 <= self.order < self.window:
            limit = f"1 to {self.window - 1} for a window of {self.window}"
            raise ValueError(f"Savitzky-Golay order is {self.order}, expected {limit}")

    @property
    def half(self) -> int:
        """The number of rows on either side of the centre."""
        return self.window // 2

    @property
    def delay_s(self) -> float:
        """The time [s] from the row that a filtered value describes to the row that completes its window."""
        return self.half / self.rate_hz

    def tail(self, rows: Array) -> Array:
        """Return the last rows that later ones still need, at most window - 1."""
        return rows[max(0, len(rows) - (self.window - 1)) :].copy()

    @cached_property
    def taps(self) -> Array:
        """Weights (2, window) of the rows in the polynomial's value and slope [unit/s] at the centre."""
        offsets = np.arange(-self.half, self.half + 1, dtype=np.float64)
        powers = np.vander(offsets, self.order + 1, increasing=True).T
        wanted = np.zeros((self.order + 1, 2))
        wanted[0, 0], wanted[1, 1] = 1.0, self.rate_hz
        return np.array(np.linalg.lstsq(powers, wanted, rcond=None)[0].T, dtype=np.float64, order="C")
