from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from caesura_lab.teacher.motion_profiles import (
    PROFILES,
    UNIT_RESPONSES,
    Profile,
    Stroke,
    path,
    time_of_share,
)

TAU = np.linspace(0.0, 1.0, 1001)


def peak(profile: Profile) -> float:
    """When a movement is fastest, as a share of its duration."""
    return float(TAU[np.argmax(np.gradient(UNIT_RESPONSES[profile](TAU), TAU))])


@pytest.mark.parametrize("profile", PROFILES)
def test_every_profile_goes_from_0_to_1_and_never_back(profile: Profile) -> None:
    response = UNIT_RESPONSES[profile](TAU)
    assert_allclose(response[[0, -1]], [0.0, 1.0], atol=1e-9)
    assert np.all(np.diff(response) >= 0.0)


def test_minimum_jerk_speed_is_a_symmetric_bell() -> None:
    speed = np.gradient(UNIT_RESPONSES["minimum_jerk"](TAU), TAU)
    assert peak("minimum_jerk") == pytest.approx(0.5, abs=0.01)
    assert_allclose(speed, speed[::-1], atol=1e-6)
    assert speed.max() == pytest.approx(1.875, abs=1e-3)  # Flash & Hogan 1985: 15/8 of the mean


def test_overdamped_is_fastest_at_its_begin() -> None:
    assert peak("overdamped") < 0.2


def test_overdamped_solves_its_differential_equation() -> None:
    x = UNIT_RESPONSES["overdamped"](TAU)
    v = np.gradient(x, TAU)
    a = np.gradient(v, TAU)
    rest = a + 20.0 * v + 60.0 * x
    assert np.ptp(rest[5:-5]) < 0.02 * rest.mean()


def test_lognormal_peaks_early_and_tails_off() -> None:
    assert 0.25 < peak("lognormal") < 0.45


@pytest.mark.parametrize("profile", PROFILES)
def test_time_of_share_inverts_the_profile(profile: Profile) -> None:
    tau = time_of_share(profile, 0.9)
    assert UNIT_RESPONSES[profile](np.array([tau]))[0] == pytest.approx(0.9, abs=1e-3)


def test_strokes_add_up_and_a_deviation_comes_back() -> None:
    t = np.linspace(0.0, 4.0, 4001)
    wild = Stroke(0.5, 1.0, np.array([0.1, 0.0, 0.0]), deviation=np.full((4, 3), 0.02))
    plain = Stroke(1.2, 2.0, np.array([0.0, -0.2, 0.0]))
    positions = path((1.0, 1.0, 1.0), [wild, plain], t)
    assert_allclose(positions[0], [1.0, 1.0, 1.0])
    assert_allclose(positions[-1], [1.1, 0.8, 1.0], atol=1e-12)
    assert np.abs(positions[:, 2] - 1.0).max() > 0.005


def test_overlapping_strokes_pass_without_stopping() -> None:
    t = np.linspace(0.0, 2.0, 2001)
    first = Stroke(0.0, 1.2, np.array([0.2, 0.0, 0.0]))
    second = Stroke(0.8, 1.2, np.array([0.0, 0.2, 0.0]))
    speed = np.linalg.norm(np.gradient(path((0.0, 0.0, 0.0), [first, second], t), t, axis=0), axis=1)
    assert speed[800:1200].min() > 0.05
