"""The bias of an estimated wrench: against the mixture written out, and in a session without a hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_service.signals.wrench_estimate_bias import BiasState, BiasTracker
from harness.segmentations import segmented

TRACKER = BiasTracker(scale_n=1.5)
BUTTON = Path(__file__).parents[3] / "data" / "button.npz"
DRIFT_N = np.array([2.0, -1.5, 1.0])


def after(forces: np.ndarray, tracker: BiasTracker = TRACKER) -> BiasState:
    state = BiasState()
    for force in forces:
        state = tracker.advance(state, force)
    return state


def test_every_step_is_the_posterior_of_the_two_components_by_scipy() -> None:
    forces = np.random.default_rng(0).normal([1.0, -0.5, 2.0], 1.0, (30, 3))
    forces[10:15] += [0.0, 0.0, 15.0]
    weight, total, squares, state = 0.0, np.zeros(3), 0.0, BiasState()
    for force in forces:
        mean = 0.1 * total / (1.0 + 0.1 * weight)
        variance = min(max((10 * 1.5**2 + 0.1 * squares) / (10 + 0.3 * weight), 1.0), 25.0)
        got_mean, got_scale = TRACKER.estimate(state)
        np.testing.assert_allclose(got_mean, mean, rtol=1e-12)
        assert got_scale == pytest.approx(np.sqrt(variance), rel=1e-12)
        free = multivariate_normal(mean, variance * np.eye(3)).pdf(force)
        touched = multivariate_normal(np.zeros(3), 100.0 * np.eye(3)).pdf(force)
        share = free / (free + touched)
        weight, total, squares = (
            weight + share,
            total + share * force,
            squares + share * float((force - mean) @ (force - mean)),
        )
        state = TRACKER.advance(state, force)


def test_the_mean_follows_a_steady_bias_and_a_press_does_not_move_it() -> None:
    rng = np.random.default_rng(1)
    free = rng.normal(DRIFT_N, 0.4, (300, 3))
    mean, scale = TRACKER.estimate(after(free))
    np.testing.assert_allclose(mean, DRIFT_N, atol=0.15)
    assert 1.0 <= scale < 1.5
    pressed = np.concatenate([free, rng.normal(DRIFT_N + np.array([0.0, 0.0, 20.0]), 0.4, (50, 3))])
    np.testing.assert_allclose(TRACKER.estimate(after(pressed))[0], mean, atol=0.05)


@pytest.mark.parametrize("newton", [1e6, 1e120, 1e155, 1e300])
def test_a_force_beyond_any_scale_is_contact_and_teaches_nothing(newton: float) -> None:
    with np.errstate(over="ignore"):
        assert TRACKER.advance(BiasState(), np.array([0.0, 0.0, newton])) == BiasState()


def test_a_long_rest_does_not_make_the_error_of_a_movement_a_contact() -> None:
    """It once did: the scale shrank to the noise of the rest, and free movement was contact for good."""
    rng = np.random.default_rng(2)
    state = after(rng.normal(0.0, 0.1, (1800, 3)))
    moving = rng.normal([2.0, -1.0, 2.0], 0.4, (400, 3))
    shares = []
    for force in moving:
        before, state = state.weight, TRACKER.advance(state, force)
        shares.append(state.weight - before)
    assert np.mean(shares) > 0.5


def test_free_space_never_becomes_broader_than_contact() -> None:
    rng = np.random.default_rng(3)
    strong = rng.normal(size=(1000, 3))
    strong *= 20.0 / np.linalg.norm(strong, axis=1, keepdims=True)
    tracker = BiasTracker(scale_n=5.0)
    assert tracker.estimate(after(strong, tracker))[1] <= 0.5 * tracker.contact_n


def taught(recording: Recording, hand: str) -> list[str]:
    """Kinds of the button demonstration with a force that drifts by 4 N, as an estimate."""
    drift = np.linspace(0.0, 1.0, recording.t.size)[:, None] * 1.5 * DRIFT_N
    signals = {**recording.signals, "force": recording.signals["force"] + drift}
    estimate = Recording(
        t=recording.t,
        signals=signals,
        wrench_source="joint_torque_estimate",
        hand_on_robot=hand,  # type: ignore[arg-type]
        force_frame=recording.force_frame,
        length_unit=recording.length_unit,
        name=recording.name,
    )
    return [segment.kind for segment in segmented(estimate).segments]


def test_presses_are_found_in_an_estimate_without_a_hand_though_its_bias_drifts() -> None:
    recording = load_recording(BUTTON)
    measured = [segment.kind for segment in segmented(recording).segments]
    assert taught(recording, "no").count("contact") == measured.count("contact") > 0


@pytest.mark.parametrize("hand", ["yes", "unknown"])
def test_no_contact_is_claimed_where_a_hand_may_be_in_the_estimate(hand: str) -> None:
    assert set(taught(load_recording(BUTTON), hand)) <= {"motion", "steady"}
