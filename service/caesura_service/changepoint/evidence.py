"""Log marginal likelihoods of data under models whose parameters are integrated out.

All functions broadcast, so that one call evaluates all hypotheses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

Array = NDArray[np.float64]


def known_mean_log_evidence(n: ArrayLike, ssr: ArrayLike, nu0: float, scale2: ArrayLike) -> Array:
    """Return the log marginal likelihood of n values about a known mean, with the variance integrated out.

    n: number of values; ssr: their sum of squared residuals [unit²]; the variance has a scaled inverse
    chi-squared prior with nu0 degrees of freedom and scale scale2 [unit²]. Shapes broadcast. Thesis (3.31),
    (3.41) with their missing (2π)^(-n/2); Murphy 2007, section 5.
    """
    n, ssr, prior = np.asarray(n, float), np.asarray(ssr, float), nu0 * np.asarray(scale2, float)
    nu_n = nu0 + n
    gammas = gammaln(0.5 * nu_n) - gammaln(0.5 * nu0) - 0.5 * n * np.log(np.pi)
    result: Array = gammas + 0.5 * nu0 * np.log(prior) - 0.5 * nu_n * np.log(prior + ssr)
    return result


def normal_log_density(value2: ArrayLike, dimensions: int, scale2: float) -> Array:
    """Return the log density of an isotropic normal about 0; value2: squared length [unit²].

    scale2: variance.
    """
    density: Array = -0.5 * (np.asarray(value2, float) / scale2 + dimensions * np.log(2.0 * np.pi * scale2))
    return density


def student_log_density(value2: ArrayLike, dimensions: int, nu: float, scale: float) -> Array:
    """Return the log density of an isotropic Student t about 0 with nu degrees of freedom.

    value2: squared length [unit²]; scale: [unit].
    """
    half = 0.5 * (nu + dimensions)
    volume = 0.5 * dimensions * np.log(nu * np.pi) + dimensions * np.log(scale)
    constant = gammaln(half) - gammaln(0.5 * nu) - volume
    density: Array = constant - half * np.log1p(np.asarray(value2, float) / (nu * scale**2))
    return density


def log_mean_exp(values: Array, axis: int = -1) -> Array:
    """Return the logarithm of the mean of exp(values) over one axis: a mixture with equal weights."""
    count = values.shape[axis]
    result: Array = log_sum_exp(values, axis) - np.log(count)
    return result


def log_sum_exp(values: Array, axis: int = -1) -> Array:
    """Return the logarithm of the sum of exp(values) over one axis; -inf if every entry is."""
    # The reductions of the ufuncs themselves: np.max, np.sum and .all() take as long again over a few values.
    peak = np.maximum.reduce(values, axis=axis, keepdims=True, initial=-np.inf)
    finite = np.isfinite(peak)
    if np.logical_and.reduce(finite, axis=None):  # nearly always, and then two thirds of the time do
        return _log_sum_exp(values, peak, axis)
    with np.errstate(divide="ignore"):
        return _log_sum_exp(values, np.where(finite, peak, 0.0), axis)


def _log_sum_exp(values: Array, peak: Array, axis: int) -> Array:
    result: Array = np.log(np.add.reduce(np.exp(values - peak), axis=axis)) + peak.squeeze(axis)
    return result
