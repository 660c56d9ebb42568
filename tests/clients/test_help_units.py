"""Units in help texts: `[mm]` in brackets is a tag to the library that prints help, and would vanish."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from caesura_clients.cli import build

UNITS = {
    "segment": "Of the apps' paths [mm]",
    "edit": "Times [s]",
    "evaluate": "so much [s] added",
}


@pytest.mark.parametrize("command", UNITS)
def test_help_keeps_its_units(command: str) -> None:
    shown = CliRunner().invoke(build(), [command, "--help"], env={"COLUMNS": "300", "TERM": "dumb"}).output
    words = " ".join(shown.replace("│", " ").split())
    assert UNITS[command] in words
