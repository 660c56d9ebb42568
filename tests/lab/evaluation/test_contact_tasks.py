"""`--suite tasks` and `repetitions`: what its demonstrations are made of, and what their truth states."""

from __future__ import annotations

import pickle
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_lab.evaluation.cases.contact_tasks import TASKS, ContactTask
from caesura_lab.evaluation.cases.stroke_tasks import FEWEST, MOST, STROKE_TASKS, StrokeTask
from caesura_lab.evaluation.cases.suites import SuiteOptions, missing_recordings, suite
from caesura_lab.ground_truth import TrueSegment
from caesura_protocol.recording import Recording

KINDS = (*TASKS, *STROKE_TASKS)
EDGE_S = 0.15  # of a segment, within which signals set in and cease


def case_of(kind: str, seed: int) -> ContactTask | StrokeTask:
    return ContactTask(kind, seed) if kind in TASKS else StrokeTask(kind, seed)


def inner(recording: Recording, span: TrueSegment) -> np.ndarray:
    """Indices of a segment's samples without its edges."""
    return np.flatnonzero((recording.t >= span.t0 + EDGE_S) & (recording.t <= span.t1 - EDGE_S))


def test_the_suite_has_every_task_by_seeds_and_needs_no_recordings():
    extent = SuiteOptions(seeds=2, first_seed=7)
    cases = suite("tasks", extent)
    assert [case.name for case in cases] == [f"{kind}-{seed}" for kind in TASKS for seed in (7, 8)]
    assert missing_recordings("tasks", extent) == []


def test_the_suite_of_repetitions_has_every_task_of_strokes():
    extent = SuiteOptions(seeds=2, first_seed=7)
    expected = [f"{kind}-{seed}" for kind in STROKE_TASKS for seed in (7, 8)]
    assert [case.name for case in suite("repetitions", extent)] == expected
    assert missing_recordings("repetitions", extent) == []


@pytest.mark.parametrize("kind", STROKE_TASKS)
def test_many_strokes_are_one_phase(kind: str):
    skill = kind.split("_", maxsplit=1)[0]
    for seed in range(1, 6):
        _, truth = StrokeTask(kind, seed).load()
        assert [phase.kind for phase in truth.phases] == ["reach", skill, "retract"]
        (phase,) = [one for one in truth.phases if one.kind == skill]
        touched = [point.t for point in truth.points if point.kind.startswith("contact")]
        assert phase.t0 - 1e-9 <= min(touched)
        assert max(touched) <= phase.t1 + 1e-9


def test_a_gripper_opens_for_each_turn_back_where_the_hand_regrips():
    recording, truth = StrokeTask("screw_regripped", 1).load()
    opened = recording.signals["gripper"][:, 0] > 0.03
    turns = [span for span in truth.spans if span.kind == "turning"]
    assert FEWEST <= len(turns[::2]) <= MOST
    for number, span in enumerate(turns):
        assert opened[inner(recording, span)].all() == bool(number % 2)
    assert "gripper" not in StrokeTask("screw_lifted", 1).load()[0].signals


@pytest.mark.parametrize("kind", KINDS)
def test_a_demonstration_is_the_same_in_every_process(kind: str):
    case = case_of(kind, 3)
    (recording, truth), (again, same) = case.load(), pickle.loads(pickle.dumps(case)).load()
    for name, values in recording.signals.items():
        np.testing.assert_array_equal(values, again.signals[name])
    assert truth == same
    assert not np.array_equal(recording.signals["pos"][:100], case_of(kind, 4).load()[0].signals["pos"][:100])


@pytest.mark.parametrize("kind", KINDS)
def test_truth_covers_the_whole_demonstration(kind: str):
    recording, truth = case_of(kind, 1).load()
    assert truth.window == (0.0, recording.t[-1])
    for parts in (truth.spans, truth.phases):
        assert [before.t1 for before, _ in pairwise(parts)] == [after.t0 for _, after in pairwise(parts)]
    assert (truth.spans[0].t0, truth.spans[-1].t1) == truth.window
    assert (truth.spans[0].kind, truth.spans[-1].kind) == ("steady", "steady")
    times = [point.t for point in truth.points]
    assert times == sorted(times)
    assert {type(t) for t in times} == {float}, "a result in JSON states them"
    assert all(
        any(abs(point.t - edge) <= 0.2 for edge in edges(truth.spans))
        for point in truth.points
        if point.kind != "corner"
    )


def edges(spans: tuple[TrueSegment, ...]) -> list[float]:
    return [span.t0 for span in spans] + [spans[-1].t1]


@pytest.mark.parametrize("kind", KINDS)
def test_a_surface_pushes_back_exactly_in_contact(kind: str):
    recording, truth = case_of(kind, 2).load()
    touched = [point.t for point in truth.points if point.kind == "contact_on"]
    left = [point.t for point in truth.points if point.kind == "contact_off"]
    assert len(touched) == len(left)
    for span in truth.spans:
        at = inner(recording, span)
        if not len(at):
            continue
        in_contact = any(
            on <= span.t0 and span.t1 <= off + 1e-9 for on, off in zip(touched, left, strict=True)
        )
        upwards = np.median(recording.signals["force"][at, 2])
        assert (upwards > 1.2) == in_contact, span


@pytest.mark.parametrize("kind", KINDS)
def test_kinds_state_what_moves(kind: str):
    recording, truth = case_of(kind, 5).load()
    turned = Rotation.from_quat(recording.signals["quat"])
    for span in truth.spans:
        at = inner(recording, span)
        if len(at) < 100:
            continue
        way = np.linalg.norm(np.diff(recording.signals["pos"][at[::50]], axis=0), axis=1).sum()
        angle = (turned[at[-1]] * turned[at[0]].inv()).magnitude()
        seconds = recording.t[at[-1]] - recording.t[at[0]]
        moves, turns = way / seconds > 0.01, angle / seconds > 0.2
        assert (moves or turns) == (span.kind in ("motion", "sliding", "turning")), span
        assert turns or span.kind != "turning", span


def test_a_slide_is_slowed_by_friction():
    recording, truth = ContactTask("wipe", 1).load()
    (slide,) = [span for span in truth.spans if span.kind == "sliding"]
    at = inner(recording, slide)[::25]
    velocity = np.gradient(recording.signals["pos"][at, :2], recording.t[at], axis=0)
    power = (recording.signals["force"][at, :2] * velocity).sum(axis=1)
    assert np.mean(power < 0.0) > 0.9


def test_a_screw_holds_a_torque_against_its_turns_and_none_back():
    recording, truth = ContactTask("screw", 1).load()
    turns = [span for span in truth.spans if span.kind == "turning"]
    torques = [np.median(recording.signals["torque"][inner(recording, span), 2]) for span in turns]
    assert all(abs(torque) > 0.3 for torque in torques[::2])
    assert all(abs(torque) < 0.1 for torque in torques[1::2])
