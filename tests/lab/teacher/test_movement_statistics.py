"""Statistics of movements, from signals where the right answer is plain to see."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from caesura_lab.teacher.motion_profiles import minimum_jerk
from caesura_lab.teacher.movement_statistics import STATISTICS, clear_dips, main, measure, speed_peaks
from caesura_protocol.recording import Recording

T = np.arange(0.0, 6.0, 0.002)
STILL = np.zeros((T.size, 3))


def stroke(begin: float, seconds: float, way: tuple[float, float, float]) -> np.ndarray:
    return np.outer(minimum_jerk(np.clip((T - begin) / seconds, 0.0, 1.0)), way)


def test_a_straight_stroke_has_one_peak_and_no_bow() -> None:
    found = measure(T, stroke(1.0, 1.5, (0.2, 0.0, 0.0)), STILL)
    assert found["peaks_per_movement"] == [1.0]
    assert found["clear_dips_per_second"] == [0.0]
    assert found["bow"][0] < 1e-6
    assert found["length"] == pytest.approx([0.2], abs=0.005)
    assert found["peak_speed"] == pytest.approx([1.875 * 0.2 / 1.5], rel=0.03)
    assert set(found) == set(STATISTICS)


def test_a_bowed_stroke_is_measured_across_its_chord() -> None:
    position = stroke(1.0, 2.0, (0.2, 0.0, 0.0))
    position[:, 1] = 0.04 * np.sin(np.pi * position[:, 0] / 0.2)
    assert measure(T, position, STILL)["bow"] == pytest.approx([0.2], abs=0.02)


def test_two_strokes_apart_are_two_movements_and_overlapping_ones_are_one() -> None:
    for second, count in ((3.5, 2), (1.75, 1)):
        position = stroke(1.0, 1.0, (0.1, 0.0, 0.0)) + stroke(second, 1.0, (0.1, 0.0, 0.0))
        found = measure(T, position, STILL)
        assert len(found["duration"]) == count
        assert sum(found["peaks_per_movement"]) == 2.0


def test_creep_is_a_share_of_the_rest() -> None:
    position = stroke(0.5, 1.0, (0.1, 0.0, 0.0))
    position[:, 0] += 0.005 * np.clip(T - 4.0, 0.0, 1.0)
    found = measure(T, position, STILL)
    assert found["creep_speed"] == pytest.approx([5.0], abs=0.5)
    assert found["creep_share"] == pytest.approx([0.22], abs=0.05)


def test_force_noise_is_of_motion_and_levels_are_of_rests() -> None:
    force = np.random.default_rng(1).normal(size=(T.size, 3)) * ((T > 1.0) & (T < 2.5))[:, None]
    force[T > 2.0, 2] += 2.0
    found = measure(T, stroke(1.0, 1.5, (0.2, 0.0, 0.0)), force)
    assert found["rest_force"] == pytest.approx([2.0], abs=0.1)
    assert 0.3 < found["force_noise"][0] < 1.1


def test_peaks_and_dips_of_a_speed() -> None:
    two = np.abs(np.sin(np.linspace(0.0, 2.0 * np.pi, 200))) * 0.1
    assert speed_peaks(two) == 2
    assert clear_dips(two) == [pytest.approx(100, abs=1)]
    assert clear_dips(0.05 + two) == [pytest.approx(100, abs=1)]
    assert clear_dips(0.2 + two) == []


@pytest.mark.slow
def test_the_table_has_a_column_a_set_and_a_line_a_statistic(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("caesura_lab.teacher.movement_statistics.BASIC", ("parkour",))
    signals = {"pos": stroke(1.0, 1.5, (0.2, 0.0, 0.0)), "force": STILL}
    Recording(T, signals).save(tmp_path / "mine_0.npz")
    main([str(tmp_path), "--people", "3", "3"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "| statistic | mine | ideal | habits |"
    assert len(lines) == 2 + len(STATISTICS)


def test_a_steady_speed_has_the_innovation_that_its_memory_leaves() -> None:
    """At 15 mm/s a step is 1.5 mm; a velocity that lasts for 0.5 s explains all but (1 − ρ)² of it."""
    position = np.outer(T, (0.015, 0.0, 0.0))
    found = measure(T, position, STILL)
    left = (1.0 - np.exp(-0.2)) ** 2 * 1.5 / np.sqrt(3.0)
    assert np.median(found["innovation_slow"]) == pytest.approx(left, rel=1e-3)
    assert found["innovation_fast"] == []
