"""Priors of segment length: what is not over yet is what has not ended."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import nbinom

from caesura_service.changepoint.hazard import Geometric, Hazard, NegativeBinomial, Refractory, Uniform

HAZARDS = [
    Geometric(20.0),
    Refractory(20.0, 2),
    Refractory(20.0, 4, single=1e-4),
    Uniform(50),
    NegativeBinomial(20.0),
    NegativeBinomial(8.0, 3.5),
]


@pytest.mark.parametrize("hazard", HAZARDS, ids=repr)
def test_survival_is_what_the_masses_leave(hazard: Hazard) -> None:
    n = np.arange(1, 50)
    ended = np.cumsum(np.exp(hazard.log_mass(n)))
    np.testing.assert_allclose(np.exp(hazard.log_survival(n)), 1.0 - ended, atol=1e-12)
    assert hazard.log_survival(np.array([0]))[0] == 0.0


def test_the_residual_life_is_that_of_a_segment_whose_early_samples_are_over() -> None:
    hazard, n = Refractory(20.0, 3), np.arange(1, 50)
    lasted = hazard.log_survival(np.array(3))
    np.testing.assert_allclose(hazard.residual.log_mass(n), hazard.log_mass(n + 3) - lasted, rtol=1e-12)
    np.testing.assert_allclose(hazard.residual.log_survival(n), hazard.log_survival(n + 3) - lasted)


def test_a_share_after_one_sample_makes_only_that_length_less_likely() -> None:
    n = np.arange(1, 50)
    with_it, without = (np.exp(Refractory(20.0, 4, 0.05, single).log_mass(n)) for single in (1e-4, None))
    assert with_it[0] == pytest.approx(1e-4 / 20.0)
    assert without[0] == pytest.approx(0.05 / 20.0)
    np.testing.assert_allclose(with_it[1:] / without[1:], (1.0 - 1e-4 / 20.0) / (1.0 - 0.05 / 20.0))


@pytest.mark.parametrize("single", [0.0, -1e-4, 0.06])
def test_a_share_after_one_sample_is_above_0_and_at_most_the_share(single: float) -> None:
    with pytest.raises(
        ValueError, match=f"single is {single}, expected above 0 and at most share, which is 0.05"
    ):
        Refractory(20.0, 4, 0.05, single)


@pytest.mark.parametrize(("mean", "shape"), [(20.0, 2.0), (8.0, 1.0), (15.0, 3.7)])
def test_negative_binomial_is_scipys(mean: float, shape: float) -> None:
    hazard, n = NegativeBinomial(mean, shape), np.arange(1, 300)
    success = shape / (shape + mean - 1.0)
    np.testing.assert_allclose(hazard.log_mass(n), nbinom.logpmf(n - 1, shape, success), rtol=1e-12)
    np.testing.assert_allclose(hazard.log_survival(n), nbinom.logsf(n - 1, shape, success), rtol=1e-10)
