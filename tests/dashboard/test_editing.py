"""What a browser asks for is checked, asked of the service, and answered in words."""

from __future__ import annotations

import pytest

from caesura_clients import editing
from caesura_clients.dashboard.editing import EditRefused, correct, corrector, parse, said
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.messages import Ack

ASKED = {"session": "s1", "revision": 3, "author": "Ann"}


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

    assert correct(ask, "cell-1", {**ASKED, **request_}) == words
    assert asked == [("cell-1", 3, "Ann", request_["do"])]


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
    with pytest.raises(EditRefused, match="Not done"):
        parse({**ASKED, **request_})


def test_who_comes_second_is_refused_with_the_reason():
    words = said(ProtocolError("conflict", "corrected meanwhile", value=3, limit=4))
    assert "revision 4" in words
    assert "you saw 3" in words


@pytest.mark.parametrize(
    "error", [CaesuraError("nobody answers"), ProtocolError("malformed", "no changepoint there", value=3.2)]
)
def test_a_refusal_is_passed_on(error):
    def ask(station, edit):
        raise error

    with pytest.raises(EditRefused, match=str(error)[:14]):
        correct(ask, "cell-1", {**ASKED, "do": "undo"})


def test_without_an_answer_that_is_said(memory, monkeypatch):
    monkeypatch.setattr(editing, "SILENCE_S", 0.3)
    with pytest.raises(EditRefused, match="no service answered the edit of cell-1/s1"):
        correct(corrector(memory.transport()), "cell-1", {**ASKED, "do": "undo"})
