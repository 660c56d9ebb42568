"""Chapter 2 of the thesis, inference and robot: of every wrong equation, the printed one fails here.

Rows of the list of wrong equations, each with the printed formula as a small function, the right one, and
ours. Not tested: step 10 of 2.1.5, "t to t − 1", is prose. No code of ours needs (2.40)–(2.42), for the
teacher moves the arm in joint space; what they should say is tested of the dynamics of `robot.robot_model`.
"""

from __future__ import annotations

import numpy as np
import pytest

from caesura_service.changepoint.channel_model import ModelInput, Noise
from caesura_service.changepoint.channel_model_checks import rows_after
from caesura_service.changepoint.constant_models import ConstantLevel
from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.hazard import Geometric, Uniform
from caesura_service.changepoint.offline_posterior import segment_offline
from caesura_service.changepoint.run_length_filter import RunLengthFilter
from caesura_service.changepoint.segment_model_set import SegmentKind, SegmentModelSet
from caesura_service.robot import Robot, load_panda
from service.changepoint.brute_force import BruteForce, segmentations

MODEL = ConstantLevel("force", Noise(2.0, 1.0), "zero")
LATTICE = SegmentModelSet({"force": MODEL}, (SegmentKind("motion", "motion", "free", ("force",)),))
LAMBDA = 4.0
HAZARD = Geometric(LAMBDA)
N = 7
READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])


@pytest.fixture(scope="module")
def data() -> list[ModelInput]:
    """Something quiet, then something loud."""
    scale = np.where(np.arange(N) < 4, 0.2, 6.0)[:, None]
    return [ModelInput(np.zeros(3), f) for f in np.random.default_rng(0).normal(0, 1, (N, 3)) * scale]


@pytest.fixture(scope="module")
def brute(data: list[ModelInput]) -> BruteForce:
    return BruteForce(LATTICE, data, HAZARD)


def evidence(observations: list[ModelInput]) -> float:
    """Of observations as one segment."""
    return float(np.exp(MODEL.log_evidence(rows_after(MODEL, observations))[0])) if observations else 1.0


def g(length: int) -> float:
    return float(np.exp(HAZARD.log_mass(np.array(length))))


def lasting(length: int) -> float:
    """1 − G."""
    return float(np.exp(HAZARD.log_survival(np.array(length))))


def backward(data: list[ModelInput]) -> list[float]:
    """Q(t) = Σ_s P(t,s) g(s−t+1) Q(s+1) + P(t,n)(1 − G(n−t)), counted from 0; Q(n) = 1."""
    q = [0.0] * N + [1.0]
    for t in reversed(range(N)):
        ends = sum(evidence(data[t : s + 1]) * g(s - t + 1) * q[s + 1] for s in range(t, N - 1))
        q[t] = ends + evidence(data[t:]) * lasting(N - 1 - t)
    return q


def test_2_9_the_prior_of_a_length_is_a_distribution_over_lengths() -> None:
    longest = 6

    def printed(length: int) -> float:
        return float((1.0 / longest) ** length)

    lengths = np.arange(1, longest + 1)
    assert sum(map(printed, lengths)) == pytest.approx(0.2, abs=1e-4)  # far from 1
    paths = [np.diff([*path, longest]) for path in segmentations(longest)]
    products = [np.prod([printed(length) for length in path]) for path in paths]
    np.testing.assert_allclose(products, products[0])  # telescopes: it prefers no segmentation to another

    own = np.exp(Uniform(longest).log_mass(lengths))
    np.testing.assert_allclose(own, 1.0 / longest)
    assert np.ptp([np.exp(Uniform(longest).log_mass(path).sum()) for path in paths]) > 0.1


def test_2_13_to_2_15_the_recursion_sums_over_all_segmentations(
    data: list[ModelInput], brute: BruteForce
) -> None:
    def printed() -> float:
        """P_D(i:n) = Σ_k P_S(i:k) P_D(k:n), P_D(n:n) = 1: neighbours share a sample; P_S with its prior."""
        p_d = [0.0] * (N - 1) + [1.0]
        for i in reversed(range(N - 1)):
            p_d[i] = sum(evidence(data[i : k + 1]) * g(k + 1 - i) * p_d[k] for k in range(i + 1, N))
        return p_d[0]

    assert np.log(backward(data)[0]) == pytest.approx(brute.total, abs=1e-9)
    assert segment_offline(LATTICE, HAZARD, data).log_evidence == pytest.approx(brute.total, abs=1e-9)
    assert abs(np.log(printed()) - brute.total) > 1.0


def test_2_17_and_2_18_the_next_changepoint_and_where_there_is_any(
    data: list[ModelInput], brute: BruteForce
) -> None:
    q = backward(data)

    def right(e: int, s: int) -> float:
        return evidence(data[s:e]) * g(e - s) * q[e] / q[s]

    def printed(e: int, s: int) -> float:
        """The segment's end is skipped in the rest, and what it is divided by begins at e."""
        return evidence(data[s:e]) * g(e - s) * q[min(e + 1, N)] / q[e]

    for s in range(N - 1):
        never = evidence(data[s:]) * lasting(N - 1 - s) / q[s]
        assert sum(right(e, s) for e in range(s + 1, N)) + never == pytest.approx(1.0, abs=1e-9)
    assert abs(sum(printed(e, 0) for e in range(1, N)) - 1.0) > 0.5

    marginal = [1.0]
    for e in range(1, N):
        marginal.append(sum(marginal[s] * right(e, s) for s in range(e)))
    expected = brute.changepoint_probability()
    np.testing.assert_allclose(marginal, expected, atol=1e-9)
    got = segment_offline(LATTICE, HAZARD, data).changepoint_probability
    np.testing.assert_allclose(got, expected, atol=1e-9)

    orders = [
        [brute.probability([path[i : i + 1] == (e,) for path in brute.paths]) for i in range(N)]
        for e in range(N)
    ]
    np.testing.assert_allclose(np.sum(orders, axis=1), expected, atol=1e-9)
    with_a_second_prior = np.sum(orders, axis=1) / N  # (2.18), P_k = 1/k_max
    assert np.abs(with_a_second_prior - expected).max() > 0.5


def test_2_21_to_2_29_the_filter_looks_at_the_data_since_the_changepoint(
    data: list[ModelInput], brute: BruteForce
) -> None:
    hazard = 1.0 / LAMBDA

    def filtered(*, since: bool = True, changepoint: float = hazard) -> np.ndarray:
        """Joint of run lengths 0..n and all data, growth and changepoint steps (2.27), (2.28)."""
        joint = np.array([1.0])
        for t, observed in enumerate(data):
            seen = [data[t - r : t] if since else data[:r] for r in range(len(joint))]
            predictive = np.array([evidence([*some, observed]) / evidence(some) for some in seen])
            stay = joint * predictive
            joint = np.concatenate([[changepoint * stay.sum()], (1.0 - hazard) * stay])
        return joint

    right = filtered()
    assert np.log(right.sum()) == pytest.approx(brute.total, abs=1e-9)
    online = RunLengthFilter(LATTICE, HAZARD, FilterParameters(prune_ratio=0.0, keep_youngest=0))
    for observed in data:
        online.step(observed)
    # Run length r = n − s as of now, or 0 where a segment has ended: on starts the latter is the next one's.
    np.testing.assert_allclose(online.posterior[::-1] * (1.0 - hazard), right[1:] / right.sum(), atol=1e-9)

    first_rather_than_last = filtered(since=False)  # X_{1:l} in (2.21)
    growth_again = filtered(changepoint=1.0 - hazard)  # second line of (2.28)
    for joint in (first_rather_than_last, growth_again):
        assert abs(np.log(joint.sum()) - brute.total) > 0.1
    assert right[1:].sum() / right.sum() == pytest.approx(1.0 - hazard)  # (2.29) from l = 1 loses r = 0


def test_a_constant_hazard_makes_the_newest_changepoint_as_probable_as_ever() -> None:
    """P(r_t = 0 | x_1:t) ≡ 1/λ; only looking back tells anything."""
    rng = np.random.default_rng(1)
    force = rng.normal(0.0, 0.1, (14, 3)) + 30.0 * (np.arange(14) >= 7)[:, None]
    online, before = RunLengthFilter(LATTICE, HAZARD), None
    for value in force:
        online.step(ModelInput(np.zeros(3), value))
        if before is not None:
            assert np.exp(online.log_prior[-1] - before) == pytest.approx(1.0 / LAMBDA, abs=1e-9)
        before = log_sum_exp(online.log_joint)
    smoothed = [online.changepoint_probability(start) for start in range(1, 14)]
    assert int(np.argmax(smoothed)) + 1 == 7
    assert smoothed[6] > 0.99
    assert np.median(smoothed) < 0.2


def test_2_34_what_is_unlikely_is_pruned(data: list[ModelInput], brute: BruteForce) -> None:
    threshold = 1e-2
    exact = RunLengthFilter(LATTICE, HAZARD, FilterParameters(prune_ratio=0.0, keep_youngest=0))
    pruned = RunLengthFilter(LATTICE, HAZARD, FilterParameters(prune_ratio=threshold, keep_youngest=0))
    for observed in data:
        exact.step(observed)
        pruned.step(observed)

    def printed(ratio: np.ndarray) -> np.ndarray:
        """Prunes where η < ratio."""
        return threshold < ratio

    best = exact.posterior.argmax()
    assert printed(exact.posterior)[best]  # the most probable of all goes
    assert best in pruned.starts
    assert pruned.starts.size < exact.starts.size
    assert exact.posterior[pruned.starts].sum() > 0.97
    assert exact.posterior[~printed(exact.posterior)].sum() < 0.03


# (2.40)–(2.42): J is 6 × 7 and has no inverse; only J M⁻¹ Jᵀ has.


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_panda()


def inertia_at_the_hand(robot: Robot) -> np.ndarray:
    """Λ, and what ours and the printed formulas need."""
    jacobian, mass = robot.flange_jacobian(READY), robot.mass_matrix(READY)
    return np.linalg.inv(jacobian @ np.linalg.solve(mass, jacobian.T))


def test_2_40_a_wrench_accelerates_the_hand_by_the_inertia_that_is_felt_there(robot: Robot) -> None:
    jacobian, mass = robot.flange_jacobian(READY), robot.mass_matrix(READY)
    wrench = np.array([3.0, -2.0, 5.0, 0.2, 0.1, -0.3])
    torque = robot.gravity_torques(READY) + robot.joint_torques_of_wrench(READY, wrench)
    acceleration = jacobian @ robot.forward_dynamics(READY, np.zeros(7), torque)  # at rest: no J̇ q̇
    np.testing.assert_allclose(inertia_at_the_hand(robot) @ acceleration, wrench, atol=1e-8)

    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.inv(jacobian)
    printed = np.linalg.pinv(jacobian).T @ mass @ np.linalg.pinv(jacobian)
    assert np.abs(printed @ acceleration - wrench)[3:].max() > 0.06  # [Nm], of 0.3


def test_2_41_at_speed_the_jacobian_turns(robot: Robot) -> None:
    """f = Λ ẍ + Λ (J M⁻¹ C − J̇) q̇, gravity compensated; the printed one has J where J̇ belongs."""
    speed, step = 0.5 * np.array([0.3, -0.5, 0.4, 0.6, -0.2, 0.7, 0.1]), 1e-6
    jacobian, mass, felt = robot.flange_jacobian(READY), robot.mass_matrix(READY), inertia_at_the_hand(robot)
    ahead, behind = (robot.flange_jacobian(READY + s * step * speed) for s in (1.0, -1.0))
    turning = (ahead - behind) / (2 * step) @ speed
    coriolis = robot.nonlinear_torques(READY, speed) - robot.gravity_torques(READY)
    wrench = np.array([3.0, -2.0, 5.0, 0.2, 0.1, -0.3])
    torque = robot.gravity_torques(READY) + robot.joint_torques_of_wrench(READY, wrench)
    acceleration = jacobian @ robot.forward_dynamics(READY, speed, torque) + turning

    def needed(turn: np.ndarray) -> np.ndarray:
        return felt @ (acceleration + jacobian @ np.linalg.solve(mass, coriolis) - turn)

    np.testing.assert_allclose(needed(turning), wrench, atol=1e-6)
    assert np.abs(needed(jacobian @ speed) - wrench).max() > 0.5


def test_2_42_gravity_at_the_hand_is_the_wrench_that_holds_it(robot: Robot) -> None:
    jacobian, mass, gravity = (
        robot.flange_jacobian(READY),
        robot.mass_matrix(READY),
        robot.gravity_torques(READY),
    )

    def sags(wrench: np.ndarray) -> float:
        """[m/s²] of a hand held by this wrench alone."""
        return float(np.abs(jacobian @ np.linalg.solve(mass, jacobian.T @ wrench - gravity)).max())

    assert sags(inertia_at_the_hand(robot) @ jacobian @ np.linalg.solve(mass, gravity)) < 1e-9
    printed = np.linalg.pinv(jacobian.T) @ gravity
    assert sags(printed) > 0.1
