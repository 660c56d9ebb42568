"""The likelihood of a guiding hand's errors, and its parameters, from steps that are known to have them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_t

from caesura_lab.evaluation.baselines.conditioned_signals import Signals
from caesura_lab.evaluation.studies.hand_noise_fit import BEGIN, END, HandNoise, best, movements
from caesura_lab.ground_truth import TrueChangepoint, Truth
from caesura_service.changepoint.default_presets import guided_motion

TRUE = HandNoise(floor=0.0008, share=0.06, correlation=0.8, nu=4.0)


def movement(rng: np.random.Generator, n: int = 80) -> np.ndarray:
    """Steps (n, 3) [m] of the model, of scale 1, about a speed of 0.1 m/s."""
    steps = [np.array([0.01, 0.0, 0.0])] * 2
    pull = np.array([0.01, 0.0, 0.0]) * (1.0 - TRUE.correlation) ** 2
    for _ in range(n):
        scale = np.sqrt(TRUE.floor**2 + TRUE.share**2 * steps[-1] @ steps[-1])
        error = scale * rng.standard_normal(3) / np.sqrt(rng.chisquare(TRUE.nu) / TRUE.nu)
        steps.append(pull + error + 2.0 * TRUE.correlation * steps[-1] - TRUE.correlation**2 * steps[-2])
    return np.array(steps)


def test_likelihood_is_that_of_student_t_steps_with_one_scale_a_movement() -> None:
    steps = movement(np.random.default_rng(1), 12)
    each = []
    for scale in guided_motion().scales:
        densities = 0.0
        for n in range(BEGIN, len(steps) - END):
            mean = 2.0 * TRUE.correlation * steps[n - 1] - TRUE.correlation**2 * steps[n - 2]
            variance = scale**2 * (TRUE.floor**2 + TRUE.share**2 * steps[n - 1] @ steps[n - 1])
            densities += multivariate_t(mean, variance * np.eye(3), df=TRUE.nu).logpdf(steps[n])
        each.append(densities)
    assert TRUE.log_likelihood(steps) == pytest.approx(np.log(np.mean(np.exp(each))), abs=1e-9)


def test_the_parameters_of_simulated_movements_are_found() -> None:
    rng = np.random.default_rng(2)
    steps = [movement(rng) for _ in range(40)]
    found = best(steps, replace(TRUE, floor=0.0004, share=0.1, correlation=0.7, nu=10.0))
    assert found.nu == pytest.approx(TRUE.nu, rel=0.15)
    assert found.correlation == pytest.approx(TRUE.correlation, abs=0.02)
    assert np.hypot(found.floor, 0.01 * found.share) == pytest.approx(0.001, rel=0.1)


def test_movements_lie_between_boundaries_and_rests_are_left_out() -> None:
    t = np.arange(0.0, 6.0, 0.1)
    speed = np.where((t > 1.0) & (t < 3.0), 0.1, 0.001)
    position = np.column_stack([np.cumsum(speed) * 0.1, np.zeros_like(t), np.zeros_like(t)])
    nothing = np.zeros((len(t), 3))
    signals = Signals(t, position, nothing, speed, nothing, np.zeros(len(t), bool), False, False)
    points = (
        TrueChangepoint(1.05, 0.1),
        TrueChangepoint(2.0, 0.1, optional=True),
        TrueChangepoint(2.95, 0.1),
    )
    (steps,) = movements(Truth("one", (0.0, 6.0), points), signals)
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), 0.01)
