"""Edits of an annotation, without a browser."""

from __future__ import annotations

import copy
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_lab.annotation.edits import EDITS, LEAST_TOLERANCE_S, AnnotationEditor, EditError
from caesura_lab.ground_truth import truth_of

EMPTY = {"file": "x.npz", "window": [0.0, 10.0], "changepoints": [], "segments": [], "rule": "kept"}


def edited(*steps: tuple[str, float], document=EMPTY) -> dict:
    """The document after these edits."""
    editor = AnnotationEditor(document)
    for name, t in steps:
        editor.edit(name, t)
    return dict(editor.document)


@pytest.mark.parametrize("kind", ["start", "stop", "contact_on", "contact_off", "corner"])
def test_a_mark_is_a_major_changepoint_of_its_kind(kind):
    (point,) = edited((kind, 1.42))["changepoints"]
    assert point == {"t": 1.42, "kind": kind, "tol": 0.15, "level": "major"}


def test_a_dip_is_optional_and_of_no_kind():
    (point,) = edited(("dip", 4.3))["changepoints"]
    assert point == {"t": 4.3, "tol": 0.15, "level": "optional"}


def test_changepoints_are_kept_in_the_order_of_time():
    points = edited(("stop", 3.0), ("start", 1.0), ("corner", 2.0))["changepoints"]
    assert [point["t"] for point in points] == [1.0, 2.0, 3.0]


def test_the_changepoint_nearest_to_the_cursor_is_the_one_that_changes():
    points = edited(("start", 1.0), ("stop", 1.4), ("level", 1.3), ("wider", 1.3), ("second", 1.25))[
        "changepoints"
    ]
    assert points[0] == {"t": 1.0, "kind": "start", "tol": 0.15, "level": "major"}
    assert points[1] == {"t": 1.4, "kind": "stop", "tol": 0.2, "level": "optional", "t_alt": 1.25}


def test_a_level_that_is_toggled_twice_is_what_it_was():
    assert edited(("start", 1.0), ("level", 1.0), ("level", 1.0)) == edited(("start", 1.0))


def test_a_tolerance_never_falls_below_its_least():
    document = edited(("start", 1.0), *[("narrower", 1.0)] * 20)
    assert document["changepoints"][0]["tol"] == LEAST_TOLERANCE_S


def test_a_removed_changepoint_is_gone_and_the_others_stay():
    points = edited(("start", 1.0), ("stop", 3.0), ("remove", 2.9))["changepoints"]
    assert [point["t"] for point in points] == [1.0]


def test_a_class_reaches_to_the_next_major_changepoints():
    document = edited(("start", 2.0), ("dip", 3.0), ("stop", 5.0), ("motion", 3.5), ("steady", 1.0))
    assert document["segments"] == [
        {"t0": 0.0, "t1": 2.0, "cls": "steady"},
        {"t0": 2.0, "t1": 5.0, "cls": "motion"},
    ]


def test_a_segment_that_is_there_changes_its_class_and_keeps_its_ends():
    document = {**EMPTY, "segments": [{"t0": 1.0, "t1": 2.0, "cls": "motion"}]}
    assert edited(("sliding", 1.5), document=document)["segments"] == [
        {"t0": 1.0, "t1": 2.0, "cls": "sliding"}
    ]
    assert edited(("no class", 1.5), document=document)["segments"] == []


def test_a_new_class_does_not_overlap_the_segments_beside_it():
    document = {**EMPTY, "segments": [{"t0": 1.0, "t1": 2.0, "cls": "motion"}]}
    assert edited(("contact", 2.5), document=document)["segments"][1] == {
        "t0": 2.0,
        "t1": 10.0,
        "cls": "contact",
    }
    assert edited(("steady", 0.5), document=document)["segments"][0] == {
        "t0": 0.0,
        "t1": 1.0,
        "cls": "steady",
    }


@pytest.mark.parametrize("steps", [(), (("motion", 5.0),), (("stop", 10.0),)])
def test_a_class_at_the_end_of_the_window_is_of_the_segment_that_ends_there(steps):
    """The key End and a class made a segment without a length."""
    assert edited(*steps, ("steady", 10.0))["segments"] == [{"t0": 0.0, "t1": 10.0, "cls": "steady"}]
    assert edited(*steps, ("steady", 10.0), ("no class", 10.0))["segments"] == []


def test_a_time_is_that_of_its_millisecond():
    """A recording begins at 0.0006 s and its window at 0.001 s: there was no class at its first sample."""
    document = {**EMPTY, "window": [0.001, 10.0]}
    assert edited(("steady", 0.0006), document=document)["segments"][0]["t0"] == 0.001


def test_a_time_of_day_is_named_to_the_millisecond():
    document = {**EMPTY, "window": [1732561234.123, 1732561244.5]}
    with pytest.raises(EditError, match=r"1732561230\.000 s is .* from 1732561234\.123 to 1732561244\.500 s"):
        edited(("start", 1732561230.0), document=document)
    with pytest.raises(EditError, match=r"a changepoint at 1732561235\.000 s already"):
        edited(("start", 1732561235.0), ("stop", 1732561235.0), document=document)


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        ([("level", 5.0)], "no changepoint within 0.5 s"),
        ([("start", 11.0)], "outside of the window"),
        ([("steady", 11.0)], "outside of the window"),
        ([("start", 1.0), ("stop", 1.0004)], "already"),
        ([("no class", 1.0)], "no class at"),
        ([("stop", 9.8), ("second", 10.2)], r"10\.200 s is outside of the window from 0\.000 to 10\.000 s"),
        ([("stop", 9.8), ("second", 9.8)], r"the changepoint is at 9\.800 s itself"),
        ([("jump", 1.0)], "expected one of"),
    ],
)
def test_an_edit_that_does_not_apply_says_why_and_changes_nothing(steps, words):
    editor = AnnotationEditor(EMPTY)
    for name, t in steps[:-1]:
        editor.edit(name, t)
    before = editor.document
    with pytest.raises(EditError, match=words):
        editor.edit(*steps[-1])
    assert editor.document is before


def test_undo_goes_back_one_edit_at_a_time():
    editor = AnnotationEditor(EMPTY)
    editor.edit("start", 1.0)
    editor.edit("stop", 2.0)
    editor.undo()
    assert [point["t"] for point in editor.document["changepoints"]] == [1.0]
    editor.undo()
    assert editor.is_saved
    with pytest.raises(EditError, match="nothing to undo"):
        editor.undo()


def test_an_annotation_is_unsaved_from_an_edit_to_the_next_save():
    editor = AnnotationEditor(EMPTY)
    editor.edit("start", 1.0)
    assert not editor.is_saved
    editor.mark_saved()
    assert editor.is_saved
    editor.undo()
    assert not editor.is_saved


@given(st.lists(st.tuples(st.sampled_from(sorted(EDITS)), st.floats(-1.0, 11.0)), max_size=30))
def test_after_any_edits_the_judge_reads_it_and_undo_returns_to_the_start(steps):
    editor, untouched = AnnotationEditor(EMPTY), copy.deepcopy(EMPTY)
    done = 0
    for name, t in steps:
        try:
            editor.edit(name, t)
        except EditError:
            continue
        done += 1
        truth = truth_of(editor.document, "x")
        spans = sorted((span.t0, span.t1) for span in truth.spans)
        assert all(before[1] <= after[0] for before, after in pairwise(spans))
    for _ in range(done):
        editor.undo()
    assert editor.document == untouched == EMPTY
