"""What was not observed makes a program less sure, and is named in it."""

from __future__ import annotations

from typing import Any

import pytest

from caesura_protocol.messages import Gap
from caesura_service.program import Gaps, GripperAction, observed_share
from service.program.segments import program, segment, stopping_at


def gap(t0: float, tn: float, **fields: Any) -> Gap:
    return Gap.model_validate({"t0": t0, "tn": tn, "reason": "source"} | fields)


def gap_note(gaps: list[Gap], began: float) -> str:
    kept = Gaps()
    for one in gaps:
        kept.add(one)
    assert kept.all == tuple(gaps)
    return kept.note(began)


@pytest.mark.parametrize(
    ("gaps", "share"),
    [
        ([], 1.0),
        ([gap(3.0, 4.0)], 2 / 3),  # at its end: it may have gone on
        ([gap(3.1, 4.1)], 2 / 3),  # between the last observation and the gap lies a little
        ([gap(3.3, 4.3)], 1.0),  # it ended before
        ([gap(0.5, 0.95)], 2 / 2.45),
        ([gap(0.0, 0.7)], 1.0),
        ([gap(1.5, 2.0)], 0.75),  # within it
        ([gap(0.0, 1.0), gap(1.5, 2.0), gap(3.0, 4.0), gap(9.0, 99.0)], 1.5 / 4.0),
        ([gap(1.0, 1.0), gap(3.0, 3.0)], 1.0),  # a lost beginning and a lost end
    ],
)
def test_the_share_counts_every_gap_in_an_app_and_at_its_edge(gaps: list[Gap], share: float):
    assert observed_share(1.0, 3.0, gaps) == pytest.approx(share)


def test_an_instant_was_observed_unless_it_lies_in_a_gap():
    assert observed_share(1.0, 1.0, [gap(1.1, 2.0)]) == 1.0
    assert observed_share(1.5, 1.5, [gap(1.1, 2.0)]) == 0.0


def test_a_contact_that_goes_on_behind_a_gap_is_less_sure_by_what_is_missing_of_it():
    press = {"force_end": (0.0, 0.0, 9.0)}
    parts = (segment("contact", 1.0, 2.0, **press), segment("contact", 3.0, 4.0, **press))
    (app,) = program(*parts, gaps=(gap(2.0, 3.0, reason="evicted"),))
    assert (app.t0, app.tn, app.segments) == (1.0, 4.0, (0, 1))
    assert app.confidence == pytest.approx(0.9 * 2 / 3)


def test_apps_away_from_a_gap_are_as_sure_as_ever():
    away, at = program(
        segment("motion", 0.0, 1.0),
        segment("motion", 1.0, 2.0),
        gaps=(gap(2.05, 3.05),),
        at=stopping_at,
    )
    assert (away.confidence, at.confidence) == (0.9, pytest.approx(0.45))


def test_a_grip_within_a_gap_was_not_seen():
    (grip,) = program(grips=(GripperAction(1.5, "grasp", 0.05),), gaps=(gap(1.0, 2.0),))
    assert grip.confidence == 0.0


def test_the_note_names_every_gap_with_its_reason():
    gaps = [gap(0.5, 0.5, reason="evicted"), gap(3.2, 4.1), gap(7.0, 7.0, reason="evicted")]
    assert gap_note(gaps, 0.5) == (
        "Not observed: before 0.50 s (samples were lost), 3.20–4.10 s (the source paused), "
        "after 7.00 s (samples were lost). What was taught then is missing, and apps beside it are less sure."
    )


def test_a_gap_of_unknown_length_makes_no_app_less_sure_and_is_not_said_to():
    """The clock of a robot was set, all later samples were refused, and the apps were as sure as before."""
    assert gap_note([gap(4.0, 4.0, reason="evicted")], 0.0) == (
        "Not observed: after 4.00 s (samples were lost). What was taught then is missing; "
        "how much is not known."
    )


def test_of_many_gaps_the_longest_are_named_in_their_order_and_the_others_counted():
    gaps = [gap(float(t), t + 0.1 * (1 + t % 7)) for t in range(20)]
    note = gap_note(gaps, 0.0)
    named = [words.split("–")[0] for words in note.removeprefix("Not observed: ").split(", ")]
    assert named[:5] == ["5.00", "6.00", "12.00", "13.00", "19.00"]
    assert "and 15 shorter ones, 7.70 s in all." in note


def test_a_time_that_no_robot_states_does_not_make_the_note_long():
    note = gap_note([gap(-1e302, -1e301), *(gap(1e301, 1e302) for _ in range(6))], 0.0)
    assert "-1e+302–-1e+301 s" in note
    assert "and 2 shorter ones, 6.3e+302 s in all" in note
    assert len(note) < 500
