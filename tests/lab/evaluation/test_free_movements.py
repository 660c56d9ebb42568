"""`--suite movements`: what its demonstrations are made of, and what their truth states."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from caesura_lab.evaluation.cases.free_movements import MOVEMENTS, FreeMovements
from caesura_lab.evaluation.cases.suites import SuiteOptions, missing_recordings, suite


def speed_at(case: FreeMovements) -> tuple[np.ndarray, np.ndarray]:
    """Times [s], and speeds over 0.1 s [m/s], of a demonstration."""
    recording, _ = case.load()
    every = recording.signals["pos"][::50]
    return recording.t[::50][1:], np.linalg.norm(np.diff(every, axis=0), axis=1) / 0.1


def test_the_suite_has_every_kind_by_seeds_and_needs_no_recordings():
    extent = SuiteOptions(seeds=2, first_seed=7)
    cases = suite("movements", extent)
    assert [case.name for case in cases] == [f"{kind}-{seed}" for kind in MOVEMENTS for seed in (7, 8)]
    assert missing_recordings("movements", extent) == []


@pytest.mark.parametrize("kind", MOVEMENTS)
def test_a_demonstration_is_the_same_in_every_process(kind: str):
    case = FreeMovements(kind, 3)
    (recording, truth), (again, same) = case.load(), pickle.loads(pickle.dumps(case)).load()
    np.testing.assert_array_equal(recording.signals["pos"], again.signals["pos"])
    assert truth == same
    assert not np.array_equal(
        recording.signals["pos"][:100], FreeMovements(kind, 4).load()[0].signals["pos"][:100]
    )


@pytest.mark.parametrize("kind", MOVEMENTS)
def test_every_movement_begins_and_ends_between_rests(kind: str):
    recording, truth = FreeMovements(kind, 1).load()
    first, last = truth.window
    assert (first, last) == (0.0, recording.t[-1])
    spans = [span.kind for span in truth.spans]
    assert spans == ["steady", "motion"] * (len(spans) // 2) + ["steady"]
    for name in ("start", "stop"):
        assert sum(point.kind == name for point in truth.points) == spans.count("motion")
    times = [point.t for point in truth.points]
    assert times == sorted(times)
    t, speeds = speed_at(FreeMovements(kind, 1))
    for span in truth.spans:
        within = speeds[(t - 0.1 >= span.t0) & (t <= span.t1)]
        assert (np.median(within) > 0.005) == (span.kind == "motion"), span


@pytest.mark.parametrize("kind", ["stroke", "hesitation"])
def test_a_straight_way_has_no_corner(kind: str):
    for seed in range(1, 6):
        _, truth = FreeMovements(kind, seed).load()
        assert {point.kind for point in truth.points if not point.optional} == {"start", "stop"}


def test_a_hesitation_dips_within_one_movement():
    _, truth = FreeMovements("hesitation", 1).load()
    t, speeds = speed_at(FreeMovements("hesitation", 1))
    for span in truth.spans:
        if span.kind == "motion":
            within = speeds[(t >= span.t0 + 0.3) & (t <= span.t1 - 0.3)]
            peaks = [i for i in range(1, len(within) - 1) if within[i - 1] < within[i] > within[i + 1]]
            assert len(peaks) >= 2
            assert within[peaks[0] : peaks[-1]].min() < 0.7 * within[peaks].max()


@pytest.mark.parametrize("kind", ["corners", "zigzag"])
def test_a_corner_by_design_is_where_the_path_turns_at_a_dip(kind: str):
    recording, truth = FreeMovements(kind, 2).load()
    corners = [point for point in truth.points if point.kind == "corner" and not point.optional]
    assert len(corners) >= 2
    position = recording.signals["pos"]
    for point in corners:
        at, chord = round(point.t * 500), 75
        before, after = position[at] - position[at - chord], position[at + chord] - position[at]
        cosine = before @ after / np.linalg.norm(before) / np.linalg.norm(after)
        assert np.degrees(np.arccos(cosine)) > 45.0, point


def test_a_curve_slows_down_by_the_cube_root_of_its_curvature():
    recording, truth = FreeMovements("curve", 2).load()
    span = next(span for span in truth.spans if span.kind == "motion")
    at = np.arange(round((span.t0 + 0.7) * 500), round((span.t1 - 0.7) * 500), 25)
    smooth = np.array([recording.signals["pos"][i - 25 : i + 26].mean(axis=0) for i in at])
    first = np.gradient(smooth, 0.05, axis=0)
    second = np.gradient(first, 0.05, axis=0)
    speed = np.linalg.norm(first, axis=1)
    curvature = np.linalg.norm(np.cross(first, second), axis=1) / speed**3
    inner = (curvature > 2.0) & (curvature < 50.0)
    slope, _ = np.polyfit(np.log(curvature[inner]), np.log(speed[inner]), 1)
    assert slope == pytest.approx(-1.0 / 3.0, abs=0.1)


def test_a_traced_line_is_slow():
    recording, _ = FreeMovements("tracing", 1).load()
    way = np.linalg.norm(np.diff(recording.signals["pos"][::50], axis=0), axis=1).sum()
    assert 0.002 < way / recording.t[-1] < 0.03
