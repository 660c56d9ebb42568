"""A wrong number for an option is refused with the number and both limits, by every command."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from caesura_protocol.option_error_texts import limits
from harness.commands import application, every_command

APP = application()
WIDE = {"COLUMNS": "2000", "TERM": "dumb"}
LONG_OPTION = "--"


def numbers() -> Iterator[Any]:
    """What is typed for a command, one of its options that takes a number, and that option's limits."""
    for typed, command in every_command(typer.main.get_command(APP)):
        for one in command.params:
            limited = getattr(one, "min", None) is not None or getattr(one, "max", None) is not None
            if limited and one.opts[0].startswith(LONG_OPTION):
                yield pytest.param(typed, one.opts[0], one.min, one.max, id=" ".join([*typed, one.opts[0]]))


def refusal(*typed: str) -> str:
    ended = CliRunner().invoke(APP, [*typed], env=WIDE)
    assert ended.exit_code == 2, ended.output
    return " ".join(ended.output.split())


@pytest.mark.parametrize(("typed", "option", "low", "high"), [*numbers()])
def test_a_number_that_is_wrong_is_named_with_its_limits(
    typed: tuple[str, ...], option: str, low: float | None, high: float | None
) -> None:
    """It read "Input should be less than or equal to 65535", without the value and the other limit."""
    beyond = [] if low is None else [f"{low - 1:g}", "nan"]
    beyond += [] if high is None else [f"{high + 1:g}"]
    for value in [*beyond, "many"]:
        said = refusal(*typed, option, value)
        assert f"Invalid value for '{option}" in said
        assert f"{value!r}, expected" in said
        assert said.partition(", expected ")[2].startswith(
            (f"a number{limits(low, high)}", f"an integer{limits(low, high)}")
        )


def test_every_option_with_limits_is_tried() -> None:
    found = {one.id for one in numbers()}
    assert {"annotate --port", "evaluate --seeds", "serve --journal-days", "sessions export --fps"} <= found


def test_the_journal_keeps_sessions_for_a_day_at_least() -> None:
    """0 was accepted, and deleted sessions as soon as nothing was recorded: also the one being taught."""
    said = refusal("serve", "--journal-days", "0")
    assert "Invalid value for '--journal-days': '0', expected a number of 1 or more" in said


def test_no_limit_of_a_cell_is_infinite() -> None:
    """It was refused by the message `open`, in three lines of its library."""
    said = refusal("segment", "x.npz", "--force-limit", "inf")
    assert "Invalid value for '--force-limit': 'inf', expected a finite number of 0.1 or more" in said


@pytest.mark.parametrize(
    ("command", "option", "most"),
    [
        ("segment", "--path-tolerance", "1000"),
        ("segment", "--angle-tolerance", "180"),
        ("evaluate", "--tolerance", "10"),
        ("evaluate", "--slack", "10"),
    ],
)
def test_no_tolerance_is_beyond_what_it_bounds(command: str, option: str, most: str) -> None:
    """Each was accepted: 1000 s of slack, typed for ms, made every changepoint right."""
    assert f"Invalid value for '{option}': 'inf', expected a " in refusal(command, "x.npz", option, "inf")
    assert f"'1001', expected a number from 0{'.1' * (command == 'segment')} to {most}" in refusal(
        command, "x.npz", option, "1001"
    )


@pytest.mark.parametrize(
    "command",
    [("serve", "--journal-days"), ("serve", "--instance-silence-s"), ("serve", "--journal-gb")],
    ids=" ".join,
)
def test_a_number_with_a_limit_is_finite(command: tuple[str, ...]) -> None:
    """It was accepted."""
    said = refusal(*command, "inf")
    assert f"Invalid value for '{command[1]}': 'inf', expected a finite number of " in said


def test_a_word_that_is_no_choice_is_named_with_the_choices() -> None:
    """It began with "Value error"."""
    assert "'--success': 'maybe' is not one of 'yes', 'no'" in refusal("stop", "cell", "--success", "maybe")
    assert "'--keep-pause': 'a', expected an integer" in refusal("program", "x", "--keep-pause", "a")


@pytest.mark.parametrize("command", [("bridge", "--station", "cell", "--source", "teacher"), ("demo",)])
def test_no_seed_is_below_zero(command: tuple[str, ...]) -> None:
    """It read "expected non-negative integer"."""
    assert "'--seed': '-1', expected a number of 0 or more" in refusal(*command, "--seed", "-1")
