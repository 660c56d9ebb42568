"""Movements with habits: where they lead, how they bow, and how many peaks they have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from caesura_lab.teacher.habits import IDEAL, draw_habits
from caesura_lab.teacher.motion_profiles import PROFILES, Profile
from caesura_lab.teacher.movement_statistics import clear_dips, speed_peaks
from caesura_lab.teacher.submovement_synthesis import (
    Submovement,
    Sweep,
    curve,
    draw_bow,
    draw_submovements,
)

WAY = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]])
T = np.arange(0.0, 3.0, 0.01)


def sweep(seed: int, profile: Profile = "minimum_jerk") -> Sweep:
    rng = np.random.default_rng(seed)
    habits = draw_habits(rng)
    bow = draw_bow(WAY, habits, rng, flat=False)
    return Sweep(0.5, 2.0, WAY, draw_submovements(2.0, habits, rng), profile, bow)


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("seed", range(8))
def test_a_sweep_starts_at_its_start_and_ends_at_its_goal(seed: int, profile: Profile) -> None:
    moved = sweep(seed, profile).positions(T)
    assert_allclose(moved[T <= 0.5], 0.0, atol=1e-12)
    assert_allclose(moved[T >= 2.5], np.broadcast_to(WAY[1], moved[T >= 2.5].shape), atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_progress_never_goes_back(seed: int) -> None:
    assert np.diff(sweep(seed).progress(np.linspace(0.0, 1.0, 500))).min() > -1e-9


def test_ideal_habits_make_one_submovement() -> None:
    found = draw_submovements(5.0, IDEAL, np.random.default_rng(1))
    assert found == (Submovement(0.0, 1.0, 1.0),)


def test_people_make_several_peaks_and_bow_by_centimetres() -> None:
    speeds, bows = [], []
    for seed in range(60):
        moved = sweep(seed).positions(T)
        speeds.append(np.linalg.norm(np.gradient(moved, 0.01, axis=0), axis=1))
        bows.append(np.linalg.norm(moved[:, 1:], axis=1).max())
    peaks = [speed_peaks(speed) for speed in speeds]
    assert 1.2 < np.mean(peaks) < 3.0
    assert max(peaks) <= 5
    assert 0.015 < np.median(bows) < 0.06
    assert max(bows) < 0.17


def test_a_pause_within_a_movement_is_a_clear_dip() -> None:
    habits = replace(IDEAL, submovement_s=0.7, overlap=0.6, pause=1.0)
    for seed in range(10):
        submovements = draw_submovements(2.0, habits, np.random.default_rng(seed))
        moved = Sweep(0.5, 2.0, WAY, submovements).positions(T)
        speed = np.linalg.norm(np.gradient(moved, 0.01, axis=0), axis=1)
        assert len(submovements) > 1
        assert min(speed[i] for i in clear_dips(speed)) < 0.01


def test_a_flat_bow_stays_in_its_plane_and_across_the_chord() -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        bow = draw_bow(WAY, draw_habits(rng), rng, flat=True)
        assert_allclose(bow[:, [0, 2]], 0.0, atol=1e-12)


def test_a_curve_passes_its_places() -> None:
    places = np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.0], [0.2, 0.0, 0.1]])
    found = curve(places, np.linspace(0.0, 1.0, 2001))
    for place in places:
        assert np.linalg.norm(found - place, axis=1).min() < 1e-3
