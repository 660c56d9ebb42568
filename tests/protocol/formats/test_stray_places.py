"""Samples whose place is a lost value are named; a fast robot and a reading that is held are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.formats.read import load_recording

T = np.arange(1000) / 1000.0
WAY = np.column_stack([0.4 + 0.1 * np.sin(6.0 * T), 0.0 * T, 0.3 + 0.0 * T])


def cautions(tmp_path: Path, **signals: object) -> tuple[str, ...]:
    np.savez(tmp_path / "x.npz", **{"t": T, "wrench_source": "none", **signals})
    return load_recording(tmp_path / "x.npz").cautions


def lost(places: np.ndarray, *rows: int) -> np.ndarray:
    """The places with zeros at these rows."""
    return np.where(np.isin(np.arange(len(places)), rows)[:, None], 0.0, places)


@pytest.mark.parametrize("run", [1, 2, 3])
def test_lost_values_are_named_with_the_first_and_their_count(tmp_path: Path, run: int) -> None:
    """Zeros changed segments, and nothing was said of them."""
    rows = [row + i for row in (250, 600) for i in range(run)]
    (caution,) = cautions(tmp_path, pos=lost(WAY, *rows))
    assert caution.startswith("Sample 250: pos leaps by 0.58")
    assert f"{2 * run} of 1000 samples lie so" in caution


def test_the_leap_is_in_metres_and_of_joints_in_radians(tmp_path: Path) -> None:
    (caution,) = cautions(tmp_path, pos=1000.0 * lost(WAY, 250), length_unit="mm")
    assert "pos leaps by 0.58" in caution
    joints = np.tile(1.0 + 0.1 * T[:, None], 7)
    (caution,) = cautions(tmp_path, q=lost(joints, 250))
    assert "q leaps by 2.71 rad" in caution


@pytest.mark.parametrize(
    "places",
    [
        WAY,
        WAY[::-1] * 8.0,  # 4.8 m/s, turning back
        np.repeat(WAY[::33], 33, axis=0)[:1000],
        WAY + np.random.default_rng(0).normal(0.0, 0.002, WAY.shape),
    ],
    ids=["smooth", "fast", "held", "noise"],
)
def test_what_a_robot_does_is_not(tmp_path: Path, places: np.ndarray) -> None:
    np.savez(tmp_path / "x.npz", t=T, pos=places, wrench_source="none")
    found = load_recording(tmp_path / "x.npz", length_unit="m").cautions
    assert [one for one in found if "leaps" in one] == []


def test_a_leap_that_does_not_come_back_is_named_as_one(tmp_path: Path) -> None:
    """Two recordings in one file, or another base frame from there on, were one movement in silence."""
    (caution,) = cautions(tmp_path, pos=np.where(T < 0.5, 0.0, 1.0)[:, None] * WAY)
    assert caution.startswith(
        "Sample 500: pos leaps by 0.511 m, faster than an arm moves, and goes on from there."
    )
    assert "Divide the file there" in caution
    assert cautions(tmp_path, pos=WAY[np.r_[:500, 500:1000:1]]) == ()


def test_two_samples_are_no_leap(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", t=T[:2], pos=WAY[:2], wrench_source="none")
    assert load_recording(tmp_path / "x.npz").cautions == ()
