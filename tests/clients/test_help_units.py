"""Help texts are shown whole: `[mm]` in brackets is a tag to the library that prints help."""

from __future__ import annotations

import pytest
import typer
from typer.testing import CliRunner

from caesura_clients.bridge.sources.registry import SOURCES
from caesura_clients.cli.preset_and_scenario_names import PRESET_NAMES, SCENARIO_NAMES
from caesura_clients.cli.sessions import sessions
from caesura_lab.teacher.scenarios import SCENARIOS
from caesura_protocol.lazy_commands import LazyCommand
from caesura_service.changepoint.presets import PRESETS
from harness.commands import application, every_command

APP = application()


COMMANDS = dict(every_command(typer.main.get_command(APP)))


@pytest.mark.parametrize("typed", COMMANDS, ids=" ".join)
def test_help_shows_every_text_with_its_units(typed: tuple[str, ...]) -> None:
    shown = CliRunner().invoke(APP, [*typed, "--help"], env={"COLUMNS": "2000", "TERM": "dumb"}).output
    words = "".join(shown.replace("│", "").split())
    command = COMMANDS[typed]
    texts = [command.help or "", *(getattr(one, "help", None) or "" for one in command.params)]
    for text in texts:
        assert "".join(text.replace("\\[", "[").split()) in words
    for paragraph in (command.help or "").split("\n\n"):
        assert " ".join(paragraph.replace("\\[", "[").split()) in shown, "only the terminal wraps it"


@pytest.mark.parametrize("typed", COMMANDS, ids=" ".join)
def test_no_name_is_cut_off_in_a_terminal_of_80_columns(typed: tuple[str, ...]) -> None:
    """The names of presets and wrench sources ended in `…`."""
    shown = CliRunner().invoke(APP, [*typed, "--help"], env={"COLUMNS": "80", "TERM": "dumb"}).output
    command = COMMANDS[typed]
    texts = [command.help or "", *(getattr(one, "help", None) or "" for one in command.params)]
    assert shown.count("…") == "".join(texts).count("…")


@pytest.mark.parametrize("group", [APP, sessions], ids=["caesura", "sessions"])
def test_a_line_of_the_list_is_how_the_help_of_the_command_begins(group: typer.Typer) -> None:
    listed = typer.main.get_command(group).commands  # type: ignore[attr-defined]
    for name, one in listed.items():
        if isinstance(one, LazyCommand):
            first = one.load().help.partition("\n\n")[0]
            assert one.help == " ".join(first.split()), name


def test_every_command_is_looked_at() -> None:
    assert {("bridge",), ("edit",), ("sessions", "show")} <= set(COMMANDS)
    assert any("[s]" in (one.help or "") for one in COMMANDS["edit",].params)


def test_the_names_in_the_help_of_bridge_are_those_that_there_are() -> None:
    assert sorted(PRESET_NAMES) == sorted(PRESETS)
    assert sorted(SCENARIO_NAMES) == sorted(SCENARIOS)
    texts = " ".join(getattr(one, "help", None) or "" for one in COMMANDS["bridge",].params)
    assert all(name in texts for name in (*PRESET_NAMES, *SCENARIO_NAMES, *SOURCES))
