"""The bias of an estimated wrench: against the mixture written out, and in a session without a hand."""

from __future__ import annotations

import copy
from dataclasses import replace
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
DOWN, UP = np.array([0.0, 0.0, -0.01]), np.array([0.0, 0.0, 0.01])  # [m] in a tenth of a second


def after(forces: np.ndarray, tracker: BiasTracker = TRACKER, path: np.ndarray | None = None) -> BiasState:
    """The state after forces at these positions, or at rest."""
    path = np.zeros_like(forces) if path is None else path
    state = tracker.initial_state(path[0])
    for force, position in zip(forces, path, strict=True):
        state = tracker.advance(state, force, position)
    return state


def wandering(rng: np.random.Generator, n: int) -> np.ndarray:
    """Positions (n, 3) [m] along directions that change."""
    return np.cumsum(rng.normal(scale=0.004, size=(n, 3)), axis=0)


def test_every_step_is_the_posterior_of_the_two_components_by_scipy() -> None:
    rng = np.random.default_rng(0)
    forces, path = rng.normal([1.0, -0.5, 2.0], 1.0, (30, 3)), wandering(rng, 30)
    forces[10:15] += [0.0, 0.0, 15.0]
    coefficients, covariance = np.zeros((4, 3)), np.diag([1.5**2, 9.0, 9.0, 9.0])
    weight, squares, direction, renewed, state = 0.0, 0.0, np.zeros(3), 0.0, TRACKER.initial_state(path[0])
    share, before = 1.0, np.zeros(3)
    for i, force in enumerate(forces):
        if i:
            step = path[i] - path[i - 1]
            way = np.linalg.norm(step)
            renewed = 1.0 - np.exp(-way / 0.002)
            direction = step / way + (direction - step / way) * np.exp(-way / 0.002)
        regressors = np.concatenate([[1.0], direction])
        variance = min(max((10 * 1.5**2 + 0.1 * squares) / (10 + 0.3 * weight), 1.0), 25.0)
        uncertain = regressors @ covariance @ regressors
        free = multivariate_normal(regressors @ coefficients, (uncertain + variance) * np.eye(3)).pdf(force)
        begins = multivariate_normal(np.zeros(3), 100.0 * np.eye(3)).pdf(force)
        goes_on = 0.05 * begins + 0.95 * multivariate_normal(before, 9.0 * np.eye(3)).pdf(force)
        was_free = share * np.array([0.95 * free, 0.05 * begins])
        was_touched = (1.0 - share) * np.array([0.05 * free, 0.95 * goes_on])
        share = (was_free + was_touched)[0] / (was_free + was_touched).sum()
        before = force
        gain = share * 0.1 * renewed * covariance @ regressors / (0.1 * renewed * uncertain + variance)
        off = force - regressors @ coefficients
        coefficients = coefficients + np.outer(gain, off)
        covariance = covariance - np.outer(gain, regressors @ covariance)
        weight, squares = weight + share, squares + share * float(off @ off)
        state = TRACKER.advance(state, force, path[i])
        mean, scale = TRACKER.estimate(state)
        np.testing.assert_allclose(mean, regressors @ coefficients, rtol=1e-9)
        assert state.weight == pytest.approx(weight, rel=1e-9)
        expected = min(max((10 * 1.5**2 + 0.1 * squares) / (10 + 0.3 * weight), 1.0), 25.0)
        assert scale == pytest.approx(np.sqrt(expected), rel=1e-9)


def test_in_free_space_bias_and_friction_are_those_of_a_regression_over_the_whole_path() -> None:
    tracker = BiasTracker(scale_n=1.0, stays=1.0 - 1e-15)
    rng = np.random.default_rng(4)
    path = wandering(rng, 200)
    friction = rng.normal(scale=2.0, size=(3, 3))
    regressors, forces, weights, state = [], [], [], tracker.initial_state(path[0])
    for position in path:
        direction, renewed, step = state.regressors[1:], 0.0, position - state.position
        if way := np.linalg.norm(step):
            renewed = 1.0 - np.exp(-way / 0.002)
            direction = step / way + (direction - step / way) * np.exp(-way / 0.002)
        force = DRIFT_N + friction @ direction + rng.normal(scale=0.1, size=3)
        regressors.append(np.concatenate([[1.0], direction]))
        forces.append(force)
        weights.append(0.1 * renewed / tracker.estimate(state)[1] ** 2)
        state = tracker.advance(state, force, position)
    weighted = np.array(regressors).T * weights
    precision = np.diag([1.0, 1 / 9.0, 1 / 9.0, 1 / 9.0]) + weighted @ np.array(regressors)
    expected = np.linalg.solve(precision, weighted @ np.array(forces))
    np.testing.assert_allclose(state.coefficients, expected, atol=1e-8)


def test_the_mean_follows_a_steady_bias_and_a_press_does_not_move_it() -> None:
    rng = np.random.default_rng(1)
    free, path = rng.normal(DRIFT_N, 0.4, (300, 3)), wandering(rng, 350)
    mean, scale = TRACKER.estimate(after(free, path=path[:300]))
    np.testing.assert_allclose(mean, DRIFT_N, atol=0.3)
    assert 1.0 <= scale < 1.5
    pressed = np.concatenate([free, rng.normal(DRIFT_N + np.array([0.0, 0.0, 20.0]), 0.4, (50, 3))])
    bias = after(free, path=path[:300]).coefficients
    np.testing.assert_allclose(after(pressed, path=path).coefficients, bias, atol=0.05)


def test_a_light_press_at_rest_is_no_bias() -> None:
    path = np.cumsum([DOWN] * 20, axis=0)
    there = after(np.zeros((20, 3)), path=path)
    state = there
    for _ in range(50):
        state = TRACKER.advance(state, np.array([0.0, 0.0, 4.0]), path[-1])
    np.testing.assert_array_equal(TRACKER.estimate(state)[0], TRACKER.estimate(there)[0])


def test_the_friction_of_a_movement_is_no_contact_and_has_the_other_sign_on_the_way_back() -> None:
    """A Panda's wrench changed by 7 N where it began to move, and all of that way was a contact or a load."""
    rng = np.random.default_rng(5)
    path = np.concatenate([np.zeros((10, 3)), np.cumsum([DOWN] * 20, axis=0)])
    path = np.concatenate([path, path[-1] + np.cumsum([UP] * 3, axis=0)])
    friction = np.array([3.0, 1.0, -6.0])
    forces = rng.normal(0.0, 0.2, path.shape) + np.outer([0.0] * 10 + [1.0] * 20 + [-1.0] * 3, friction)
    there = after(forces[:30], path=path[:30])
    assert there.weight > 28.0
    assert np.linalg.norm(TRACKER.estimate(there)[0] - friction) < 2.0
    back = after(forces, path=path)
    assert back.weight - there.weight > 2.5
    assert TRACKER.estimate(back)[0] @ friction < 0.0


def test_a_slide_that_leaves_a_rest_in_contact_is_no_friction() -> None:
    """Its direction is new, so 8 N were free space within half a second, and three slides were lost."""
    pressed, along = np.array([0.0, 0.0, 8.0]), np.array([0.002, 0.0, 0.0])
    path = np.cumsum([DOWN] * 10 + [np.zeros(3)] * 10 + [along] * 40, axis=0)
    forces = np.array([np.zeros(3)] * 10 + [pressed] * 10 + [pressed - [2.4, 0.0, 0.0]] * 40)
    there, slid = after(forces[:20], path=path[:20]), after(forces, path=path)
    assert slid.weight - there.weight < 0.5  # of 40 observations
    assert np.linalg.norm(TRACKER.estimate(slid)[0]) < 0.5


def test_friction_stays_where_the_arm_stops() -> None:
    path = np.cumsum([DOWN] * 30, axis=0)
    forces = np.tile([2.0, 0.0, -4.0], (30, 1))
    state = after(forces, path=path)
    for _ in range(50):
        state = TRACKER.advance(state, forces[-1], path[-1])
    np.testing.assert_allclose(TRACKER.estimate(state)[0], forces[-1], atol=0.5)
    np.testing.assert_allclose(state.regressors, [1.0, 0.0, 0.0, -1.0], atol=1e-6)


def test_states_share_nothing_that_changes() -> None:
    state = after(np.tile(DRIFT_N, (20, 1)), path=np.cumsum([UP] * 20, axis=0))
    kept = copy.deepcopy(state)
    TRACKER.advance(state, DRIFT_N, np.ones(3))
    for was, now in zip(kept, state, strict=True):
        np.testing.assert_array_equal(was, now)


@pytest.mark.parametrize("newton", [1e6, 1e120, 1e155, 1e300])
def test_a_force_beyond_any_scale_is_contact_and_teaches_nothing(newton: float) -> None:
    state = after(np.tile(DRIFT_N, (5, 1)))
    with np.errstate(over="ignore"):
        beyond = TRACKER.advance(state, np.array([0.0, 0.0, newton]), np.zeros(3))
        again = TRACKER.advance(beyond, np.array([0.0, 0.0, -newton]), np.zeros(3))
    assert (beyond.free, again.free) == (0.0, 0.0)
    for name in ("coefficients", "covariance", "regressors", "weight", "squares"):
        np.testing.assert_array_equal(getattr(state, name), getattr(again, name))


def test_a_long_rest_does_not_make_the_error_of_a_movement_a_contact() -> None:
    """It once did: the scale shrank to the noise of the rest, and free movement was contact for good."""
    rng = np.random.default_rng(2)
    state = after(rng.normal(0.0, 0.1, (1800, 3)))
    moving = rng.normal([2.0, -1.0, 2.0], 0.4, (400, 3))
    shares = []
    for force, position in zip(moving, wandering(rng, 400), strict=True):
        before, state = state.weight, TRACKER.advance(state, force, position)
        shares.append(state.weight - before)
    assert np.mean(shares) > 0.5


def test_free_space_never_becomes_broader_than_contact() -> None:
    rng = np.random.default_rng(3)
    strong = rng.normal(size=(1000, 3))
    strong *= 20.0 / np.linalg.norm(strong, axis=1, keepdims=True)
    tracker = BiasTracker(scale_n=5.0)
    assert tracker.estimate(after(strong, tracker))[1] <= 0.5 * tracker.contact_n


def estimated(recording: Recording, error: np.ndarray, hand: str = "no") -> list[str]:
    """Kinds of a demonstration with an error (n, 3) [N] in its force, as an estimate."""
    signals = {**recording.signals, "force": recording.signals["force"] + error}
    estimate = replace(
        recording,
        signals=signals,
        wrench_source="joint_torque_estimate",
        hand_on_robot=hand,  # type: ignore[arg-type]
    )
    return [segment.kind for segment in segmented(estimate).segments]


def drift(recording: Recording) -> np.ndarray:
    return np.linspace(0.0, 1.0, recording.t.size)[:, None] * 1.5 * DRIFT_N


def friction(recording: Recording, newton: float) -> np.ndarray:
    """The friction of a tool, by Dahl's model, against its movement."""
    steps = np.diff(recording.signals["pos"], axis=0, prepend=recording.signals["pos"][:1])
    states = np.zeros_like(steps)
    for i, step in enumerate(steps[1:], start=1):
        way = float(np.linalg.norm(step))
        states[i] = states[i - 1] + (step - way * states[i - 1]) / 0.002
    return -newton * states


def test_presses_are_found_in_an_estimate_without_a_hand_though_its_bias_drifts() -> None:
    recording = load_recording(BUTTON)
    measured = [segment.kind for segment in segmented(recording).segments]
    assert estimated(recording, drift(recording)).count("contact") == measured.count("contact") > 0


def test_friction_of_3_n_is_no_contact_and_hides_none() -> None:
    """Four of its movements slid before friction was tracked."""
    recording = load_recording(BUTTON)
    kinds = estimated(recording, friction(recording, 3.0))
    assert kinds.count("contact") == 3
    assert set(kinds) == {"steady", "motion", "contact"}


@pytest.mark.parametrize("hand", ["yes", "unknown"])
def test_no_contact_is_claimed_where_a_hand_may_be_in_the_estimate(hand: str) -> None:
    recording = load_recording(BUTTON)
    assert set(estimated(recording, drift(recording), hand)) <= {"motion", "steady"}
