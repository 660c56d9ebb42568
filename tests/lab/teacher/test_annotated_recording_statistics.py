"""The simulation against the statistics of real recordings (data/PROVENANCE.md has the table)."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_lab.teacher.annotated_recording_statistics import STATISTICS, measure
from caesura_lab.teacher.simulated_teaching import Demonstration
from lab.teacher.nominal import nominal_once


@pytest.fixture(scope="module")
def statistics(demonstrations: list[Demonstration]) -> dict[str, list[float]]:
    """Statistics of the thesis' person in every scenario together."""
    together: dict[str, list[float]] = {}
    for demonstration in demonstrations:
        for name, values in measure(demonstration.recording, demonstration.truth).items():
            together.setdefault(name, []).extend(values)
    return together


@pytest.mark.parametrize(
    ("statistic", "low", "high"),
    [
        ("position_noise", 2.0, 15.0),
        ("force_noise_rest", 0.02, 0.22),
        ("force_noise_motion", 0.1, 1.0),
        ("peak_speed", 0.02, 0.6),
        ("pause", 0.13, 4.6),
        ("impact", 2.0, 118.0),
    ],
)
def test_statistics_lie_within_real_ones(
    statistics: dict[str, list[float]], statistic: str, low: float, high: float
) -> None:
    assert statistic in STATISTICS
    assert low <= min(statistics[statistic])
    assert max(statistics[statistic]) <= high


@pytest.mark.parametrize(
    ("statistic", "low", "high"), [("move", 0.7, 2.1), ("release", 0.15, 0.5), ("rise_to_8N", 0, 0.3)]
)
def test_medians_are_like_real_ones(
    statistics: dict[str, list[float]], statistic: str, low: float, high: float
) -> None:
    assert low <= np.median(statistics[statistic]) <= high


def test_a_hand_in_the_wrench_has_most_power_below_a_few_hertz() -> None:
    demonstration = nominal_once("three_point", wrench_source="flange_sensor_with_hand")
    found = measure(demonstration.recording, demonstration.truth)
    assert found["half_power"][0] < 0.8
    assert found["power_90"][0] < 5.5
    assert 2.0 < np.linalg.norm(demonstration.recording.signals["force"], axis=1).max() < 26.0


def test_pauses_are_almost_still_but_not_quite(
    pick_and_place: Demonstration, dispenser: Demonstration
) -> None:
    rest = [s for s in dispenser.truth["segments"] if s["cls"] == "steady"][1]
    t = dispenser.recording.t
    inside = (t > rest["t0"] + 0.1) & (t < rest["t1"] - 0.1)
    spread = np.ptp(dispenser.recording.signals["pos"][inside], axis=0).max()
    assert 1e-5 < spread < 2e-3
