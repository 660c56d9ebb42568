"""Telling simulated from real: what is alike cannot be told apart, what differs can, by recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.evaluation.studies import realism
from caesura_lab.evaluation.studies.realism import (
    IDEAL,
    MEASURES,
    NATURAL,
    RealCase,
    SimulatedCase,
    WindowMeasures,
    measures,
    separation,
)
from caesura_lab.ground_truth import TruthError
from caesura_protocol.recording import Recording

K = len(MEASURES)


def windows(
    set_name: str, count: int, seed: int, *, shift: float = 0.0, own: float = 0.0
) -> list[WindowMeasures]:
    """Recordings of 8 windows; shift: of the set in all measures; own: of each recording by itself."""
    rng = np.random.default_rng(seed)
    return [
        WindowMeasures(
            set_name,
            f"{set_name}-{i}",
            shift + own * rng.normal(size=K) + rng.normal(size=(8, K)),
            guided=True,
        )
        for i in range(count)
    ]


def test_what_is_alike_is_distinguished_no_better_than_by_chance() -> None:
    found = separation([*windows("a", 30, 1), *windows("b", 30, 2)], "a", range(3))
    assert 0.4 < found.auc < 0.6
    assert found.low < 0.5 < found.high
    assert 0.4 < found.accuracy < 0.6


def test_what_differs_is_distinguished() -> None:
    found = separation([*windows("a", 15, 1), *windows("b", 15, 2, shift=2.0)], "a", range(3))
    assert found.auc > 0.95
    assert found.accuracy > 0.9


def test_windows_of_a_recording_never_stand_on_both_sides() -> None:
    # Each recording differs from all others, and no set from the other: by window, this would be 1.0.
    found = separation([*windows("a", 20, 1, own=5.0), *windows("b", 20, 2, own=5.0)], "a", range(3))
    assert found.auc < 0.75


def test_recordings_of_a_person_never_stand_on_both_sides() -> None:
    """Every person has a way of their own in all recordings: by recording, it was learned."""
    rng = np.random.default_rng(0)
    people = [
        WindowMeasures(name, f"{name}-{person}-{i}", own + rng.normal(size=(8, K)), person=f"{name}-{person}")
        for name in ("a", "b")
        for person in range(8)
        for own in [5.0 * rng.normal(size=K)]
        for i in range(6)
    ]
    found = separation(people, "a", range(3))
    by_recording = separation([replace(one, person="") for one in people], "a", range(3))
    assert found.low < 0.5 < found.high
    assert by_recording.low > 0.9


def test_a_difference_of_spread_is_seen_too() -> None:
    rng = np.random.default_rng(3)
    wide = [WindowMeasures("a", f"a{i}", 3.0 * rng.normal(size=(8, K))) for i in range(20)]
    assert separation([*wide, *windows("b", 20, 4)], "a", [0]).auc > 0.7


def recording(seconds: float = 8.0, rate: float = 200.0) -> Recording:
    t = np.arange(0.0, seconds, 1.0 / rate)
    position = np.column_stack([0.1 * np.sin(t), 0.1 * np.cos(t), np.zeros(t.size)])
    force = np.column_stack([np.sin(2 * np.pi * 3.0 * t), np.zeros(t.size), np.full(t.size, 2.0)])
    return Recording(t, {"pos": position, "force": force})


def test_measures_of_a_circle() -> None:
    signals = recording().signals
    values = measures(recording().t, signals["pos"], signals["force"])
    found = dict(zip(MEASURES, np.median(values, axis=0), strict=True))
    assert values.shape == (7, K)
    assert np.exp(found["mean speed"]) == pytest.approx(0.1, rel=0.02)
    assert np.exp(found["turn a metre"]) == pytest.approx(10.0, rel=0.05)
    assert found["clear dips"] == 0.0
    assert found["force 1-5 Hz"] > found["force 5-12 Hz"] + 2.0


def test_rest_is_no_window() -> None:
    signals = recording().signals
    assert measures(recording().t, 0.01 * signals["pos"], signals["force"]).shape == (0, K)


def test_a_slow_recording_is_left_out(tmp_path: Path) -> None:
    recording().save(tmp_path / "fast_0.npz")
    recording(rate=20.0).save(tmp_path / "slow_0.npz")
    assert RealCase(tmp_path / "slow_0.npz").load() is None
    loaded = RealCase(tmp_path / "fast_0.npz").load()
    assert loaded is not None
    assert (loaded.set_name, loaded.recording, loaded.guided) == ("fast", "fast_0", False)


def test_a_directory_without_recordings_is_named(tmp_path: Path) -> None:
    with pytest.raises(TruthError, match=r"no recording \(\*\.npz\).*--data"):
        realism.cases(tmp_path, range(1, 3))


def test_a_simulated_case_is_measured() -> None:
    loaded = SimulatedCase("parkour", 3, natural=True).load()
    assert loaded.set_name == NATURAL
    assert loaded.guided
    assert len(loaded.values) > 3
    assert np.isfinite(loaded.values).all()


def test_the_tables_have_people_before_and_after(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(realism, "RESAMPLES", 20)
    real = [*windows("delft", 6, 1), *windows("modena", 6, 2)]
    result = realism.summarise([*real, None, *windows(IDEAL, 6, 3, shift=2.0), *windows(NATURAL, 6, 4)])
    assert result.simulated[IDEAL]["all"].auc > result.simulated[NATURAL]["all"].auc
    assert result.guided[IDEAL]["all"].auc > 0.9
    assert set(result.real) == {"delft", "modena"}
    page = realism.page(result, realism.title(range(1, 3))).as_markdown()
    assert all(f"| {name} |" in page for name in ("all", *MEASURES))
    assert realism.as_json(result)["counts"]["delft"] == (6, 48)
