"""What the page draws, against signals of which the speed is known."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_lab.annotation.signals import plotted_signals
from caesura_protocol.recording import Recording

STRAIGHT = np.array([0.6, 0.0, 0.8])  # a unit vector


def recording(t: np.ndarray, path_m: np.ndarray, **more: object) -> Recording:
    return Recording(t, {"pos": np.outer(path_m, STRAIGHT), "force": np.ones((t.size, 3))}, **more)


@pytest.mark.parametrize("rate_hz", [20.0, 100.0, 1000.0])
def test_a_constant_speed_is_shown_as_it_is(rate_hz: float):
    t = np.arange(0.0, 3.0, 1 / rate_hz)
    shown = plotted_signals(recording(t, 0.2 * t))
    assert shown.speed == pytest.approx(200.0, rel=1e-6)
    assert np.diff(shown.t).min() >= 0.0099


def test_lengths_are_shown_in_millimetres_for_any_unit():
    t = np.arange(0.0, 2.0, 0.01)
    shown = plotted_signals(recording(t, 50.0 * t, length_unit="mm"))
    assert shown.speed == pytest.approx(50.0, rel=1e-6)


def test_a_pose_that_is_held_between_readings_does_not_look_like_stops():
    sample = np.arange(1000)
    t, held = 0.002 * sample, 0.1 * 0.04 * (sample // 20)
    shown = plotted_signals(recording(t, held))
    inner = (shown.t > 0.1) & (shown.t < 1.85)  # after the last reading nothing is known
    assert shown.speed[inner] == pytest.approx(100.0, rel=1e-6)


def test_a_rest_of_equal_poses_stays_a_rest_until_the_movement_starts():
    t = np.arange(0.0, 2.0, 0.01)
    shown = plotted_signals(recording(t, 0.2 * np.maximum(t - 1.0, 0.0)))
    assert shown.speed[shown.t < 0.9].max() == pytest.approx(0.0, abs=1e-9)
    assert shown.speed[shown.t > 1.1] == pytest.approx(200.0, rel=1e-6)


def test_times_in_any_order_and_repeated_are_drawn_in_order():
    rng = np.random.default_rng(0)
    t = rng.permutation(np.repeat(np.arange(0.0, 1.0, 0.01), 2))
    shown = plotted_signals(recording(t, 0.1 * t))
    assert (np.diff(shown.t) > 0).all()
    assert shown.speed == pytest.approx(100.0, rel=1e-6)


def test_a_recording_of_joints_is_drawn_in_radians():
    t = np.arange(0.0, 1.0, 0.01)
    shown = plotted_signals(Recording(t, {"q": np.outer(t, np.eye(7)[0])}, wrench_source="none"))
    assert (shown.unit, shown.force) == ("rad", None)
    assert shown.speed == pytest.approx(1.0, rel=1e-6)
    assert shown.as_payload()["force"] is None


def test_a_single_sample_is_drawn():
    shown = plotted_signals(recording(np.zeros(1), np.zeros(1)))
    assert shown.as_payload()["speed"] == [0.0]


def test_a_recording_that_is_too_long_to_be_drawn_finely_says_so():
    """Forty minutes had a point every 0.12 s, in windows of 4 s, and nothing said so."""
    t = np.arange(0.0, 2400.0, 0.02)
    drawn = plotted_signals(Recording(t, {"pos": np.outer(t, [0.0001, 0.0, 0.0])}, wrench_source="none"))
    assert drawn.coarse is not None
    assert "every 0.12 s, because the recording lasts 2400 s; parts of at most 200 s" in drawn.coarse
    short = plotted_signals(Recording(t[:500], {"pos": np.outer(t[:500], [0.1, 0, 0])}, wrench_source="none"))
    assert short.coarse is None
