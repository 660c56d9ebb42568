"""Edits as they are typed, without a service."""

from __future__ import annotations

import time
from io import StringIO

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from caesura_clients import session_corrections
from caesura_clients.cli import edit_program as edit_program_command
from caesura_clients.cli.commands import register
from caesura_clients.cli.edit import corrections_table, parse
from caesura_protocol.errors import CaesuraError, ProtocolError, Unreachable
from caesura_protocol.messages import (
    Correction,
    Edit,
    Insert,
    LimitForce,
    Move,
    NamePhase,
    Program,
    ReplacePart,
    TakeBack,
    Undo,
)
from caesura_protocol.session_time_display import NO_OFFSET
from clients.examples import snapshot
from harness.programs import app


def test_a_correction_that_is_not_applied_is_listed_with_its_reason():
    gone = Correction(
        number=4,
        author="Ann",
        at=0.0,
        action=LimitForce(t=3.0, newton=2.0),
        state="not_applied",
        reason="no app exerts a force at 3.00 s any more",
    )
    shown = StringIO()
    Console(file=shown, width=200).print(corrections_table([gone], NO_OFFSET))
    assert "not applied: no app exerts a force at 3.00 s any more" in shown.getvalue()


def test_corrections_are_listed_with_local_time_as_sessions_are(monkeypatch):
    """It was UTC, beside sessions and a dashboard in local time."""
    monkeypatch.setenv("TZ", "Etc/GMT-2")
    time.tzset()
    try:
        shown = StringIO()
        made = Correction(number=1, author="Ann", at=1764172800.0, action=Insert(t=3.0))
        Console(file=shown, width=200).print(corrections_table([made], NO_OFFSET))
        assert "2025-11-26 18:00 " in shown.getvalue()
    finally:
        monkeypatch.undo()
        time.tzset()


def test_actions_as_they_are_typed():
    assert parse(["move", "3.2", "3.4"]) == Move(t=3.2, to=3.4)
    assert parse(["limit-force", "3.2", "none"]) == LimitForce(t=3.2, newton=None)
    assert parse(["name-phase", "3.2", "wipe the table"]) == NamePhase(t=3.2, name="wipe the table")
    assert parse(["undo"]) == Undo()
    assert parse(["undo", "3"]) == TakeBack(number=3)


@pytest.mark.parametrize("words", [["turn"], ["move", "3.2"], ["undo", "1", "2"]])
def test_an_action_that_is_none_is_refused_with_those_that_are(words: list[str]):
    with pytest.raises(typer.BadParameter, match=r"expected one of: insert T"):
        parse(words)


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("insert noon", "T is 'noon', expected a valid number"),
        ("insert nan", "T is 'nan', expected a finite number"),
        ("limit_force 1 -4", "NEWTON is '-4', expected greater than or equal to 0"),
        ("relabel 1 jump", "KIND is 'jump', expected 'motion', "),
        ("move 1 later", "TO is 'later', expected a valid number"),
    ],
)
def test_a_value_that_is_none_is_named_with_what_is_expected(words: str, found: str):
    """It once read "Input should be a valid number, unable to parse string as a number"."""
    with pytest.raises(typer.BadParameter) as refused:
        parse(words.split())
    assert str(refused.value).startswith(found)
    assert "unable" not in str(refused.value)


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("change 1 force=nan", "force is nan, expected a finite number"),
        ("change 1 target=nan,0,0", "target [m] is nan, expected a finite number"),
        ("change 1 tolerance=-1", "tolerance [m] is -0.001, expected greater than 0"),
        ("change 1 speed=3", "speed is 3.0, expected less than or equal to 2"),
        ("insert 0 grasp width=-3", "width [m] is -0.003, expected greater than or equal to 0"),
        ("insert 0 hold seconds=-3", "seconds is -3.0, expected greater than 0"),
    ],
)
def test_a_value_of_an_app_is_named_as_it_is_typed(words: str, found: str):
    """A target with a NaN once read "0 is nan", and a tolerance "TOLERANCE_M is -0.001"."""
    typed = edit_program_command.typed(words.split())
    with pytest.raises(typer.BadParameter) as refused:
        edit_program_command.parse(
            typed, snapshot(0).program.model_copy(update={"apps": (app("hold", 0, 1),)})
        )
    assert str(refused.value).startswith(found)


# --- patience -------------------------------------------------------------------------------------------


def test_while_a_session_is_rebuilt_the_service_is_asked_again(monkeypatch):
    refusals = iter([ProtocolError("overloaded", "try again"), Unreachable("no service"), None])
    asked = []

    def ask(*given):
        asked.append(given)
        if (refusal := next(refusals)) is not None:
            raise refusal
        return "done"

    monkeypatch.setattr(session_corrections, "_ask", ask)
    monkeypatch.setattr(session_corrections, "RETRY_S", 0.0)
    made = Edit(session="s1", revision=0, author="Ann", action=Insert(t=1.0))
    assert session_corrections.send(None, "cell-1", made) == "done"
    assert len(asked) == 3


@pytest.mark.parametrize("refusal", [ProtocolError("overloaded", "no room"), Unreachable("no service")])
def test_patience_ends(monkeypatch, refusal: Exception):
    def ask(*_):
        raise refusal

    monkeypatch.setattr(session_corrections, "_ask", ask)
    made = Edit(session="s1", revision=0, author="Ann", action=Insert(t=1.0))
    with pytest.raises(type(refusal)):
        session_corrections.send(None, "cell-1", made, patience_s=0.0)


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("target=1,2", r"^target is '1,2', expected target=X,Y,Z \[mm\]$"),
        ("target=up", r"^target is 'up', expected target=X,Y,Z \[mm\]$"),
        ("force=8", r"^force is '8', expected force=X,Y,Z \[N\]$"),
        ("width=wide", r"^width is 'wide', expected width=NUMBER \[mm\]$"),
        (
            "colour=red",
            r"^'colour=red' is no value, expected one of: .*, force=X,Y,Z \[N\], width=NUMBER \[mm\]",
        ),
    ],
)
def test_a_value_that_cannot_be_read_is_named_with_what_is_expected(typed: str, message: str):
    with pytest.raises(typer.BadParameter, match=message):
        edit_program_command.typed(["insert", "0", "grasp", typed])


def test_a_tolerance_in_another_unit_is_refused():
    """5000 was accepted: every path kept a tolerance of 5 m."""
    with pytest.raises(
        typer.BadParameter, match=r"^tolerance is '5000', expected tolerance=NUMBER \[mm, up to"
    ):
        edit_program_command.typed(["change", "1", "tolerance=5000"])
    assert edit_program_command.typed(["change", "1", "tolerance=1000"]).values == {"tolerance_m": 1.0}


def test_an_inserted_press_without_a_force_is_refused_with_its_form():
    """The service refused it with "'apply force' needs a force": how it is typed was only in the docs."""
    with pytest.raises(typer.BadParameter, match=r"^apply_force needs a force, .*: force=X,Y,Z \[N\]$"):
        edit_program_command.typed(["insert", "1", "apply_force", "name=Press"])
    with pytest.raises(typer.BadParameter, match=r"'7' is no value, expected one of: .* force=NUMBER \[N\]"):
        edit_program_command.typed(["change", "1", "7"])


# --- a part that was taught again -------------------------------------------------------------------------


def with_times(*times: tuple[float, float]) -> Program:
    apps = tuple(app("cartesian_motion", t0, tn) for t0, tn in times)
    return snapshot(1).program.model_copy(update={"apps": apps})


def test_a_part_is_named_by_the_numbers_of_its_apps_or_by_times():
    program = with_times((0.0, 2.0), (2.0, 3.0), (3.0, 6.0), (6.0, 7.0))

    def parsed(words: list[str], t0: float | None = None, tn: float | None = None) -> object:
        typed = edit_program_command.typed(words, edit_program_command.Part(t0, tn, "s2"))
        return edit_program_command.parse(typed, program)

    by_number = parsed(["replace", "2", "3"])
    assert isinstance(by_number, ReplacePart)
    assert (by_number.first.t0, by_number.last.t0, by_number.session) == (2.0, 3.0, "s2")
    by_time = parsed(["replace"], 1.5, 4.5)
    assert by_time == by_number, "half of an app has to lie between the times"


@pytest.mark.parametrize(
    ("words", "part", "message"),
    [
        (["replace", "1", "1"], (), "expected: replace FIRST LAST --with SESSION"),
        (["replace", "1"], (None, None, "s2"), "the part is not clear"),
        (["replace"], (1.0, None, "s2"), "the part is not clear"),
        (["replace", "1", "2"], (1.0, 2.0, "s2"), "the part is not clear"),
        (["replace", "1", "9"], (None, None, "s2"), "there is no app '9'"),
        (["replace"], (40.0, 50.0, "s2"), "no app has at least half of its time between 40 and 50 s"),
        (["replace"], (0.0, 3.0, "s2"), "do not follow each other"),
        (["replace", "1", "1"], (None, None, "S 2"), "SESSION is 'S 2'"),
        (["delete", "1"], (None, None, "s2"), "--from, --to and --with belong to replace, not to delete"),
    ],
)
def test_a_part_that_is_not_clear_is_refused(words: list[str], part: tuple, message: str):
    program = with_times((0.0, 1.0), (5.0, 6.0), (2.0, 3.0))
    with pytest.raises((CaesuraError, typer.BadParameter), match=message):
        edit_program_command.parse(
            edit_program_command.typed(words, edit_program_command.Part(*part)), program
        )


def test_what_is_typed_wrong_is_refused_before_anything_is_asked():
    """It connected first: without a service, a wrong word was answered with that."""
    commands = typer.Typer()
    register(commands)
    for command in ("edit-program", "edit"):
        words = [command, "cell-1", "s1", "turn", "3", "--connect", "tcp/127.0.0.1:1"]
        refused = CliRunner().invoke(commands, words, env={"COLUMNS": "200"})
        assert refused.exit_code == 2
        assert "'turn 3' is no" in refused.output
