"""A pose that is read seldom is named; what a fast robot or a hand at rest repeats is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.formats.read import load_recording
from caesura_protocol.pose_update_rate import PoseReadings, slow_pose

T = np.arange(1000) / 100.0


def held(read_hz: float) -> np.ndarray:
    """A pose on a line, read so often and held at 100 Hz; (n, 3) [m]."""
    return np.column_stack([np.floor(T * read_hz + 1e-9) / read_hz * 0.1, np.zeros_like(T), np.zeros_like(T)])


@pytest.mark.parametrize(("read_hz", "words"), [(10.0, "10 times"), (15.0, "15 times"), (20.0, "20 times")])
def test_a_slow_pose_is_named_with_its_rate(read_hz: float, words: str) -> None:
    named = slow_pose(T, {"pos": held(read_hz), "force": np.random.default_rng(0).normal(size=(1000, 3))})
    assert named is not None
    assert words in named
    assert "interpolated" in named


@pytest.mark.parametrize(("read_hz", "words"), [(4.0, "4 times"), (7.0, "7.1 times"), (8.0, "8")])
def test_a_pose_that_is_read_too_seldom_to_be_interpolated_is_named_so(read_hz: float, words: str) -> None:
    """7 readings a second were not named, and 8 as interpolated: at 100 Hz half of these are 0.13 s apart."""
    named = slow_pose(T, {"pos": held(read_hz)})
    assert named is not None
    assert f"about {words}" in named
    assert "movements are cut" in named


@pytest.mark.parametrize("read_hz", [30.0, 50.0, 100.0])
def test_a_pose_that_is_read_often_is_not(read_hz: float) -> None:
    assert slow_pose(T, {"pos": held(read_hz)}) is None


def test_joints_are_a_pose_where_there_is_no_position() -> None:
    joints = np.repeat(held(10.0), 3, axis=1)[:, :7]
    assert slow_pose(T, {"q": joints}) is not None
    assert slow_pose(T, {"pos": np.column_stack([T, T, T]), "q": joints}) is None


def test_a_rest_and_an_orientation_that_goes_on_are_no_repeated_pose() -> None:
    resting = np.where(T < 5.0, 0.0, 0.02 * (T - 5.0))[:, None] * np.ones(3)
    assert slow_pose(T, {"pos": resting}) is None
    turning = np.column_stack([np.sin(T / 9.0), np.zeros_like(T), np.zeros_like(T), np.cos(T / 9.0)])
    assert slow_pose(T, {"pos": held(10.0), "quat": turning}) is None


def test_a_hand_that_stops_often_is_not_read_too_seldom() -> None:
    """Thirty rests of 0.2 s, with movements of 0.13 s between them."""
    moved_s = np.cumsum(np.where(T % 0.33 < 0.2, 0.0, 0.01))
    assert slow_pose(T, {"pos": 0.1 * np.column_stack([moved_s] * 3)}) is None


COLUMNS = ("t", "px", "py", "pz", "fx", "fy", "fz")


def live(read_hz: float, step: int, columns: tuple[str, ...] = COLUMNS) -> PoseReadings:
    """Readings of a pose that is read so often, from chunks of `step` samples with a force that goes on."""
    readings = PoseReadings(columns)
    rows = np.column_stack([T, held(read_hz), np.random.default_rng(0).normal(size=(1000, 3))])
    for start in range(0, len(rows), step):
        readings.push(rows[start : start + step])
    return readings


@pytest.mark.parametrize("step", [1, 7, 20, 1000])
@pytest.mark.parametrize(("read_hz", "words"), [(7.0, "7.1 times"), (15.0, "15 times"), (50.0, None)])
def test_a_live_pose_is_named_as_that_of_a_file(read_hz: float, words: str | None, step: int) -> None:
    """A live bridge named no slow pose, and movements were cut at its readings."""
    slow = live(read_hz, step).slow
    assert (slow is None) == (words is None)
    assert words is None or f"about {words}" in str(slow)


def test_a_pose_that_becomes_slow_later_is_named() -> None:
    readings = PoseReadings(COLUMNS[:4])
    fast_s = np.arange(20_000) / 1000.0
    readings.push(np.column_stack([fast_s, fast_s, fast_s, fast_s]))
    assert readings.slow is None
    for later_s in (20.0, 30.0, 40.0, 50.0, 60.0):
        readings.push(np.column_stack([later_s + T, later_s + held(7.0)]))
    assert "about 7.1 times" in str(readings.slow)


def test_samples_without_a_pose_have_none_that_is_slow() -> None:
    assert live(7.0, 20, ("t", "a", "b", "c", "fx", "fy", "fz")).slow is None
    assert slow_pose(T, {"force": held(7.0)}) is None


def test_a_file_says_so(tmp_path: Path) -> None:
    np.savez(tmp_path / "slow.npz", t=T, pos=held(15.0), wrench_source="none")
    (caution,) = load_recording(tmp_path / "slow.npz").cautions
    assert "15 times a second" in caution
