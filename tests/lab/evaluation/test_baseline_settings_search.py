"""How settings of baselines are chosen_settings, and that those in use come from the grid."""

from __future__ import annotations

from dataclasses import asdict, replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.evaluation.baselines import baseline_settings_search, chosen_settings
from caesura_lab.evaluation.baselines.baseline_settings_search import (
    FIRST_SEED,
    SEARCHES,
    SEEDS,
    SettingsSearch,
    choose,
    lines,
    pooled_f1,
)
from caesura_lab.evaluation.baselines.bocpd_baseline import student_speed
from caesura_lab.evaluation.baselines.chosen_settings import KernelSettings, StudentSettings
from caesura_lab.evaluation.baselines.conditioned_signals import Signals
from caesura_lab.evaluation.baselines.features import log_features, vector_features
from caesura_lab.evaluation.baselines.third_party_baselines import kernel
from caesura_lab.evaluation.cases.suites import OPEN, FileCase, SuiteOptions
from caesura_lab.evaluation.methods import baselines
from caesura_lab.ground_truth import TrueChangepoint, Truth

BUTTON = Path(__file__).parents[3] / "data" / "button.npz"
N, STEP_S = 90, 0.1


def signals(seed: int = 0, *, force_shows_contact: bool = True) -> Signals:
    """Rest, movement from 3.0 s to 6.0 s, rest; a force of 8 N from 7.0 s on."""
    rng = np.random.default_rng(seed)
    velocity, force = rng.normal(0.0, 0.0005, (N, 3)), rng.normal(0.0, 0.1, (N, 3))
    velocity[30:60, 0] += 0.1 + 0.02 * np.sin(np.arange(30) / 4)
    force[70:, 2] += 8.0
    return Signals(
        t=STEP_S * np.arange(N),
        position_base=np.cumsum(velocity * STEP_S, axis=0),
        velocity_base=velocity,
        speed=np.linalg.norm(velocity, axis=1),
        force_base=force,
        holding=np.zeros(N, dtype=bool),
        force_shows_contact=force_shows_contact,
        tared=True,
    )


TRUTH = Truth(
    "one",
    (0.0, 9.0),
    (TrueChangepoint(2.95, 0.05), TrueChangepoint(5.95, 0.05), TrueChangepoint(6.95, 0.05, optional=True)),
)
DEMONSTRATIONS = [(signals(seed), TRUTH) for seed in range(3)]


def starts_every(signals: Signals, settings: StudentSettings) -> np.ndarray:
    """A stand-in for a detector: a start each `least_s` from `mean_segment_s` on."""
    first, step = round(settings.mean_segment_s / STEP_S), round(settings.least_s / STEP_S)
    return np.arange(first, N, step)


def test_the_best_of_a_grid_is_chosen():
    grid = {"mean_segment_s": (1.0, 2.0, 3.0, 4.0), "least_s": (1.0, 2.0, 3.0)}
    search = SettingsSearch("STUDENT", starts_every, StudentSettings(mean_segment_s=1.0, least_s=1.0), grid)
    choice = choose(search, DEMONSTRATIONS)
    rated = {
        values: pooled_f1(
            starts_every, replace(search.begin, **dict(zip(grid, values, strict=True))), DEMONSTRATIONS
        )
        for values in product(*grid.values())
    }
    best = max(rated, key=rated.__getitem__)
    assert best == (3.0, 3.0)  # 3.0 s and 6.0 s, and nothing else that counts
    assert (choice.settings.mean_segment_s, choice.settings.least_s) == best
    assert choice.f1 == rated[best] == 1.0
    assert 1 < choice.tried <= 2 * len(rated) + 1  # from the beginning, and from the settings in use


def test_the_search_begins_at_the_settings_in_use_too():
    """It found 0.845 for the kernel where the settings in use had 0.855."""
    mute = StudentSettings(mean_segment_s=1000.0, spread=100.0)
    choice = choose(SettingsSearch("STUDENT", student_speed, mute, {}), DEMONSTRATIONS)
    assert pooled_f1(student_speed, mute, DEMONSTRATIONS) < choice.f1 == choice.in_use_f1
    assert choice.settings == chosen_settings.STUDENT


def test_f1_is_pooled_over_demonstrations():
    truths = [replace(TRUTH, points=TRUTH.points[:count]) for count in (1, 2)]
    some = [(signals(), truth) for truth in truths]
    sparse = StudentSettings(mean_segment_s=3.0, least_s=60.0)
    assert pooled_f1(starts_every, sparse, some) == pytest.approx(2 * 2 / (2 * 2 + 0 + 1))


def test_a_table_is_printed_that_can_stand_in_the_code():
    grid = {"mean_segment_s": (3.0,)}
    line = next(
        lines([choose(SettingsSearch("STUDENT", starts_every, StudentSettings(), grid), DEMONSTRATIONS)])
    )
    name, value = line.split("  #")[0].split(" = ", 1)
    assert name == "STUDENT"
    assert eval(value, vars(chosen_settings)) == replace(StudentSettings(), mean_segment_s=3.0)


@pytest.mark.parametrize("search", SEARCHES, ids=lambda search: search.name)
def test_settings_in_use_come_from_the_grid(search: SettingsSearch):
    used = asdict(getattr(chosen_settings, search.name))
    for field, value in used.items():
        reached = [*search.grid.get(field, ()), *(restart.get(field) for restart in search.restarts)]
        assert value in [*reached, getattr(search.begin, field)]


@pytest.mark.parametrize("name", ["BOCPD log", "BOCPD speed", "kernel"])
@pytest.mark.parametrize("seed", range(3))
def test_new_baselines_find_a_movement_where_it_starts_and_stops(name: str, seed: int):
    (method,) = (one for one in baselines() if one.name == name)
    starts = method.starts(signals(seed))
    assert min(abs(starts - 30)) <= 1
    assert min(abs(starts - 60)) <= 1


@pytest.mark.parametrize("name", ["BOCPD log", "kernel"])
def test_force_counts_where_it_shows_contact_only(name: str):
    (method,) = (one for one in baselines() if one.name == name)
    assert min(abs(method.starts(signals()) - 70)) <= 1
    assert min(abs(method.starts(signals(force_shows_contact=False)) - 70)) > 3


def test_speed_alone_sees_no_force():
    starts = student_speed(signals())
    assert np.array_equal(starts, student_speed(signals(force_shows_contact=False)))


@pytest.mark.parametrize("scale", ["log", "linear"])
def test_speed_is_taken_as_it_is_or_its_logarithm(scale: str):
    starts = student_speed(signals(), StudentSettings(scale=scale, unit_m_per_s=0.005, spread=0.5))
    assert {30, 60} <= set(starts.tolist())


@pytest.mark.parametrize("kind", ["log", "vectors"])
def test_the_kernel_works_on_either_signals(kind: str):
    starts = kernel(signals(), KernelSettings(signals=kind, gamma=0.1, penalty=0.5))
    assert min(abs(starts - 30)) <= 1


def test_a_recording_too_short_for_two_segments_has_none():
    short = signals()
    short = replace(
        short, **{f: getattr(short, f)[:5] for f in ("t", "speed", "velocity_base", "force_base")}
    )
    assert kernel(short).size == 0


def test_features_are_floored_and_leave_force_out_where_it_shows_nothing():
    reported, silent = signals(), signals(force_shows_contact=False)
    rows = log_features(reported, 0.01, 1.0)
    assert rows.shape == (N, 2)
    assert np.exp(rows[:, 0]) - 0.01 == pytest.approx(reported.speed)
    assert rows[:, 1].min() >= 0.0
    assert log_features(silent, 0.01, 1.0).shape == (N, 1)
    assert vector_features(reported, 0.01, 1.0).shape == (N, 6)
    assert vector_features(silent, 0.01, 1.0) == pytest.approx(100.0 * silent.velocity_base)


def test_the_command_prints_one_line_a_baseline(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    asked = []

    def one_recording(name: str, extent: SuiteOptions) -> list[FileCase]:
        asked.append((name, extent.seeds, extent.first_seed, extent.data))
        return [FileCase(BUTTON)]

    small = [replace(search, grid={}, restarts=({},)) for search in SEARCHES]
    monkeypatch.setattr(baseline_settings_search, "suite", one_recording)
    monkeypatch.setattr(baseline_settings_search, "SEARCHES", small)
    baseline_settings_search.main(["--seeds", "3", "--first-seed", "7", "--workers", "1"])
    printed = capsys.readouterr().out.splitlines()
    baseline_settings_search.main(["--suite", "real", "--data", "there", "--workers", "1"])
    assert asked == [("teacher", 3, 7, OPEN), ("real", SEEDS, FIRST_SEED, Path("there"))]
    assert [line.split(" = ")[0] for line in printed] == ["GAUSSIAN", "KERNEL", "STUDENT"]
