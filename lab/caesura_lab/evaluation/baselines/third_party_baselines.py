"""Baselines from libraries of changepoint detection; they need the extra `judge`."""

from __future__ import annotations

import changepoint
import numpy as np
import ruptures
from numpy.typing import NDArray
from ruptures.base import BaseCost

from caesura_lab.evaluation.baselines.chosen_settings import KERNEL, KernelSettings
from caesura_lab.evaluation.baselines.conditioned_signals import Signals
from caesura_lab.evaluation.baselines.features import log_features, vector_features

Array = NDArray[np.float64]
# What a hand at rest and a sensor in use leave unexplained: nothing smaller is distinguished.
POSITION_M, FORCE_N = 0.0007, 0.5
SPEED_M_PER_S = 0.010  # the annotators' rest
MEAN_SEGMENT_S = 2.0  # as our own hazard
LEAST_OBSERVATIONS = 3  # 0.3 s, the annotators' shortest rest


class PiecewiseLinear(BaseCost):  # type: ignore[misc]
    """-2 log likelihood of straight lines with a Gaussian noise of its own for each segment and channel.

    From running sums, so that a cost takes constant time; noise below `floor` is not distinguished. signal:
    (n, channels), in units of the floor.
    """

    model = "linear"
    min_size = LEAST_OBSERVATIONS

    def fit(self, signal: Array) -> PiecewiseLinear:
        """Compute cumulative sums of 1, t, t², y, y², ty."""
        self.signal = signal - signal.mean(axis=0)
        time = np.arange(len(signal), dtype=float)[:, None]
        columns = (time, time**2, self.signal, self.signal**2, time * self.signal)
        self._sums = [np.vstack([np.zeros((1, c.shape[1])), np.cumsum(c, axis=0)]) for c in columns]
        return self

    def error(self, start: int, end: int) -> float:
        """Return the cost of observations start to end (exclusive)."""
        t, tt, y, yy, ty = (sums[end] - sums[start] for sums in self._sums)
        n = end - start
        spread = tt - t * t / n
        residual = yy - y * y / n - (ty - t * y / n) ** 2 / spread
        return float(n * np.log(np.maximum(residual, 0.0) / n + 1.0).sum())


def pelt(signals: Signals) -> NDArray[np.intp]:
    """Straight lines in position and force, PELT with the penalty of BIC.

    Killick, Fearnhead & Eckley 2012; Schwarz 1978: log n for each free number of a segment, which are
    intercept, slope and noise of each channel, and the place of its boundary.
    """
    channels = _scaled(signals, signals.position_base / POSITION_M)
    n, width = channels.shape
    if n < 2 * LEAST_OBSERVATIONS:
        return np.array([], dtype=np.intp)
    penalty = (3 * width + 1) * np.log(n)
    detector = ruptures.Pelt(custom_cost=PiecewiseLinear(), min_size=LEAST_OBSERVATIONS, jump=1)
    return np.array(detector.fit_predict(channels, penalty)[:-1], dtype=np.intp)


def gaussian_online(signals: Signals) -> NDArray[np.intp]:
    """Bayesian online changepoint detection on velocity and force with unknown mean and covariance.

    Adams & MacKay 2007 with the normal-inverse-Wishart prior of Murphy 2007, section 9: weakest degrees of
    freedom that have a mean, which is the floor's variance. Changepoints as the library decides them: the
    most probable run length at the end, then that at the observation before it, and so on.
    """
    channels = _scaled(signals, signals.velocity_base / SPEED_M_PER_S)
    width = channels.shape[1]
    prior = changepoint.NormalInvWishart(np.zeros(width), 0.01, width + 2, np.eye(width))
    mean_segment = MEAN_SEGMENT_S / float(np.median(np.diff(signals.t)))
    detector = changepoint.Bocpd(prior, mean_segment)
    run_lengths = [detector.step(row) for row in channels]
    # The library names the last observation before each change; the first entry is the recording's beginning.
    last_before = np.array(changepoint.map_changepoints(run_lengths)[1:], dtype=np.intp)
    return last_before + 1


def kernel(signals: Signals, settings: KernelSettings = KERNEL) -> NDArray[np.intp]:
    """Kernel changepoint detection with a Gaussian kernel, and a penalty for each changepoint.

    Arlot, Celisse & Harchaoui 2019; Garreau & Arlot 2018: the penalty grows with log n.
    """
    features = log_features if settings.signals == "log" else vector_features
    rows = features(signals, settings.floor_m_per_s, settings.floor_n)
    least = max(round(settings.least_s / float(np.median(np.diff(signals.t)))), 1)
    if len(rows) < 2 * least:
        return np.array([], dtype=np.intp)
    gamma = {} if settings.gamma is None else {"gamma": settings.gamma}
    detector = ruptures.KernelCPD(kernel="rbf", min_size=least, params=gamma)
    penalty = settings.penalty * np.log(len(rows))
    return np.array(detector.fit_predict(np.ascontiguousarray(rows), pen=penalty)[:-1], dtype=np.intp)


def _scaled(signals: Signals, motion: Array) -> Array:
    """Motion and, where it shows contact, force, (n, 3 or 6), in units of the smallest difference."""
    return np.hstack([motion, signals.force_base / FORCE_N]) if signals.force_shows_contact else motion
