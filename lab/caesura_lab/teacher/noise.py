"""Coloured noise of unit variance, drawn at once with one row per tick: tremor, unrest, drift."""

from __future__ import annotations

import numpy as np

from caesura_lab.teacher.motion_profiles import Array

BUTTERWORTH_2 = 1.11  # noise bandwidth of a second order filter over its nominal bandwidth


def band_noise(
    n: int, width: int, hertz: tuple[float, float], rate_hz: float, rng: np.random.Generator
) -> Array:
    """Return noise (n, width) between two frequencies, or below the second if the first is 0."""
    from scipy.signal import butter, sosfilt  # noqa: PLC0415 - `--speed optimal` would wait for it

    low, high = hertz
    if low > 0.0:
        sos = butter(2, hertz, btype="bandpass", fs=rate_hz, output="sos")
    else:
        sos = butter(2, high, btype="lowpass", fs=rate_hz, output="sos")
    noise: Array = sosfilt(sos, rng.normal(size=(n, width)), axis=0)
    noise *= np.sqrt(rate_hz / (2.0 * BUTTERWORTH_2 * (high - low)))
    return noise


def ornstein_uhlenbeck(n: int, width: int, seconds: float, rate_hz: float, rng: np.random.Generator) -> Array:
    """Return an Ornstein-Uhlenbeck process (n, width) with a time constant of `seconds`, from 0."""
    from scipy.signal import sosfilt  # noqa: PLC0415 - as above

    keep = np.exp(-1.0 / (rate_hz * seconds))
    drive = np.sqrt(1.0 - keep**2) * rng.normal(size=(n, width))
    wander: Array = sosfilt(np.array([[1.0, 0.0, 0.0, 1.0, -keep, 0.0]]), drive, axis=0)
    return wander
