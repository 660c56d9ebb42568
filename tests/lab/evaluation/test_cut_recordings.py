"""`--suite windows`: parts of annotated recordings, as where one was begun or cut late."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.evaluation.cases.cut_recordings import WINDOWS, in_window
from caesura_lab.evaluation.cases.suites import FileCase, WindowCase
from caesura_lab.evaluation.scoring.score import FoundSegmentation, score
from caesura_lab.ground_truth import TrueChangepoint, TrueSegment, read_truth
from caesura_protocol.formats.read import load_recording

PICK_AND_PLACE = Path(__file__).parents[3] / "data" / "pick_and_place.npz"
BASE, TRUTH = load_recording(PICK_AND_PLACE), read_truth(PICK_AND_PLACE)
BEGUN, LASTS = float(BASE.t[0]), float(np.ptp(BASE.t))


@pytest.mark.parametrize("window", WINDOWS)
def test_samples_and_truth_of_a_window_are_those_within_it(window: str) -> None:
    low, high = (BEGUN + share * LASTS for share in WINDOWS[window])
    part, found = in_window(BASE, TRUTH, window)
    inside = (BASE.t >= low) & (BASE.t <= high)
    np.testing.assert_array_equal(part.t, BASE.t[inside])
    assert {len(values) for values in part.signals.values()} == {int(inside.sum())}
    np.testing.assert_array_equal(part.signals["force"], BASE.signals["force"][inside])
    assert found.points == tuple(one for one in TRUTH.points if low <= one.t <= high)
    assert found.window == (max(low, TRUTH.window[0]), min(high, TRUTH.window[1]))


def test_a_release_across_the_edge_of_a_window_is_no_false_alarm() -> None:
    """It began inside of the window and ended outside, was left out, and a changepoint at it was wrong."""
    half = BEGUN + 0.5 * LASTS
    release = TrueChangepoint(half - 0.2, 0.15, kind="contact_off", t_alt=half + 0.6)
    part = in_window(BASE, replace(TRUTH, points=(release,)), "from the half on")[1]
    assert part.points == (release,)
    one = score("mine", part, FoundSegmentation((half + 0.65,)))
    assert (one.hits, one.false_alarms, one.misses, one.excused) == (0, 0, 0, 1)


def test_a_stretch_across_the_edge_of_a_window_ends_there() -> None:
    third, half, end = (BEGUN + share * LASTS for share in (0.3, 0.5, 1.0))
    spans = (TrueSegment(BEGUN, third, "motion"), TrueSegment(third, end, "contact"))
    truth = replace(TRUTH, window=(BEGUN, end), spans=spans)
    assert in_window(BASE, truth, "from the half on")[1].spans == (TrueSegment(half, end, "contact"),)
    assert in_window(BASE, truth, "whole")[1].spans == spans


def test_a_case_has_its_window_as_name_group_and_robot() -> None:
    case = pickle.loads(pickle.dumps(WindowCase(FileCase(PICK_AND_PLACE), "the middle half")))
    _, truth = case.load()
    assert (case.name, truth.name) == (2 * ("the middle half: pick_and_place.npz",))
    assert {case.group, truth.robot, *case.tags} == {"the middle half"}
