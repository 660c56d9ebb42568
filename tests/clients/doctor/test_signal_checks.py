"""Every judgement of samples."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from caesura_clients.doctor.run_checks import examine_recording
from caesura_clients.doctor.signal_checks import CheckedSamples, cells_at_rest, check_samples
from caesura_protocol.recording import Recording
from clients.doctor.judged import grades, said


def test_a_time_that_lies_far_off_costs_no_memory():
    far = Recording(t=np.append(np.arange(40) * 0.01, 1e12), signals={"pos": np.zeros((41, 3))})
    tracemalloc.start()
    try:
        assert len(cells_at_rest(far)) >= 1
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1e6


def hand(t: np.ndarray, **changes: object) -> Recording:
    """Rests for a second, then moves along x."""
    x = np.clip(t - t[0] - 1.0, 0.0, None) * 0.2
    pos = np.column_stack([x, 0 * x, 0 * x + 0.3])
    force = 0.1 * np.random.default_rng(0).standard_normal((len(t), 3))
    return Recording(
        t, {"pos": pos, "force": force, "gripper": 0 * x[:, None], **changes}, wrench_source="flange_sensor"
    )


EVEN = np.arange(2000) / 1000.0


@pytest.mark.parametrize(
    ("taught", "check", "grade", "words"),
    [
        (hand(EVEN), "rate", "ok", "1000 Hz"),
        (hand(EVEN), "regularity", "ok", "0.0 %"),
        (hand(EVEN), "wrench noise", "ok", "0.10 N"),
        (hand(EVEN[::50]), "rate", "warn", "20 Hz"),
        (hand(EVEN * 1e3), "units", "bad", "probably in ms"),
        (hand(EVEN * 1e9), "units", "bad", "State --time-unit ns"),
        (hand(np.delete(EVEN, slice(500, 900))), "regularity", "warn", "longest 401 ms"),
        (hand(EVEN + np.tile([0, 9e-4], 1000)), "regularity", "warn", "off by more than half"),
        (hand(np.repeat(EVEN, 2)), "repeats", "warn", "2000 of 4000 samples"),
        (hand(np.where(EVEN < 1.5, EVEN, EVEN - 0.2)), "repeats", "warn", "200 of 2000 samples"),
        (hand(EVEN[::-1]), "clock", "bad", "1999 of 2000 samples are earlier than the one before"),
        (
            hand(600.0 * EVEN[np.random.default_rng(2).permutation(2000)]),
            "clock",
            "bad",
            "sort the samples by t",
        ),
        (hand(EVEN // 1 + 1.7e9), "clock", "bad", "write the fractions of a second too: the file is refused"),
        (replace(hand(EVEN), t=EVEN + 86400 * (EVEN >= 1.5)), "clock", "bad", "time leaps from 1.499 s to"),
        (hand(EVEN, pos=np.tile(200.0 * EVEN[:, None], 3)), "units", "bad", "State --length-unit mm"),
        (
            hand(np.where(EVEN < 1.5, EVEN, EVEN - 0.7)),
            "clock",
            "bad",
            "sample 1500: time goes back from 1.499 s to 0.8 s, expected within 0.25 s",
        ),
        (hand(EVEN), "signals", "warn", "without quat apps have no orientation"),
        (hand(EVEN, force=np.tile([0.0, 3.0, 6.0], (2000, 1))), "wrench bias", "warn", "6.7 N in all"),
        (
            hand(EVEN, force=5 * np.random.default_rng(1).standard_normal((2000, 3))),
            "wrench noise",
            "warn",
            "loose cable",
        ),
    ],
)
def test_samples_are_judged(taught, check, grade, words):
    found = list(examine_recording(taught))
    assert grades(found, check) == [grade]
    assert words in said(found, check)


def test_a_live_pose_that_is_read_seldom_is_named():
    t = np.arange(1000) / 100.0
    x = 0.1 * np.floor(t * 7.0) / 7.0
    live = CheckedSamples(t, {"pos": np.column_stack([x, x, x])})
    found = list(check_samples(live))
    assert grades(found, "pose") == ["warn"]
    assert "about 7.1 times a second" in said(found, "pose")


def test_a_robot_that_never_rests_says_nothing_of_noise():
    moving = hand(EVEN, pos=np.column_stack([EVEN / 2, EVEN / 2, EVEN / 2]))
    assert grades(list(examine_recording(moving)), "wrench noise") == []


def test_the_unit_of_length_is_heeded():
    metres = hand(EVEN)
    signals = {**metres.signals, "pos": 1000 * metres.signals["pos"]}
    millimetres = replace(metres, signals=signals, length_unit="mm")
    assert list(examine_recording(millimetres)) == list(examine_recording(metres))
