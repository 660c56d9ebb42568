"""Refusals of corrections and edits say what to do, in the same words on the command line and on the page."""

from __future__ import annotations

from typing import Any

import pytest

from caesura_clients.cli.edit_action_validation import refused_in_words
from caesura_clients.cli.stdin_markers import _mark
from caesura_clients.dashboard.correction_requests import said
from caesura_clients.refusal_words import Refused, refusal_words
from caesura_clients.session_corrections import is_stale
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.messages import (
    Insert,
    InsertApp,
    LimitForce,
    Move,
    Relabel,
    Remove,
    ReplacePart,
    Since,
    TakeBack,
    Undo,
)
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock

DAY = SessionClock(1764172800.25)
REFERENCE: dict[str, Any] = {"kind": "grasp", "t0": 1.0, "tn": 2.0}


def conflict(message: str, **found: object) -> ProtocolError:
    return ProtocolError("conflict", message, **found)


def malformed(message: str, **found: object) -> ProtocolError:
    return ProtocolError("malformed", message, **found)


OUTSIDE = "the time is outside the demonstration"
REFUSALS: list[tuple[ProtocolError, Refused, str]] = [
    (
        malformed(OUTSIDE, value=9.2, limit=[0.0, 8.4]),
        Insert(t=9.2),
        "time 9.2 s is outside the session (0 to 8.4 s)",
    ),
    (
        malformed(OUTSIDE, value=-3, limit=(0.05, 8.4)),
        Move(t=4.0, to=-3.0),
        "time -3 s is outside the session (0.05 to 8.4 s)",
    ),
    (
        conflict("there is no changepoint near this time", value=3.0, limit=0.5, expected=[2.0, 4.15]),
        Remove(t=3.0),
        "there is no changepoint near 3 s; the nearest are at 2 s, 4.15 s",
    ),
    (
        conflict("there is no changepoint near this time", value=3.0, limit=0.5, expected="none is there"),
        Move(t=3.0, to=3.5),
        "there is no changepoint near 3 s; this session has none",
    ),
    (  # As it comes from the wire; it once read "value 0.5; limit 0.5; expected ['[2.65, 4.35]']".
        conflict("no app exerts a force there", value=0.5, limit=0.5, expected=[[2.65, 4.35], [7.65, 9.45]]),
        LimitForce(t=0.5, newton=3.0),
        "no app exerts a force at 0.5 s; the nearest that do: 2.65 to 4.35 s, 7.65 to 9.45 s",
    ),
    (
        conflict("no app exerts a force there", value=0.5, limit=0.5, expected="none is there"),
        LimitForce(t=0.5, newton=3.0),
        "no app exerts a force at 0.5 s; no app of this session does",
    ),
    (
        malformed("no app exerts more than the cell's force limit", value=30.0, limit=25.0),
        LimitForce(t=2.0, newton=30.0),
        "no app exerts more than the cell's force limit: 30 N, at most 25 N",
    ),
    (
        malformed("that is less than the least of a press", value=0.0001, limit=0.001),
        LimitForce(t=2.0, newton=0.0001),
        "that is less than the least of a press: 0.0001 N, at least 0.001 N",
    ),
    (
        malformed("this session has no such kind of segment", value="hold", expected=["motion", "steady"]),
        Relabel(t=2.0, kind="hold"),
        "this session has no such kind of segment: 'hold'; there is motion, steady",
    ),
    (
        conflict("samples are missing there: behind a gap a segment always begins", value=4.0, limit=4.1),
        Remove(t=4.0),
        "at 4 s samples are missing there: behind a gap a segment always begins",
    ),
    (conflict("nothing has been observed yet", value=4.0), Insert(t=4.0), "nothing has been observed yet"),
    (conflict("there is nothing to undo", value=3), Undo(), "there is nothing to undo"),
    (
        conflict("the session has no such correction", value=7, expected=["1 to 3"]),
        TakeBack(number=7),
        "the session has no such correction: 7; there is 1 to 3",
    ),
    (
        conflict("correction 3 by Bob moved it on: take correction 3 back first", value=1, expected=3),
        TakeBack(number=1),
        "correction 3 by Bob moved it on: take correction 3 back first",
    ),
    (
        conflict("another operator has corrected the session meanwhile: look at it again", value=0, limit=2),
        Undo(),
        "another operator changed this meanwhile (it is at revision 2, you saw 0): "
        "look at the current state, and do it again",
    ),
    (
        conflict("another operator has edited the program meanwhile: look at it again", value=0, limit=2),
        Undo(),
        "another operator changed this meanwhile (it is at revision 2, you saw 0): "
        "look at the current state, and do it again",
    ),
    (  # It was taken for the edit of another operator.
        conflict("a program has 500 edits at most: undo some", limit=500),
        InsertApp(after=None, kind="grasp"),
        "a program has 500 edits at most: undo some",
    ),
    (
        conflict("session s2 has another robot than the program", value="ur5e", expected="fr3"),
        ReplacePart(first=REFERENCE, last=REFERENCE, session="s2"),
        "session s2 has another robot than the program: 'ur5e'; expected fr3",
    ),
    (
        conflict("session s2 is still open: stop it first", value="s2"),
        ReplacePart(first=REFERENCE, last=REFERENCE, session="s2"),
        "session s2 is still open: stop it first",
    ),
]


@pytest.mark.parametrize(("error", "action", "words"), REFUSALS, ids=lambda one: str(one)[:40])
def test_a_refusal_says_what_to_do_and_has_no_field_of_the_wire(error, action, words):
    assert refusal_words(error, action) == words
    assert said(error, action) == f"Not done: {words}."
    with pytest.raises(CaesuraError) as shown, refused_in_words(action):
        raise error
    assert str(shown.value) == words


@pytest.mark.parametrize(
    ("error", "action", "words"),
    [
        (
            malformed(OUTSIDE, value=DAY.start_s + 9.2, limit=[DAY.start_s, DAY.start_s + 8.4]),
            Insert(t=DAY.start_s + 9.2),
            "time 9.2 s is outside the session (0 to 8.4 s)",
        ),
        (
            conflict("no changepoint", value=DAY.start_s + 3, limit=0.5, expected=[DAY.start_s + 4.15]),
            Remove(t=DAY.start_s + 3),
            "there is no changepoint near 3 s; the nearest are at 4.15 s",
        ),
        (
            conflict("no force", value=DAY.start_s, limit=0.5, expected=[[DAY.start_s + 2, DAY.start_s + 3]]),
            LimitForce(t=DAY.start_s, newton=1.0),
            "no app exerts a force at 0 s; the nearest that do: 2 to 3 s",
        ),
        (
            conflict(f"a changepoint is at {DAY.start_s + 2.0:.2f} s"),
            Undo(),
            "a changepoint is at 2.00 s",
        ),
    ],
)
def test_times_of_day_are_those_of_the_clock_that_people_read(error, action, words):
    assert refusal_words(error, action, DAY) == words


def test_an_action_that_an_older_service_lacks_is_named_with_what_to_do():
    """The answer was pydantic's, with the list of all actions."""
    lacking = (
        "Control.command.preview.action: Input tag 'since' found using 'do' does not match any of the tags"
    )
    error = malformed(lacking, value="{'do': 'since', 'number': 0}")
    words = "the service has no action 'since': it is an older version. Update it"
    assert refusal_words(error, Since(number=0)) == words
    assert said(error, Since(number=0)) == f"Not done: {words}."
    assert refusal_words(error, Undo()).startswith("Control.command.preview.action: "), "another one's"


def test_a_pedal_whose_mark_is_refused_says_so_in_the_same_words():
    class Refusing:
        def mark(self) -> None:
            raise malformed(OUTSIDE, value=9.2, limit=[0.0, 8.4])

    said = "no mark: time 9.2 s is outside the session (0 to 8.4 s)"
    assert _mark(Refusing()) == said  # type: ignore[arg-type]


def test_only_the_edit_of_another_operator_is_stale():
    assert is_stale(REFUSALS[-5][0])
    assert not is_stale(REFUSALS[-3][0])


def test_what_is_an_error_of_another_kind_passes():
    with pytest.raises(CaesuraError, match=r"^no service$"), refused_in_words(Undo(), NO_OFFSET):
        raise CaesuraError("no service")
