"""Chapter 3 of the thesis, people and segment models: of every wrong equation, the printed one fails here.

Rows of the list of wrong equations, each with the printed formula as a small function, the right one, and
ours. Not tested: "force columns are in N, not m" is a misprint of the tables' headings; our own forces carry
their unit in their names and in the protocol's fields.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats
from scipy.special import gammaln

from caesura_lab.teacher.guided_arm import GuidedArmSimulation
from caesura_lab.teacher.hand_motion_plan import make_plan
from caesura_lab.teacher.person import THESIS
from caesura_lab.teacher.scenarios import Scenario, Step
from caesura_service.changepoint.channel_model import ChannelModel, ModelInput, Noise
from caesura_service.changepoint.channel_model_checks import everywhere, mass, rows_after
from caesura_service.changepoint.constant_models import ConstantLevel
from caesura_service.changepoint.constant_velocity import ConstantVelocity
from caesura_service.changepoint.contact_mixture import CONTACT, FREE, TRANSPORT, ContactMixture
from caesura_service.changepoint.evidence import known_mean_log_evidence, log_mean_exp, log_sum_exp
from caesura_service.changepoint.profile_library import ProfileLibrary, first_order, overdamped
from caesura_service.changepoint.profile_model import ProfileModel
from caesura_service.changepoint.segment_model_set import SegmentKind, SegmentModelSet
from caesura_service.changepoint.thesis_presets import thesis_motion_library
from caesura_service.constants import GRAVITY
from caesura_service.robot import load_panda
from service.changepoint.catalogue import Whole
from service.changepoint.quadrature import constant_velocity
from service.program.segments import program, segment, stopping_at

STEP_S = 0.1
NU0, SIGMA2, KAPPA0, LINE_STEP_S = 3.0, 0.5, 1.0, 0.5
LINE = ConstantVelocity(nu0=NU0, sigma2=SIGMA2, kappa0=KAPPA0, length_unit_m=1.0, step_s=LINE_STEP_S)


def positions(values: np.ndarray) -> list[ModelInput]:
    return [ModelInput(value, np.zeros(3)) for value in values]


def forces(values: np.ndarray) -> list[ModelInput]:
    return [ModelInput(np.zeros(3), value) for value in values]


def evidence(model: ChannelModel, observations: list[ModelInput]) -> float:
    """Log evidence of all of them as one segment."""
    return float(model.log_evidence(rows_after(model, observations))[0])


# What people do


@pytest.mark.parametrize(("sign", "ends_nearer"), [(1.0, True), (-1.0, False)])
def test_3_6_a_hand_pulls_towards_where_it_aims(sign: float, ends_nearer: bool) -> None:
    """f = K (x_d − x); printed K (x − x_d), which is a negative stiffness in the same place."""
    here = Scenario("here", "stay where you are", (0.4, 0.1, 0.3), (Step("dwell", 1.0),))
    hand = replace(THESIS, stiffness_n_per_m=sign * THESIS.stiffness_n_per_m, tremor_n=0.0, wander_n=0.0)
    plan = make_plan(here, hand, np.random.default_rng(0))
    goal = np.add(here.start, [0.0, 0.02, 0.0])
    plan = replace(plan, position=np.broadcast_to(goal, plan.position.shape))
    robot = load_panda()
    moved, _ = robot.flange_poses(GuidedArmSimulation(robot, plan).run(400).q[[0, -1]])
    before, after = np.linalg.norm(moved - goal, axis=1)
    assert before == pytest.approx(0.02, abs=1e-4)
    assert (after < 0.5 * before) == ends_nearer
    assert (after > 1.5 * before) != ends_nearer


def test_3_22_the_profile_drives_to_its_goal() -> None:
    """Λ ẍ + D ẋ = K (x_d − x); with the printed sign there is no rest at the goal."""
    stiffness, damping, t, h = 12.0, 32.5, np.linspace(0.05, 2.0, 9), 1e-4
    x = overdamped(stiffness, damping)
    felt = (x(t + h) - 2 * x(t) + x(t - h)) / h**2 + damping * (x(t + h) - x(t - h)) / (2 * h)
    np.testing.assert_allclose(felt, stiffness * (1.0 - x(t)), atol=1e-4)
    printed = stiffness * (x(t) - 1.0)
    assert np.abs(felt - printed).min() > 1.0
    printed_roots = np.roots([1.0, damping, -stiffness])
    assert printed_roots.max() > 0.0  # a deviation grows


def test_3_5_and_3_6_weight_belongs_to_transport() -> None:
    """u = 2 is contact and u = 3 transport; (3.6) has the weight second and the push third."""
    says = {"nothing": 0.0, "push": 15.0, "weight": -0.5 * GRAVITY}
    right = {"nothing": FREE, "push": CONTACT, "weight": TRANSPORT}
    printed = {"nothing": FREE, "weight": CONTACT, "push": TRANSPORT}

    def implemented(force_z: float) -> int:
        observed = forces(np.tile([0.0, 0.0, force_z], (30, 1)))
        return int(np.argmax([evidence(ContactMixture(u), observed) for u in (FREE, CONTACT, TRANSPORT)]))

    got = {what: implemented(force_z) for what, force_z in says.items()}
    assert got == right
    assert got != printed


def test_3_36_a_force_takes_time() -> None:
    """ḟ = k (f_d − f); as printed, f = k (f − f_d) is algebraic, and only one constant force obeys it."""
    rate, goal, t, h = 3.0, 20.0, np.linspace(0.1, 2.0, 9), 1e-5
    profile = first_order(rate)
    slope = goal * (profile(t + h) - profile(t - h)) / (2 * h)
    np.testing.assert_allclose(slope, rate * (goal - goal * profile(t)), atol=1e-6)
    printed = rate * (goal * profile(t) - goal)
    assert np.abs(goal * profile(t) - printed).min() > 1.0


# Constant velocity


def design(n: int) -> np.ndarray:
    return np.column_stack([np.ones(n), LINE_STEP_S * np.arange(n)])


def best(phi: np.ndarray, y: np.ndarray, *, sign: float = 1.0) -> np.ndarray:
    """β* = (ΦᵀΦ + κ₀ I)⁻¹ Φᵀ x; the thesis (A.1.2) has a minus."""
    return np.linalg.solve(phi.T @ phi + sign * KAPPA0 * np.eye(2), phi.T @ y)


def spread(phi: np.ndarray, y: np.ndarray, coefficients: np.ndarray) -> float:
    """S_n (3.18)."""
    residual = y - phi @ coefficients
    return NU0 * SIGMA2 + KAPPA0 * coefficients @ coefficients + residual @ residual


@pytest.fixture(scope="module")
def line() -> np.ndarray:
    """(6, 3) along a noisy line from the origin."""
    noise = np.random.default_rng(2).normal(0.0, 0.2, (6, 3))
    return np.outer(LINE_STEP_S * np.arange(6), [0.8, -0.4, 0.0]) + noise - noise[0]


def test_3_14_the_likelihood_is_a_density(line: np.ndarray) -> None:
    """(2π)ⁿ and covariance σ² I; printed (2π)² and, in the exponent, σ²/κ₀."""
    variance, kappa0 = 0.3, 2.0

    def right(x: np.ndarray) -> np.ndarray:
        return (2 * np.pi * variance) ** (-0.5 * 3) * np.exp(-0.5 * (x**2).sum(axis=-1) / variance)

    def printed(x: np.ndarray) -> np.ndarray:
        return (
            (2 * np.pi) ** -1
            * variance ** (-0.5 * 3)
            * np.exp(-0.5 * (x**2).sum(axis=-1) * kappa0 / variance)
        )

    axis = np.linspace(-6.0, 6.0, 61)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    volume = (axis[1] - axis[0]) ** 3
    assert right(grid).sum() * volume == pytest.approx(1.0, abs=1e-6)
    assert abs(printed(grid).sum() * volume - 1.0) > 0.1
    expected = constant_velocity(LINE, line[0], line[:3])  # the right likelihood, summed over all lines
    assert evidence(LINE, positions(line[:3])) == pytest.approx(expected, abs=1e-6)


def test_the_best_line_is_the_best(line: np.ndarray) -> None:
    phi, y = design(6), line[:, 0]
    right, printed = best(phi, y), best(phi, y, sign=-1.0)
    nearby = [spread(phi, y, right + change) for change in 1e-3 * np.vstack([np.eye(2), -np.eye(2)])]
    assert spread(phi, y, right) < min(nearby)
    assert spread(phi, y, printed) > spread(phi, y, right) + 0.1

    def log_marginal(coefficients) -> float:
        """(3.17), with κ₀ to the number of coefficients on top."""
        nu_n, kappa_n = NU0 + 6, phi.T @ phi + KAPPA0 * np.eye(2)
        spreads = [spread(phi, line[:, axis], coefficients(phi, line[:, axis])) for axis in range(3)]
        gammas = gammaln(nu_n / 2) - gammaln(NU0 / 2) + np.log(KAPPA0) - 0.5 * np.linalg.slogdet(kappa_n)[1]
        each = gammas + 0.5 * NU0 * np.log(NU0 * SIGMA2) - 0.5 * nu_n * np.log(spreads) - 3 * np.log(np.pi)
        return float(each.sum())

    assert evidence(LINE, positions(line)) == pytest.approx(log_marginal(best), abs=1e-9)
    assert log_marginal(lambda phi, y: best(phi, y, sign=-1.0)) < evidence(LINE, positions(line)) - 0.1


def test_3_19_to_3_21_the_next_place_on_a_line_is_as_uncertain_as_the_line_there(line: np.ndarray) -> None:
    def log_product(scale2) -> float:
        total = 0.0
        for axis in range(3):
            for n, value in enumerate(line[:, axis]):
                phi, ahead = design(n), np.array([1.0, LINE_STEP_S * n])
                coefficients = best(phi, line[:n, axis])
                variance = spread(phi, line[:n, axis], coefficients) / (NU0 + n)
                scale = np.sqrt(variance * scale2(phi, ahead))
                total += stats.t.logpdf(value, NU0 + n, ahead @ coefficients, scale)
        return total

    def right(phi: np.ndarray, ahead: np.ndarray) -> float:
        return 1.0 + ahead @ np.linalg.solve(phi.T @ phi + KAPPA0 * np.eye(2), ahead)

    def printed(phi: np.ndarray, ahead: np.ndarray) -> float:
        """(κ_n + 1)/κ_n, with κ_n = κ₀ + n in place of the matrix that cannot be divided by."""
        kappa_n = KAPPA0 + len(phi)
        return (kappa_n + 1.0) / kappa_n

    kappa = design(3).T @ design(3) + KAPPA0 * np.eye(2), design(4).T @ design(4) + KAPPA0 * np.eye(2)
    determinants = np.linalg.det(kappa[1]) / np.linalg.det(kappa[0])
    assert right(design(3), design(4)[3]) == pytest.approx(determinants)
    assert evidence(LINE, positions(line)) == pytest.approx(log_product(right), abs=1e-9)
    assert abs(log_product(printed) - evidence(LINE, positions(line))) > 0.1


# Second order


def test_3_25_and_3_26_a_movement_starts_where_it_starts() -> None:
    stiffness, damping, x_0, x_d = 12.0, 32.5, 0.1, 0.4
    slow, fast = np.sort(np.roots([1.0, damping, stiffness]).real)[::-1]
    r1, r2, t, h = slow, fast, np.linspace(0.0, 3.0, 31), 1e-6

    def printed(t: np.ndarray) -> np.ndarray:
        e = r1 / (r1 - r2) * np.exp(r1 * t) + (1.0 - r1 / (r1 - r2)) * np.exp(r2 * t)
        return (x_d - x_0) * e + x_d

    def right(t: np.ndarray) -> np.ndarray:
        e = -r2 / (r1 - r2) * np.exp(r1 * t) + r1 / (r1 - r2) * np.exp(r2 * t)
        return x_d + (x_0 - x_d) * e

    implemented = x_0 + (x_d - x_0) * overdamped(stiffness, damping)(t)
    np.testing.assert_allclose(implemented, right(t), atol=1e-12)
    assert right(np.array(0.0)) == pytest.approx(x_0)
    assert (right(np.array(h)) - x_0) / h == pytest.approx(0.0, abs=1e-4)
    assert printed(np.array(0.0)) == pytest.approx(2 * x_d - x_0)
    assert abs((printed(np.array(h)) - printed(np.array(0.0))) / h) > 1.0  # nor does it start at rest


def test_3_27_most_profiles_are_not_where_they_are_said_to_be() -> None:
    """x_d = x(T): of 30 only three are within 5 % of the goal after 2 s, so the last sample is no x(∞)."""
    left = [1.0 - float(profile(np.array(2.0))) for profile in thesis_motion_library().profiles]
    assert len(left) == 30
    assert sum(share < 0.05 for share in left) == 3
    far = ProfileModel("position", ProfileLibrary([overdamped(4.0, 100.0)], STEP_S), Noise(1.0, 0.01))
    rows = rows_after(far, positions(np.linspace(0, 1, 21)[:, None] * [0.2, 0.0, 0.0]))
    own = (0.2 * left[4]) ** 2  # what the last sample, as its own target, still leaves
    assert left[4] == max(left)
    assert far.residuals(rows)[0, 0, 0] > own > 1e-2


def test_3_28_an_axis_that_does_not_move_is_no_division_by_zero() -> None:
    library = thesis_motion_library()
    values = np.outer(library.profiles[0](STEP_S * np.arange(12)), [0.2, 0.0, 0.0])

    def printed(x: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            ratio = (x - x[-1]) / (x[0] - x[-1])
        e = 1.0 - library.values(np.arange(12))
        return ((ratio[:, None] - e) ** 2).sum(axis=0)

    model = ProfileModel("position", library, Noise(1.0, 0.025))
    implemented = model.residuals(rows_after(model, positions(values)))[0]
    assert np.isnan(printed(values[:, 1])).all()
    np.testing.assert_array_equal(implemented[1], 0.0)  # in metres: it explains itself perfectly
    assert np.isfinite(evidence(model, positions(values)))


# Known mean


def printed_known_mean(n: int, ssr: np.ndarray, nu0: float, scale2: float) -> np.ndarray:
    """(3.31), (3.41)."""
    nu_n, start, end = nu0 + n, 0.5 * nu0 * scale2, 0.5 * (nu0 * scale2 + ssr)
    return gammaln(nu_n / 2) - 0.5 * nu_n * np.log(end) - gammaln(nu0 / 2) + 0.5 * nu0 * np.log(start)


def test_3_31_and_3_41_evidence_is_a_density() -> None:
    x = np.sinh(np.linspace(-9.0, 9.0, 4001))
    implemented = np.exp(known_mean_log_evidence(1, x**2, 3.0, 0.25))
    printed = np.exp(printed_known_mean(1, x**2, 3.0, 0.25))
    assert integrate.trapezoid(implemented, x) == pytest.approx(1.0, abs=1e-5)
    assert integrate.trapezoid(printed, x) == pytest.approx(np.sqrt(2 * np.pi), abs=1e-4)
    missing = known_mean_log_evidence(7, 2.0, 3.0, 0.25) - printed_known_mean(7, np.array(2.0), 3.0, 0.25)
    assert missing == pytest.approx(-3.5 * np.log(2 * np.pi))


def test_3_39_the_maximum_over_profiles_is_no_density() -> None:
    """Of a force halfway to a known goal: the profiles' densities average to one, their maximum does not."""
    rates, goal, sigma = (1.0, 4.0, 15.0), 10.0, 1.0
    means = [goal * float(first_order(rate)(np.array(0.2))) for rate in rates]
    f = np.linspace(-40.0, 60.0, 4001)
    each = np.array([stats.t.pdf(f, 10.0, mean, sigma) for mean in means])
    assert integrate.trapezoid(each.mean(axis=0), f) == pytest.approx(1.0, abs=1e-4)
    assert integrate.trapezoid(each.max(axis=0), f) > 2.0

    def reported(rates: tuple[float, ...], choice: str) -> float:
        library = ProfileLibrary([first_order(rate) for rate in rates], STEP_S)
        model = ProfileModel("force", library, Noise(10.0, 1.25, joint=True), choice, origin="zero")  # type: ignore[arg-type]
        return evidence(model, forces(np.outer([0.5, 3.0, 6.0, 8.0], [0.1, 0.0, 1.0])))

    alone = np.array([reported((rate,), "mixture") for rate in rates])
    assert reported(rates, "mixture") == pytest.approx(float(log_mean_exp(alone)))
    assert reported(rates, "maximum") == pytest.approx(alone.max())  # the thesis' variant, by its name


def test_3_42_to_3_45_a_known_profile_leaves_only_the_variance_to_learn() -> None:
    """Predictive t_ν(f_d φ, σ_n²); printed with (κ_n + 1)/κ_n, and there is no κ in it."""
    profile, nu0, scale2 = first_order(5.0), 10.0, 1.25**2
    values = np.outer([0.2, 4.0, 7.0, 9.5, 10.0], [0.3, 0.0, 1.0])
    phi = profile(STEP_S * np.arange(5))

    def log_product(widened) -> float:
        total = 0.0
        for axis in range(3):
            ssr = 0.0
            for n in range(5):
                residual = values[n, axis] - values[-1, axis] * phi[n]
                variance = (nu0 * scale2 + ssr) / (nu0 + n)
                total += stats.t.logpdf(residual, nu0 + n, 0.0, np.sqrt(variance * widened(n)))
                ssr += residual**2
        return total

    model = ProfileModel("force", ProfileLibrary([profile], STEP_S), Noise(nu0, 1.25), origin="zero")
    assert evidence(model, forces(values)) == pytest.approx(log_product(lambda n: 1.0), abs=1e-9)
    assert abs(log_product(lambda n: (n + 2.0) / (n + 1.0)) - evidence(model, forces(values))) > 0.5


# Contact, and all together


def test_3_54_to_3_57_the_next_force_may_come_from_any_state() -> None:
    """Predictive Σ_k (α_k + c_k)/(Σα + n) N_k; printed: of the likeliest state alone, which sums to less."""
    past = forces(np.random.default_rng(3).normal(0.0, 0.8, (4, 3)))
    places = everywhere("force", np.zeros(3), 0.6, reach=3.2)
    for u in (FREE, CONTACT, TRANSPORT):
        assert mass(ContactMixture(u, contact2=2.0), past, places) == pytest.approx(1.0, abs=0.01)

    lightest = np.array([0.0, 0.0, -0.2 * GRAVITY])
    at = np.array([place.force for place in places[0]])
    states = ((0.0, 0.75), (0.0, 2.75), (lightest, 0.75))  # means and variances before anything is known
    each = [
        stats.multivariate_normal.pdf(at - mean, np.zeros(3), variance) / 3.0 for mean, variance in states
    ]
    assert places[1] @ np.sum(each, axis=0) == pytest.approx(1.0, abs=0.01)
    printed = np.max(each, axis=0)
    assert places[1] @ printed < 0.8


def test_3_61_to_3_64_the_kinds_of_segments_have_a_prior_and_are_averaged() -> None:
    channels = {
        "low": ConstantLevel("force", Noise(4.0, 0.5, joint=True), "zero"),
        "high": ConstantLevel("force", Noise(4.0, 2.0, joint=True), "zero"),
    }
    kinds = (
        SegmentKind("motion", "motion", "free", ("low",)),
        SegmentKind("steady", "steady", "free", ("high",)),
    )
    mixture, maximum = (Whole(SegmentModelSet(channels, kinds, choice)) for choice in ("mixture", "maximum"))
    start, places = forces(np.zeros((1, 3))), everywhere("force", np.zeros(3), 0.5)
    assert mass(mixture, start, places) == pytest.approx(1.0, abs=0.01)
    printed = 2.0 * mass(maximum, start, places)  # no prior over u: each kind counts in full
    assert printed > 1.4

    reported = np.array([evidence(model, forces(np.ones((3, 3)))) for model in channels.values()])
    assert evidence(mixture, forces(np.ones((3, 3)))) == pytest.approx(
        float(log_sum_exp(reported)) - np.log(2.0)
    )


def test_the_load_that_was_carried() -> None:
    """257 g for 1.5 s and 293 g for 1.8 s (Tab. 4.17): 275 g on average, 276.6 g by time; printed 273 g."""
    loads, seconds, printed = np.array([0.257, 0.293]), np.array([1.5, 1.8]), 0.273
    assert loads.mean() == pytest.approx(0.275)
    by_time = float(loads @ seconds / seconds.sum())
    assert by_time == pytest.approx(0.2766, abs=5e-5)
    apps = program(
        segment("transport", 4.2, 5.7, load_kg=loads[0], load_sd_kg=0.01),
        segment("transport", 5.7, 7.5, load_kg=loads[1], load_sd_kg=0.01),
        at=stopping_at,
    )
    assert [app.load_kg for app in apps] == [pytest.approx(by_time)] * 2
    assert abs(printed - loads.mean()) > 0.0015
