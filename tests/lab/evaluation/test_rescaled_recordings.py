"""`--suite tempo`: annotated recordings as people of other habits would have given them."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.evaluation.cases.rescaled_recordings import TEMPI, in_tempo
from caesura_lab.evaluation.cases.suites import FileCase, OtherTempoCase
from caesura_lab.ground_truth import read_truth
from caesura_protocol.formats.read import load_recording

PICK_AND_PLACE = Path(__file__).parents[3] / "data" / "pick_and_place.npz"
BASE, TRUTH = load_recording(PICK_AND_PLACE), read_truth(PICK_AND_PLACE)


def path_m(positions: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())


@pytest.mark.parametrize("tempo", TEMPI)
def test_duration_and_path_have_their_factors_and_the_wrench_stays(tempo: str) -> None:
    duration, size = TEMPI[tempo]
    changed, _ = in_tempo(BASE, TRUTH, tempo)
    assert np.ptp(changed.t) == pytest.approx(duration * np.ptp(BASE.t))
    assert path_m(changed.signals["pos"]) == pytest.approx(size * path_m(BASE.signals["pos"]))
    np.testing.assert_array_equal(changed.signals["force"], BASE.signals["force"])
    assert ("q" in changed.signals) == (size == 1.0 and "q" in BASE.signals)


def test_a_path_of_joints_alone_has_its_size() -> None:
    """A recording without positions beside the others ended the suite with KeyError: 'pos'."""
    joints = replace(BASE, signals={"q": BASE.signals["q"]})
    changed, _ = in_tempo(joints, TRUTH, "twice the size")
    assert path_m(changed.signals["q"]) == pytest.approx(2.0 * path_m(BASE.signals["q"]))


def test_every_true_time_stays_at_its_sample() -> None:
    later = replace(BASE, t=BASE.t + 1000.0)
    at = replace(TRUTH.points[0], t=float(later.t[40]), t_alt=float(later.t[20]))
    truth = replace(TRUTH, points=(at,), window=(float(later.t[10]), float(later.t[90])))
    span = replace(TRUTH.spans[0], t0=float(later.t[30]), t1=float(later.t[50]))
    changed, found = in_tempo(later, replace(truth, spans=(span,)), "1.5 times the time")
    times = (*found.window, found.points[0].t, found.points[0].t_alt, found.spans[0].t0, found.spans[0].t1)
    assert times == pytest.approx(tuple(changed.t[[10, 90, 40, 20, 30, 50]]))
    assert found.points[0].tolerance_s == at.tolerance_s


def test_a_case_has_its_tempo_as_name_group_and_robot() -> None:
    case = pickle.loads(pickle.dumps(OtherTempoCase(FileCase(PICK_AND_PLACE), "half the time")))
    _, truth = case.load()
    assert (case.name, truth.name) == (2 * ("half the time: pick_and_place.npz",))
    assert {case.group, truth.robot, *case.tags} == {"half the time"}
