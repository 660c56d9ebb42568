"""Corrections: what they come to, and that they mean the same whenever they are made."""

from __future__ import annotations

from functools import cache
from itertools import islice
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol.app_force_limit import LEAST_FORCE_N
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Action,
    Insert,
    LimitForce,
    Move,
    NamePhase,
    Phase,
    Redo,
    Relabel,
    Remove,
    TakeBack,
    Undo,
)
from caesura_protocol.programs.apps_by_phase import groups_of
from caesura_service.changepoint.preset import STEP_S
from caesura_service.offline_segmentation import batches, opening_of
from caesura_service.segmentation.corrections import (
    AHEAD_S,
    EditHistory,
    ResolvedEdit,
    correction_of,
)
from caesura_service.segmentation.encoded_log import EncodedMessageLog, MessageSequence
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.segmentation.pipeline_interface import Pipeline, PipelineView
from harness.demonstrations import taught as many_strokes
from service.segmentation.corrected import SHORT, begun, edit, fed, refusal, taught, times, whole, with_one

LOST = range(200, 212)  # batches that never come, in the demonstration with a hole
SHORTER = 200  # where the thesis decides, which takes ten times as long
KINDS = ("motion", "contact", "transport", "steady", "hold", "sliding")


# --- what each of them means ----------------------------------------------------------------------------


@pytest.mark.parametrize("t", np.linspace(0.3, 12.3, 25))
def test_an_inserted_changepoint_is_as_near_as_there_are_observations_certain_final_and_marked(
    shown: Pipeline, t: float
):
    view = with_one(shown, Insert(t=t))
    (found,) = [one for one in view.changepoints if one.corrected]
    assert abs(found.t - t) <= 0.5 * STEP_S + 1e-9
    assert (found.probability, found.certainty, found.t_low, found.t_high) == (
        1.0,
        "final",
        found.t,
        found.t,
    )
    assert found.t in [one.t0 for one in view.segments]


def test_an_insert_at_the_time_of_a_changepoint_confirms_it():
    """Where the speed has it at the end of a step, the next step started a segment of 10 ms beside it."""
    wiped = whole("wiping")
    for t in times(wiped.view):
        view = with_one(wiped, Insert(t=round(t, 2)))
        assert times(view) == times(wiped.view)
        assert [one.t for one in view.changepoints if one.corrected] == [t]


def test_a_changepoint_that_an_operator_inserts_divides_the_app():
    """The hand goes on there: the program had one app, and the corrected session looked as before."""
    walked = whole("parkour")
    first, *_ = walked.view.apps
    assert first.tn - first.t0 > 0.8
    divided = with_one(walked, Insert(t=first.t0 + 0.4)).apps
    assert len(divided) == len(walked.view.apps) + 1
    assert divided[0].tn == divided[1].t0 == pytest.approx(first.t0 + 0.4, abs=STEP_S / 2 + 1e-9)
    assert divided[1].tn == first.tn


def test_a_removed_changepoint_is_gone_and_nothing_takes_its_place_between_its_neighbours(shown: Pipeline):
    before = [shown.view.segments[0].t0, *times(shown.view), np.inf]
    for last, t, following in zip(before, before[1:], before[2:], strict=False):
        left = [one for one in times(with_one(shown, Remove(t=t))) if last < one < following]
        assert left == []


def test_forbidding_its_interval_only_would_put_a_removed_changepoint_right_beside(shown: Pipeline):
    first, back = shown.view.segments[0].t0, 0
    for one in shown.view.changepoints:
        low, high = (round((t - first) / STEP_S + 0.5) for t in (one.t_low, one.t_high))
        view = shown.corrected([ResolvedEdit(none=tuple(range(low, high + 1)))]).view
        back += any(abs(t - one.t) < 0.35 for t in times(view))
    assert (back, len(shown.view.changepoints)) == (5, 8)


def test_a_changepoint_is_meant_from_half_a_second_away_and_the_nearest_of_all(shown: Pipeline):
    assert shown.resolve(Remove(t=4.15 + 0.45)) == shown.resolve(Remove(t=4.15))
    assert shown.resolve(Remove(t=7.55 - 0.45)) == shown.resolve(Remove(t=7.55))


def test_a_moved_changepoint_is_where_it_was_moved_to_and_nowhere_else(shown: Pipeline):
    view = with_one(shown, Move(t=4.15, to=4.75))
    assert [round(t, 2) for t in times(view) if 1.8 < t < 5.5] == [4.75]
    assert [one.corrected for one in view.changepoints if 4.7 < one.t < 4.8] == [True]


@pytest.mark.parametrize("t", [*np.linspace(0.3, 12.3, 25), 5.05, 5.1])
def test_a_correction_states_where_its_changepoint_lies(shown: Pipeline, t: float):
    """The list stated the time that was asked for, and the answer the place."""
    before = min(times(shown.view), key=lambda one: abs(one - 4.2))
    for action, meant in ((Insert(t=t), None), (Move(t=4.2, to=t), before)):
        made = shown.resolve(action)
        (found,) = [one.t for one in with_one(shown, action).changepoints if one.corrected]
        assert (made.meant, made.placed) == (meant, found)
    assert shown.resolve(Remove(t=4.2)).meant == before


def test_a_changepoint_that_is_yet_to_come_has_no_place():
    short = fed(begun(), range(SHORT))
    assert short.resolve(Insert(t=short.view.t + 1.0)).placed is None


def test_a_relabelled_segment_keeps_its_ends_and_is_what_it_is_said_to_be(shown: Pipeline):
    old = shown.view.segments[2]
    view = with_one(shown, Relabel(t=0.5 * (old.t0 + old.tn), kind="contact"))
    (new,) = [one for one in view.segments if one.corrected]
    assert (new.t0, new.tn) == (old.t0, old.tn)
    assert (new.kind, new.motion, new.contact) == ("contact", "steady", "contact")
    assert (new.probability, new.runner_up, new.log_odds) == (1.0, None, 0.0)
    assert new.force_held is not None
    assert [one.t for one in view.changepoints if one.corrected] == [old.t0, old.tn]


def test_a_relabelled_segment_keeps_its_kind_when_its_end_is_moved(shown: Pipeline):
    old = shown.view.segments[2]
    labelled = shown.resolve(Relabel(t=old.tn - 0.05, kind="contact"))
    once = shown.corrected([labelled])
    for to in (old.tn - 0.4, old.tn + 0.4):
        view = once.corrected([labelled, once.resolve(Move(t=old.tn, to=to))]).view
        (new,) = [one for one in view.segments if one.corrected]
        assert (new.t0, new.kind) == (old.t0, "contact")
        assert new.tn == pytest.approx(to, abs=0.06)


def test_a_kind_changes_the_program(shown: Pipeline):
    carried = next(one for one in shown.view.segments if one.kind == "transport")
    view = with_one(shown, Relabel(t=carried.t0 + 0.3, kind="motion"))
    kinds = [app.kind for app in view.apps if app.t0 == carried.t0]
    assert "transport" not in kinds
    assert kinds


def test_a_limited_force_is_found_again_by_its_time_and_its_direction_stays():
    wiped = whole("wiping")
    app = max((one for one in wiped.view.apps if one.force), key=lambda one: one.tn - one.t0)
    limited = wiped.resolve(LimitForce(t=app.t0 + 0.01, newton=2.0))
    inside = 0.5 * (app.t0 + app.tn) - 0.4
    for corrections in ([limited], [wiped.resolve(Insert(t=0.4)), limited]):
        view = wiped.corrected(corrections).view
        (found,) = [one for one in view.apps if one.t0 <= inside <= one.tn and one.force]
        np.testing.assert_allclose(np.linalg.norm(found.force), 2.0)
        np.testing.assert_allclose(np.cross(found.force, found.force_taught), 0.0, atol=1e-9)
        assert found.force_taught == app.force_taught
        assert isinstance(view.apps, MessageSequence), "only its end is made anew at every look"
    lifted = wiped.resolve(LimitForce(t=app.t0 + 0.01, newton=None))
    assert wiped.corrected([limited, lifted]).view == wiped.view


def test_a_named_phase_keeps_its_name_and_gives_it_to_its_group():
    wiped = whole("wiping")
    (wipe,) = [phase for phase in wiped.view.phases if phase.kind == "contact"]
    named = wiped.resolve(NamePhase(t=wipe.t0 + 0.1, name="wipe the table"))
    again = correction_of(named.recorded())  # as the journal keeps it
    for corrections in ([named], [wiped.resolve(Insert(t=wipe.t0 - 1.0)), again]):
        view = wiped.corrected(corrections).view
        assert [phase.name for phase in view.phases] == [None, "wipe the table", None]
        groups = groups_of(view.apps, view.phases)
        assert [group.name for group in groups] == ["free 1", "wipe the table", "free 2"]
    other = wiped.resolve(NamePhase(t=wipe.tn - 0.1, name="polish"))
    assert wiped.corrected([named, other]).view.phases[1].name == "polish"
    assert wiped.corrected([]).view.phases == wiped.view.phases


def test_the_later_of_two_corrections_counts(shown: Pipeline):
    inserted = shown.resolve(Insert(t=3.02))
    once = shown.corrected([inserted])
    removed = once.resolve(Remove(t=3.0))
    gone = once.corrected([inserted, removed])
    assert [t for t in times(gone.view) if 2.7 < t < 3.3] == []
    back = gone.corrected([inserted, removed, gone.resolve(Insert(t=2.98))])
    assert [round(t, 2) for t in times(back.view) if 2.7 < t < 3.3] == [2.95]


# --- what is refused ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "action",
    [
        Insert(t=99.0),
        Remove(t=-1.0),
        Move(t=4.15, to=99.0),
        LimitForce(t=99.0, newton=1.0),
        NamePhase(t=99.0, name="a"),
    ],
)
def test_a_time_outside_the_demonstration_is_refused_with_its_ends(shown: Pipeline, action: Action):
    error = refusal(shown, action)
    assert error.code == "malformed"
    assert error.limit == [shown.view.segments[0].t0, shown.view.t]


@pytest.mark.parametrize("action", [Remove(t=3.0), Move(t=3.0, to=4.0)])
def test_where_there_is_no_changepoint_the_nearest_are_named(shown: Pipeline, action: Action):
    error = refusal(shown, action)
    assert (error.code, error.value, error.limit) == ("conflict", 3.0, 0.5)
    assert error.expected == pytest.approx(sorted(times(shown.view), key=lambda t: abs(t - 3.0))[:3])


def test_a_kind_that_the_session_does_not_know_is_refused_with_those_that_it_does():
    opening, samples = taught()
    blind = make_pipeline(opening.model_copy(update={"wrench_source": "none"}), "default")
    for batch in samples[:300]:
        blind.push(batch)
    error = refusal(blind, Relabel(t=2.0, kind="contact"))
    assert (error.code, error.value, error.expected) == (
        "malformed",
        "contact",
        ["motion", "steady", "turning"],
    )


def test_a_force_limit_without_a_force_or_above_the_cells_is_refused(shown: Pipeline):
    assert refusal(shown, LimitForce(t=3.0, newton=1.0)).code == "conflict"
    opening, _ = taught()
    limited = make_pipeline(opening.model_copy(update={"force_limit_n": 10.0}), "default")
    error = refusal(limited, LimitForce(t=0.0, newton=10.5))
    assert (error.code, error.value, error.limit) == ("malformed", 10.5, 10.0)
    error = refusal(shown, LimitForce(t=0.0, newton=LEAST_FORCE_N / 2))
    assert (error.code, error.value, error.limit) == ("malformed", LEAST_FORCE_N / 2, LEAST_FORCE_N)


def test_a_segment_behind_a_gap_begins_there_whatever_is_corrected():
    holed = whole(lost=LOST)
    (gap,) = holed.view.gaps
    behind = next(t for t in times(holed.view) if t >= gap.tn - 0.01)
    assert "samples are missing" in str(refusal(holed, Remove(t=behind)))
    before = max(t for t in times(holed.view) if t < gap.t0)
    assert behind in times(with_one(holed, Remove(t=before)))


def test_before_the_first_observation_there_is_nothing_to_correct():
    assert refusal(begun(), Insert(t=0.0)).code == "conflict"


# --- while it goes on -----------------------------------------------------------------------------------


def test_an_insert_may_be_a_little_ahead_of_what_has_been_observed():
    half = fed(begun(), range(300))
    t = half.view.t + 0.6
    ahead = half.corrected([half.resolve(Insert(t=t))])
    assert times(ahead.view) == times(half.view)
    first = half.view.segments[0].t0
    later = fed(ahead, range(300, 400))
    (found,) = [one for one in later.view.changepoints if one.corrected]
    assert found.t == pytest.approx(t, abs=0.5 * STEP_S + 1e-9)
    error = refusal(later, Insert(t=later.view.t + AHEAD_S + 0.1))
    assert (error.code, error.limit) == ("malformed", [first, later.view.t + AHEAD_S])


def test_the_growing_segment_can_be_named_and_still_ends_by_itself():
    half = fed(begun(), range(300))
    named = half.corrected([half.resolve(Relabel(t=half.view.t, kind="hold"))])
    assert (named.view.segments[-1].kind, named.view.segments[-1].tn) == ("hold", half.view.t)
    later = fed(named, range(300, len(taught()[1])))
    (found,) = [one for one in later.view.segments if one.corrected]
    assert half.view.t <= found.tn < later.view.t


# --- the same whenever they are made --------------------------------------------------------------------


def _action(seed: np.random.Generator, view: PipelineView, *, finished: bool) -> Action:
    t = float(seed.uniform(0.0, max(view.t, 0.0) + (0.0 if finished else 1.0)))
    near = float(seed.choice([one.t for one in view.changepoints] or [t])) + float(seed.normal(0.0, 0.1))
    actions: list[Action] = [
        Insert(t=t),
        Remove(t=near),
        Move(t=near, to=t),
        Relabel(t=t, kind=str(seed.choice(KINDS))),  # type: ignore[arg-type]
        LimitForce(t=t, newton=float(seed.uniform(0.0, 10.0))),
        NamePhase(t=t, name=str(seed.choice(["reach", "wipe"]))),
        Undo(),
        Redo(),
        TakeBack(number=int(seed.integers(1, 12))),
    ]
    return actions[int(seed.integers(len(actions)))]


def edited_at_random(
    seed: np.random.Generator, threshold: float | None, lost: range, count: int
) -> tuple[Pipeline, EditHistory, int]:
    """A demonstration with edits at any moment; how many were taken."""
    pipeline, corrections, taken = begun(threshold=threshold), EditHistory(), 0
    stops = sorted({*seed.integers(1, count, 5).tolist(), count})
    for first, stop in zip([0, *stops], [*stops, None], strict=True):
        if stop is None:
            pipeline.finish()
        else:
            fed(pipeline, range(first, stop), lost=lost)
        for _ in range(int(seed.integers(0, 4))):
            try:
                action = _action(seed, pipeline.view, finished=stop is None)
                after = corrections.after(edit(action), 0.0, pipeline.resolve)
            except ProtocolError:
                continue
            pipeline, corrections, taken = pipeline.corrected(after.active), after, taken + 1
    return pipeline, corrections, taken


def check_same(seed: int, threshold: float | None, lost: range, count: int = SHORT) -> int:
    pipeline, corrections, taken = edited_at_random(np.random.default_rng(seed), threshold, lost, count)
    fresh = begun(threshold=threshold).corrected(corrections.active)
    fed(fresh, range(count), lost=lost).finish()
    assert pipeline.view == fresh.view
    assert pipeline.corrected([]).view == plain(threshold, lost, count).view
    return taken


@cache
def plain(threshold: float | None, lost: range, count: int = SHORT) -> Pipeline:
    """The demonstration that is edited at random, without edits."""
    pipeline = fed(begun(threshold=threshold), range(count), lost=lost)
    pipeline.finish()
    return pipeline


@pytest.mark.slow
@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_edits_at_any_moment_are_as_if_they_had_been_known_from_the_first_sample_on(seed: int, holed: bool):
    check_same(seed, None, LOST if holed else range(0))


def strokes(seconds: float, end: int | None = None, at_once: int = 1) -> Pipeline:
    """A demonstration of strokes that has ended, after so many batches."""
    recording = many_strokes(3, seconds)
    pipeline = make_pipeline(opening_of(recording, "default"), "default")
    for batch in islice(batches(recording, at_once), end):
        pipeline.push(batch)
    pipeline.finish()
    return pipeline


@pytest.mark.slow
@pytest.mark.parametrize("end", range(277, 284))
def test_a_corrected_session_is_finished_wherever_it_ends(end: int):
    """Settled segments are stored every 150 observations, also at the last one."""
    pipeline = strokes(29.0, end)
    assert pipeline.corrected([]).view == pipeline.view


def test_a_correction_decodes_each_phase_a_few_times_however_many_apps_there_are(monkeypatch):
    """Of an hour, each app decoded all phases, at each 15 s: no preview was answered in four minutes."""
    pipeline, decoded = strokes(90.0, at_once=1000), 0
    read = EncodedMessageLog.read

    def counting(log: EncodedMessageLog[Any], start: int, stop: int) -> tuple[Any, ...]:
        nonlocal decoded
        decoded += stop - start if log._model is Phase else 0
        return read(log, start, stop)

    monkeypatch.setattr(EncodedMessageLog, "read", counting)
    view = pipeline.corrected([]).view
    assert len(view.apps) > 50
    assert decoded <= 4 * len(view.phases)


@pytest.mark.parametrize(("name", "number"), [("pick_and_place", 8), ("three_point", 4), ("three_point", 11)])
def test_an_end_that_a_correction_makes_certain_is_where_the_speed_has_it_as_without_a_restart(
    name: str, number: int
):
    """The filter knows such an end with its observation, and its place with the next one only."""
    made = whole(name)
    named = made.view.segments[number]
    correction = made.resolve(Relabel(t=0.5 * (named.t0 + named.tn), kind="contact"))
    replayed = fed(begun(name).corrected([correction]), range(len(taught(name)[1])), name)
    replayed.finish()
    assert [*replayed.view.segments] == [*made.corrected([correction]).view.segments]
    assert replayed.view.segments[number - 1].tn == replayed.view.segments[number].t0


@pytest.mark.slow
def test_the_thesis_decision_heeds_corrections_as_well():
    assert check_same(7, 0.2, range(0), SHORTER) > 5
    pipeline = plain(0.2, range(0), SHORTER)
    assert [one.corrected for one in with_one(pipeline, Insert(t=3.0)).changepoints].count(True) == 1
    before = times(pipeline.view)
    last, removed, following = before[:3]
    assert [t for t in times(with_one(pipeline, Remove(t=removed))) if last < t < following] == []


def test_a_start_keeps_the_time_that_an_operator_gives_it_and_any_other_where_the_speed_has_it(
    shown: Pipeline,
):
    found = times(shown.view)
    moved = with_one(shown, Move(t=found[2], to=found[2] + 0.3))
    (put,) = [one.t for one in moved.changepoints if one.corrected]
    assert put == pytest.approx(found[2] + 0.3, abs=0.5 * STEP_S)
    pinned = with_one(shown, Relabel(t=found[2] + 0.05, kind="steady"))
    assert [one.t for one in pinned.changepoints if one.corrected] == found[2:4]
