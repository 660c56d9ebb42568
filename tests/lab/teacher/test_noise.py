from __future__ import annotations

import numpy as np
import pytest

from caesura_lab.teacher.noise import band_noise, ornstein_uhlenbeck

N, RATE = 100_000, 1000.0


@pytest.mark.parametrize("hertz", [(8.0, 12.0), (1.5, 6.0), (0.0, 15.0)])
def test_band_noise_has_unit_variance_and_its_power_in_the_band(hertz: tuple[float, float]) -> None:
    noise = band_noise(N, 3, hertz, RATE, np.random.default_rng(0))
    power = np.sum(np.abs(np.fft.rfft(noise, axis=0)) ** 2, axis=1)
    f = np.fft.rfftfreq(N, 1 / RATE)
    assert noise.std() == pytest.approx(1.0, rel=0.1)
    assert power[(f >= hertz[0]) & (f <= hertz[1])].sum() > 0.75 * power.sum()


def test_wandering_starts_at_0_and_forgets_in_its_time() -> None:
    wander = ornstein_uhlenbeck(N, 20, 0.8, RATE, np.random.default_rng(0))
    settled = wander[5000:]
    later = np.mean(settled[:-800] * settled[800:]) / np.mean(settled**2)
    assert np.abs(wander[0]).max() < 0.2
    assert settled.std() == pytest.approx(1.0, rel=0.15)
    assert later == pytest.approx(np.exp(-1.0), abs=0.1)
