"""Priors of segment length, as the two functions that the recursions need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Hazard(Protocol):
    """g, the probability of a length, and S, the probability of lasting beyond some samples."""

    def log_mass(self, n: NDArray[np.int64]) -> Array:
        """log g(n): the segment has exactly n ≥ 1 samples."""

    def log_survival(self, n: NDArray[np.int64]) -> Array:
        """log S(n): the segment has more than n ≥ 0 samples."""


@dataclass(frozen=True)
class Geometric:
    """Constant hazard: at every sample the segment ends with probability 1/mean_samples. Thesis (2.24)."""

    mean_samples: float

    def __post_init__(self) -> None:
        if not self.mean_samples > 1.0:
            raise ValueError(f"mean segment length is {self.mean_samples} samples, expected more than 1")

    def log_mass(self, n: NDArray[np.int64]) -> Array:
        """log g(n) = log H + (n − 1) log(1 − H)."""
        mass: Array = -np.log(self.mean_samples) + (n - 1) * np.log1p(-1.0 / self.mean_samples)
        return mass

    def log_survival(self, n: NDArray[np.int64]) -> Array:
        """log S(n) = n log(1 − H)."""
        survival: Array = n * np.log1p(-1.0 / self.mean_samples)
        return survival
