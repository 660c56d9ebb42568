"""Evidence against direct sums and known densities.

test_channel_model_checks.py has what holds for every model.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from caesura_service.changepoint.channel_model import ChannelModel, ModelInput, Noise, Rows, select
from caesura_service.changepoint.constant_models import GripperHoldingChain, LoadForce, ThesisLoadForce
from caesura_service.changepoint.constant_velocity import ConstantVelocity
from caesura_service.changepoint.contact_mixture import ContactMixture
from caesura_service.changepoint.evidence import known_mean_log_evidence, log_mean_exp, log_sum_exp
from caesura_service.changepoint.profile_library import (
    ProfileLibrary,
    first_order,
    lognormal,
    minimum_jerk,
    overdamped,
    whiten,
)
from caesura_service.changepoint.profile_model import DisplacementPrior, ProfileModel
from caesura_service.changepoint.thesis_presets import thesis_force_library, thesis_motion_library


def rows_after(model: ChannelModel, data: np.ndarray, channel: str = "position") -> Rows:
    """All hypotheses after some values (n, 3) in one channel."""
    rows = model.empty()
    for value in data:
        position, force = (value, np.zeros(3)) if channel == "position" else (np.zeros(3), value)
        rows = model.extend(rows, ModelInput(position, force))
    return rows


@pytest.mark.parametrize(
    ("n", "ssr", "nu0", "scale2"), [(1, 0.0, 1.0, 0.25), (5, 2.0, 1.0, 0.5), (9, 0.3, 10.0, 1.5)]
)
def test_known_mean_evidence_is_the_integral_over_the_variance(
    n: int, ssr: float, nu0: float, scale2: float
) -> None:
    def integrand(log_variance: float) -> float:
        variance = np.exp(log_variance)
        likelihood = (2 * np.pi * variance) ** (-n / 2) * np.exp(-ssr / (2 * variance))
        return likelihood * stats.invgamma.pdf(variance, nu0 / 2, scale=nu0 * scale2 / 2) * variance

    expected, _ = integrate.quad(integrand, -40, 60, limit=500)
    assert known_mean_log_evidence(n, ssr, nu0, scale2) == pytest.approx(np.log(expected), abs=1e-6)


def test_known_mean_evidence_is_the_product_of_its_predictives() -> None:
    values = np.random.default_rng(0).normal(0, 0.7, 12)
    nu0, scale2 = 3.0, 0.4
    total, ssr = 0.0, 0.0
    for i, value in enumerate(values):
        scale = np.sqrt((nu0 * scale2 + ssr) / (nu0 + i))
        total += stats.t.logpdf(value, nu0 + i, 0.0, scale)
        ssr += value**2
    assert known_mean_log_evidence(values.size, ssr, nu0, scale2) == pytest.approx(total, abs=1e-10)


def test_log_sums_do_not_overflow_and_know_nothing_from_nothing() -> None:
    assert log_sum_exp(np.array([-1000.0, -1000.0])) == pytest.approx(-1000.0 + np.log(2.0))
    assert log_mean_exp(np.array([700.0, 700.0])) == pytest.approx(700.0)
    assert log_sum_exp(np.array([-np.inf, -np.inf])) == -np.inf


@pytest.mark.parametrize("origin", ["previous", "first", "zero"])
@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_recursive_sums_of_a_profiled_channel_equal_the_direct_ones(origin: str, correlation: float) -> None:
    rng = np.random.default_rng(1)
    data = np.cumsum(rng.normal(0, 0.02, (40, 3)), axis=0) + np.array([0.4, -0.3, 0.2])
    profiles = [overdamped(8.0, 32.5), minimum_jerk(1.3), minimum_jerk(0.4)]
    model = ProfileModel(
        "position",
        ProfileLibrary(profiles, 0.1, correlation),
        Noise(1.0, 0.01, correlation=correlation),
        origin=origin,
    )  # type: ignore[arg-type]
    got = model.residuals(rows_after(model, data))
    for start in range(len(data)):
        offset = int(origin == "previous")
        begin = {"previous": data[max(start - 1, 0)], "first": data[start], "zero": np.zeros(3)}[origin]
        y = data[start:] - begin
        t = 0.1 * (np.arange(len(y)) + offset)
        for k, profile in enumerate(profiles):
            residual = y - y[-1] * profile(t)[:, None]
            before = np.vstack([np.zeros(3), residual[:-1]])
            fresh = whiten(residual, before, correlation)
            if origin != "previous":
                fresh[0] = residual[0]
            np.testing.assert_allclose(got[start, :, k], (fresh**2).sum(axis=0), atol=1e-9)


def test_sums_stay_good_far_from_the_origin_and_after_a_long_time() -> None:
    rng = np.random.default_rng(2)
    data = 1000.0 + rng.normal(0, 1e-3, (3000, 3))
    model = ProfileModel("position", thesis_motion_library(), Noise(1.0, 0.025))
    rows = model.empty()
    for value in data:
        rows = select(model.extend(rows, ModelInput(value, np.zeros(3))), np.array([0]))
    y = data - data[0]
    phi = np.column_stack([p(0.1 * np.arange(len(y))) for p in model.library.profiles])
    direct = ((y[:, :, None] - y[-1][None, :, None] * phi[:, None, :]) ** 2).sum(axis=0)
    np.testing.assert_allclose(model.residuals(rows)[0], direct, atol=1e-9)


def test_a_load_has_a_density_that_integrates_to_one() -> None:
    model = LoadForce(Noise(2.0, 0.3, joint=True), bias=1.5)
    down = np.linspace(-60, 60, 120_001)
    mean = np.column_stack([np.zeros_like(down), np.zeros_like(down), down])
    variance = np.full((down.size, 1), 0.01)
    sideways = 2 * stats.norm.logpdf(0.0, 0.0, np.sqrt(1.5**2 + 0.01))
    density = np.exp(model.mean_log_density(mean, variance) - sideways)
    assert integrate.trapezoid(density, down) == pytest.approx(1.0, abs=1e-4)


def test_the_target_of_a_movement_has_a_density_that_integrates_to_one() -> None:
    target = DisplacementPrior(reach=2.0, least=1.0)
    axis = np.linspace(-14, 14, 113)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    density = np.exp(target.log_density(grid))
    assert density.sum() * (axis[1] - axis[0]) ** 3 == pytest.approx(1.0, abs=1e-3)


def test_an_unknown_gripper_says_nothing() -> None:
    rows = GripperHoldingChain(0.2).extend(
        GripperHoldingChain(0.2).empty(), ModelInput(np.zeros(3), np.zeros(3))
    )
    assert GripperHoldingChain(0.2).log_evidence(rows).tolist() == [0.0]


def test_a_load_is_found_from_the_weight_and_has_a_least() -> None:
    model = ThesisLoadForce(Noise(1.0, 0.5), least_kg=0.2)
    heavy = rows_after(model, np.tile([0.0, 0.0, -0.5 * 9.81], (10, 1)), "force")
    none = rows_after(model, np.zeros((10, 3)), "force")
    assert model.log_evidence(heavy)[0] > model.log_evidence(none)[0]


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_pooled_axes_turn_with_the_base_frame(share: float) -> None:
    rng = np.random.default_rng(6)
    data = np.cumsum(rng.normal(0, 0.02, (15, 3)), axis=0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    noise = Noise(2.0, 0.001, shares=(share,), joint=True, correlation=0.8)
    library = ProfileLibrary([minimum_jerk(0.7), minimum_jerk(1.5)], 0.1, 0.8)
    model = ProfileModel("position", library, noise, origin="previous", target=DisplacementPrior(0.2, 0.005))
    straight = model.log_evidence(rows_after(model, data))
    turned = model.log_evidence(rows_after(model, data @ turn.T))
    np.testing.assert_allclose(turned, straight, atol=1e-8)


def test_profiles_begin_at_zero_and_settle_at_one() -> None:
    late = np.array([0.0, 500.0])
    for profile in (*thesis_motion_library().profiles, *thesis_force_library().profiles, minimum_jerk(1.0)):
        np.testing.assert_allclose(profile(late), [0.0, 1.0], atol=1e-6)


def test_a_lognormal_movement_is_early_and_arrives() -> None:
    course = lognormal(1.5)(np.array([0.0, 0.75, 1.5, 9.0]))
    assert course[0] == 0.0
    assert course[1] > 0.8  # of the way in half of the time
    assert course[2] == pytest.approx(0.99)
    assert course[3] == pytest.approx(1.0, abs=1e-3)


def test_a_profile_that_is_not_overdamped_is_refused() -> None:
    with pytest.raises(ValueError, match="not overdamped"):
        overdamped(30.0, 10.0)


def test_a_library_whitened_for_another_correlation_is_refused() -> None:
    with pytest.raises(ValueError, match=r"correlation 0\.5"):
        ProfileModel(
            "position", ProfileLibrary([minimum_jerk(1.0)], 0.1, 0.5), Noise(1.0, 0.1, correlation=0.8)
        )


def test_constant_velocity_is_a_multivariate_student_t() -> None:
    rng = np.random.default_rng(8)
    data = np.cumsum(rng.normal(0, 0.01, (9, 3)), axis=0)
    model = ConstantVelocity(nu0=1.0, sigma2=0.5, kappa0=1.0, length_unit_m=0.01, step_s=0.1)
    got = model.log_evidence(rows_after(model, data))
    for start in range(len(data)):
        y = (data[start:] - data[start]) / 0.01
        phi = np.column_stack([np.ones(len(y)), 0.1 * np.arange(len(y))])
        shape = 0.5 * (np.eye(len(y)) + phi @ phi.T)
        expected = sum(
            stats.multivariate_t.logpdf(y[:, axis], np.zeros(len(y)), shape, df=1.0) for axis in range(3)
        )
        assert got[start] == pytest.approx(expected, abs=1e-9)


def test_the_shares_of_the_contact_model_add_up_to_the_product_of_its_predictives() -> None:
    data = np.random.default_rng(9).normal([0.0, 0.0, -2.0], 1.5, (8, 3))
    parts = [
        model.log_evidence(rows_after(model, data, "force"))[0]
        for model in (ContactMixture(0), ContactMixture(1), ContactMixture(2))
    ]
    counts, total = np.full(3, 10.0), 0.0
    for i, force in enumerate(data):
        mean_z = data[:i, 2].mean() if i else 0.0
        weight = min(mean_z, -0.2 * 9.81)
        means = np.array([[0, 0, 0], [0, 0, 0], [0, 0, weight]])
        density = [
            np.prod(stats.norm.pdf(force, mean, np.sqrt(variance)))
            for mean, variance in zip(means, (0.75, 20.75, 0.75), strict=True)
        ]
        joint = counts / counts.sum() * density
        total += np.log(joint.sum())
        counts = counts + joint / joint.sum()
    assert log_sum_exp(np.array(parts)) - np.log(3.0) == pytest.approx(total, abs=1e-9)


@pytest.mark.parametrize("rest_scale_ratio", [1.0, 0.3])
def test_a_table_ends_where_its_profiles_rest_and_says_the_same_of_an_hour(rest_scale_ratio):
    profiles = [minimum_jerk(0.7), lognormal(2.0), first_order(3.0)]
    short, long = (ProfileLibrary(profiles, 0.1, 0.8, rest_scale_ratio) for _ in range(2))
    long._at_rest = False
    long._tabulate(1 << 16)
    index = np.array([3, 70, 500, 36_000])
    for name in ("values", "precisions", "sums_of_squares", "log_scales"):
        np.testing.assert_allclose(getattr(short, name)(index), getattr(long, name)(index), rtol=1e-12)
    assert len(short._values) <= 1024
