"""Corrections taken back and made again, and what of the list of them is not applied."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    MAX_CORRECTIONS,
    Action,
    Insert,
    LimitForce,
    Move,
    NamePhase,
    Redo,
    Relabel,
    Remove,
    TakeBack,
    Undo,
)
from caesura_service.changepoint.preset import STEP_S
from caesura_service.segmentation.corrections import (
    EditHistory,
    FilterConstraints,
    ResolvedEdit,
)
from caesura_service.segmentation.pipeline import SegmentationPipeline
from caesura_service.segmentation.pipeline_interface import Pipeline
from service.segmentation.corrected import SHORT, begun, edit, fed, times, whole, with_one


def _with(history: EditHistory, *actions: Action) -> EditHistory:
    """With these edits more; a time stands for its own correction."""
    for action in actions:
        history = history.after(edit(action), 7.0, lambda change: ResolvedEdit(inserted=change.t))
    return history


def _inserted(history: EditHistory) -> list[float | None]:
    return [one.inserted for one in history.active]


def test_undo_takes_the_last_one_back_and_redo_makes_it_again():
    two = _with(EditHistory(), Insert(t=1.0), Insert(t=2.0))
    once = _with(two, Undo())
    assert (_inserted(once), once.revision) == ([1.0], 3)
    again = _with(once, Redo())
    assert (again.active, again.undone, again.revision) == (two.active, (), 4)


def test_a_new_correction_ends_what_could_be_made_again():
    undone = _with(EditHistory(), Insert(t=1.0), Undo())
    assert undone.undone
    assert not _with(undone, Insert(t=2.0)).undone


def test_any_correction_is_taken_back_and_redo_puts_it_at_its_place_again():
    three = _with(EditHistory(), Insert(t=1.0), Insert(t=2.0), Insert(t=3.0))
    without = _with(three, TakeBack(number=2))
    assert (_inserted(without), without.revision) == ([1.0, 3.0], 4)
    twice = _with(without, Undo())
    assert _inserted(twice) == [1.0]
    again = _with(twice, Redo(), Redo())
    assert again.active == three.active
    assert again.listed == three.listed


def test_the_list_has_author_time_and_state_of_each_by_its_number():
    listed = _with(EditHistory(), Insert(t=1.0), Insert(t=2.0), TakeBack(number=1)).listed
    assert [(one.number, one.author, one.at, one.action, one.state) for one in listed] == [
        (1, "Ann", 7.0, Insert(t=1.0), "undone"),
        (2, "Ann", 7.0, Insert(t=2.0), "applied"),
    ]


@pytest.mark.parametrize(
    ("number", "why"),
    [(1, "taken back already"), (3, "no such correction"), (0, "no such correction")],
)
def test_a_correction_that_is_not_there_cannot_be_taken_back(number: int, why: str):
    history = _with(EditHistory(), Insert(t=1.0), Insert(t=2.0), TakeBack(number=1))
    with pytest.raises(ProtocolError, match=why) as caught:
        _with(history, TakeBack(number=number))
    assert caught.value.expected == [2]


def test_a_refusal_to_take_back_names_every_correction_that_there_is():
    """It named the newest three, whatever there was."""
    five = _with(EditHistory(), *(Insert(t=float(t)) for t in range(1, 6)))
    with pytest.raises(ProtocolError, match="no such correction") as caught:
        _with(five, TakeBack(number=99))
    assert (caught.value.value, caught.value.expected) == (99, ["1 to 5"])
    with pytest.raises(ProtocolError) as caught:
        _with(five, TakeBack(number=2), TakeBack(number=2))
    assert caught.value.expected == [1, "3 to 5"]
    many = _with(EditHistory(), *(Insert(t=float(t)) for t in range(1, 101)))
    alternate = _with(many, *(TakeBack(number=number) for number in range(2, 101, 2)))
    with pytest.raises(ProtocolError) as caught:
        _with(alternate, TakeBack(number=2))
    assert caught.value.expected == ["…", *range(69, 101, 2)]


def history_of(pipeline: Pipeline, *actions: Action) -> tuple[Pipeline, EditHistory]:
    """Real corrections, each resolved against the results of those before it."""
    history = EditHistory()
    for action in actions:
        history = history.after(edit(action), 0.0, pipeline.resolve)
        pipeline = pipeline.corrected(history.active)
    return pipeline, history


@pytest.mark.parametrize(
    ("first", "later", "why"),
    [
        (Insert(t=3.0), Move(t=3.0, to=3.4), "correction 2 by Ann moved that changepoint on"),
        (Insert(t=3.0), Remove(t=3.0), "correction 2 by Ann removed that changepoint"),
        (Move(t=4.15, to=4.4), Move(t=4.4, to=4.6), "take correction 2 back first"),
        (Insert(t=3.0), Relabel(t=3.2, kind="contact"), "correction 2 by Ann states what the segment is"),
    ],
)
def test_a_correction_to_whose_changepoint_a_later_one_refers_stays(
    shown: Pipeline, first: Action, later: Action, why: str
):
    pipeline, history = history_of(shown, first, later)
    with pytest.raises(ProtocolError, match=why) as caught:
        history.check_unreferred(history.active[0], pipeline.observation_at)
    assert (caught.value.value, caught.value.expected) == (1, 2)
    history.check_unreferred(history.active[1], pipeline.observation_at)


@pytest.mark.parametrize(
    "later",
    [
        Insert(t=3.4),
        Remove(t=4.15),
        Move(t=1.35, to=1.5),
        Relabel(t=9.0, kind="steady"),
        NamePhase(t=3.0, name="go"),
    ],
)
def test_what_lies_beside_does_not_refer_to_a_correction(shown: Pipeline, later: Action):
    pipeline, history = history_of(shown, Insert(t=3.0), later)
    history.check_unreferred(history.active[0], pipeline.observation_at)
    without = history.after(edit(TakeBack(number=1)), 0.0, pytest.fail)
    alone = history_of(shown, later)[0]
    assert pipeline.corrected(without.active).view.segments == alone.view.segments


def test_an_insert_that_was_confirmed_may_be_taken_back(shown: Pipeline):
    there = times(with_one(shown, Insert(t=3.0)))[2]
    pipeline, history = history_of(shown, Insert(t=3.0), Insert(t=there))
    history.check_unreferred(history.active[0], pipeline.observation_at)
    left = history.after(edit(TakeBack(number=1)), 0.0, pytest.fail)
    near = [one for one in pipeline.corrected(left.active).view.changepoints if one.corrected]
    assert [abs(one.t - there) < STEP_S for one in near] == [True]


def test_a_force_limit_whose_app_is_gone_is_not_applied_until_the_app_is_back():
    wiped = whole("wiping")
    app = max((one for one in wiped.view.apps if one.force), key=lambda one: one.tn - one.t0)
    middle = 0.5 * (app.t0 + app.tn)
    limited = LimitForce(t=app.t0 + 0.01, newton=2.0)
    pipeline, history = history_of(wiped, limited)
    assert pipeline.view.unapplied == {}
    moved, history = history_of(wiped, limited, Relabel(t=middle, kind="motion"))
    assert moved.view.unapplied == {1: f"no app exerts a force at {middle:.2f} s any more"}
    assert [one for one in moved.view.notes if "Correction 1 by Ann (limit_force) is not applied" in one]
    history = history.after(edit(TakeBack(number=2)), 0.0, pytest.fail)
    back = moved.corrected(history.active).view
    assert (back.unapplied, back.apps) == ({}, pipeline.view.apps)


def test_a_name_whose_phase_is_now_one_with_another_is_not_applied_until_they_are_two():
    """Of two names that people gave one was gone, and it was listed as applied."""
    wiped = whole("wiping")
    reach, wipe, *_ = wiped.view.phases
    names = [NamePhase(t=one.t0 + 0.1, name=name) for one, name in ((reach, "reach"), (wipe, "wipe"))]
    pipeline, history = history_of(wiped, *names, NamePhase(t=wipe.t0 + 0.1, name="polish"))
    assert ([one.name for one in pipeline.view.phases][:2], pipeline.view.unapplied) == (
        ["reach", "polish"],
        {},
    )
    touching = [one for one in wiped.view.segments if wipe.t0 <= one.t0 < wipe.tn]
    free = [Relabel(t=0.5 * (one.t0 + one.tn), kind="motion") for one in touching]
    joined, history = history_of(wiped, *names, *free)
    assert joined.view.phases[0].name == "wipe"
    middle = 0.5 * (wipe.t0 + wipe.tn)
    reason = f"its phase is now one with that at {middle:.2f} s, 'wipe'"
    assert joined.view.unapplied == {1: reason}
    assert f"Correction 1 by Ann (name_phase) is not applied: {reason}." in joined.view.notes
    for number in range(len(history.active), 2, -1):
        history = history.after(edit(TakeBack(number=number)), 0.0, pytest.fail)
    assert joined.corrected(history.active).view.unapplied == {}


def test_a_changepoint_that_was_to_come_after_the_end_is_not_applied():
    growing = fed(begun(), range(SHORT))
    t = growing.view.t + 2.0
    pipeline, _ = history_of(growing, Insert(t=t))
    assert pipeline.view.unapplied == {}, "it may still come"
    pipeline.finish()
    assert pipeline.view.unapplied == {1: f"the session ended before {t:.2f} s"}


@pytest.mark.parametrize("t", [0.2, 1.0, 3.0, 3.04, 7.25, 12.3])
def test_an_inserted_changepoint_is_at_the_observation_that_it_is_looked_up_at(shown: Pipeline, t: float):
    index = shown.observation_at(t)
    by_index = shown.corrected([ResolvedEdit(starts=(index,))]).view
    by_time = with_one(shown, Insert(t=t))
    assert [one.kind for one in by_index.segments] == [one.kind for one in by_time.segments]
    (put,) = [one.t for one in by_time.changepoints if one.corrected]
    assert isinstance(shown, SegmentationPipeline)
    middle = 0.5 * (shown._history.t(index - 1) + shown._history.t(index))
    assert put == pytest.approx(middle)


@pytest.mark.parametrize("action", [Undo(), Redo()])
def test_with_nothing_to_undo_or_redo_an_edit_is_refused(action: Action):
    with pytest.raises(ProtocolError, match="nothing to"):
        _with(EditHistory(), action)


def test_corrections_are_bounded():
    full = EditHistory(active=(ResolvedEdit(),) * MAX_CORRECTIONS)
    with pytest.raises(ProtocolError, match=f"limit {MAX_CORRECTIONS}"):
        _with(full, Insert(t=1.0))


def test_the_filter_is_informed_once_for_each_observation_and_the_later_word_counts():
    said = FilterConstraints(
        [ResolvedEdit(none=(3, 4)), ResolvedEdit(inserted=0.35), ResolvedEdit(none=(5,), starts=(6,))]
    )
    reported = [said.start(index, 0.1 * index) for index in range(8)]
    assert reported == [None, None, None, False, True, False, True, None]
    assert [said.is_certain(index) for index in range(8)].count(True) == 2


@given(
    st.lists(st.tuples(st.integers(0, 30), st.sampled_from("abc")), max_size=40),
    st.integers(0, 30),
    st.integers(0, 30),
)
def test_of_the_labels_within_a_segment_the_last_one_given_counts(given_labels, start, end):
    said = FilterConstraints([ResolvedEdit(label=label) for label in given_labels])
    inside = [kind for index, kind in given_labels if start <= index < end]
    assert said.label(start, end) == (inside[-1] if inside else None)


def test_the_label_of_a_segment_costs_the_same_however_many_were_given():
    def cost_s(labels: int) -> float:
        said = FilterConstraints([ResolvedEdit(label=(10 * index, "motion")) for index in range(labels)])
        began = time.process_time()
        for index in range(5000):
            said.label(index, index + 10)
        return time.process_time() - began

    few, many = (min(cost_s(labels) for _ in range(3)) for labels in (10, 2000))
    assert many < 8 * few
