"""Priors of segment length: what is not over yet is what has not ended."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import nbinom

from caesura_service.changepoint.hazard import Geometric, Hazard, NegativeBinomial, Refractory, Uniform

HAZARDS = [
    Geometric(20.0),
    Refractory(20.0, 2),
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


@pytest.mark.parametrize(("mean", "shape"), [(20.0, 2.0), (8.0, 1.0), (15.0, 3.7)])
def test_negative_binomial_is_scipys(mean: float, shape: float) -> None:
    hazard, n = NegativeBinomial(mean, shape), np.arange(1, 300)
    success = shape / (shape + mean - 1.0)
    np.testing.assert_allclose(hazard.log_mass(n), nbinom.logpmf(n - 1, shape, success), rtol=1e-12)
    np.testing.assert_allclose(hazard.log_survival(n), nbinom.logsf(n - 1, shape, success), rtol=1e-10)
