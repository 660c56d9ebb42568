"""`--suite sensors`: annotated recordings as poorer sensors would have made them."""

from __future__ import annotations

import hashlib
import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.evaluation.cases.sensor_conditions import CONDITIONS
from caesura_lab.evaluation.cases.suites import FileCase, PoorerCase, SuiteOptions, suite
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording

BUTTON = Path(__file__).parents[3] / "data" / "button.npz"
BASE = load_recording(BUTTON)
RNG_SEED = 7


def under(condition: str) -> Recording:
    return CONDITIONS[condition](BASE, np.random.default_rng(RNG_SEED))


def test_noise_is_in_metres_whatever_unit_the_file_has(tmp_path: Path):
    """A recording in mm had 0.001 mm of noise in place of 1 mm."""
    signals = dict(BASE.signals) | {"pos": 1000.0 * BASE.signals["pos"]}
    replace(BASE, signals=signals, length_unit="mm").save(tmp_path / "x.npz")
    (tmp_path / "x.ann.json").write_text(json.dumps({"window": [0, 5], "changepoints": []}))
    noisy, _ = PoorerCase(FileCase(tmp_path / "x.npz"), "position noise 1 mm").load()
    assert noisy.length_unit == "m"
    assert np.std(noisy.signals["pos"] - BASE.signals["pos"]) == pytest.approx(0.001, rel=0.05)


def of(recording: Recording, *names: str) -> np.ndarray:
    return np.column_stack([recording.signals[name] for name in names])


def test_a_recording_that_begins_later_has_the_same_samples():
    later = under("begun 50 ms later")
    left_out = len(BASE.t) - len(later.t)
    assert BASE.t[left_out - 1] < BASE.t[0] + 0.05 <= later.t[0]
    np.testing.assert_array_equal(later.matrix(), BASE.matrix()[left_out:])


@pytest.mark.parametrize(("condition", "rate_hz"), [("50 Hz", 50.0), ("20 Hz", 20.0), ("10 Hz", 10.0)])
def test_a_lower_rate_keeps_samples_that_were_measured(condition: str, rate_hz: float):
    slower = under(condition)
    assert np.median(np.diff(slower.t)) == pytest.approx(1.0 / rate_hz, rel=0.01)
    rows = np.searchsorted(BASE.t, slower.t)
    np.testing.assert_array_equal(slower.matrix(), BASE.matrix()[rows])


def test_a_lower_rate_is_a_mean_where_samples_come_in_bursts():
    times = np.sort(np.concatenate([np.arange(0.0, 10.0, 0.02), np.arange(0.0, 10.0, 0.02) + 0.001]))
    bursts = Recording(t=times, signals={"pos": np.zeros((len(times), 3))})
    slower = CONDITIONS["20 Hz"](bursts, np.random.default_rng(RNG_SEED))
    assert len(slower.t) == pytest.approx(200, abs=2)


def test_a_tenth_of_the_samples_is_lost():
    assert len(under("a tenth of the samples lost").t) == pytest.approx(0.9 * len(BASE.t), rel=0.01)


@pytest.mark.parametrize(
    ("condition", "signal", "deviation"),
    [
        ("position noise 0.5 mm", "pos", 0.0005),
        ("position noise 1 mm", "pos", 0.001),
        ("force noise 1 N", "force", 1.0),
    ],
)
def test_noise_has_its_deviation_and_leaves_the_rest(condition: str, signal: str, deviation: float):
    noisy = under(condition)
    added = noisy.signals[signal] - BASE.signals[signal]
    np.testing.assert_allclose(added.std(axis=0), deviation, rtol=0.05)
    rest = [name for name in BASE.signals if name != signal]
    np.testing.assert_array_equal(of(noisy, *rest), of(BASE, *rest))


@pytest.mark.parametrize(
    ("condition", "signal", "step"),
    [("position in steps of 1 mm", "pos", 0.001), ("force in steps of 0.5 N", "force", 0.5)],
)
def test_steps_are_multiples_nearest_to_what_was_measured(condition: str, signal: str, step: float):
    stepped = under(condition).signals[signal]
    np.testing.assert_allclose(stepped / step, np.round(stepped / step), atol=1e-9)
    assert np.abs(stepped - BASE.signals[signal]).max() <= 0.5 * step + 1e-12


def test_a_pose_is_held_until_it_is_read_again_and_the_wrench_is_not():
    held = under("pose read at 15 Hz, held at 100 Hz")
    np.testing.assert_allclose(np.diff(held.t), 0.01, atol=1e-9)
    changes = np.flatnonzero((np.diff(held.signals["pos"], axis=0) != 0.0).any(axis=1)) + 1
    moving = changes[(held.t[changes] > 2.0) & (held.t[changes] < 3.0)]
    assert len(moving) == pytest.approx(15, abs=1)
    for row in moving:  # read at the last fifteenth of a second
        read_s = held.t[0] + np.floor((held.t[row] - held.t[0]) * 15.0 + 1e-9) / 15.0
        expected = [np.interp(read_s, BASE.t, column) for column in BASE.signals["pos"].T]
        np.testing.assert_allclose(held.signals["pos"][row], expected, atol=1e-12)
    assert (np.diff(held.signals["force"], axis=0) != 0.0).any(axis=1).mean() > 0.99


def test_a_pose_that_stands_still_goes_on_where_it_is_by_then():
    stalled = under("pose stands still for 0.1 s")
    off = (stalled.signals["pos"] != BASE.signals["pos"]).any(axis=1)
    share = off.mean()
    assert 0.01 < share < 0.1  # half a stall a second, of a tenth of a second each, where it moves at all
    np.testing.assert_array_equal(stalled.signals["force"], BASE.signals["force"])


def test_times_that_are_off_have_their_deviation():
    """A straight ramp shows by how much the time of each sample is off."""
    t = np.arange(0.0, 60.0, 0.01)
    ramp = Recording(t=t, signals={"pos": np.column_stack([0.01 * t] * 3)})
    late = CONDITIONS["times off by 10 ms"](ramp, np.random.default_rng(RNG_SEED))
    off_s = (late.signals["pos"] - ramp.signals["pos"])[100:-100, 0] / 0.01
    assert off_s.std() == pytest.approx(0.01, rel=0.1)
    assert np.corrcoef(off_s[5:], off_s[:-5])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.08)


def test_a_late_wrench_is_the_one_of_a_tenth_of_a_second_ago():
    late = under("wrench 0.1 s late")
    rows = np.flatnonzero(BASE.t - BASE.t[0] > 0.2)[:500]
    ago = [int(np.argmin(np.abs(BASE.t - (BASE.t[row] - 0.1)))) for row in rows]
    np.testing.assert_array_equal(late.signals["force"][rows], BASE.signals["force"][ago])
    np.testing.assert_array_equal(late.signals["pos"], BASE.signals["pos"])


def test_a_drift_ends_at_its_size():
    added = under("force drifts by 2 N").signals["force"] - BASE.signals["force"]
    np.testing.assert_allclose(added[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(added[-1], 2.0)


def test_the_suite_has_every_recording_under_every_condition(tmp_path: Path):
    annotations = tmp_path / "annotations"
    annotations.mkdir()
    source = {"file": BUTTON.name, "sha256": hashlib.sha256(BUTTON.read_bytes()).hexdigest()}
    truth = {"window": [0, 5], "changepoints": [{"t": 2.0, "tol": 0.15, "level": "major"}]}
    (annotations / "button.ann.json").write_text(json.dumps(truth | {"recording": source}))
    cases = suite("sensors", SuiteOptions(data=BUTTON.parent, annotations=annotations))
    button = [case for case in cases if case.name.endswith(BUTTON.name)]
    assert [case.group for case in button] == list(CONDITIONS)
    of_noise = next(case for case in button if case.group == "position noise 1 mm")
    noisy, truth_of_it = pickle.loads(pickle.dumps(of_noise)).load()
    assert truth_of_it.robot == of_noise.group
    again, _ = of_noise.load()
    np.testing.assert_array_equal(noisy.matrix(), again.matrix())


def test_two_recordings_have_other_noise():
    cases = [
        PoorerCase(FileCase(BUTTON.with_name(name)), "position noise 1 mm")
        for name in ("button.npz", "wiping.npz")
    ]
    added = [case.load()[0].signals["pos"] - case.case.load()[0].signals["pos"] for case in cases]
    assert not np.allclose(added[0][:100], added[1][:100])
