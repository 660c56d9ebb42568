"""The commands of a client install, by name."""

from __future__ import annotations

import typer

from caesura_clients.cli.sessions import sessions
from caesura_protocol.lazy_commands import add_command

COMMANDS = {
    "bridge": "caesura_clients.cli.bridge:bridge",
    "start": "caesura_clients.cli.start_stop_describe:start",
    "stop": "caesura_clients.cli.start_stop_describe:stop",
    "watch": "caesura_clients.cli.watch:watch",
    "hints": "caesura_clients.cli.hints:hints",
    "program": "caesura_clients.cli.programs:program",
    "edit": "caesura_clients.cli.edit:edit",
    "doctor": "caesura_clients.cli.doctor:doctor",
    "edit-program": "caesura_clients.cli.edit_program:edit_program",
    "record": "caesura_clients.cli.record:record_session",
    "robots": "caesura_clients.cli.robots:list_robots",
}
NUMBERS = {"edit"}  # commands whose arguments may be negative: times of a clock that begins below zero


def register(app: typer.Typer) -> None:
    """Add the commands of a client install."""
    for name, place in COMMANDS.items():
        add_command(app, name, place, takes_numbers=name in NUMBERS)
    app.add_typer(sessions)
