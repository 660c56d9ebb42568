"""Bayesian online changepoint detection with a Gaussian of unknown mean and covariance in every segment.

Adams & MacKay 2007 with the normal-inverse-Wishart prior of Murphy 2007, section 9. In one dimension that is
the normal-gamma prior, and the predictive is a Student t. The most probable segmentation comes from the same
recursion with maximum in place of sum (Fearnhead & Liu 2007, section 3.1). Step t sees observations up to t.

1. log p(x_s..x_t | one segment) for every start s, from running sums.
2. log joint(s, t): growth of every start, and a new start from all that are long enough.
3. The same with maximum, and for every start the start before it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_lab.evaluation.baselines.chosen_settings import (
    GAUSSIAN,
    STUDENT,
    GaussianSettings,
    StudentSettings,
)
from caesura_lab.evaluation.baselines.conditioned_signals import Signals
from caesura_lab.evaluation.baselines.features import log_features
from caesura_lab.evaluation.baselines.simple_baselines import CONTACT_N, MOVING_M_PER_S

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class NormalInverseWishart:
    """Prior of a segment's mean and covariance.

    mean: (d,); mean_weight: in observations, > 0; degrees: of freedom, above d − 1; spread: (d,) standard
    deviations that `degrees` observations would have had.
    """

    mean: tuple[float, ...]
    mean_weight: float
    degrees: float
    spread: tuple[float, ...]


class SegmentEvidence:
    """Log evidence of every segment that ends at an observation, from running sums; Murphy 2007, (266)."""

    def __init__(self, rows: Array, prior: NormalInverseWishart) -> None:
        """rows: (n, d)."""
        from scipy.special import multigammaln  # noqa: PLC0415 - every command would wait for it

        n, width = rows.shape
        # About the prior's mean, and with their products, so that a segment is a difference of two columns.
        centred = (rows - np.array(prior.mean)).T
        self._pairs = [(i, j) for i in range(width) for j in range(i, width)]
        self._sums = _running(centred)
        self._products = _running(np.array([centred[i] * centred[j] for i, j in self._pairs]))
        self._scatter = prior.degrees * np.square(prior.spread)
        counts = np.arange(n + 1)[::-1]  # as starts go: the earliest has most observations
        self._weights = prior.mean_weight + counts
        self._half_degrees = 0.5 * (prior.degrees + counts)
        self._of_count = (
            -0.5 * counts * width * np.log(np.pi)
            + multigammaln(self._half_degrees, width)
            - multigammaln(0.5 * prior.degrees, width)
            + 0.5 * prior.degrees * np.log(self._scatter).sum()
            + 0.5 * width * np.log(prior.mean_weight / self._weights)
        )

    def ending_at(self, t: int) -> Array:
        """Return log p(x_s … x_t) of one segment for every start s = 0 … t, (t + 1,)."""
        by_count = slice(-t - 2, -1)
        sums = self._sums[:, t + 1 : t + 2] - self._sums[:, : t + 1]
        products = self._products[:, t + 1 : t + 2] - self._products[:, : t + 1]
        entries = {
            (i, j): product - sums[i] * sums[j] / self._weights[by_count] + (i == j) * self._scatter[i]
            for (i, j), product in zip(self._pairs, products, strict=True)
        }
        evidence: Array = self._of_count[by_count] - self._half_degrees[by_count] * _log_det(entries)
        return evidence


def _running(rows: Array) -> Array:
    """Return sums over the first 0, 1 … n columns, (d, n + 1)."""
    return np.concatenate([np.zeros((len(rows), 1)), np.cumsum(rows, axis=1)], axis=1)


def _log_det(entries: Mapping[tuple[int, int], Array]) -> Array:
    """Return log determinants of positive definite matrices; entries: (i, j) → (k,), the upper triangle.

    By Cholesky's recursion, entry by entry for all k at once.
    """
    width = max(j for _, j in entries) + 1
    left = dict(entries)
    total = np.zeros_like(left[0, 0])
    for pivot in range(width):
        total = total + np.log(left[pivot, pivot])
        for i in range(pivot + 1, width):
            for j in range(i, width):
                left[i, j] = left[i, j] - left[pivot, i] * left[pivot, j] / left[pivot, pivot]
    return total


@dataclass(frozen=True)
class DetectionResult:
    """Result of a detection in n observations.

    log_joint: (n,) log p(x, the last segment starts at s) at the end; log_evidence: of all observations;
    starts: (k,) observations that begin a segment of the most probable segmentation, the first (0) left out.
    """

    log_joint: Array
    log_evidence: float
    starts: Indices


def detect(rows: Array, prior: NormalInverseWishart, mean_segment: float, least: int = 1) -> DetectionResult:
    """Detect changepoints in rows (n, d).

    mean_segment: in observations, more than `least`; least: observations of every segment but the last. A
    segment goes on for certain up to `least`, then ends at every observation with the same probability.
    Raises ValueError where no such probability gives that mean.
    """
    if not mean_segment > least:
        raise ValueError(f"mean segment is {mean_segment:g} observations, expected more than {least}")
    n = len(rows)
    evidence = SegmentEvidence(rows, prior)
    hazard = 1.0 / (mean_segment - least + 1)
    survival = np.maximum(np.arange(n, 0, -1) - least, 0) * np.log1p(-hazard)  # as starts go
    summed = np.full(n, -np.inf)  # log p(all observations before s, and that a segment starts at s)
    best = np.full(n, -np.inf)  # the same, for the most probable segmentation of what lies before
    parent = np.zeros(n, dtype=np.intp)
    summed[0] = best[0] = 0.0
    for t in range(n):
        ending = evidence.ending_at(t) + survival[n - 1 - t :]
        long_enough = t + 2 - least
        if t + 1 < n and long_enough > 0:
            paths = best[:long_enough] + ending[:long_enough]
            parent[t + 1] = paths.argmax()
            best[t + 1] = np.log(hazard) + paths[parent[t + 1]]
            summed[t + 1] = np.log(hazard) + _log_sum(summed[:long_enough] + ending[:long_enough])
    log_joint = summed + ending
    last = int((best + ending).argmax())
    return DetectionResult(log_joint, _log_sum(log_joint), _followed(parent, last))


def _log_sum(values: Array) -> float:
    """Return the logarithm of the sum of exponentials; −inf where all are."""
    largest = float(values.max())
    return largest if largest == -np.inf else largest + float(np.log(np.exp(values - largest).sum()))


def _followed(parent: Indices, last: int) -> Indices:
    """Return all starts from the last one back to the first, in order, without the first (0)."""
    starts = []
    while last > 0:
        starts.append(last)
        last = int(parent[last])
    return np.array(starts[::-1], dtype=np.intp)


def gaussian_log(signals: Signals, settings: GaussianSettings = GAUSSIAN) -> Indices:
    """Detect segments in log speed and, if the force shows a contact, log force.

    Returns (k,) rows of the signals that begin a segment, without row 0. The prior's mean is the annotators'
    threshold: a segment is as likely above it as below it. Raises ValueError as `detect`.
    """
    rows = log_features(signals, settings.floor_m_per_s, settings.floor_n)
    means = (np.log(MOVING_M_PER_S + settings.floor_m_per_s), np.log(CONTACT_N + settings.floor_n))
    spreads = (settings.speed_spread, settings.force_spread)
    width = rows.shape[1]
    degrees = settings.degrees + width - 1  # as many for each channel, whether there are one or two
    prior = NormalInverseWishart(means[:width], settings.mean_weight, degrees, spreads[:width])
    return _starts(signals, rows, prior, settings)


def student_speed(signals: Signals, settings: StudentSettings = STUDENT) -> Indices:
    """Detect segments in the speed alone. Prior mean, return value and error are those of `gaussian_log`."""
    unit = settings.unit_m_per_s
    if settings.scale == "log":
        rows, mean = log_features(signals, unit, 1.0)[:, :1], float(np.log(MOVING_M_PER_S + unit))
    else:
        rows, mean = signals.speed[:, None] / unit, MOVING_M_PER_S / unit
    prior = NormalInverseWishart((mean,), settings.mean_weight, settings.degrees, (settings.spread,))
    return _starts(signals, rows, prior, settings)


def _starts(
    signals: Signals, rows: Array, prior: NormalInverseWishart, settings: GaussianSettings | StudentSettings
) -> Indices:
    step_s = float(np.median(np.diff(signals.t)))
    least = max(round(settings.least_s / step_s), 1)
    return detect(rows, prior, settings.mean_segment_s / step_s, least).starts
