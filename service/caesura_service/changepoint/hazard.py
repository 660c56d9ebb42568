"""Priors of segment length, as the two functions that the recursions need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, gammaln

Array = NDArray[np.float64]


class Hazard(Protocol):
    """A prior of segment lengths: g, the probability of a length, and S, of a greater one."""

    @property
    def residual(self) -> Hazard:
        """Return the prior of the remaining length of a segment that began before the first observation."""

    def log_mass(self, n: NDArray[np.int64]) -> Array:
        """Return log g(n): the segment has exactly n ≥ 1 samples."""

    def log_survival(self, n: NDArray[np.int64]) -> Array:
        """Return log S(n): the segment has more than n ≥ 0 samples."""


def log_mass(hazard: Hazard, n: NDArray[np.int64], opens: NDArray[np.bool_]) -> Array:
    """Return log g(n) of each segment; of its residual length if it opens a recording or follows a gap."""
    mass: Array = hazard.log_mass(n)
    return np.where(opens, hazard.residual.log_mass(n), mass) if opens.any() else mass


def log_survival(hazard: Hazard, n: NDArray[np.int64], opens: NDArray[np.bool_]) -> Array:
    """Return log S(n) of each segment; of its residual length if it opens a recording or follows a gap."""
    survival: Array = hazard.log_survival(n)
    return np.where(opens, hazard.residual.log_survival(n), survival) if opens.any() else survival


@dataclass(frozen=True)
class Geometric:
    """Constant hazard: at every sample the segment ends with probability 1/mean_samples. Thesis (2.24)."""

    mean_samples: float

    def __post_init__(self) -> None:
        if not self.mean_samples > 1.0:
            raise ValueError(f"mean segment length is {self.mean_samples} samples, expected more than 1")

    @property
    def residual(self) -> Geometric:
        """Return the same prior: a constant hazard has no memory."""
        return self

    def log_mass(self, n: NDArray[np.int64]) -> Array:
        """log g(n) = log H + (n − 1) log(1 − H)."""
        mass: Array = -np.log(self.mean_samples) + (n - 1) * np.log1p(-1.0 / self.mean_samples)
        return mass

    def log_survival(self, n: NDArray[np.int64]) -> Array:
        """log S(n) = n log(1 − H)."""
        survival: Array = n * np.log1p(-1.0 / self.mean_samples)
        return survival


@dataclass(frozen=True)
class Refractory:
    """Constant hazard 1/mean_samples, but a `share` of that for the first `early` samples of a segment.

    No person makes two movements within one submovement of 0.2 to 0.3 s; an apparent pair is one. `single` is
    the share after the first sample, None for `share`: no action of a hand lasts one observation of 0.1 s. It
    is above 0, because an operator may set two changepoints that are so close.
    """

    mean_samples: float
    early: int
    share: float = 0.05
    single: float | None = None

    def __post_init__(self) -> None:
        single = self.share if self.single is None else self.single
        if not self.mean_samples > 1.0:
            raise ValueError(f"mean_samples is {self.mean_samples}, expected above 1")
        if not self.early >= 0:
            raise ValueError(f"early is {self.early} samples, expected at least 0")
        if not 0.0 < self.share <= 1.0:
            raise ValueError(f"share is {self.share}, expected above 0 and at most 1")
        if not 0.0 < single <= self.share:
            raise ValueError(f"single is {single}, expected above 0 and at most share, which is {self.share}")

    @property
    def residual(self) -> Geometric:
        """Return the prior g(early + n) / S(early): a segment in progress has passed its early samples."""
        return Geometric(self.mean_samples)

    @property
    def _shares(self) -> Array:
        """(early + 1,) share of the constant hazard after each of the first `early` samples, and later."""
        shares = np.full(self.early + 1, self.share)
        if self.single is not None:
            shares[0] = self.single
        shares[-1] = 1.0
        return shares

    def log_mass(self, n: NDArray[np.int64]) -> Array:
        """Log g(n) = log S(n − 1) + log h(n)."""
        n = np.asarray(n)
        share = self._shares[np.minimum(n - 1, self.early)]
        mass: Array = self.log_survival(n - 1) + np.log(share) - np.log(self.mean_samples)
        return mass

    def log_survival(self, n: NDArray[np.int64]) -> Array:
        """Log S(n) = Σ log(1 − h) over samples 1 to n."""
        lasts = np.log1p(-self._shares / self.mean_samples)
        young = np.concatenate([[0.0], np.cumsum(lasts[:-1])])
        survival: Array = young[np.minimum(n, self.early)] + np.maximum(n - self.early, 0) * lasts[-1]
        return survival


@dataclass(frozen=True)
class Tempered:
    """The power of another prior, for sums over segmentations (`SegmentModelSet.power`); not normalised."""

    prior: Hazard
    power: float

    @property
    def residual(self) -> Tempered:
        """The residual prior, to the same power."""
        return Tempered(self.prior.residual, self.power)

    def log_mass(self, n: NDArray[np.int64]) -> Array:
        """Return power · log g(n)."""
        mass: Array = self.power * self.prior.log_mass(n)
        return mass

    def log_survival(self, n: NDArray[np.int64]) -> Array:
        """Return power · log S(n)."""
        survival: Array = self.power * self.prior.log_survival(n)
        return survival


@dataclass(frozen=True)
class Uniform:
    """Every length from 1 to `longest` samples has the same probability.

    Thesis (2.9), whose exponent is wrong.
    """

    longest: int

    def __post_init__(self) -> None:
        if self.longest < 1:
            raise ValueError(f"longest segment is {self.longest} samples, expected at least 1")

    @property
    def residual(self) -> Uniform:
        """Return the same prior: in the thesis the first segment begins with the recording."""
        return self

    def log_mass(self, n: NDArray[np.int64]) -> Array:
        """Log g(n) = −log n_max up to n_max, −inf beyond."""
        return np.where(np.asarray(n) <= self.longest, -np.log(self.longest), -np.inf)

    def log_survival(self, n: NDArray[np.int64]) -> Array:
        """Log S(n) = log(1 − n/n_max)."""
        with np.errstate(divide="ignore"):
            survival: Array = np.log(np.maximum(1.0 - np.asarray(n) / self.longest, 0.0))
        return survival


@dataclass(frozen=True)
class NegativeBinomial:
    """Lengths about a mean, with a mode above 1: a movement has a typical duration. Fearnhead 2006.

    n − 1 is negative binomial with `shape` successes; shape 1 is geometric, a larger one is more regular.
    """

    mean_samples: float
    shape: float = 2.0

    def __post_init__(self) -> None:
        if not (self.mean_samples > 1.0 and self.shape > 0.0):
            raise ValueError(
                f"mean is {self.mean_samples} samples and shape {self.shape}, expected above 1 and above 0"
            )

    @property
    def residual(self) -> NegativeBinomial:
        """Return the same prior, as for `Uniform`."""
        return self

    @property
    def _success(self) -> float:
        return self.shape / (self.shape + self.mean_samples - 1.0)

    def log_mass(self, n: NDArray[np.int64]) -> Array:
        """Return log g(n)."""
        failures, shape, success = np.asarray(n) - 1.0, self.shape, self._success
        ways = gammaln(failures + shape) - gammaln(failures + 1.0) - gammaln(shape)
        mass: Array = ways + shape * np.log(success) + failures * np.log1p(-success)
        return mass

    def log_survival(self, n: NDArray[np.int64]) -> Array:
        """Log S(n): n failures before the successes (`scipy.stats` takes half a second to load)."""
        n = np.asarray(n)
        with np.errstate(divide="ignore"):
            survival: Array = np.log(betainc(np.maximum(n, 1), self.shape, 1.0 - self._success))
        return np.where(n > 0, survival, 0.0)
