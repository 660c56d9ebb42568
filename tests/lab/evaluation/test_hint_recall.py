"""The suite of hints: what it injects, when that can be seen, and how it counts."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from caesura_lab.commands import register
from caesura_lab.evaluation.hints import hint_recall, injected_faults
from caesura_lab.evaluation.hints.hint_recall import (
    CleanResult,
    CoachingCase,
    CoachingResult,
    FaultResult,
    PublishedHint,
    bars,
    summarise,
    title,
    unmet,
)
from caesura_lab.evaluation.hints.injected_faults import (
    FAULTS,
    INJECTED,
    CleanDemonstration,
    Fault,
    NotInjectableError,
    first_unrecorded,
)
from caesura_protocol.messages import Hint, HintKind
from caesura_protocol.recording import Recording
from caesura_service.robot import load_panda

T = np.arange(0.0, 8.0, 0.001)


@pytest.fixture(scope="module")
def taught() -> CleanDemonstration:
    """Two seconds of rest, then 0.6 m in free space within three, then rest."""
    s = np.clip((T - 2.0) / 3.0, 0.0, 1.0)
    x = 0.6 * (10 * s**3 - 15 * s**4 + 6 * s**5)
    signals = {
        "pos": np.column_stack([x, 0.0 * T, 0.0 * T + 0.3]),
        "force": np.zeros((T.size, 3)),
        "q": np.tile([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], (T.size, 1)),
        "gripper": np.full((T.size, 1), 0.08),
    }
    recording = Recording(T, signals, wrench_source="flange_sensor")
    segments = [{"cls": "steady", "t0": 0.0, "t1": 2.0}, {"cls": "motion", "t0": 2.0, "t1": 5.0}]

    def with_hand() -> Recording:
        push = 12.0 * np.clip(T - 2.5, 0.0, 1.0)
        force = np.column_stack([push, 0.0 * T, 0.0 * T])
        return Recording(T, {**signals, "force": force}, wrench_source="flange_sensor_with_hand")

    return CleanDemonstration(recording, {"segments": segments, "changepoints": []}, with_hand, load_panda())


def test_a_hint_counts_once_and_is_at_the_place_that_it_named_first(monkeypatch):
    pause = Hint(kind="uncertain_boundary", since=2.0, text="Unclear.", advice="Pause.", t0=1.4, tn=1.4)
    again = pause.model_copy(update={"advice": "Show it again.", "t0": 0.0, "tn": 5.0})
    over = again.model_copy(update={"until": 6.0})
    shown = [
        SimpleNamespace(hints=(one,), samples=n) for one, n in ((pause, 2100), (again, 5000), (over, 6100))
    ]
    monkeypatch.setattr(hint_recall, "views", lambda _recording: shown)
    (one,) = hint_recall.published(Recording(T, {"pos": np.zeros((T.size, 3))}))
    assert (one.at, one.hint.t0, one.hint.until) == (T[2099], 1.4, 6.0)


def test_every_fault_has_a_hint_and_there_are_fifty():
    assert {one.hint for one in INJECTED.values()} <= set(get_args(HintKind))
    assert sum(one.judged for one in INJECTED.values()) == FAULTS


@pytest.mark.parametrize("name", ["cable", "weight"])
def test_a_force_begins_at_its_cause_and_not_before(taught: CleanDemonstration, name: str):
    fault = INJECTED[name].inject(taught, np.random.default_rng(1))
    force = fault.recording.signals["force"]
    assert fault.kind == INJECTED[name].hint
    assert not force[fault.cause > T].any()
    assert np.linalg.norm(force[np.searchsorted(T, fault.cause + 0.2)]) > 5.0


def test_joints_are_led_to_a_limit_and_the_flange_goes_with_them(taught: CleanDemonstration):
    fault = INJECTED["joint limit"].inject(taught, np.random.default_rng(1))
    led = fault.recording.signals["q"]
    left = np.minimum(led - taught.robot.lower_limits, taught.robot.upper_limits - led).min(axis=1)
    at = int(np.searchsorted(T, fault.cause))
    assert left[at] < 0.05 <= left[at - 2]
    assert np.allclose(fault.recording.signals["pos"][at], taught.robot.flange_pose(led[at]).position_base)


def test_lost_samples_are_noticed_with_the_next_one(taught: CleanDemonstration):
    fault = INJECTED["lost samples"].inject(taught, np.random.default_rng(1))
    at = int(np.searchsorted(fault.recording.t, fault.cause))
    assert fault.recording.t[at] - fault.recording.t[at - 1] > 0.3


def test_a_hand_counts_from_when_it_drives_more_than_a_bias_does(taught: CleanDemonstration):
    fault = INJECTED["hand"].inject(taught, np.random.default_rng(1))
    reached = 2.5 + 2.33 * 2.3 / 12.0
    assert fault.cause == pytest.approx(reached, abs=0.05)


def test_a_hand_begins_before_it_can_be_seen(taught: CleanDemonstration):
    fault = INJECTED["hand"].inject(taught, np.random.default_rng(1))
    assert 2.0 < fault.begins < fault.cause


def test_an_unclear_corner_turns_by_the_limit_and_dips_until_the_posterior_is_even(
    monkeypatch: pytest.MonkeyPatch, taught: CleanDemonstration
):
    def pace(recording: Recording, t: float) -> float:
        moved = np.gradient(recording.signals["pos"], recording.t, axis=0)
        return float(np.linalg.norm(moved[np.searchsorted(recording.t, t)]))

    def probability(recording: Recording, corner: float) -> float:
        """A boundary below a dip of 0.55, and as good as none above one of 0.65."""
        dip = pace(recording, corner) / pace(recording, corner - 0.35)
        return float(np.clip(0.5 + (0.6 - dip) / 0.1, 0.0, 1.0))

    monkeypatch.setattr(injected_faults, "boundary_probability", probability)
    fault = INJECTED["unclear corner"].inject(taught, np.random.default_rng(1))
    assert fault.place == fault.begins == pytest.approx(fault.cause - 0.5)
    assert 0.4 < probability(fault.recording, fault.begins) < 0.6
    moved = np.gradient(fault.recording.signals["pos"], fault.recording.t, axis=0)
    before, after = (moved[np.searchsorted(fault.recording.t, fault.begins + dt)] for dt in (-0.2, 0.2))
    turn = np.degrees(np.arccos(before @ after / np.linalg.norm(before) / np.linalg.norm(after)))
    assert 40.0 <= turn <= 50.0


def test_a_corner_at_which_the_posterior_is_sure_is_no_fault(
    monkeypatch: pytest.MonkeyPatch, taught: CleanDemonstration
):
    monkeypatch.setattr(injected_faults, "boundary_probability", lambda _recording, _corner: 0.95)
    with pytest.raises(NotInjectableError):
        INJECTED["unclear corner"].inject(taught, np.random.default_rng(1))


def test_a_hint_at_another_boundary_does_not_name_the_fault(taught: CleanDemonstration):
    fault = Fault("uncertain_boundary", taught.recording, 4.5, begins=4.0, place=4.0)
    hint = Hint(kind="uncertain_boundary", since=4.6, text="Unclear.", advice="Pause.", t0=3.9, tn=3.9)
    assert fault.is_named_by(hint)
    assert not fault.is_named_by(hint.model_copy(update={"t0": 3.0}))
    assert not fault.is_named_by(hint.model_copy(update={"kind": "too_fast"}))


@pytest.mark.parametrize(
    ("published_at", "until", "found"),
    [
        (3.0, None, True),  # it stands at the cause
        (3.0, 3.8, False),  # it was cleared before the cause
        (1.9, None, False),  # it stood before the fault began
        (4.5, None, True),
        (4.6, None, False),  # too late
    ],
)
def test_a_fault_is_found_by_a_hint_of_it_that_is_active_in_time(
    monkeypatch: pytest.MonkeyPatch,
    taught: CleanDemonstration,
    published_at: float,
    until: float | None,
    found: bool,
):
    hint = Hint(kind="bias_drift", since=published_at, until=until, text="Drift.", advice="Tare.")
    monkeypatch.setattr(hint_recall, "published", lambda _recording: [PublishedHint(hint, published_at)])
    fault = Fault("bias_drift", taught.recording, 4.0, begins=2.0)
    assert hint_recall.judged("drift", CoachingCase("curves", 1, ()), fault).found == found


def test_a_fault_without_a_place_is_not_injected(taught: CleanDemonstration):
    still = CleanDemonstration(
        taught.recording, {"segments": [], "changepoints": []}, taught.with_hand, taught.robot
    )
    with pytest.raises(NotInjectableError):
        INJECTED["cable"].inject(still, np.random.default_rng(1))


def test_a_path_is_unrecorded_where_it_turns_within_a_step_of_the_grid():
    smooth = np.column_stack([0.1 * np.sin(T), 0.0 * T, 0.0 * T])
    assert first_unrecorded(T, smooth) is None
    reversed_at_4 = np.column_stack([1.0 * np.abs(T - 4.0), 0.0 * T, 0.0 * T])
    assert first_unrecorded(T, reversed_at_4) == pytest.approx(4.0, abs=0.15)


def test_results_are_counted_by_fault_and_by_set():
    def result(name: str, latency: float | None) -> CoachingResult:
        clean = CleanResult("simulated", name, 30.0, ("too_fast",), ())
        return CoachingResult(clean, (FaultResult("hand", "curves", 1, 2.0, latency),))

    some = [result("a-1", 0.3), None, result("b-1", 0.7), result("c-1", None)]
    summary = summarise(some)
    assert [one.found for one in summary.faults["hand"]] == [True, False, False]
    page = hint_recall.page(summary, title(range(1, 3))).as_markdown()
    assert "| hand | hand_in_wrench | 1 of 3 | 0.33 | 0.30 | 0.30 |" in page
    assert "2.00" in page  # false hints a minute
    assert "0.70 s late" in page


SUBSET = (
    CoachingCase("button", 2, tuple(name for name in INJECTED if name not in {"weight", "unclear corner"})),
    CoachingCase("pick_and_place", 2, ("weight",)),
)


@pytest.mark.slow
def test_both_bars_are_met_by_a_subset_with_faults_of_eight_kinds():
    summary = summarise(map(hint_recall.run_case, SUBSET))
    assert sum(map(len, summary.faults.values())) == 8
    recall, false = bars(summary)
    assert recall.is_met, recall.words()
    assert false.is_met, false.words()


def evaluated(monkeypatch: pytest.MonkeyPatch, folder: Path, found: int, hints: int):
    """The command, of ten faults and a minute without a fault."""
    clean = CleanResult("simulated", "curves-1", 60.0, ("too_fast",) * hints, ())
    faults = [FaultResult("hand", "curves", 1, 2.0, 0.1 if number < found else None) for number in range(5)]
    more = [
        FaultResult("drift", "curves", 1, 2.0, 0.1 if number + 5 < found else None) for number in range(5)
    ]
    monkeypatch.setattr(hint_recall, "run", lambda _: CoachingResult(clean, (*faults, *more)))
    monkeypatch.setattr(hint_recall, "cases", lambda *_: [CoachingCase("curves", 1, ())])
    app = typer.Typer()
    register(app)
    page = folder / "page.md"
    command = ["evaluate", "--suite", "coaching", "--workers", "1", "--format", "markdown", "-o", str(page)]
    return CliRunner().invoke(app, command), page.read_text()


@pytest.mark.parametrize(
    ("found", "hints", "said"),
    [
        (9, 1, ""),
        (8, 1, "error: not met: recall: 0.80, wanted at least 0.9"),
        (9, 2, "error: not met: false hints a minute: 2.00, wanted at most 1"),
    ],
)
def test_the_command_states_its_bars_and_ends_with_an_error_where_one_is_not_met(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, found: int, hints: int, said: str
):
    result, page = evaluated(monkeypatch, tmp_path, found, hints)
    assert result.exit_code == bool(said)
    assert said in result.stderr
    assert f"| recall | at least 0.9 | {found / 10:.2f} | {'yes' if found >= 9 else 'no'} |" in page
    assert f"| false hints a minute | at most 1 | {hints:.2f} | {'yes' if hints <= 1 else 'no'} |" in page


def test_nothing_that_was_judged_meets_no_bar():
    assert unmet(summarise([])) == [
        "recall: nothing was judged, wanted at least 0.9",
        "false hints a minute: nothing was judged, wanted at most 1",
    ]
