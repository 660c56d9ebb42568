"""Turns in place: the evidence of a fixed centre against quadrature, and that no frame changes it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.channel_model_checks import rows_after
from caesura_service.changepoint.turn_in_place import TurnInPlace, centre_of, rotation_matrix

MODEL = TurnInPlace(floor=0.002, share=0.01, reach=0.05, nu0=6.0)
CENTRE = np.array([0.42, -0.1, 0.33])


def turn(count: int = 5, seed: int = 0, noise: float = 0.001) -> list[ModelInput]:
    """A turn about `CENTRE`, from 3 cm beside it."""
    rng, rotation = np.random.default_rng(seed), np.zeros(3)
    position = CENTRE + np.array([0.03, 0.0, 0.01])
    observed = [ModelInput(position, np.zeros(3), np.nan, rotation)]
    for _ in range(count):
        step = rng.normal([0.0, 0.1, 0.05], 0.03)
        position = CENTRE + rotation_matrix(step) @ (position - CENTRE) + rng.normal(0, noise, 3)
        rotation = rotation + step
        observed.append(ModelInput(position, np.zeros(3), np.nan, rotation))
    return observed


def evidence(model: TurnInPlace, observed: list[ModelInput]) -> float:
    """Log evidence of all but the first observation as one segment."""
    return float(model.log_evidence(rows_after(model, observed))[1])


def test_evidence_is_the_integral_over_centre_and_variance() -> None:
    """Importance sampling of the centre about its least-squares value, and quadrature of the variance."""
    observed = turn()
    moved = np.diff([one.position for one in observed], axis=0)
    turned = np.diff([one.rotation for one in observed], axis=0)
    before = [one.position for one in observed[:-1]]
    angles2 = (turned**2).sum(axis=1)
    scale = np.sqrt(MODEL.floor**2 + MODEL.share**2 * angles2)
    ratio = (moved**2).sum(axis=1) / (MODEL.floor**2 + MODEL.reach**2 * angles2)
    near = float((-0.5 * ratio**2).sum())
    start = observed[0].position
    rng = np.random.default_rng(1)
    spread = 0.02
    centres = CENTRE + spread * rng.standard_normal((60_000, 3))
    proposal = stats.norm.logpdf(centres, CENTRE, spread).sum(axis=1)
    squares = np.zeros(len(centres))
    for step, vector, place, w in zip(moved, turned, before, scale, strict=True):
        error = step - (place - centres) @ (rotation_matrix(vector) - np.eye(3)).T
        squares += (error**2).sum(axis=1) / w**2
    n, log_scales = 3 * len(moved), 3 * float(np.log(scale).sum())

    def given(variance: float) -> float:
        likelihood = -0.5 * squares / variance - 0.5 * n * np.log(2 * np.pi * variance) - log_scales
        prior = stats.norm.logpdf(centres, start, MODEL.reach * np.sqrt(variance)).sum(axis=1)
        return float(np.mean(np.exp(likelihood + prior - proposal)))

    chi = stats.invgamma(0.5 * MODEL.nu0, scale=0.5 * MODEL.nu0)
    grid = np.geomspace(0.02, 30.0, 120)
    total = integrate.trapezoid([given(v) * chi.pdf(v) for v in grid], grid)
    assert evidence(MODEL, observed) - near == pytest.approx(np.log(total), abs=0.05)


@pytest.mark.parametrize("seed", [0, 1])
def test_neither_base_frame_nor_tool_frame_matters(seed: int) -> None:
    observed, base = turn(12, seed), rotation_matrix(np.array([0.3, -1.1, 0.7]))
    shift = np.array([0.2, -0.4, 0.1])
    moved = [
        one._replace(position=base @ one.position + shift, rotation=base @ one.rotation) for one in observed
    ]
    assert evidence(MODEL, moved) == pytest.approx(evidence(MODEL, observed), abs=1e-9)


def test_an_arc_about_a_far_centre_is_no_turn_in_place() -> None:
    near = turn(10, noise=0.0)
    far = [one._replace(position=CENTRE + 10.0 * (one.position - CENTRE)) for one in near]
    assert evidence(MODEL, far) < evidence(MODEL, near) - 100.0


def test_the_centre_lies_on_the_axis_where_the_turn_begins() -> None:
    observed = turn(0)
    first, steps = observed[0].position, [np.array([0.0, 0.0, 0.8]), np.array([0.0, 0.0, 1.6])]
    places = [first, *(CENTRE + rotation_matrix(step) @ (first - CENTRE) + [0, 0, 0.001] for step in steps)]
    found = centre_of(places, steps)
    assert found[:2] == pytest.approx(CENTRE[:2], abs=1e-6)
    assert found[2] == pytest.approx(first[2], abs=1e-6)
    assert centre_of([first, first, first], [np.zeros(3), np.zeros(3)]) == pytest.approx(first)
