"""What a browser asks for is checked, asked of the service, and answered in words."""

from __future__ import annotations

import pytest

from caesura_clients import session_corrections
from caesura_clients.correction_words import ELSEWHERE
from caesura_clients.dashboard.correction_requests import (
    EditRefused,
    correct,
    corrector,
    parse,
    preview,
    said,
)
from caesura_protocol.errors import CaesuraError, ProtocolError, Unreachable
from caesura_protocol.keys import service_key
from caesura_protocol.messages import (
    Ack,
    AppOutline,
    Correction,
    EditEffect,
    Insert,
    Preview,
    Remove,
    SegmentOutline,
)
from caesura_protocol.session_time_display import SessionClock

ASKED = {"session": "s1", "revision": 3, "author": "Ann"}
DAY = SessionClock(1764172800.25)


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"do": "insert", "t": 3.2}, "Changepoint inserted at 3.20 s."),
        ({"do": "remove", "t": 3.2}, "Changepoint at 3.20 s removed."),
        ({"do": "move", "t": 3.2, "to": 4.0}, "Changepoint moved from 3.20 s to 4.00 s."),
        ({"do": "relabel", "t": 3.2, "kind": "hold"}, "The segment at 3.20 s is hold."),
        ({"do": "limit_force", "t": 3.2, "newton": 8}, "The force at 3.20 s is limited to 8 N."),
        ({"do": "limit_force", "t": 3.2, "newton": None}, "The limit is gone."),
        ({"do": "name_phase", "t": 3.2, "name": "wipe"}, "The phase at 3.20 s is called wipe."),
        ({"do": "undo"}, "Undone."),
        ({"do": "redo"}, "Done again."),
        ({"do": "take_back", "number": 3}, "Correction 3 is taken back."),
    ],
)
def test_every_tool_asks_for_what_it_says(request_, words):
    asked = []

    def ask(station, edit):
        asked.append((station, edit.revision, edit.author, edit.action.do))
        return Ack(session="s1", next_seq=0, state="open")

    assert correct(ask, "cell-1", {**ASKED, **request_}).words == words
    assert asked == [("cell-1", 3, "Ann", request_["do"])]


def test_of_a_session_with_times_of_day_words_have_its_clock_and_the_service_that_of_the_samples():
    asked = []

    def ask(station, edit):
        asked.append((edit.action.t, edit.action.to))
        return Ack(session="s1", next_seq=0, state="open")

    move = {**ASKED, "do": "move", "t": DAY.start_s + 3.2, "to": DAY.start_s + 4.0}
    assert correct(ask, "cell-1", move, DAY).words == "Changepoint moved from 3.20 s to 4.00 s."
    assert asked == [(DAY.start_s + 3.2, DAY.start_s + 4.0)]


@pytest.mark.parametrize(
    "request_",
    [
        {"do": "explode", "t": 1.0},
        {"do": "insert"},
        {"do": "insert", "t": float("nan")},
        {"do": "relabel", "t": 1.0, "kind": "dance"},
        {"do": "undo", "session": "../x"},
        {"do": "undo", "author": ""},
        {"do": "undo", "revision": -1},
        {},
    ],
)
def test_what_is_no_correction_never_reaches_the_service(request_):
    with pytest.raises(EditRefused, match=r"^Not done: .*[^.]\.$"):
        parse({**ASKED, **request_})


def test_who_comes_second_is_refused_with_the_reason():
    words = said(ProtocolError("conflict", "corrected meanwhile", value=3, limit=4))
    assert "revision 4" in words
    assert "you saw 3" in words


def test_a_refusal_of_who_comes_second_applies_to_the_revision_that_is_there():
    def ask(station, edit):
        raise ProtocolError("conflict", "corrected meanwhile", value=edit.revision, limit=5)

    with pytest.raises(EditRefused) as refused:
        correct(ask, "cell-1", {**ASKED, "do": "remove", "t": 9.2})
    assert refused.value.revision == 5


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (CaesuraError("no service answers"), "Not done: no service answers."),
        (Unreachable("no router; is it running?"), "Not done: no router; is it running?"),
        (ProtocolError("conflict", "undo 3 first", value=1, expected=3), "Not done: undo 3 first."),
        (
            ProtocolError("malformed", "the time is outside", value=9.2, limit=[0.0, 8.4]),
            "Not done: time 9.2 s is outside the session (0 to 8.4 s).",
        ),
    ],
)
def test_a_refusal_is_passed_on_in_words(error, words):
    def ask(station, edit):
        raise error

    with pytest.raises(EditRefused) as refused:
        correct(ask, "cell-1", {**ASKED, "do": "remove", "t": 9.2})
    assert (str(refused.value), refused.value.revision) == (words, 3)
    found = preview(ask, "cell-1", {"session": "s1", "revision": 3, "do": "remove", "t": 9.2})
    assert found == {"words": [words], "rows": [], "span": [0.0, 0.0], "failed": True}


def test_a_correction_that_has_a_session_inferred_again_states_that_other_results_change():
    effect = EditEffect(first_segment=0, first_app=0, inferred_again=True)
    ack = Ack(session="s1", next_seq=0, state="closed", revision=4, effect=effect)
    made = correct(lambda *_: ack, "cell-1", {**ASKED, "do": "remove", "t": 2.0})
    assert made == ("Changepoint at 2.00 s removed.", ELSEWHERE)


def test_a_preview_states_sentences_and_the_segments_of_its_span():
    effect = EditEffect(
        first_segment=1,
        segments_before=(outline(1.0, 2.0, "motion"), outline(2.0, 3.5, "contact")),
        segments_after=(outline(1.0, 3.5, "contact"),),
        first_app=0,
        apps_before=(AppOutline(kind="apply_force", t0=2.0, tn=3.5, force=(0.0, 0.0, -12.0)),),
        apps_after=(AppOutline(kind="apply_force", t0=1.0, tn=3.5, force=(0.0, 0.0, -4.0)),),
    )
    asked = []

    def ask(station, command):
        asked.append(command)
        return Ack(session="s1", next_seq=0, state="open", effect=effect)

    request = {"session": "s1", "revision": 3, "do": "remove", "t": 2.0}
    assert preview(ask, "cell-1", request) == {
        "lead": "Preview",
        "words": [
            "Motion 1.00 to 2.00 s and contact 2.00 to 3.50 s become contact 1.00 to 3.50 s.",
            "App 1 (apply force): 2.00 to 3.50 s becomes 1.00 to 3.50 s, force 12.0 N becomes 4.0 N.",
        ],
        "rows": [[1.0, 3.5, "contact"]],
        "span": [1.0, 3.5],
        "failed": False,
    }
    assert asked == [Preview(session="s1", revision=3, action=Remove(t=2.0))]
    past = preview(ask, "cell-1", {"session": "s1", "revision": 3, "do": "since", "number": 0})
    before = [[1.0, 2.0, "motion"], [2.0, 3.5, "contact"]]
    assert (past["lead"], past["rows"]) == ("Changed", before), "the band shows how it was"
    del asked[1]
    refused = preview(ask, "cell-1", {**request, "do": "explode"})
    assert refused["failed"]
    assert len(asked) == 1, "what is no correction never reaches the service"


AT_GRID = EditEffect(
    first_segment=1,
    segments_before=(SegmentOutline(t0=1.0, tn=3.5, kind="motion"),),
    segments_after=(
        SegmentOutline(t0=1.0, tn=1.35, kind="motion"),
        SegmentOutline(t0=1.35, tn=3.5, kind="motion"),
    ),
    first_app=0,
)
IN_VAIN = EditEffect(first_segment=1, first_app=0)  # where a changepoint is already
INSERTED = Correction(number=4, author="Bob", at=0.0, action=Insert(t=1.39))


@pytest.mark.parametrize(
    ("request_", "correction", "effect", "words"),
    [
        ({"do": "insert", "t": 1.39}, None, AT_GRID, "Changepoint inserted at 1.35 s."),
        ({"do": "insert", "t": 1.39}, None, IN_VAIN, "Changepoint inserted at 1.39 s. Nothing changes."),
        ({"do": "limit_force", "t": 1.39, "newton": None}, None, IN_VAIN, "The limit is gone."),
        ({"do": "redo"}, INSERTED, AT_GRID, "Done again: Bob inserted a changepoint at 1.35 s."),
        ({"do": "undo"}, INSERTED, "back", "Undone: Bob inserted a changepoint at 1.35 s."),
        (
            {"do": "take_back", "number": 4},
            INSERTED,
            "back",
            "Correction 4 is taken back: Bob inserted a changepoint at 1.35 s.",
        ),
        ({"do": "undo"}, INSERTED, None, "Undone: Bob inserted a changepoint at 1.39 s."),
    ],
)
def test_an_answer_states_what_was_undone_and_where_a_changepoint_lies(request_, correction, effect, words):
    if effect == "back":
        swapped = {"segments_before": AT_GRID.segments_after, "segments_after": AT_GRID.segments_before}
        effect = AT_GRID.model_copy(update=swapped)

    def ask(station, edit):
        assert edit.with_effect
        return Ack(session="s1", next_seq=0, state="open", correction=correction, effect=effect)

    assert correct(ask, "cell-1", {**ASKED, **request_}).words == words


def outline(t0, tn, kind):
    return SegmentOutline(t0=t0, tn=tn, kind=kind)


def test_without_an_answer_that_is_said(memory, monkeypatch):
    monkeypatch.setattr(session_corrections, "SILENCE_S", 0.3)
    with pytest.raises(EditRefused, match="Not done: no service is alive at memory"):
        correct(corrector(memory.transport()), "cell-1", {**ASKED, "do": "undo"})
    words = r"no answer to the edit of cell-1/s1, and a is alive: .*, or it is forbidden"
    with (
        memory.transport().declare_token(service_key("a", "alive")),
        pytest.raises(EditRefused, match=words),
    ):
        correct(corrector(memory.transport()), "cell-1", {**ASKED, "do": "undo"})
