"""`--suite starts`: annotated recordings that begin a moment later."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.evaluation.cases.shifted_starts import STARTS, with_shifted_start
from caesura_lab.evaluation.cases.suites import FileCase, LaterCase
from caesura_lab.ground_truth import read_truth
from caesura_protocol.formats.read import load_recording
from harness.segmentations import segmented

PICK_AND_PLACE = Path(__file__).parents[3] / "data" / "pick_and_place.npz"
BASE, TRUTH = load_recording(PICK_AND_PLACE), read_truth(PICK_AND_PLACE)


@pytest.mark.parametrize("start", STARTS)
def test_only_what_lies_before_the_start_is_left_out(start: str) -> None:
    later, found = with_shifted_start(BASE, TRUTH, start)
    kept = BASE.t >= BASE.t[0] + STARTS[start]
    np.testing.assert_array_equal(later.t, BASE.t[kept])
    np.testing.assert_array_equal(later.signals["force"], BASE.signals["force"][kept])
    assert found.points == TRUTH.points
    assert found.window[1] == TRUTH.window[1]


def test_observations_then_lie_elsewhere() -> None:
    """What is compared depends on it: the same rows with the same observations would show nothing."""
    later, _ = with_shifted_start(BASE, TRUTH, "40 ms later")
    assert later.t[0] - BASE.t[0] == pytest.approx(0.04)
    first, second = ({one.probability for one in segmented(r).changepoints} for r in (BASE, later))
    assert first
    assert second
    assert first != second


def test_a_case_has_its_start_as_name_group_and_robot() -> None:
    case = pickle.loads(pickle.dumps(LaterCase(FileCase(PICK_AND_PLACE), "40 ms later")))
    _, truth = case.load()
    assert (case.name, truth.name) == (2 * ("40 ms later: pick_and_place.npz",))
    assert {case.group, truth.robot, *case.tags} == {"40 ms later"}
